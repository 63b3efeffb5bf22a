"""Other people's meshes by two renderers: as edofsim reads and renders them, and as trimesh reads and Mitsuba
renders them.

`python -m benchmarks.meshes FOLDER... [--most N] [--json FILE] [--csv FILE]` takes the OBJ, PLY, STL, GLB,
glTF and OFF files below each folder, at most N of each, evenly chosen by name. Each mesh stands a metre away,
flat shaded and matt, in even light and that of a lamp. Compared are the surface's area with that of trimesh,
without faces that lie twice, and the pictures: ratio of their means, and correlation of means of 3 x 3
pixels.
"""

from __future__ import annotations

import argparse
import logging
import math
import shlex
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from edofsim.errors import InputError
from edofsim.recipe import SceneRecipe
from edofsim.record import record, write_csv, write_record
from edofsim.render import render
from edofsim.render.engine import use_engine
from edofsim.scene.mesh_files import SUFFIXES, read_mesh

ROWS, COLUMNS, CELL = 36, 48, 3
SIZE, ANGLE = 0.06, 1.8e-3
"""Longest side of a mesh at 1 m, and tangent of the angle of a pixel."""
EVEN, LAMP = 0.05, 60.0
LAMP_AT, LAMP_SIDE = (0.4, 0.6, 0.4), 0.3
LARGEST = 1 << 25
"""Bytes of a file that is tried."""


@dataclass(frozen=True)
class Compared:
    """area: ratio to trimesh's; ratio, likeness: of the pictures; refused: why it was not read, or empty."""

    name: str
    faces: int = 0
    area: float = math.nan
    ratio: float = math.nan
    likeness: float = math.nan
    refused: str = ""


def ours(path: Path, folder: Path, samples: int) -> np.ndarray:
    """The picture [y, x] by edofsim."""
    x, y, z = (1e3 * value for value in LAMP_AT)
    matt = {"kind": "matt", "reflectance": 0.5}
    recipe = SceneRecipe.model_validate({
        "name": "mesh",
        "bands": {"count": 2},
        "frame": {"width_px": COLUMNS, "height_px": ROWS, "margin_px": 0, "pixel_angle_mrad": 1e3 * ANGLE},
        "render": {"samples": samples, "hidden": False, "max_depth": 4},
        "objects": [{"kind": "mesh", "path": str(path), "size_mm": 1e3 * SIZE, "depth_m": 1.0,
                     "anchor": "centre", "smooth": False, "surface": matt}],
        "lights": [{"kind": "environment", "illuminant": "E", "radiance": EVEN},
                   {"kind": "area", "illuminant": "E", "radiance": LAMP, "position_mm": (x, y, z),
                    "target_mm": (0.0, 0.0, 1e3), "size_mm": (1e3 * LAMP_SIDE, 1e3 * LAMP_SIDE)}],
    })  # fmt: skip
    return render(recipe, folder, cache=folder / "cache").all_in_focus().mean(0).numpy()


def mitsubas(mesh: trimesh.Trimesh, folder: Path, samples: int) -> np.ndarray:
    """The picture [y, x] by Mitsuba, of a mesh as trimesh has it."""
    mi = use_engine("auto")
    low, high = mesh.bounds
    still = trimesh.Trimesh(mesh.vertices - (low + high) / 2, mesh.faces, process=False)
    still.apply_scale(SIZE / float((high - low).max()))
    still.apply_translation((0, 0, -1))  # seen along -z, x to the right, as the file has it
    still.export(folder / "still.ply")
    at = (LAMP_AT[0], LAMP_AT[1], -LAMP_AT[2])
    half = LAMP_SIDE / 2

    def facing(origin: tuple[float, float, float]) -> mi.ScalarTransform4f:
        return mi.ScalarTransform4f().look_at(origin=origin, target=(0, 0, -1), up=(0, 1, 0))

    grey = {"type": "rgb", "value": 0.5}
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "mesh": {"type": "ply", "filename": str(folder / "still.ply"), "face_normals": True,
                 "bsdf": {"type": "twosided", "inside": {"type": "diffuse", "reflectance": grey}}},
        "even": {"type": "constant", "radiance": {"type": "rgb", "value": EVEN}},
        "lamp": {"type": "rectangle", "emitter": {"type": "area", "radiance": {"type": "rgb", "value": LAMP}},
                 "to_world": facing(at).scale((half, half, 1))},
        "sensor": {"type": "perspective", "fov": 2 * math.degrees(math.atan(COLUMNS * ANGLE / 2)),
                   "fov_axis": "x", "to_world": facing((0, 0, 0)),
                   "film": {"type": "hdrfilm", "width": COLUMNS, "height": ROWS, "rfilter": {"type": "box"}}},
    })  # fmt: skip
    return np.array(mi.render(scene, spp=samples, seed=5))[..., 0]


def compare(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Ratio of the means of two pictures, and correlation of the means of their cells."""
    cells = [
        a.reshape(ROWS // CELL, CELL, COLUMNS // CELL, CELL).mean((1, 3)).ravel() for a in (first, second)
    ]
    return float(first.mean() / second.mean()), float(np.corrcoef(*cells)[0, 1])


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Area of triangles."""
    a, b, c = (np.asarray(vertices, float)[faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def judged(path: Path, name: str, samples: int = 256) -> Compared:
    """Both renderings of a file."""
    try:
        mesh = read_mesh(path, "mesh", smooth=False)
    except InputError as error:
        return Compared(name, refused=str(error).replace(str(path), path.name))
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        truth = trimesh.load(path, force="mesh", process=False)
        assert isinstance(truth, trimesh.Trimesh)
        truth.update_faces(truth.unique_faces())
        pictures = ours(path.resolve(), Path(folder), samples), mitsubas(truth, Path(folder), samples)
        return Compared(
            name,
            len(mesh.faces),
            area(mesh.vertices, mesh.faces) / truth.area,
            *compare(*pictures),
        )


def chosen(folder: Path, most: int) -> list[Path]:
    """Mesh files below a folder, at most so many, evenly by name."""
    found = sorted(
        p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.stat().st_size < LARGEST
    )
    if len(found) <= most:
        return found
    return [found[round(k)] for k in np.linspace(0, len(found) - 1, most)]


def main(arguments: Sequence[str] | None = None) -> None:
    """The command: see the top."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.meshes", description="Meshes by two renderers."
    )
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--most", type=int, default=100, help="files of a folder")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--csv", type=Path)
    asked = parser.parse_args(arguments)
    logging.getLogger("edofsim").setLevel(logging.ERROR)
    figures: dict[str, float] = {}
    rows: list[Compared] = []
    for folder in asked.folders:
        found = [judged(path, str(path.relative_to(folder))) for path in chosen(folder, asked.most)]
        rows += found
        read = [each for each in found if not each.refused]
        name = folder.name
        figures |= {f"{name}.files": len(found), f"{name}.read": len(read)}
        if read:
            figures |= {
                f"{name}.area_error_percent": 100 * max(abs(each.area - 1) for each in read),
                f"{name}.ratio_low": min(each.ratio for each in read),
                f"{name}.ratio_high": max(each.ratio for each in read),
                f"{name}.least_correlation": min(each.likeness for each in read),
            }
        for each in found:
            about = each.refused or (
                f"{each.faces} faces, area {each.area:.5f}, mean {each.ratio:.4f}, "
                f"correlation {each.likeness:.4f}"
            )
            print(f"{name}/{each.name}: {about}", flush=True)
    for key, value in figures.items():
        print(f"{key:40} {value:.6g}")
    if asked.csv:
        write_csv(
            asked.csv,
            ["file", "faces", "area_ratio", "mean_ratio", "correlation", "refused"],
            [[r.name, r.faces, r.area, r.ratio, r.likeness, r.refused] for r in rows],
        )
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.meshes", *(arguments or sys.argv[1:])])
        write_record(asked.json, record("meshes", figures=figures, typed=typed))


if __name__ == "__main__":
    main()
