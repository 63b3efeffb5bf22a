"""Cameras by numbers, `edofsim.camera`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from .errors import InputError
from .optics import Camera
from .recipe import CameraRecipe, load_camera
from .recipe.toml import validate
from .restore.checkpoint import camera_with_mask, load_checkpoint

KEYS = (
    ("focus", "distance_m"),
    ("sensor", "pixel_um"),
    ("sensor", "read_noise"),
    ("sensor", "full_well_electrons"),
    ("sensor", "bits"),
    ("sensor", "bayer"),
    ("psf", "window_px"),
)
"""Tables of a camera recipe and keys in them, of the numbers that `camera` takes, in order."""


def camera(
    source: str | Path | None = None,
    *,
    focal_length: float | None = None,
    f_number: float | None = None,
    focus: float | None = None,
    pixel: float | None = None,
    read_noise: float | None = None,
    full_well: float | None = None,
    bits: int | None = None,
    bayer: str | None = None,
    window: int | None = None,
    mask: Mapping[str, object] | None = None,
    name: str | None = None,
    height: Tensor | np.ndarray | None = None,
    amplitude: Tensor | np.ndarray | None = None,
    pitch: float | None = None,
    material: str | None = None,
    network: str | Path | None = None,
) -> Camera:
    """A camera: a shipped one by name, a recipe's, or one given by numbers.

    source: name such as `paper-learned`, or a TOML file; None for the paper's lens without a mask.
    focal_length: of an ideal lens in place of that one's [m], which takes an f_number too.
    f_number: focal length over the width of the aperture.
    focus: the distance that is sharp [m].
    pixel: pitch of the sensor [m].
    read_noise: standard deviation, full scale 1.
    full_well: electrons at full scale, for shot noise.
    bits: of the converter.
    bayer: the mosaic's first four pixels, such as `RGGB`.
    window: width of the PSFs, pixels.
    mask: the table [mask] of a recipe, such as `{"kind": "cubic", "alpha_rad": 60}`; its `file` is relative
        to the working folder.
    name: of the camera.
    height: height map of the mask [n, n] in metres, row 0 the top of the pupil; gradients reach a tensor.
    amplitude: what the mask also lets through of a wave, [n, n] from 0 to 1, by samples that just cover the
        pupil; gradients reach a tensor.
    pitch: of the height map's samples [m]; None where they just cover the pupil.
    material: of the height map; None for the photoresist S1813.
    network: checkpoint whose mask the camera has.

    Raises InputError for what cannot be a camera, naming every problem.
    """
    loaded = None if source is None else load_camera(source)
    recipe = CameraRecipe(name="paper-clear") if loaded is None else loaded.recipe
    base = Path.cwd() if loaded is None else loaded.base
    _check_lengths(focal_length=focal_length, pixel=pixel, pitch=pitch)
    _check_together((mask, height, network), (focal_length, f_number), height, (pitch, material))
    _check_together((amplitude, network), (), (), ())
    given = recipe.model_dump(mode="json", exclude_unset=True)
    pixel_um = None if pixel is None else pixel * 1e6
    tables = _tables(given, (focus, pixel_um, read_noise, full_well, bits, bayer, window))
    tables |= {} if mask is None else {"mask": dict(mask)}
    if focal_length is not None:
        tables["lens"] = {"kind": "ideal", "f_number": f_number, "focal_length_mm": focal_length * 1e3}
    given_map = None if height is None else _heights(height)
    if given_map is not None and not (pitch is None and material is None):
        tables["mask"] = _mask_of(given_map, _with(given, tables), base, pitch, material)
    if tables or name:
        recipe = validate(CameraRecipe, _with(given, tables, name))
    if network is not None:
        return camera_with_mask(recipe, load_checkpoint(network, recipe), base)
    made = Camera.from_recipe(recipe, base)
    amplitude = None if amplitude is None else torch.as_tensor(amplitude)
    return (made if given_map is None else made.with_height(given_map)).with_amplitude(amplitude)


def _check_together(
    masks: Iterable[object], lens: Iterable[object], height: object, of_height: Iterable[object]
) -> None:
    """Raises InputError for arguments that exclude each other, or are given without each other."""
    if sum(each is not None for each in masks) > 1:
        raise InputError(
            "the mask is that of mask or height, with an amplitude, or of network: give one of them"
        )
    if sum(each is None for each in lens) == 1:
        raise InputError("focal_length and f_number belong together: give both, or neither")
    if height is None and any(each is not None for each in of_height):
        raise InputError("pitch and material are those of a height map: give height as well")


def _tables(given: Mapping[str, object], values: Iterable[object]) -> dict[str, dict[str, object]]:
    """Tables of a recipe with other values of `KEYS`; None keeps what is given."""
    found: dict[str, dict[str, object]] = {}
    for (table, key), value in zip(KEYS, values, strict=True):
        if value is not None:
            known = given.get(table, {})
            assert isinstance(known, dict)
            found.setdefault(table, dict(known))[key] = value
    return found


def _mask_of(
    given_map: Tensor, given: Mapping[str, object], base: Path, pitch: float | None, material: str | None
) -> dict[str, object]:
    """The table [mask] of a height map; its samples just cover the pupil where no pitch is given."""
    clear = CameraRecipe.model_validate({**given, "mask": {"kind": "clear"}})
    across = 2 * Camera.from_recipe(clear, base).aperture_radius * (1 + 1e-12) / given_map.shape[0]
    made_of = {} if material is None else {"material": material}
    return {"kind": "height-map", "pitch_um": (across if pitch is None else pitch) * 1e6, **made_of}


def _with(
    given: Mapping[str, object], tables: Mapping[str, object], name: str | None = None
) -> dict[str, object]:
    """What a recipe says with other tables, and under another name."""
    return {**given, **tables, **({} if name is None else {"name": name})}


def _check_lengths(**lengths: float | None) -> None:
    """Raises InputError for lengths of small things that are metres: numbers of another unit look so."""
    small = {"focal_length": (10.0, "mm", 1e-3), "pixel": (1e-3, "um", 1e-6), "pitch": (1e-2, "um", 1e-6)}
    for name, value in lengths.items():
        most, unit, metres = small[name]
        if value is not None and value >= most:
            raise InputError(
                f"{name} = {value:g} m: lengths are in metres; {value:g} {unit} is {value * metres:.6g}"
            )


def _heights(height: object) -> Tensor:
    """A height map [n, n] as a tensor. Raises InputError for what is none."""
    if isinstance(height, str | Path):
        raise InputError(
            f"height = {str(height)!r}: give an array [n, n] in metres; a file goes into "
            'mask={"kind": "height-map", "file": ..., "pitch_um": ...}'
        )
    if isinstance(height, Tensor):
        found = height
    else:
        values = np.asarray(height)
        if values.dtype.kind not in "buif":
            raise InputError(f"height holds {values.dtype}, not real numbers: give an array [n, n] in metres")
        found = torch.tensor(np.array(values, float))
    if found.ndim != 2 or found.shape[0] != found.shape[1]:
        raise InputError(f"height has the shape {list(found.shape)}; a height map is square, [n, n]")
    return found
