"""Textures: photographs, files of the user's, and procedural ones, as coefficients over basis spectra.

A texture is a BandTexture whose image holds, at every point, at most three coefficients. Photographs are
decoded from sRGB to linear and put over the basis of Mallett and Yuksel (EGSR 2019).
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image

from ..core.colours import read_colours
from ..core.images import srgb_decode, unit_rgb
from ..core.shipped import installed
from ..errors import InputError
from ..recipe.surfaces import (
    AnyTexture,
    CheckerTexture,
    FileTexture,
    MeshTexture,
    NoiseTexture,
    PhotoTexture,
    WoodTexture,
)
from .model import BandTexture
from .spectra import hex_to_linear, reflectance, srgb_basis

PHOTOGRAPHS = (
    "astronaut", "brick", "camera", "cell", "chelsea", "coffee", "coins", "color", "grass", "gravel",
    "hubble_deep_field", "ihc", "moon", "motorcycle_left", "page", "retina", "rocket", "text",
)  # fmt: skip
"""Pictures of skimage.data that come inside its wheel, so that nothing is downloaded."""


def flat(value: float | str, wavelengths: np.ndarray) -> BandTexture:
    """The same reflectance everywhere; see `spectra.reflectance`.

    wavelengths: [band], metres.
    """
    return BandTexture(reflectance(value, wavelengths)[None].astype(np.float32))


def from_srgb(image: np.ndarray, wavelengths: np.ndarray) -> BandTexture:
    """An sRGB picture, uint8/uint16 or float in [0, 1], [y, x], [y, x, 3] or [y, x, 4].

    image: [y, x], [y, x, 3] or [y, x, 4], uint8, uint16, or float in [0, 1].
    wavelengths: [band], metres.
    """
    return BandTexture(
        srgb_basis(wavelengths).astype(np.float32), srgb_decode(unit_rgb(image)).astype(np.float32)
    )


def mixture(weight: np.ndarray, first: np.ndarray, second: np.ndarray) -> BandTexture:
    """Two spectra mixed by an image: (1 - weight) first + weight second.

    weight: [y, x] in [0, 1].
    first, second: [band].
    """
    image = np.stack([1 - weight, weight], axis=-1)
    return BandTexture(np.stack([first, second]).astype(np.float32), image.astype(np.float32))


@lru_cache(maxsize=32)
def photo(name: str) -> np.ndarray:
    """A photograph of skimage.data, as it is stored. Raises InputError for one that would be downloaded."""
    if name not in PHOTOGRAPHS:
        raise InputError(f"there is no photograph {name!r}; known: {', '.join(PHOTOGRAPHS)}")
    folder = installed("skimage") / "data"
    found = [path for path in (folder / f"{name}.png", folder / f"{name}.jpg") if path.exists()]
    if not found:
        raise InputError(f"this installation of scikit-image does not have its photograph {name!r}")
    with Image.open(found[0]) as picture:
        return np.asarray(picture)


def _cropped(image: np.ndarray, crop: tuple[float, float, float, float] | None) -> np.ndarray:
    if crop is None:
        return image
    rows, columns = image.shape[:2]
    left, top, right, bottom = crop
    x0, x1, y0, y1 = round(left * columns), round(right * columns), round(top * rows), round(bottom * rows)
    if x1 <= x0 or y1 <= y0:
        raise InputError(f"the crop {crop} is empty: it is left, top, right, bottom as fractions")
    return image[y0:y1, x0:x1]


def periodic_noise(
    shape: tuple[int, int], scale: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """Smooth noise without seams at the borders, [y, x] in [0, 1] with a flat histogram.

    scale: standard deviation of the smoothing along (y, x) as a fraction of the image.
    """
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    gain = np.exp(-2 * np.pi**2 * ((fy * shape[0] * scale[0]) ** 2 + (fx * shape[1] * scale[1]) ** 2))
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * gain, s=shape)
    rank = np.empty(noise.size)
    rank[np.argsort(noise, axis=None, kind="stable")] = np.linspace(0, 1, noise.size)
    return rank.reshape(shape)


def _wood(texture: WoodTexture, wavelengths: np.ndarray, rng: np.random.Generator) -> BandTexture:
    shape = (512, 512)
    warp = periodic_noise(shape, (0.25, 0.06), rng)
    fine = periodic_noise(shape, (0.12, 0.0015), rng)
    across = np.arange(shape[1]) / shape[1]
    phase = texture.rings * across + 2.5 * warp
    ring = 0.5 - 0.5 * np.cos(2 * np.pi * (phase - np.floor(phase)) ** 0.7)
    weight = np.clip(0.55 * ring + 0.45 * fine, 0, 1)
    dark, light = (hex_to_linear(c) @ srgb_basis(wavelengths) for c in (texture.dark, texture.light))
    return mixture(weight, light, dark)


def build_texture(
    texture: AnyTexture, wavelengths: np.ndarray, base: Path, rng: np.random.Generator, what: str
) -> BandTexture:
    """A recipe's texture as coefficients over spectra. `what` names the object in errors.

    wavelengths: [band], metres.

    Files are relative to `base`. Raises InputError for what cannot be read.
    """
    if isinstance(texture, PhotoTexture):
        return from_srgb(_cropped(photo(texture.name), texture.crop), wavelengths)
    if isinstance(texture, FileTexture):
        picture = read_colours(base / texture.path, f"{what} (texture)")
        basis = srgb_basis(wavelengths).astype(np.float32)
        return BandTexture(basis, picture.linear.clip(0, 1).astype(np.float32))
    if isinstance(texture, WoodTexture):
        return _wood(texture, wavelengths, rng)
    if isinstance(texture, NoiseTexture):
        weight = periodic_noise((512, 512), (texture.grain, texture.grain), rng)
        first, second = (hex_to_linear(c) @ srgb_basis(wavelengths) for c in (texture.first, texture.second))
        return mixture(weight, first, second)
    if isinstance(texture, CheckerTexture):
        side = 16  # texels a square: edges stay sharp under bilinear interpolation
        odd = np.indices((texture.rows, texture.columns)).sum(axis=0) % 2
        weight = np.kron(odd, np.ones((side, side)))
        return mixture(weight, *(reflectance(r, wavelengths) for r in (texture.first, texture.second)))
    if isinstance(texture, MeshTexture):
        raise InputError(f'{what}: texture kind "mesh" is the colours of a mesh\'s file; it has no such file')
    raise TypeError(f"no texture builder for {type(texture).__name__}")
