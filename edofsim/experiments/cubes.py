"""Spectral cubes for the broadband experiment: files of the user's, and rendered scenes all in focus."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from .. import completion
from ..errors import InputError
from ..recipe.sources import CubeFile
from ..render.view import View
from ..scene.cube_files import FILES
from ..scene.cubes import at_bands, stored_cube
from .photographs import REACH_PX, SMALLEST_PX

CAVE_BANDS, CAVE_START_NM, CAVE_STEP_NM = 31, 400.0, 10.0


CubesOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--data",
        metavar="PATH",
        help="Spectral cube (folder with a picture a band, .mat, spectral .exr) or a folder of cubes.",
    ),
]
PlanesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--scene",
        metavar="SCENE",
        help="Scene to render, as one plane; repeatable.",
        autocompletion=completion.scenes,
    ),
]


@dataclass(frozen=True)
class Cube:
    """radiance: float32 [band, y, x], linear, in any unit.
    wavelengths: float64 [band], metres.
    margin: pixels of surroundings on each side, which are no part of the picture.
    sha256: of the radiance.
    """

    name: str
    radiance: Tensor
    wavelengths: Tensor
    margin: int
    sha256: str


@dataclass(frozen=True)
class Reading:
    """How cubes are read.

    key: array in a MAT file.
    start_nm, step_nm: bands of files that do not tell.
    bands: (lowest, highest) in nm to use.
    crop: pixels to cut off at the left, top, right, bottom.
    """

    key: str | None = None
    start_nm: float | None = None
    step_nm: float | None = None
    bands: tuple[float, ...] | None = None
    crop: tuple[int, ...] = (0, 0, 0, 0)


def read_cubes(path: Path, wanted_nm: np.ndarray, reading: Reading) -> tuple[list[Cube], list[str]]:
    """The cube at `path`, or all in that folder, at the bands of `wanted_nm` that they have; and a sentence
    for each that cannot be used.

    wanted_nm: [band], nanometres.

    Raises InputError where there is none at all.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; name a spectral cube or a folder of them, --data")
    places = [path] if _is_cube(path) else sorted(p for p in path.iterdir() if _is_cube(p) or p.is_dir())
    cubes: list[Cube] = []
    problems: list[str] = []
    for place in places:
        try:
            cubes.append(read_one(place, wanted_nm, reading))
        except InputError as error:
            problems += [f"{place}: {_with_options(problem)}" for problem in error.problems]
    if not cubes:
        kinds = "folders with a PNG or TIFF a band, ENVI, .mat, HDF5, .npy, TIFF and spectral .exr files"
        raise InputError(problems or f"{path}: holds no spectral cubes ({kinds})")
    return cubes, problems


def _with_options(problem: str) -> str:
    """A sentence about a cube with the options of the command line in place of a recipe's keys."""
    problem = re.sub(r'with key = "([^"]*)"', r"with --key \1", problem)
    return problem.replace("start_nm and step_nm", "--start-nm and --step-nm")


def read_one(path: Path, wanted_nm: np.ndarray, reading: Reading) -> Cube:
    """A cube at those of the bands `wanted_nm` that it has.

    wanted_nm: [band], nanometres.

    Raises InputError.
    """
    start, step = reading.start_nm, reading.step_nm
    if start is None and _named_like_cave(path):
        start, step = CAVE_START_NM, CAVE_STEP_NM
    file = CubeFile(path=path.name, key=reading.key, start_nm=start, step_nm=step, crop=reading.crop)
    stored, nm, _ = stored_cube(file, path.parent)
    low, high = reading.bands or (-np.inf, np.inf)
    low, high = max(low, nm[0]) - 1e-6, min(high, nm[-1]) + 1e-6
    chosen = wanted_nm[(wanted_nm >= low) & (wanted_nm <= high)]
    if not len(chosen):
        raise InputError(
            f"has bands from {nm[0]:g} to {nm[-1]:g} nm: none that the sensor sees is among them"
        )
    if min(stored.shape[1:]) < SMALLEST_PX:
        raise InputError(
            f"has {stored.shape[2]} x {stored.shape[1]} pixels; at least {SMALLEST_PX} are needed"
        )
    radiance = torch.from_numpy(at_bands(stored, nm, chosen, path.name).astype(np.float32))
    if not float(radiance.max()) > 0:
        raise InputError("is black")
    return _cube(path.stem, radiance, chosen, REACH_PX)


def from_view(name: str, view: View) -> Cube:
    """A rendered scene all in focus, with its margin."""
    nm = view.wavelengths.numpy() * 1e9
    return _cube(name, view.all_in_focus().float(), nm, view.margin)


def _cube(name: str, radiance: Tensor, nm: np.ndarray, margin: int) -> Cube:
    digest = hashlib.sha256(radiance.numpy().tobytes() + np.ascontiguousarray(nm).tobytes()).hexdigest()
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
    return Cube(safe, radiance, torch.from_numpy(np.asarray(nm, float) * 1e-9), margin, digest)


def _is_cube(path: Path) -> bool:
    if path.is_dir():
        return bool(_pictures(path))
    return path.suffix.lower() in FILES


def _pictures(path: Path) -> Sequence[Path]:
    return [p for p in path.iterdir() if p.suffix.lower() in (".png", ".tif", ".tiff")]


def _named_like_cave(path: Path) -> bool:
    """CAVE's cubes are 31 pictures NAME_ms_01.png to NAME_ms_31.png, 400 to 700 nm (Yasuma et al., 2010)."""
    if not path.is_dir():
        return False
    names = [p.stem for p in _pictures(path)]
    return len(names) == CAVE_BANDS and all(re.search(r"_ms_\d\d$", name) for name in names)
