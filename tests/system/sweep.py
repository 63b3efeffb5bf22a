"""Tries that nobody should make, one after the other: `python sweep.py FOLDER FIRST LAST`.

Every number of every recipe takes values that it should not have, and every reader gets files that are not
what their names say. A try is right if it ends in a result or in the package's own error, within 60 s of
processor time and 2 GiB of address space above what the engine has when it is warm. Prints a JSON line a try.
"""

from __future__ import annotations

import copy
import json
import math
import os
import re
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from edofsim.errors import EdofsimError
from edofsim.recipe.base import RecipeModel
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.load import load_camera, load_scene, load_train
from edofsim.recipe.scene import SceneRecipe
from edofsim.recipe.toml import validate
from edofsim.recipe.train import TrainRecipe

SECONDS = 60
MEMORY = 2 << 30
VALUES: tuple[Any, ...] = (math.nan, math.inf, -math.inf, -1, 0, 1e30, -1e30, 1e-30, 2**70, True, "24")


@dataclass(frozen=True)
class Try:
    """What is tried, in words, and the work."""

    name: str
    work: Callable[[], object]


# ---- numbers of recipes --------------------------------------------------------------------------------

OBJECTS: dict[str, dict[str, Any]] = json.loads(
    Path(__file__).parents[1].joinpath("small", "objects.json").read_text()
)
LIGHTS = [
    {"kind": "environment"},
    {"kind": "sky"},
    {"kind": "area", "position_mm": [0, 500, 500], "target_mm": [0, 0, 1000], "size_mm": [100, 100]},
    {"kind": "environment_map", "path": "good.exr"},
    {"kind": "bulb", "position_mm": [0, 300, 500]},
    {"kind": "neon", "points_mm": [[-50, 0, 900], [50, 10, 900]]},
]
TEXTURES = [
    {"kind": "photo", "name": "coffee", "crop": [0, 0, 1, 1]},
    {"kind": "wood"},
    {"kind": "checker"},
    {"kind": "noise"},
]
SURFACES: list[dict[str, Any]] = [
    *({"kind": "matt", "texture": texture} for texture in TEXTURES),
    *({"kind": kind} for kind in ("matt", "plastic", "metal", "principled", "glass")),
]
SOURCES = [
    {
        "kind": "rgbd",
        "image": "good.png",
        "depth": {"path": "good.npy", "holds": "disparity", "focal_length_px": 900, "baseline_mm": 50},
    },
    {"kind": "cube", "path": "good.mat", "start_nm": 400, "step_nm": 50, "depth_m": 1.0, "scale": 1.0},
    {"kind": "mitsuba", "path": "good.xml"},
]
SMALL = {
    "bands": {"count": 1, "start_nm": 550, "stop_nm": 550},
    "frame": {"width_px": 6, "height_px": 4, "margin_px": 1, "pixel_angle_mrad": 4.0},
    "render": {"samples": 1, "max_depth": 2, "hidden": False, "fragments": 1},
}
PLACED = {"depth_m", "x_mm", "y_mm", "x_frame", "y_frame", "turn_deg", "tilt_deg", "roll_deg"}
WALL = {"kind": "wall", "depth_m": 2.0}
CARD = {"kind": "panel", "depth_m": 1.0, "width_mm": 10, "height_mm": 10}


def scene(**parts: Any) -> dict[str, Any]:
    return {"name": "swept", **copy.deepcopy(SMALL), **parts}


def numbers_of(model: RecipeModel, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Where a validated recipe has numbers, or could have."""
    for name, field in type(model).model_fields.items():
        value, here = getattr(model, name), (*at, field.alias or name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if isinstance(value, RecipeModel):
            yield from numbers_of(value, here)
        elif is_number or (value is None and re.search(r"\b(int|float)\b", str(field.annotation))):
            yield here
        elif isinstance(value, tuple):
            yield from _in_list(value, here)


def _in_list(values: tuple[Any, ...], at: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:
    for number, value in enumerate(values[:2]):
        if isinstance(value, RecipeModel):
            yield from numbers_of(value, (*at, number))
        elif isinstance(value, tuple):
            yield from _in_list(value, (*at, number))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*at, number)


def changed(data: dict[str, Any], place: tuple[str | int, ...], value: object) -> dict[str, Any]:
    data = copy.deepcopy(data)
    inside: Any = data
    for step in place[:-1]:
        inside = inside[step]
    inside[place[-1]] = value
    return data


def swept(
    label: str,
    model: type[RecipeModel],
    data: dict[str, Any],
    use: Callable[[Any], object],
    under: tuple[str | int, ...] = (),
    leave: set[str] = frozenset(),  # type: ignore[assignment]
) -> Iterator[Try]:
    """A try for each number below `under` and each value."""
    good = model.model_validate(data)
    whole = good.model_dump(mode="json", by_alias=True)
    for place in numbers_of(good):
        if place[: len(under)] != under or place[-1] in leave:
            continue
        for value in VALUES:

            def work(place: tuple[str | int, ...] = place, value: object = value) -> object:
                return use(validate(model, changed(whole, place, value), "", Path("swept.toml")))

            yield Try(f"{label}: {'.'.join(map(str, place))} = {value!r}", work)


def numbers(folder: Path) -> Iterator[Try]:
    """All tries with numbers."""

    def rendered(recipe: SceneRecipe) -> object:
        from edofsim.render.readers.pictures import picture_view
        from edofsim.render.rendering import render_foreign, render_model
        from edofsim.render.settings import RenderSettings
        from edofsim.render.view import View
        from edofsim.scene import build_scene
        from edofsim.scene.foreign import NotCarried

        if recipe.source is not None and recipe.source.kind != "mitsuba":
            return picture_view(recipe, folder)
        settings = RenderSettings.from_recipe(recipe)
        try:
            return View.of(render_model(build_scene(recipe, folder), settings))
        except NotCarried as reasons:
            return View.of(render_foreign(recipe, folder, settings, reasons.problems))

    light = [{"kind": "environment"}]
    yield from swept("scene", SceneRecipe, scene(objects=[CARD], lights=light), rendered)
    for kind, item in OBJECTS.items():
        data = scene(objects=[{"kind": kind, **item}, WALL], lights=light)
        leave = set() if kind in ("sphere", "book") else PLACED
        yield from swept(kind, SceneRecipe, data, rendered, ("objects", 0), leave)
    for lamp in LIGHTS:
        data = scene(objects=[CARD, WALL], lights=[lamp])
        yield from swept(str(lamp["kind"]), SceneRecipe, data, rendered, ("lights",))
    for surface in SURFACES:
        data = scene(objects=[{**CARD, "surface": surface}, WALL], lights=light)
        label = f"{surface['kind']} {surface.get('texture', {}).get('kind', '')}"
        yield from swept(label, SceneRecipe, data, rendered, ("objects", 0, "surface"))
    for source in SOURCES:
        lights = light if source["kind"] == "mitsuba" else []
        data = scene(source=source, lights=lights)
        yield from swept(str(source["kind"]), SceneRecipe, data, rendered, ("source",))

    def seen(recipe: CameraRecipe) -> object:
        from edofsim.optics import Camera, psf_bank
        from edofsim.optics.mtf import mtf

        camera = Camera.from_recipe(recipe, folder)
        mtf(camera, 543e-9, [0.7], [0.0, 2e4])
        return psf_bank(camera, [543e-9], [0.7])

    plain = {"name": "swept", "psf": {"window_px": 32, "oversampling": 1}, "fabrication": {"pitch_um": 50.0}}
    yield from swept("camera", CameraRecipe, {**plain, "mask": {"kind": "cubic"}}, seen)
    from edofsim.optics.masks import catalogue

    for entry in catalogue():
        mask = entry.example.model_dump(mode="json")
        data = {**plain, "mask": mask, "fabrication": None}
        yield from swept(f"mask {entry.kind}", CameraRecipe, data, seen, ("mask",))
    for path in sorted((Path(__file__).parents[2] / "train").glob("*.toml"))[:2]:
        data = load_train(path).recipe.model_dump(mode="json", by_alias=True)
        yield from swept(path.stem, TrainRecipe, data, lambda recipe: recipe)


# ---- files ---------------------------------------------------------------------------------------------


def good_files(folder: Path) -> None:
    """One right file of each kind, `good.SUFFIX`."""
    import OpenEXR
    import trimesh
    from PIL import Image
    from scipy.io import savemat

    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (16, 32, 3), dtype=np.uint8)
    for suffix in ("png", "jpg", "tif"):
        Image.fromarray(picture).save(folder / f"good.{suffix}")
    Image.fromarray(picture[..., 0]).save(folder / "cube-0.png")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    plane = rng.random((16, 32), np.float32)
    OpenEXR.File(header, dict.fromkeys("RGBZ", plane)).write(str(folder / "good.exr"))
    bands = {f"S0.{nm},000000nm": plane for nm in (500, 550, 600)}
    OpenEXR.File(header, bands).write(str(folder / "bands.exr"))
    rgbe = np.concatenate([picture, np.full((16, 32, 1), 129, np.uint8)], axis=2)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n"
    (folder / "good.hdr").write_bytes(head + rgbe.tobytes())
    (folder / "good.pfm").write_bytes(b"Pf\n32 16\n-1.0\n" + plane.tobytes())
    sintel = np.float32(202021.25).tobytes() + np.array([32, 16], "<i4").tobytes()
    (folder / "good.dpt").write_bytes(sintel + plane.tobytes())
    np.save(folder / "good.npy", plane + 1)
    np.savez(folder / "good.npz", depth=plane + 1)
    np.save(folder / "mask.npy", np.zeros((239, 239)))
    savemat(folder / "good.mat", {"cube": np.stack([plane] * 5, axis=2)})
    savemat(folder / "depth.mat", {"depth": plane + 1})
    new_files(folder, plane)
    ball = trimesh.creation.icosphere(subdivisions=1)
    for suffix in ("obj", "ply", "stl", "glb", "off"):
        ball.export(folder / f"good.{suffix}")
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene([ball]))
    for name, content in gltf.items():
        (folder / ("good.gltf" if name == "model.gltf" else name)).write_bytes(content)
    (folder / "good.xml").write_text(
        '<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/><shape type="sphere">'
        '<point name="center" x="0" y="0" z="4"/><bsdf type="diffuse"/></shape></scene>'
    )
    (folder / "good.json").write_text(
        '{"type": "scene", "sensor": {"type": "perspective"}, "light": {"type": "constant"}, '
        '"ball": {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "diffuse"}}}'
    )
    (folder / "good.csv").write_text("wavelength_nm,r,g,b\n400,0,0.1,0.5\n550,0.2,0.8,0.2\n700,0.5,0.1,0\n")
    (folder / "scene.toml").write_text(
        'name = "a"\n[[objects]]\nkind = "sphere"\ndepth_m = 1.0\nradius_mm = 5.0\n[[lights]]\nkind = "sky"\n'
    )
    (folder / "camera.toml").write_text('name = "a"\n[mask]\nkind = "cubic"\nalpha_rad = 20.0\n')
    root = Path(__file__).parents[2] / "train"
    (folder / "train.toml").write_bytes(sorted(root.glob("*.toml"))[0].read_bytes())
    shipped = sorted((root / "checkpoints").glob("*.safetensors"), key=lambda path: path.stat().st_size)
    (folder / "good.safetensors").write_bytes(shipped[0].read_bytes())


def new_files(folder: Path, plane: np.ndarray) -> None:
    """Measurements, cubes and heights in formats of other programs, and meshes with colours."""
    import h5py
    import tifffile
    import trimesh
    from PIL import Image
    from scipy.io import savemat
    from spectral.io import envi

    stack = np.stack([plane] * 5)
    np.save(folder / "cube.npy", stack)
    tifffile.imwrite(folder / "cube.tif", stack, photometric="minisblack")
    for name, array in (("cube", stack), ("depth", plane + 1)):
        with h5py.File(folder / f"{name}.h5", "w") as file:
            file[name] = array
    envi.save_image(str(folder / "cube.hdr"), np.moveaxis(stack, 0, 2), ext=".raw", force=True)
    (folder / "hostile.raw").write_bytes((folder / "cube.raw").read_bytes())  # beside a hostile header
    np.savetxt(folder / "depth.csv", plane + 1, delimiter=",")
    tifffile.imwrite(folder / "depth.tif", plane + 1)
    Image.fromarray((plane * 60000).astype(np.uint16)).save(folder / "depth.png")
    height = np.zeros((239, 239))
    np.savez(folder / "mask.npz", height=height)
    savemat(folder / "mask.mat", {"height": height})
    np.savetxt(folder / "mask.csv", height, delimiter=",", fmt="%g")
    Image.fromarray(height.astype(np.uint16)).save(folder / "mask.png")
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.visual.vertex_colors = np.arange(4 * len(ball.vertices)).reshape(-1, 4).astype(np.uint8)
    ball.export(folder / "painted.ply")
    image = Image.fromarray((plane * 255).astype(np.uint8)).convert("RGB")
    ball.visual = trimesh.visual.TextureVisuals(ball.vertices[:, :2], image=image)
    ball.export(folder / "painted.obj")
    ball.visual.material = ball.visual.material.to_pbr()
    ball.export(folder / "painted.glb")
    (folder / "fidelity.json").write_text(json.dumps({"layers": 13, "band_groups": 1}))


def readers(folder: Path) -> dict[str, Callable[[Path], object]]:
    """What reads a file, by the name of the right one."""
    from edofsim.capture.fidelity import Fidelity
    from edofsim.capture.files import read_image
    from edofsim.optics import Camera
    from edofsim.render.readers.pictures import picture_view
    from edofsim.restore.checkpoint import load_checkpoint
    from edofsim.scene import build_scene
    from edofsim.scene.mesh_files import read_mesh

    def built(**parts: Any) -> object:
        recipe = SceneRecipe.model_validate(scene(**parts))
        return build_scene(recipe, folder)

    def textured(path: Path) -> object:
        surface = {"kind": "matt", "texture": {"kind": "file", "path": path.name}}
        return built(objects=[{**CARD, "surface": surface}], lights=[{"kind": "environment"}])

    def lit(path: Path) -> object:
        return built(objects=[CARD], lights=[{"kind": "environment_map", "path": path.name}])

    def deep(path: Path) -> object:
        source = {"kind": "rgbd", "image": "good.png", "depth": {"path": path.name}}
        return picture_view(SceneRecipe.model_validate(scene(source=source)), folder)

    def cube(path: Path) -> object:
        source = {"kind": "cube", "path": path.name, "depth_m": 1.0}
        if path.suffix != ".exr":
            source |= {"start_nm": 400, "step_nm": 50}
        return picture_view(SceneRecipe.model_validate(scene(source=source)), folder)

    def foreign(path: Path) -> object:
        return built(source={"kind": "mitsuba", "path": path.name}, lights=[{"kind": "environment"}])

    def camera(**parts: Any) -> object:
        from edofsim.optics import response
        from edofsim.optics.height import designed_map

        made = Camera.from_recipe(CameraRecipe.model_validate({"name": "a", **parts}), folder)
        designed_map(made)
        return response(made, torch.tensor([500e-9, 600e-9]))

    def mask(path: Path) -> object:
        return camera(mask={"kind": "height-map", "file": path.name, "pitch_um": 21.0})

    def measured(path: Path) -> object:
        return camera(mask={"kind": "height-map", "file": path.name, "pitch_um": 21.0, "unit": "um"})

    def mesh(path: Path) -> object:
        return read_mesh(path, "thing")

    def painted(path: Path) -> object:
        return built(objects=[{"kind": "mesh", "path": path.name, "size_mm": 9, "depth_m": 1.0}],
                     lights=[{"kind": "environment"}])  # fmt: skip

    table: dict[str, Callable[[Path], object]] = {
        "scene.toml": load_scene,
        "camera.toml": load_camera,
        "train.toml": load_train,
        "good.xml": foreign,
        "good.json": foreign,
        "mask.npy": mask,
        "good.safetensors": load_checkpoint,
        "good.csv": lambda path: camera(sensor={"response": path.name}),
        "good.mat": cube,
        "bands.exr": cube,
        "depth.mat": deep,
    }
    table |= {f"good.{suffix}": mesh for suffix in ("obj", "ply", "stl", "glb", "gltf", "off")}
    table |= {f"good.{suffix}": lit for suffix in ("hdr", "exr")}
    table |= {f"good.{suffix}": deep for suffix in ("npy", "npz", "pfm", "dpt")}
    table |= {f"good.{suffix}": textured for suffix in ("png", "jpg", "tif")}
    table |= {f"cube.{suffix}": cube for suffix in ("npy", "tif", "h5", "hdr")}
    table |= {f"depth.{suffix}": deep for suffix in ("h5", "csv", "tif", "png")}
    table |= {f"mask.{suffix}": measured for suffix in ("npz", "mat", "csv", "png")}
    table |= {f"painted.{suffix}": painted for suffix in ("ply", "obj", "glb")}
    table["fidelity.json"] = Fidelity.load
    return table | {"photo.png": read_image, "photo.jpg": read_image, "photo.exr": read_image}


def contents(good: bytes) -> dict[str, bytes]:
    """What a file may hold that it should not."""
    rng = np.random.default_rng(0)
    found = {
        "nothing": b"",
        "a byte": b"\0",
        "zeros": bytes(4096),
        "ones": b"\xff" * 4096,
        "noise": rng.bytes(65536),
        "text": b"nothing that it should be\n" * 40,
        "nan": b"nan " * 900,
        "brackets": b"[" * 90000,
        "braces": b'{"a":' * 90000,
        "tags": b"<scene>" * 90000,
        "a long line": b"x" * (1 << 20),
        "digits": b"name = " + b"9" * 5000,
        "twice": good + good,
        "more": good + rng.bytes(999),
        "mark": b"\xef\xbb\xbf" + good,
        "line ends": good.replace(b"\n", b"\r\n"),
        "upside down": good[::-1],
    }
    found |= {f"the first {part} %": good[: len(good) * part // 100] for part in (1, 10, 50, 90, 99)}
    for seed in range(6):
        damaged = bytearray(good)
        for place in np.random.default_rng(seed).integers(0, len(good), 1 + 3 * seed):
            damaged[place] ^= 1 << seed
        found[f"bits turned, {seed}"] = bytes(damaged)
    for seed in range(4):
        start = int(np.random.default_rng(seed).integers(0, max(1, min(len(good), 200))))
        found[f"large numbers at {start}"] = good[:start] + b"\xff\xff\xff\x7f" + good[start + 4 :]
    return found


def files(folder: Path) -> Iterator[Try]:
    """All tries with files."""
    for name, read in readers(folder).items():
        right = folder / name.replace("photo", "good")
        suffix = right.suffix
        for what, content in contents(right.read_bytes()).items():

            def work(
                read: Callable[[Path], object] = read, content: bytes = content, end: str = suffix
            ) -> object:
                path = folder / f"hostile{end}"
                path.write_bytes(content)
                try:
                    return read(path)
                finally:
                    path.unlink()

            yield Try(f"{name}: {what}", work)
        for what in ("pipe", "/dev/zero", "/dev/full", "folder", "loop", "nowhere"):

            def special(read: Callable[[Path], object] = read, what: str = what, end: str = suffix) -> object:
                path = folder / f"special{end}"
                if what == "pipe":
                    os.mkfifo(path)
                elif what == "folder":
                    path.mkdir()
                else:
                    path.symlink_to({"loop": path, "nowhere": folder / "none"}.get(what, what))
                try:
                    return read(path)
                finally:
                    path.rmdir() if what == "folder" else path.unlink()

            yield Try(f"{name}: {what}", special)


def tries(folder: Path) -> list[Try]:
    return [*numbers(folder), *files(folder)]


# ---- the worker ----------------------------------------------------------------------------------------


class TooLong(BaseException):
    """More than SECONDS of processor time."""


def ended(each: Try) -> str:
    """How a try ended: `made`, `refused`, or what went wrong."""

    def stop(number: int, frame: object) -> None:
        raise TooLong

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        each.work()
    except EdofsimError as error:
        text = str(error)
        return "refused" if text and len(text) < 4000 else f"a message of {len(text)} characters"
    except TooLong:
        return f"more than {SECONDS} s"
    except BaseException as error:  # whatever else it is, it is a failure
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:200]} ({place.filename}:{place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return "made"


def main() -> None:
    folder, first, last = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    every = tries(folder)
    if first < 0:
        print(json.dumps(len(every)))
        return
    validated = SceneRecipe.model_validate(scene(objects=[CARD], lights=[{"kind": "environment"}]))
    from edofsim.render.rendering import render_model
    from edofsim.render.settings import RenderSettings
    from edofsim.render.view import View
    from edofsim.scene import build_scene

    View.of(render_model(build_scene(validated, folder), RenderSettings.from_recipe(validated)))
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    for number, each in enumerate(every[first:last], first):
        print(json.dumps([number, each.name, ""]), flush=True)
        print(json.dumps([number, each.name, ended(each)]), flush=True)


if __name__ == "__main__":
    main()
