"""Pictures as linear light: the one reader for every file whose numbers are colours."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..errors import InputError
from .decoded import decoded
from .high_range import read_pfm, read_radiance
from .images import exr_chromaticities, exr_colours, srgb_decode, unit_rgb

REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""(x, y) of red, green, blue and white of sRGB."""


@dataclass(frozen=True)
class Picture:
    """linear: float64 [y, x, 3], linear light of sRGB's primaries, 1 is white; row 0 the top. Files of floats
        may hold values below 0.
    assumed: what the file was taken for, a phrase each.
    """

    linear: np.ndarray
    assumed: tuple[str, ...]

    def positive(self) -> Picture:
        """The same with what is below 0 taken as 0, and a phrase that says so."""
        below = float((self.linear < 0).mean())
        if not below:
            return self
        said = f"{below:.1%} of its values are below 0 and taken as 0"
        return Picture(self.linear.clip(0), (*self.assumed, said))


def read_colours(path: Path, what: str, layer: str | None = None) -> Picture:
    """A picture file of any kind as linear light.

    OpenEXR, Radiance, PFM and TIFF of floats are linear; the others are sRGB unless they say otherwise. They
    are turned upright, brought from their own colour space to sRGB, and what is transparent lies on white.

    layer: of an OpenEXR file, see `exr_colours`.

    Raises InputError for what is missing, too large, damaged, no picture, or not finite.
    """
    suffix = path.suffix.lower()
    if layer is not None and suffix != ".exr":
        raise InputError(f"{what}: {str(path)!r} has no layers; only OpenEXR files have")
    if suffix == ".exr":
        return _exr(path, what, layer)
    if suffix in (".pfm", ".hdr", ".pic"):
        image = (read_pfm if suffix == ".pfm" else read_radiance)(path, what)
        return _linear(image, path, what, ["linear light"])
    return colours_of(*_stored(path, what), name=f"{what}: {str(path)!r}")


def _stored(path: Path, what: str) -> tuple[np.ndarray, float | None, tuple[str, ...], bool]:
    found = decoded(path, what)
    linear = found.values.dtype.kind == "f"
    return found.values, found.gamma, found.said, linear


def colours_of(
    values: np.ndarray,
    gamma: float | None = None,
    said: tuple[str, ...] = (),
    linear: bool = False,
    *,
    name: str = "the picture",
) -> Picture:
    """An array [y, x] or [y, x, 1 to 4], the last of 2 or 4 channels opacity, as a picture.

    Whole numbers count to their type's largest.

    values: [y, x] or [y, x, 1 to 4].
    gamma: exponent of the transfer curve in place of sRGB's.
    linear: whether there is none.

    Raises InputError for another shape, for floats beyond [0, 1] that have a transfer curve, and for values
    that are not finite.
    """
    values = np.asarray(values)
    if values.dtype.kind not in "buif":
        raise InputError(f"{name} holds {values.dtype}, not numbers")
    if values.dtype.kind == "f":
        if values.size and not np.isfinite(values).all():
            raise InputError(f"{name} holds values that are not finite")
        if not linear and values.size:
            _check_unit(values, name)
    phrases = list(said)
    if values.ndim == 3 and values.shape[2] in (2, 4):
        phrases.append("transparency laid on white")
    if linear:
        return _linear(_opaque(values), Path(name), "", [*phrases, "linear light, since it holds floats"])
    rgb = unit_rgb(values)
    if values.ndim == 2 or values.shape[2] < 3:
        phrases.append("grey")
    if gamma is not None:
        return Picture(rgb**gamma, tuple(phrases))
    return Picture(srgb_decode(rgb), (*phrases, "sRGB"))


def _check_unit(values: np.ndarray, name: str) -> None:
    low, high = float(values.min()), float(values.max())
    if high > 1.5 or low < -0.5:  # resampled pictures overshoot a little
        scale = "255" if high <= 255.5 else "65535" if high <= 65535.5 else "its largest value"
        raise InputError(
            f"{name} holds floats from {low:.4g} to {high:.4g}; they count from 0 to 1: divide by {scale}"
        )


def _opaque(values: np.ndarray) -> np.ndarray:
    """Linear colours on white, where there is opacity."""
    if values.ndim == 3 and values.shape[2] in (2, 4):
        alpha = values[..., -1:].clip(0, 1)
        return values[..., :-1] * alpha + (1 - alpha)
    return values


def _exr(path: Path, what: str, layer: str | None) -> Picture:
    image, channels = exr_colours(path, what, layer)
    said = [f"linear light of the channels {channels}"]
    stated = exr_chromaticities(path, what)
    if stated is not None and np.abs(np.subtract(stated, REC_709)).max() > 2e-3:
        image = image @ _to_srgb(stated).T
        said.append("from the primaries that the file states to sRGB's")
    return _linear(image, path, what, said)


@lru_cache(maxsize=8)
def _to_srgb(chromaticities: tuple[float, ...]) -> np.ndarray:
    """Matrix [3, 3] from linear RGB of other primaries to sRGB's, white to white (Bradford)."""
    from colour import RGB_COLOURSPACES, RGB_Colourspace, matrix_RGB_to_RGB

    primaries = np.reshape(chromaticities[:6], (3, 2))
    own = RGB_Colourspace("file", primaries, np.array(chromaticities[6:]))
    return np.asarray(matrix_RGB_to_RGB(own, RGB_COLOURSPACES["sRGB"], "Bradford"))


def _linear(image: np.ndarray, path: Path, what: str, said: list[str]) -> Picture:
    """Linear light [y, x] or [y, x, 1 or 3]."""
    image = np.asarray(image, np.float64)
    name = f"{what}: {str(path)!r}" if what else str(path)
    image = image[..., None] if image.ndim == 2 else image
    if image.ndim != 3 or image.shape[2] not in (1, 3):
        raise InputError(f"{name} has the shape {list(image.shape)}; a picture has [y, x, 1 to 4 channels]")
    if not np.isfinite(image).all():
        raise InputError(f"{name} holds values that are not finite")
    if image.shape[2] == 1:
        said.append("grey")
    return Picture(np.broadcast_to(image, (*image.shape[:2], 3)), tuple(said))
