"""Lights of a scene: from infinity, and lamps in the scene, which are seen where they stand in the view."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .base import NotNegative, Positive, RecipeModel, Triple
from .placed import ObjectName
from .surfaces import Reflectance


class EnvironmentLight(RecipeModel):
    """The same light from every direction at infinity. Its luminance is that of an equal-energy light of
    `radiance` (W/m2/sr/nm)."""

    kind: Literal["environment"]
    name: ObjectName | None = None
    illuminant: str = "D65"
    radiance: Positive = 1.0


class SkyLight(RecipeModel):
    """A daylight sky: blue overhead, white towards the horizon, the ground's reflection from below."""

    kind: Literal["sky"]
    name: ObjectName | None = None
    radiance: Positive = 1.0
    """luminance-weighted radiance at the horizon, W/m2/sr/nm"""
    zenith: Positive = 0.8
    """radiance overhead as a fraction of the horizon's"""
    ground: NotNegative = 0.3
    """radiance from below as a fraction of the horizon's"""
    horizon_cct_k: Annotated[float, Field(ge=4000, le=25000)] = 6500.0
    zenith_cct_k: Annotated[float, Field(ge=4000, le=25000)] = 15000.0
    ground_reflectance: Reflectance = "light skin"


class AreaLamp(RecipeModel):
    """A rectangular lamp that shines towards `target_mm`; it may stand outside the view."""

    kind: Literal["area"]
    name: ObjectName | None = None
    position_mm: Triple
    target_mm: Triple
    size_mm: tuple[Positive, Positive] = (300.0, 300.0)
    illuminant: str = "A"
    radiance: Positive = 10.0


class EnvironmentMap(RecipeModel):
    """A picture of all directions (equirectangular, .exr or .hdr, linear sRGB), as light from infinity.

    Its middle column is straight ahead before it is turned by `turn_deg` (positive: to the right). White of
    1 becomes the spectrum of `illuminant` times `scale`."""

    kind: Literal["environment_map"]
    name: ObjectName | None = None
    path: str
    scale: Positive = 1.0
    turn_deg: float = 0.0
    illuminant: str = "D65"


class Bulb(RecipeModel):
    """A shining ball."""

    kind: Literal["bulb"]
    name: ObjectName | None = None
    position_mm: Triple
    radius_mm: Positive = 5.0
    illuminant: str = "A"
    radiance: Positive = 10.0


class NeonTube(RecipeModel):
    """A shining tube along a smooth curve through `points_mm`."""

    kind: Literal["neon"]
    name: ObjectName | None = None
    points_mm: Annotated[tuple[Triple, ...], Field(min_length=2, max_length=1000)]
    radius_mm: Positive = 1.0
    closed: bool = False
    illuminant: str = "A"
    colour: Reflectance = 1.0
    """a filter over the illuminant"""
    radiance: Positive = 10.0


AnyLight = Annotated[
    EnvironmentLight | SkyLight | EnvironmentMap | AreaLamp | Bulb | NeonTube, Field(discriminator="kind")
]
