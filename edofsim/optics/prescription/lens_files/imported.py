"""A lens file of another program as a camera recipe."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch

from ....core.limits import existing
from ....errors import InputError
from ....recipe.camera import CameraRecipe
from ...lenses.prescription import PrescriptionLens
from ..first_order import first_order
from ..surfaces import stack
from . import codev, optiland_json, oslo, zemax
from .glasses import catalogue, keys_of
from .rows import LensFile, Row

READERS = {".zmx": zemax.read, ".seq": codev.read, ".len": oslo.read, ".json": optiland_json.read}
DIGITS = 10
MOST_BYTES = 1 << 24
D_LINE = 587.56e-9


def read_lens(path: Path) -> LensFile:
    """A lens file, by its suffix, in millimetres. Raises InputError."""
    existing(path, "lens import")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: lens files end in {', '.join(READERS)}")
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path} is larger than {MOST_BYTES >> 20} MiB, which no lens is")
    content = path.read_bytes()
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        raise InputError(f"{path} is no text; save the lens again as {path.suffix}")
    found = reader(text, path.name)
    if len(found.rows) < 3:
        raise InputError(f"{path} holds {len(found.rows)} surfaces; a lens has object, surfaces and image")
    return replace(found, rows=[row.scaled(found.unit) for row in found.rows])


def camera_of(
    path: Path,
    *,
    name: str | None = None,
    glasses_by_name: Mapping[str, tuple[float, float]] | None = None,
    catalogues: Sequence[Path] = (),
    focus_m: float = 2.0,
    pixel_um: float = 3.45,
    window_px: int = 64,
) -> tuple[CameraRecipe, list[str]]:
    """The camera with a lens of a file, and a sentence for each thing that is not as the file has it.

    name: of the camera, by default that of the file.
    glasses_by_name: n_d and V_d of glasses by name.
    catalogues: files of makers of glass, .agf.
    focus_m, pixel_um, window_px: what a lens file does not say.

    Raises InputError, naming every problem: glass that is not known, no stop, nothing that says how wide the
    lens is, and what cannot be traced.
    """
    found = read_lens(path)
    rows = found.rows[1:-1]
    upper = {key.upper(): value for key, value in (glasses_by_name or {}).items()}
    surfaces, notes = _surfaces(path, rows, upper, [catalogue(each) for each in catalogues])
    notes = [*found.notes, *(note for note in notes if note not in found.notes)]
    if not any(row.stop for row in rows):
        raise InputError(f"{path} names no stop; mark a surface as the aperture stop in the program it is of")
    if any(row.thickness < 0 for row in rows[:-1]):
        raise InputError(
            f"{path}: a thickness is below 0: mirrors, and planes that are behind, are not traced"
        )
    lens: dict[str, object] = {"kind": "prescription", "source": f"{found.title or 'a lens'}, {path.name}"}
    _open(lens, surfaces, found, path)
    if not any("clear_radius_mm" in each for each in surfaces if not each.get("stop")):
        notes.append("no surface has a clear radius: nothing but the stop shuts the pupil off the axis")
    if not math.isinf(found.rows[0].thickness) and found.rows[0].thickness < 1e9:
        notes.append(
            f"its object lies {found.rows[0].thickness * 1e-3:.4g} m away; the camera is focused at"
            f" {focus_m:g} m, which [focus] says"
        )
    recipe_name = re.sub(r"[^A-Za-z0-9_-]+", "-", name or path.stem).strip("-_") or "lens"
    recipe = CameraRecipe.model_validate(
        {
            "name": recipe_name[:64],
            "lens": {**lens, "surfaces": surfaces},
            "focus": {"distance_m": focus_m, "plane": "best"},
            "sensor": {"pixel_um": pixel_um},
            "psf": {"window_px": window_px},
        }
    )
    return recipe, notes


def _surfaces(
    path: Path,
    rows: Sequence[Row],
    glasses_by_name: Mapping[str, tuple[float, float]],
    known: Sequence[Mapping[str, dict[str, object]]],
) -> tuple[list[dict[str, object]], list[str]]:
    """Tables of surfaces with their glass, and a note on each glass that is not as the file has it. Raises
    InputError, naming every glass that is not known."""
    surfaces: list[dict[str, object]] = []
    notes: list[str] = []
    problems: list[str] = []
    for number, row in enumerate(rows, 1):
        try:
            glass, note = keys_of(row.glass, row.index, glasses_by_name, known) if row.glass else ({}, "")
        except InputError as error:
            where = f"{path}, surface {number}: "
            known_already = {each.partition(": ")[2] for each in problems}
            problems += [where + each for each in error.problems if each not in known_already]
            continue
        notes += [note] if note and note not in notes else []
        surfaces.append(_surface(row, glass))
    if problems:
        raise InputError(problems)
    return surfaces, notes


def _open(lens: dict[str, object], surfaces: list[dict[str, object]], found: LensFile, path: Path) -> None:
    """Say how wide a lens is, in its table or at its stop. Raises InputError where the file does not."""
    stop = next(each for each in surfaces if each.get("stop"))
    how, value = found.opening
    if how == "stop":
        if "clear_radius_mm" not in stop:
            raise InputError(f"{path}: the file does not give the radius of the stop")
    elif how:
        stop.pop("clear_radius_mm", None)
        lens["f_number"] = value
        if how == "diameter":
            bare = PrescriptionLens.model_validate({**lens, "surfaces": surfaces})
            if wrong := bare.wrong_numbers():
                raise InputError(wrong)
            as_stack = stack(bare.surfaces)
            index = as_stack.index(torch.tensor([D_LINE], dtype=torch.float64))[0]
            lens["f_number"] = _plain(first_order(as_stack, index).focal / (value * found.unit))
    else:
        raise InputError(f"{path} does not say how wide the lens is: no entrance pupil diameter, no f-number")


def _surface(row: Row, glass: Mapping[str, object]) -> dict[str, object]:
    found: dict[str, object] = {"stop": True} if row.stop else {}
    if row.curvature:
        found["radius_mm"] = _plain(1 / row.curvature)
    if row.thickness:
        found["thickness_mm"] = _plain(row.thickness)
    found |= glass
    if row.conic:
        found["conic"] = row.conic
    for key, terms in (("aspheres_mm", row.even), ("odd_aspheres_mm", row.odd)):
        if any(terms):
            found[key] = tuple(_plain(each) for each in terms)
    if row.clear is not None:
        found["clear_radius_mm"] = _plain(row.clear)
    return found


def _plain(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
