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
    """name of the light, for `family`"""
    illuminant: str = "D65"
    """spectrum: a CIE illuminant, such as D65, A or LED-B3"""
    radiance: Positive = 1.0
    """radiance from every direction, W/m2/sr/nm, as bright as an equal-energy light of it"""


class SkyLight(RecipeModel):
    """A daylight sky: blue overhead, white towards the horizon, the ground's reflection from below."""

    kind: Literal["sky"]
    name: ObjectName | None = None
    """name of the light, for `family`"""
    radiance: Positive = 1.0
    """luminance-weighted radiance at the horizon, W/m2/sr/nm"""
    zenith: Positive = 0.8
    """radiance overhead as a fraction of the horizon's"""
    ground: NotNegative = 0.3
    """radiance from below as a fraction of the horizon's"""
    horizon_cct_k: Annotated[float, Field(ge=4000, le=25000)] = 6500.0
    """colour temperature at the horizon, K"""
    zenith_cct_k: Annotated[float, Field(ge=4000, le=25000)] = 15000.0
    """colour temperature overhead, K"""
    ground_reflectance: Reflectance = "light skin"
    """reflectance of the ground"""


class AreaLamp(RecipeModel):
    """A rectangular lamp that shines towards `target_mm`; it may stand outside the view."""

    kind: Literal["area"]
    name: ObjectName | None = None
    """name of the light, for `family`"""
    position_mm: Triple
    """centre of the lamp, camera space, mm"""
    target_mm: Triple
    """point that the lamp faces, camera space, mm"""
    size_mm: tuple[Positive, Positive] = (300.0, 300.0)
    """width and height of the lamp, mm"""
    illuminant: str = "A"
    """spectrum: a CIE illuminant"""
    radiance: Positive = 10.0
    """radiance of the lamp, W/m2/sr/nm, as bright as an equal-energy light of it"""


class EnvironmentMap(RecipeModel):
    """A picture of all directions (equirectangular, .exr or .hdr, linear sRGB), as light from infinity.

    Its middle column is straight ahead before it is turned by `turn_deg` (positive: to the right). White of
    1 becomes the spectrum of `illuminant` times `scale`."""

    kind: Literal["environment_map"]
    name: ObjectName | None = None
    """name of the light, for `family`"""
    path: str
    """equirectangular picture (.exr, .hdr), relative to the recipe's folder"""
    scale: Positive = 1.0
    """factor on the picture's values"""
    turn_deg: float = 0.0
    """turn about the vertical, degrees; positive turns the picture to the right"""
    illuminant: str = "D65"
    """spectrum that white of the picture has: a CIE illuminant"""


class Bulb(RecipeModel):
    """A shining ball."""

    kind: Literal["bulb"]
    name: ObjectName | None = None
    """name of the light, for `family`"""
    position_mm: Triple
    """centre of the ball, camera space, mm"""
    radius_mm: Positive = 5.0
    """radius of the ball, mm"""
    illuminant: str = "A"
    """spectrum: a CIE illuminant"""
    radiance: Positive = 10.0
    """radiance of the ball, W/m2/sr/nm, as bright as an equal-energy light of it"""


class NeonTube(RecipeModel):
    """A shining tube along a smooth curve through `points_mm`."""

    kind: Literal["neon"]
    name: ObjectName | None = None
    """name of the light, for `family`"""
    points_mm: Annotated[tuple[Triple, ...], Field(min_length=2, max_length=1000)]
    """points of the smooth curve that the tube follows, camera space, mm"""
    radius_mm: Positive = 1.0
    """radius of the tube, mm"""
    closed: bool = False
    """whether the curve returns to its first point"""
    illuminant: str = "A"
    """spectrum: a CIE illuminant"""
    colour: Reflectance = 1.0
    """a filter over the illuminant"""
    radiance: Positive = 10.0
    """radiance of the tube before its filter, W/m2/sr/nm"""


AnyLight = Annotated[
    EnvironmentLight | SkyLight | EnvironmentMap | AreaLamp | Bulb | NeonTube, Field(discriminator="kind")
]
