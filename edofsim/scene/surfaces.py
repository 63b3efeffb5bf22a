"""A recipe's surfaces as BSDF settings and reflectances.

The settings name Mitsuba's plugins, all affine in the reflectance that they leave open. Few different
settings means few different programs on the renderer's side, so equal settings are one shared dictionary.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..recipe.surfaces import (
    AnySurface,
    GlassSurface,
    MattSurface,
    MetalSurface,
    PlasticSurface,
    PrincipledSurface,
)
from . import spectra
from .model import BandTexture, Surface
from .textures import build_texture, flat


@lru_cache(maxsize=256)
def _settings(items: tuple[tuple[str, object], ...]) -> Mapping[str, object]:
    return dict(items)


def settings(**items: object) -> Mapping[str, object]:
    """A BSDF's plugin dictionary; equal settings give the same object, so nobody may change it."""
    return _settings(tuple(sorted(items.items())))


def matt(reflectance: BandTexture) -> Surface:
    """Lambert's law."""
    return Surface(settings(type="diffuse"), "reflectance", reflectance)


def _glass(surface: GlassSurface, wavelengths: np.ndarray) -> Surface:
    index = spectra.refractive_index(surface.glass, wavelengths)
    clear = flat(1.0, wavelengths)
    if surface.dispersion:
        bsdf = settings(type="dielectric", ext_ior=1.0)
        return Surface(bsdf, "", clear, two_sided=False, per_band={"int_ior": index})
    middle = float(spectra.refractive_index(surface.glass, np.array([587.6e-9]))[0])
    return Surface(settings(type="dielectric", ext_ior=1.0, int_ior=middle), "", clear, two_sided=False)


def build_surface(
    surface: AnySurface, wavelengths: np.ndarray, base: Path, rng: np.random.Generator, what: str
) -> Surface:
    """A recipe's surface at `wavelengths` ([band], m).

    wavelengths: [band], metres.

    Raises InputError, naming `what`, for what cannot be read.
    """
    if isinstance(surface, MetalSurface):
        carrier = BandTexture(spectra.metal(surface.metal, wavelengths)[None].astype(np.float32))
        # material = none: Fresnel's factor is 1, the whole reflectance is the carrier's
        bsdf = settings(type="roughconductor", material="none", distribution="ggx", alpha=surface.roughness)
        return Surface(bsdf, "specular_reflectance", carrier)
    if isinstance(surface, GlassSurface):
        return _glass(surface, wavelengths)
    if surface.texture is not None:
        carrier = build_texture(surface.texture, wavelengths, base, rng, what)
    else:
        carrier = flat(surface.reflectance, wavelengths)
    if isinstance(surface, MattSurface):
        return matt(carrier)
    if isinstance(surface, PlasticSurface):
        bsdf = settings(
            type="roughplastic",
            distribution="ggx",
            alpha=surface.roughness,
            int_ior=surface.refractive_index,
            nonlinear=False,
        )
        return Surface(bsdf, "diffuse_reflectance", carrier)
    if isinstance(surface, PrincipledSurface):
        bsdf = settings(
            type="principled",
            roughness=surface.roughness,
            metallic=surface.metallic,
            specular=surface.specular,
            clearcoat=surface.clearcoat,
            clearcoat_gloss=surface.clearcoat_gloss,
            sheen=surface.sheen,
        )
        return Surface(bsdf, "base_color", carrier)
    raise TypeError(f"no surface builder for {type(surface).__name__}")
