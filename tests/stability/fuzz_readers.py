"""Mutated files through a reader, in a process of its own: `python fuzz_readers.py READER COUNT SEED`.

Prints JSON: how many were read, how many refused, and what else happened, with the number of the mutation,
which makes it again. Memory beyond 2 GiB above the start, or five seconds of the processor on one file,
count as failures too. Without arguments it takes lines of JSON, [READER, COUNT, SEED, FILE], forks a process
for each, which has all imports by then and writes into the file, and answers with how that process ended.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import struct
import sys
import tempfile
import traceback
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from edofsim.core import measurements
from edofsim.errors import InputError

SECONDS = 5
MEMORY = 2 << 30
TEXT = (
    b"=",
    b"[",
    b"]",
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"\x00",
    b'"',
    b"\n",
    b"99999999999",
    b"{",
    b"\xff",
)


def mutated(seed: bytes, number: int, base: int) -> bytes:
    """Mutation `number`: bits flipped, bytes inserted, parts cut out or doubled, the end missing."""
    rng = np.random.default_rng([base, number])
    content = bytearray(seed)
    for _ in range(int(rng.integers(1, 6))):
        kind, at = int(rng.integers(6)), int(rng.integers(max(len(content), 1)))
        length = int(rng.integers(1, 1 + max(1, len(content) // 8)))
        if kind == 0 and content:
            content[at % len(content)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            content[at:at] = rng.integers(0, 256, int(rng.integers(1, 9)), np.uint8).tobytes()
        elif kind == 2:
            del content[at : at + length]
        elif kind == 3:
            content[at:at] = content[at : at + length]
        elif kind == 4:
            content[at:at] = TEXT[int(rng.integers(len(TEXT)))]
        else:
            del content[at:]
    return bytes(content)


def recipe(folder: Path) -> Made:
    from edofsim.recipe.load import load_scene, shipped_folder

    return (shipped_folder("scenes") / "bench.toml").read_bytes(), "scene.toml", load_scene


def training(folder: Path) -> Made:
    from edofsim.recipe.load import load_train, shipped_folder

    return (shipped_folder("train") / "paper-dcnn.toml").read_bytes(), "train.toml", load_train


def view(folder: Path) -> Made:
    """A spectral EXR with fragments; as the cache reads it, with a damaged one's reason as a ValueError."""
    from edofsim.render.exr import read_view, write_view
    from edofsim.render.view import View
    from edofsim.stability.views import flat, layered_view

    path = folder / "seed.exr"
    half = flat(0.5).coverage.reshape(30, 35) * 0.5
    write_view(path, layered_view(half, 1.2, 0.4, 0.5).fragments())

    def read(path: Path) -> object:
        try:
            return View.of(read_view(path))
        except ValueError as error:
            raise InputError(str(error)) from error

    return path.read_bytes(), "view.exr", read


def photo(folder: Path) -> Made:
    import torch

    from edofsim.capture import read_image, write_image

    path = write_image(folder / "seed.exr", torch.rand(3, 9, 11))
    return path.read_bytes(), "photo.exr", read_image


def picture(folder: Path) -> Made:
    from skimage import io

    from edofsim.capture import read_image

    path = folder / "seed.png"
    io.imsave(path, np.arange(9 * 11 * 3, dtype=np.uint8).reshape(9, 11, 3), check_contrast=False)
    return path.read_bytes(), "photo.png", read_image


def checkpoint(folder: Path) -> Made:
    from edofsim.restore.checkpoint import load_checkpoint, save_checkpoint
    from edofsim.restore.network import build_network

    path = save_checkpoint(folder / "seed.safetensors", build_network("dcnn"), {"name": "seed"})
    return path.read_bytes(), "net.safetensors", load_checkpoint


def response(folder: Path) -> Made:
    import torch

    from edofsim.optics import Camera
    from edofsim.optics import response as weights
    from edofsim.recipe.camera import CameraRecipe, Sensor

    rows = "\n".join(f"{nm},{nm / 700},{1 - nm / 900},{500 / nm}" for nm in range(400, 701, 20))

    def read(path: Path) -> object:
        camera = Camera.from_recipe(CameraRecipe(name="x", sensor=Sensor(response=str(path))), path.parent)
        return weights(camera, torch.linspace(450e-9, 650e-9, 5, dtype=torch.float64))

    return f"wavelength_nm,r,g,b\n{rows}\n".encode(), "response.csv", read


Made: TypeAlias = tuple[bytes, str, Callable[[Path], object]]
"""A good file, what to call it, and what reads it."""


def write_array(path: Path, values: np.ndarray) -> None:
    """An array as a file of any kind that is read."""
    match path.suffix:
        case ".npy":
            np.save(path, values)
        case ".npz":
            np.savez_compressed(path, depth=values)
        case ".mat":
            from scipy.io import savemat

            savemat(path, {"depth": values})
        case ".h5":
            import h5py

            with h5py.File(path, "w") as file:
                file.create_dataset("depth", data=values, compression="gzip")
        case ".tif":
            import tifffile

            tifffile.imwrite(path, values, photometric="minisblack", compression="zlib")
        case ".csv":
            np.savetxt(path, values, delimiter=",", fmt="%.4f")
        case ".png":
            from PIL import Image

            Image.fromarray((values * 10000).astype(np.uint16)).save(path)
        case ".exr":
            from edofsim.core.images import write_exr

            write_exr(path, {"Z": values}, {})
        case ".pfm":
            rows, columns = values.shape
            path.write_bytes(b"Pf\n%d %d\n-1.0\n" % (columns, rows) + values.astype("<f4").tobytes())
        case ".dpt":
            size = np.array(values.shape[::-1], "<i4").tobytes()
            path.write_bytes(np.float32(202021.25).tobytes() + size + values.astype("<f4").tobytes())


def depth(suffix: str) -> Callable[[Path], Made]:
    def make(folder: Path) -> Made:
        from edofsim.recipe.sources import DepthMap
        from edofsim.scene.depth_maps import read_inverse_depth

        path = folder / f"seed{suffix}"
        write_array(path, np.linspace(0.5, 3, 77, dtype=np.float32).reshape(7, 11))

        def read(path: Path) -> object:
            return read_inverse_depth(DepthMap(path=path.name), path.parent)

        return path.read_bytes(), f"depth{suffix}", read

    return make


def height(suffix: str) -> Callable[[Path], Made]:
    def make(folder: Path) -> Made:
        from edofsim.optics.height import load_height_map

        path = folder / f"seed{suffix}"
        write_array(path, np.linspace(0, 3, 81).reshape(9, 9))
        return path.read_bytes(), f"mask{suffix}", lambda path: load_height_map(path, unit="nm")

    return make


def cube(suffix: str) -> Callable[[Path], Made]:
    def make(folder: Path) -> Made:
        from edofsim.recipe.sources import CubeFile
        from edofsim.scene.cube_files import read_stored
        from edofsim.scene.wavelengths import chosen_nm

        path = folder / f"seed{suffix}"
        values = np.linspace(0, 1, 5 * 7 * 11, dtype=np.float32).reshape(5, 7, 11)
        if suffix == ".hdr":
            from spectral.io import envi

            about = {"wavelength": [450, 500, 550, 600, 650], "wavelength units": "nm"}
            envi.save_image(str(path), np.moveaxis(values, 0, 2), ext=".raw", force=True, metadata=about)
            (folder / "cube.raw").write_bytes(path.with_suffix(".raw").read_bytes())
        else:
            write_array(path, values)

        def read(path: Path) -> object:
            given = {} if suffix == ".hdr" else {"start_nm": 450, "step_nm": 50}
            source = CubeFile(path=path.name, **given)
            found = read_stored(source, path.parent, "cube")
            return chosen_nm(source, found.waves, found.unit, len(found.values), "cube")

        return path.read_bytes(), f"cube{suffix}", read

    return make


def colours(suffix: str) -> Callable[[Path], Made]:
    """Pictures with all that a file may say of them: 16 bits, a profile, how it was held."""

    def make(folder: Path) -> Made:
        from PIL import Image, ImageCms

        from edofsim.core.colours import read_colours
        from edofsim.core.images import write_exr

        path = folder / f"seed{suffix}"
        pixels = np.arange(9 * 11 * 3).reshape(9, 11, 3)
        if suffix == ".exr":
            write_exr(path, {f"L.{name}": np.ones((9, 11), np.float32) for name in "RGB"}, {})
        elif suffix == ".png":
            path.write_bytes(png_of_16_bits(pixels.astype(np.uint16) * 200))
        elif suffix == ".tif":
            import tifffile

            tifffile.imwrite(path, pixels.astype(np.float32), photometric="rgb", compression="zlib")
        elif suffix == ".hdr":
            head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9 +X 11\n"
            rgbe = np.concatenate([pixels.astype(np.uint8), np.full((9, 11, 1), 129, np.uint8)], axis=2)
            path.write_bytes(head + rgbe.tobytes())
        else:
            image = Image.fromarray(pixels.astype(np.uint8))
            exif = image.getexif()
            exif[274] = 6
            profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
            image.save(path, exif=exif, icc_profile=profile)
        return path.read_bytes(), f"picture{suffix}", lambda path: read_colours(path, "picture")

    return make


def png_of_16_bits(pixels: np.ndarray) -> bytes:
    rows, columns, _ = pixels.shape
    body = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(body)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )


def fidelity(folder: Path) -> Made:
    from edofsim.capture.fidelity import Fidelity

    return Fidelity(layers=13).save(folder / "seed.json").read_bytes(), "how.json", Fidelity.load


def mesh(suffix: str) -> Callable[[Path], Made]:
    """With colours of its corners, or a picture where the format has such."""

    def make(folder: Path) -> Made:
        import trimesh
        from PIL import Image

        from edofsim.scene.mesh_colours import painted_parts
        from edofsim.scene.mesh_files import read_content

        path = folder / f"mesh{suffix}"
        body = trimesh.creation.icosahedron()
        if suffix in (".obj", ".glb"):
            image = Image.new("RGB", (4, 4), (200, 50, 9))
            material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
            body.visual = trimesh.visual.TextureVisuals(body.vertices[:, :2], material)
        elif suffix != ".stl":
            body.visual.vertex_colors = np.arange(48, dtype=np.uint8).reshape(12, 4) * 5
        body.export(path)

        def read(path: Path) -> object:
            content = read_content(path, "mesh")
            return painted_parts(content.mesh, content.paint, np.array([500e-9, 600e-9]))

        return path.read_bytes(), f"mesh{suffix}", read

    return make


def foreign(folder: Path) -> Made:
    """A Mitsuba scene; what it cannot carry is told in one message too."""
    from edofsim.scene.foreign import MitsubaSource, NotCarried, read_scene

    scene = b"""<scene version="3.0.0">
    <default name="grey" value="0.25"/>
    <bsdf type="plastic" id="paint"><rgb name="diffuse_reflectance" value="0.2, 0.4, $grey"/></bsdf>
    <shape type="rectangle"><ref id="paint"/>
        <transform name="to_world"><scale value="2"/><translate z="3"/></transform></shape>
    <shape type="sphere"><point name="center" x="0" y="0" z="2"/><float name="radius" value="0.5"/>
        <emitter type="area"><spectrum name="radiance" value="400:1, 500:2, 700:6"/></emitter></shape>
    <emitter type="constant"><float name="radiance" value="1.5"/></emitter>
    <sensor type="perspective"><float name="fov" value="40"/></sensor>
</scene>"""

    def read(path: Path) -> object:
        source = MitsubaSource(kind="mitsuba", path=path.name)
        try:
            return read_scene(source, path.parent, np.linspace(450e-9, 650e-9, 3), "scene")
        except NotCarried as error:
            raise InputError(error.problems) from error

    return scene, "scene.xml", read


def dictionary(folder: Path) -> Made:
    """A Mitsuba scene as JSON."""
    _, _, read = foreign(folder)
    scene = {
        "type": "scene",
        "ball": {"type": "sphere", "skin": {"type": "ref", "id": "paint"}, "center": [0, 0, 4]},
        "paint": {"type": "plastic", "diffuse_reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}},
        "sky": {"type": "constant"},
        "way": {"type": "path", "max_depth": 4},
        "camera": {"type": "perspective", "fov": 40, "to_world": np.eye(4).tolist()},
    }
    return json.dumps(scene, indent=1).encode(), "scene.json", read


ARRAYS = (".npy", ".npz", ".mat", ".h5", ".tif", ".csv", ".png")
READERS = {
    "recipe": recipe,
    "training": training,
    "view": view,
    "photo": photo,
    "picture": picture,
    "checkpoint": checkpoint,
    "response": response,
    "foreign": foreign,
    "dictionary": dictionary,
    "fidelity": fidelity,
    **{
        f"depth{s}": depth(s)
        for s in (".npy", ".npz", ".mat", ".h5", ".pfm", ".dpt", ".tif", ".csv", ".png", ".exr")
    },
    **{f"height{s}": height(s) for s in (".npy", ".npz", ".mat", ".h5", ".tif", ".csv", ".png")},
    **{f"cube{s}": cube(s) for s in (".npy", ".npz", ".mat", ".h5", ".tif", ".hdr")},
    **{f"colours{s}": colours(s) for s in (".png", ".jpg", ".tif", ".webp", ".exr", ".hdr")},
    **{f"mesh{s}": mesh(s) for s in (".obj", ".ply", ".stl", ".glb", ".off")},
}


def fuzz(reader: str, count: int, base: int) -> dict[str, object]:
    """Totals of a reader."""
    found: dict[str, object] = {"read": 0, "refused": 0, "failed": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seed, file, read = READERS[reader](folder)
        path = folder / file
        path.write_bytes(seed)
        measurements.TRY_S = SECONDS
        read(path)  # the seed itself is good, and imports are done
        # addresses, not resident pages: what a reader asks for in one go counts
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
        present = sorted(folder.iterdir())
        for number in range(count):
            print(number, file=sys.stderr, flush=True)
            content = mutated(seed, number, base)
            path.write_bytes(content)
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    read(path)
                found["read"] += 1
            except InputError as error:
                found["refused"] += 1
                if not str(error).strip() or "Traceback" in str(error):
                    found["failed"].append([number, f"message {str(error)[:80]!r}"])
            except Exception as error:
                found["failed"].append([number, f"{type(error).__name__}: {str(error)[:120]}"])
            signal.setitimer(signal.ITIMER_PROF, 0)
            if path.read_bytes() != content or sorted(folder.iterdir()) != present:
                found["failed"].append([number, "a file was touched"])
    return found


def serve() -> None:
    import edofsim.cli
    import edofsim.learn.trainer
    import edofsim.scene.foreign
    import edofsim.stability.views  # noqa: F401

    for line in sys.stdin:
        reader, count, base, said = json.loads(line)
        child = os.fork()
        if child == 0:
            status = 1
            try:
                with open(f"{said}.stderr", "w") as log:  # libraries print, too
                    os.dup2(log.fileno(), 1)
                    os.dup2(log.fileno(), 2)
                Path(said).write_text(json.dumps(fuzz(reader, count, base)))
                status = 0
            except Exception:
                traceback.print_exc()
            finally:
                os._exit(status)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    if len(sys.argv) == 1:
        serve()
    else:
        print(json.dumps(fuzz(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
