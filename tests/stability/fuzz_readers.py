"""Mutated files through a reader, in a process of its own: `python fuzz_readers.py READER COUNT SEED`.

Prints JSON: how many were read, how many refused, and what else happened, with the number of the mutation,
which makes it again. Memory beyond 2 GiB above the start, or a second too many on one file, counts as a
failure too.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edofsim.core import measurements
from edofsim.errors import InputError

SECONDS = 20
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


FORKED = 100
"""With more mutations than this, the trial process of a MAT file is forked, which takes milliseconds, not
started anew."""


def crashes_forked(path: Path) -> bool:
    """As `measurements._crashes`."""
    from scipy.io import loadmat

    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(SECONDS)
        try:
            loadmat(path)
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


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


def recipe(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    from edofsim.recipe.load import load_scene, shipped_folder

    return (shipped_folder("scenes") / "bench.toml").read_bytes(), "scene.toml", load_scene


def training(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    from edofsim.recipe.load import load_train, shipped_folder

    return (shipped_folder("train") / "paper-dcnn.toml").read_bytes(), "train.toml", load_train


def view(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    """A spectral EXR with fragments; as the cache reads it, with a damaged one's reason as a ValueError."""
    from edofsim.render.exr import read_view, write_view
    from edofsim.render.fragments import Fragments
    from edofsim.stability.views import flat, layered_view

    path = folder / "seed.exr"
    half = flat(0.5).coverage.reshape(30, 35) * 0.5
    write_view(path, Fragments.of(layered_view(half, 1.2, 0.4, 0.5)))

    def read(path: Path) -> object:
        try:
            return read_view(path).view()
        except ValueError as error:
            raise InputError(str(error)) from error

    return path.read_bytes(), "view.exr", read


def photo(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    import torch

    from edofsim.capture import read_image, write_image

    path = write_image(folder / "seed.exr", torch.rand(3, 9, 11))
    return path.read_bytes(), "photo.exr", read_image


def picture(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    from skimage import io

    from edofsim.capture import read_image

    path = folder / "seed.png"
    io.imsave(path, np.arange(9 * 11 * 3, dtype=np.uint8).reshape(9, 11, 3), check_contrast=False)
    return path.read_bytes(), "photo.png", read_image


def checkpoint(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    from edofsim.restore.checkpoint import load_checkpoint, save_checkpoint
    from edofsim.restore.network import build_network

    path = save_checkpoint(folder / "seed.safetensors", build_network("dcnn"), {"name": "seed"})
    return path.read_bytes(), "net.safetensors", load_checkpoint


def response(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
    import torch

    from edofsim.optics import Camera
    from edofsim.optics import response as weights
    from edofsim.recipe.camera import CameraRecipe, Sensor

    rows = "\n".join(f"{nm},{nm / 700},{1 - nm / 900},{500 / nm}" for nm in range(400, 701, 20))

    def read(path: Path) -> object:
        camera = Camera.from_recipe(CameraRecipe(name="x", sensor=Sensor(response=str(path))), path.parent)
        return weights(camera, torch.linspace(450e-9, 650e-9, 5, dtype=torch.float64))

    return f"wavelength_nm,r,g,b\n{rows}\n".encode(), "response.csv", read


def depth(suffix: str) -> Callable[[Path], tuple[bytes, str, Callable[[Path], object]]]:
    def make(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
        from edofsim.core.measurements import read_numbers

        values = np.linspace(0.5, 3, 77, dtype=np.float32).reshape(7, 11)
        path = folder / f"seed{suffix}"
        if suffix == ".npy":
            np.save(path, values)
        elif suffix == ".npz":
            np.savez_compressed(path, depth=values)
        elif suffix == ".mat":
            from scipy.io import savemat

            savemat(path, {"depth": values})
        else:
            path.write_bytes(b"Pf\n11 7\n-1.0\n" + values.tobytes())
        return (
            path.read_bytes(),
            f"depth{suffix}",
            lambda path: read_numbers(path.name, None, path.parent, "depth"),
        )

    return make


def mesh(suffix: str) -> Callable[[Path], tuple[bytes, str, Callable[[Path], object]]]:
    def make(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
        import trimesh

        from edofsim.scene.mesh_files import read_mesh

        path = folder / f"seed{suffix}"
        trimesh.creation.icosahedron().export(path)
        return path.read_bytes(), f"mesh{suffix}", lambda path: read_mesh(path, "mesh")

    return make


def foreign(folder: Path) -> tuple[bytes, str, Callable[[Path], object]]:
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


READERS = {
    "recipe": recipe,
    "training": training,
    "view": view,
    "photo": photo,
    "picture": picture,
    "checkpoint": checkpoint,
    "response": response,
    "foreign": foreign,
    **{f"depth{suffix}": depth(suffix) for suffix in (".npy", ".npz", ".mat", ".pfm")},
    **{f"mesh{suffix}": mesh(suffix) for suffix in (".obj", ".ply", ".stl", ".glb")},
}


def fuzz(reader: str, count: int, base: int) -> dict[str, object]:
    """Totals of a reader."""
    found: dict[str, object] = {"read": 0, "refused": 0, "failed": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seed, file, read = READERS[reader](folder)
        path = folder / file
        path.write_bytes(seed)
        if count > FORKED:
            measurements._crashes = crashes_forked
        read(path)  # the seed itself is good, and imports are done
        # addresses, not resident pages: what a reader asks for in one go counts
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
        present = sorted(folder.iterdir())
        for number in range(count):
            print(number, file=sys.stderr, flush=True)
            content = mutated(seed, number, base)
            path.write_bytes(content)
            signal.alarm(SECONDS)
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
            signal.alarm(0)
            if path.read_bytes() != content or sorted(folder.iterdir()) != present:
                found["failed"].append([number, "a file was touched"])
    return found


if __name__ == "__main__":
    print(json.dumps(fuzz(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
