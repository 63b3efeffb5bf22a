"""Files of measured PSFs: NPY, NPZ, MAT, EXR, and folders of pictures, with what the recipe says of them."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from ...core.images import openexr, read_exr
from ...core.limits import existing
from ...core.measurements import load_mat, read_numbers
from ...errors import InputError, first_line
from .bank import MeasuredBank

Place = tuple[float, float]
T = TypeVar("T")
ABOUT = "edofsim_psfs"
"""Attribute of an EXR file with the statements as JSON."""
NAME = re.compile(
    r"(?:^|[._ ])(?:(?:(?P<right>-?[\d.]+),)?(?P<up>-?[\d.]+)deg[._ ])?"
    r"(?P<depth>inf|infinity|[\d.]+(?=m))m?[._ ](?P<nm>[\d.]+?)nm(?:$|[._ ])"
)
"""Of a channel or picture: `0.5m.543nm`, `10deg.infinity.543nm`, `-5,10deg_0.5m_543nm`."""
TOO_MUCH = 1.001
"""Light in a PSF, of what its point sends, that is more than rounding adds."""
DARK = 0.01
"""Part of a PSF's light that may be below 0, as noise is."""


@dataclass(frozen=True)
class Stated:
    """What is said of PSFs, by a recipe or a file; None or empty where nothing is.

    fields_deg: angles (right, up) of places in the field.
    """

    fields_deg: Sequence[Place] = ()
    inverse_depths: Sequence[float] = ()
    wavelengths_nm: Sequence[float] = ()
    pixel_um: float | None = None
    orientation: str | None = None
    centre: str | None = None
    normalisation: str | None = None
    light: Sequence[float] = ()


ISET = {"psf", "wave", "umPerSamp"}
"""Variables of a file for shift-invariant optics of ISETCam."""
HOW = {
    "inverse_depths": "inverse_depths_per_m = [0, 1, 2], 1/m each",
    "wavelengths_nm": "wavelengths_nm = [482, 543, 611]",
    "pixel_um": "pixel_um, the pitch of their samples",
    "orientation": 'orientation = "upright", as pictures are looked at, or "sensor", as the lens throws them',
    "centre": 'centre = "pixel" (n // 2), "middle", "peak" or "centroid": where the chief ray lands',
    "normalisation": 'normalisation = "light" (fractions of all light) or "sum" (all light is in the array)',
}
"""What must be said, and how."""


def digest(path: Path) -> str:
    """SHA-256 of a file, or of all files of a folder with their names. Raises InputError."""
    if path.is_dir():
        files = sorted(each for each in path.iterdir() if each.is_file())
    else:
        files = [existing(path, "PSFs")]
    return _digest(tuple((each, each.stat().st_mtime_ns, each.stat().st_size) for each in files))


@lru_cache(maxsize=64)
def _digest(files: tuple[tuple[Path, int, int], ...]) -> str:
    found = hashlib.sha256()
    for path, _, size in files:
        found.update(f"{path.name} {size}|".encode() + path.read_bytes())
    return found.hexdigest()


def read_bank(path: Path, stated: Stated) -> MeasuredBank:
    """PSFs of a file or folder.

    stated: what the recipe says of them.

    Raises InputError, naming every problem: what cannot be read, is missing or contradicted, NaN, and sums
    that light cannot have.
    """
    values, own = _read(path, stated)
    said, problems = _together(stated, own)
    if problems:
        raise InputError(problems)
    places = list(said.fields_deg) or [(0.0, 0.0)]
    shape = len(places), len(said.inverse_depths), len(said.wavelengths_nm)
    values = _shaped(values, shape, path)
    order = [np.lexsort(([p[0] for p in places], [p[1] for p in places]))]
    order += [np.argsort(said.inverse_depths), np.argsort(said.wavelengths_nm)]
    values = values[np.ix_(*order)]
    places = [places[n] for n in order[0]]
    rights, ups = _grid(places)
    inverse = tuple(float(said.inverse_depths[n]) for n in order[1])
    nanometres = tuple(float(said.wavelengths_nm[n]) for n in order[2])
    _check_axes(ups, inverse, nanometres)
    _check_values(values, places, inverse, nanometres, str(said.normalisation))
    if said.orientation == "sensor":
        values = values[..., ::-1, ::-1]
    if said.normalisation == "sum":
        values = values / values.sum((-1, -2), keepdims=True)
    light = np.ones(len(places)) if len(said.light) == 0 else np.asarray(said.light, float)[order[0]]
    assert said.pixel_um is not None  # what _together asks for
    return MeasuredBank(
        torch.from_numpy(np.ascontiguousarray(values, np.float32)),
        _centres(values, str(said.centre), said.orientation == "sensor"),
        said.pixel_um * 1e-6,
        rights,
        ups,
        inverse,
        tuple(each * 1e-9 for each in nanometres),
        torch.from_numpy(light),
    )


def _read(path: Path, stated: Stated) -> tuple[np.ndarray, Stated]:
    """Numbers, [field, depth, band, y, x] but for axes of one, and what the file says of them."""
    if path.is_dir():
        pictures = sorted(each for each in path.iterdir() if NAME.search(each.stem))
        planes = {each.stem: read_numbers(each.name, None, path, str(path)) for each in pictures}
        return _of_planes(planes, {}, path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return _of_planes(read_exr(path, "PSFs"), _header(path), path)
    if suffix not in (".npz", ".mat"):
        return read_numbers(path.name, None, path.parent, "PSFs").astype(float), Stated()
    existing(path, "PSFs")
    try:
        if suffix == ".mat":
            found = load_mat(path, "PSFs")
            return _of_arrays({key: np.asarray(each) for key, each in found.items() if key[:1] != "_"}, path)
        with np.load(path, allow_pickle=False) as file:
            return _of_arrays(dict(file), path)
    except InputError:
        raise
    except Exception as error:  # damaged archives raise many kinds
        raise InputError(f"{path} cannot be read as PSFs: {first_line(error)}") from error


def _of_arrays(found: Mapping[str, np.ndarray], path: Path) -> tuple[np.ndarray, Stated]:
    if found.keys() >= ISET:
        found = _of_iset(found, path)
    if "values" not in found:
        raise InputError(
            f"{path} has no array `values` [field, depth, wavelength, y, x]; it has {', '.join(found)}"
        )
    return np.asarray(found["values"], float), _stated({key: found[key].tolist() for key in found}, path)


def _of_iset(found: Mapping[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """What `ieSaveSIDataFile` of ISETCam wrote: psf [y, x, wavelength], nanometres, micrometres (y, x). As
    its `siSynthetic` reads it: each sums to 1, about the pixel n // 2."""
    psfs, pitch = np.asarray(found["psf"], float), np.asarray(found["umPerSamp"], float)
    if psfs.ndim not in (2, 3) or pitch.size not in (1, 2) or not np.allclose(pitch, pitch.max()):
        raise InputError(
            f"{path}: psf {list(psfs.shape)} of samples of {pitch.tolist()} um; what can be read is"
            " [y, x, wavelength] with square samples"
        )
    said = {"centre": np.array("pixel"), "normalisation": np.array("sum")}
    values = np.moveaxis(np.atleast_3d(psfs), -1, 0)
    return {"values": values, "wavelengths_nm": found["wave"], "pixel_um": pitch.max(), **said}


def _stated(found: Mapping[str, object], path: Path) -> Stated:
    """What a file says by names of recipe keys; depths in metres as well."""
    try:
        numbers = {
            key: np.atleast_1d(np.asarray(found[key], float))
            for key in ("fields_deg", "inverse_depths_per_m", "depths_m", "wavelengths_nm", "light")
            if key in found
        }
        if "depths_m" in numbers:
            with np.errstate(divide="ignore"):
                numbers["inverse_depths_per_m"] = 1 / numbers.pop("depths_m")
        pitch = found.get("pixel_um")
        given = numbers.get("fields_deg", np.zeros(0))
        places = given if given.ndim == 2 else np.stack([np.zeros_like(given), given], -1)
        return Stated(
            fields_deg=[(right, up) for right, up in places.tolist()],
            inverse_depths=numbers.get("inverse_depths_per_m", np.zeros(0)).tolist(),
            wavelengths_nm=numbers.get("wavelengths_nm", np.zeros(0)).tolist(),
            pixel_um=None if pitch is None else float(np.asarray(pitch).item()),
            light=numbers.get("light", np.zeros(0)).tolist(),
            **{key: str(found[key]) for key in ("orientation", "centre", "normalisation") if key in found},
        )
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: what it says of its PSFs is no number: {first_line(error)}") from None


def _header(path: Path) -> dict[str, object]:
    try:
        with openexr().File(str(path), header_only=True) as file:
            header = dict(file.header())
        about = json.loads(header.get(ABOUT, "{}"))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: its header cannot be read: {first_line(error)}") from None
    return about if isinstance(about, dict) else {}


def _of_planes(
    planes: Mapping[str, np.ndarray], about: Mapping[str, object], path: Path
) -> tuple[np.ndarray, Stated]:
    """PSFs by their names. Raises InputError for gaps, and for planes of several sizes."""
    found: dict[tuple[Place, float, float], np.ndarray] = {}
    for name, plane in planes.items():
        said = NAME.search(name)
        if said:
            depth = said["depth"]
            at = (float(said["right"] or 0), float(said["up"] or 0))
            inverse = 0.0 if depth.startswith("inf") else 1 / float(depth)
            found[at, inverse, float(said["nm"])] = np.asarray(plane, float)
    if not found:
        raise InputError(
            f"{path} holds no PSF by name, such as 0.5m.543nm, infinity.611nm or 10deg.0.5m.543nm"
            f" (in a folder 0.5m_543nm.png); it holds {', '.join(list(planes)[:6]) or 'nothing'}"
        )
    places = sorted({place for place, _, _ in found})
    inverse, nanometres = sorted({depth for _, depth, _ in found}), sorted({nm for _, _, nm in found})
    gaps = [(p, d, nm) for p in places for d in inverse for nm in nanometres if (p, d, nm) not in found]
    if gaps:
        named = ", ".join(called(*gap) for gap in gaps[:6])
        raise InputError(
            f"{path} has gaps, {len(gaps)} in all: {named}; measure them, or leave out the others"
        )
    sizes = sorted({plane.shape for plane in found.values()})
    if len(sizes) > 1:
        raise InputError(
            f"{path} holds PSFs of {len(sizes)} sizes, {sizes[0]} and {sizes[1]}: cut them alike"
        )
    values = np.stack([found[p, d, nm] for p in places for d in inverse for nm in nanometres])
    own = _stated(about, path)
    values = values.reshape(len(places), len(inverse), len(nanometres), *sizes[0])
    stated = replace(
        own,
        fields_deg=_exact(own.fields_deg, places),
        inverse_depths=_exact(own.inverse_depths, inverse),
        wavelengths_nm=_exact(own.wavelengths_nm, nanometres),
    )
    return values, stated


def _exact(said: Sequence[T], named: Sequence[T]) -> Sequence[T]:
    """What a header says of an axis, in the order of the names, which are rounded."""
    return sorted(said) if len(said) == len(named) else named  # pyrefly: ignore - numbers, or pairs


def _together(stated: Stated, own: Stated) -> tuple[Stated, list[str]]:
    """What recipe and file say, and what is contradicted or missing."""
    problems: list[str] = []
    found = {}
    for each in fields(Stated):
        here, there = getattr(stated, each.name), getattr(own, each.name)
        given, in_file = here not in (None, (), []), there not in (None, (), [])
        if given and in_file and not _equal(here, there):
            problems.append(f"the recipe says {each.name} = {here}, the file {there}; leave out one of them")
        found[each.name] = there if in_file else here
        if not given and not in_file and each.name in HOW:
            problems.append(f"neither the file nor the recipe says {HOW[each.name]}")
    return Stated(**found), problems


def _equal(here: str | float | Sequence[object], there: str | float | Sequence[object]) -> bool:
    if isinstance(here, str) or isinstance(there, str):
        return here == there
    one, other = np.atleast_1d(np.asarray(here, float)), np.atleast_1d(np.asarray(there, float))
    return one.shape == other.shape and bool(np.allclose(np.sort(one), np.sort(other), rtol=1e-6))


def _shaped(values: np.ndarray, shape: tuple[int, int, int], path: Path) -> np.ndarray:
    """[place, depth, band, y, x], where axes of one may have been left out."""
    full = (*shape, *values.shape[-2:])
    axes = [size for size in full[:-2] if size > 1]
    if values.ndim < 2 or [size for size in values.shape[:-2] if size > 1] != axes:
        raise InputError(
            f"{path} has the shape {values.shape}; for {shape[0]} places in the field, {shape[1]} depths and"
            f" {shape[2]} wavelengths it must be [{', '.join(map(str, shape))}, y, x], axes of one left out"
        )
    return values.reshape(full)


def _grid(places: Sequence[Place]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(rights, ups) of a grid; no rights for places above the axis."""
    rights, ups = (tuple(sorted({place[axis] for place in places})) for axis in (0, 1))
    if rights == (0.0,) and ups[0] >= 0:
        return (), ups
    if len(rights) * len(ups) != len(places):
        raise InputError(
            f"{len(places)} places in the field are no full grid of {len(rights)} x {len(ups)} angles to the"
            " right and upwards; fill it, or give angles above the axis alone"
        )
    return rights, ups


def _check_axes(ups: Sequence[float], inverse: Sequence[float], nanometres: Sequence[float]) -> None:
    problems = []
    for name, axis in (("fields_deg", ups), ("depths", inverse), ("wavelengths_nm", nanometres)):
        if not all(map(math.isfinite, axis)) or any(a == b for a, b in zip(axis[:-1], axis[1:], strict=True)):
            problems.append(f"{name} of the PSFs are not finite, or twice the same: {list(axis)}")
    if inverse[0] < 0 or nanometres[0] < 100 or nanometres[-1] > 20000:
        problems.append(
            f"PSFs at {nanometres[0]:g} to {nanometres[-1]:g} nm: are these nanometres, and metres?"
        )
    if problems:
        raise InputError(problems)


def _check_values(
    values: np.ndarray,
    places: Sequence[Place],
    inverse: Sequence[float],
    nanometres: Sequence[float],
    normalisation: str,
) -> None:
    """Name PSFs that no light makes. Raises InputError."""
    problems: dict[str, list[str]] = {}
    sums = values.sum((-1, -2))
    for at in np.ndindex(values.shape[:3]):
        name, total = called(places[at[0]], inverse[at[1]], nanometres[at[2]]), sums[at]
        bad = int((~np.isfinite(values[at])).sum())
        if bad:
            problems.setdefault("hold NaN or infinity: fill them, or leave out these PSFs", []).append(
                f"{name} ({bad} samples)"
            )
        elif not total > 0:
            problems.setdefault("hold no light", []).append(name)
        elif -values[at].clip(max=0).sum() > DARK * total:
            said = "are below 0 by more than noise: subtract the right dark level"
            problems.setdefault(said, []).append(name)
        elif normalisation == "light" and total > TOO_MUCH:
            said = 'sum to more than 1, all light of a point; normalise them, or say normalisation = "sum"'
            problems.setdefault(said, []).append(f"{name} (sum {total:.4g})")
    if problems:
        raise InputError(
            [
                f"PSFs {what}: {', '.join(names[:4])}" + (f" and {len(names) - 4} more" if names[4:] else "")
                for what, names in problems.items()
            ]
        )


def called(place: Place, inverse: float, nm: float) -> str:
    """Name of a PSF, as channels and pictures have it."""
    right, up = place
    field = f"{right:.9g},{up:.9g}deg." if right else f"{up:.9g}deg." if up else ""
    return f"{field}{'infinity' if inverse == 0 else f'{1 / inverse:.9g}m'}.{nm:.9g}nm"


def _centres(values: np.ndarray, centre: str, turned: bool) -> Tensor:
    """(y, x) of chief rays, [place, depth, band, 2], in arrays that are upright; turned: they were not."""
    shape, (rows, columns) = values.shape[:3], values.shape[-2:]
    if centre == "pixel":
        at = [size - 1 - size // 2 if turned else size // 2 for size in (rows, columns)]
        return torch.tensor(at, dtype=torch.float64).expand(*shape, 2)
    if centre == "middle":
        middle = torch.tensor([(rows - 1) / 2, (columns - 1) / 2], dtype=torch.float64)
        return middle.expand(*shape, 2)
    if centre == "peak":
        peaks = np.unravel_index(values.reshape(*shape, -1).argmax(-1), (rows, columns))
        return torch.from_numpy(np.stack(peaks, -1).astype(float))
    total = values.sum((-1, -2))
    y = (values.sum(-1) * np.arange(rows)).sum(-1) / total
    x = (values.sum(-2) * np.arange(columns)).sum(-1) / total
    return torch.from_numpy(np.stack([y, x], -1))
