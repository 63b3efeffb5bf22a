"""What surrounds things: table-top, wall, window, hills, hallway, foliage, houses, clouds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import NotNegative, Positive, RecipeModel
from .placed import ObjectName, Placed
from .surfaces import (
    AnySurface,
    CheckerTexture,
    MattSurface,
    NoiseTexture,
    PhotoTexture,
    PlasticSurface,
    WoodTexture,
)


class Table(RecipeModel):
    """A horizontal table-top from `near_m` to `far_m`; its top lies at `y_mm`.

    The texture is laid in tiles of `tile_mm` (across, along the depth)."""

    kind: Literal["table"]
    name: ObjectName | None = None
    y_mm: float
    near_m: float
    far_m: float
    width_mm: Positive = 1200.0
    thickness_mm: Positive = 20.0
    tile_mm: tuple[Positive, Positive] = (90.0, 700.0)
    surface: AnySurface = PlasticSurface(kind="plastic", texture=WoodTexture(kind="wood"), roughness=0.25)

    @model_validator(mode="after")
    def _ordered(self) -> Table:
        if self.far_m <= self.near_m:
            raise ValueError("far_m must be above near_m")
        return self


class WindowOpening(RecipeModel):
    """A window in a wall: centre and size in the wall, the width of its frame, and its panes."""

    x_mm: float
    y_mm: float
    width_mm: Positive
    height_mm: Positive
    frame_mm: NotNegative = 10.0
    columns: Annotated[int, Field(ge=1, le=16)] = 1
    rows: Annotated[int, Field(ge=1, le=16)] = 1
    surface: AnySurface = PlasticSurface(kind="plastic", reflectance=0.8, roughness=0.2)


class Wall(RecipeModel):
    """A wall across the view at `depth_m`, with at most one window."""

    kind: Literal["wall"]
    name: ObjectName | None = None
    depth_m: float
    x_mm: float = 0.0
    y_mm: float = 0.0
    width_mm: Positive = 3000.0
    height_mm: Positive = 2000.0
    window: WindowOpening | None = None
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.6)

    @model_validator(mode="after")
    def _window_in_wall(self) -> Wall:
        w = self.window
        if w is None:
            return self
        inside_x = abs(w.x_mm) + w.width_mm / 2 < self.width_mm / 2
        inside_y = abs(w.y_mm) + w.height_mm / 2 < self.height_mm / 2
        if not (inside_x and inside_y):
            raise ValueError("the window must lie inside the wall (x_mm and y_mm start at the wall's centre)")
        return self


class Hills(Placed):
    """A ridge of hills across the view; `height_mm` and `base_mm` are measured from y."""

    kind: Literal["hills"]
    width_mm: Positive
    height_mm: Positive
    base_mm: NotNegative = 0.0
    """how far the slope goes on below y"""
    roughness: Annotated[float, Field(ge=0, le=2)] = 1.0
    """how quickly the ridge's small features fade: 0 jagged, 2 smooth"""
    surface: AnySurface = MattSurface(kind="matt", reflectance="foliage")
    anchor: Literal["centre", "base"] = "centre"


class Hallway(RecipeModel):
    """A corridor towards its end wall: floor, ceiling and side walls that slant through all depths.

    Doors stand along both sides, and panels in the ceiling shine. `y_mm` is the floor's height. The floor's
    texture is laid in tiles as wide as the corridor and four times as long."""

    kind: Literal["hallway"]
    name: ObjectName | None = None
    near_m: float = 0.45
    far_m: float = 5.0
    x_mm: float = 0.0
    y_mm: float = -30.0
    width_mm: Positive = 80.0
    height_mm: Positive = 66.0
    doors: Annotated[int, Field(ge=0, le=40)] = 5
    lamps: Annotated[int, Field(ge=0, le=40)] = 6
    lamp_radiance: NotNegative = 4.0
    lamp_illuminant: str = "LED-B3"
    floor: AnySurface = MattSurface(
        kind="matt", texture=CheckerTexture(kind="checker", first=0.12, second=0.6, columns=4, rows=4)
    )
    walls: AnySurface = MattSurface(kind="matt", reflectance="#e2d5b8")
    ceiling: AnySurface = MattSurface(kind="matt", reflectance=0.8)
    end: AnySurface = MattSurface(kind="matt", texture=PhotoTexture(kind="photo", name="coffee"))
    door: AnySurface = PlasticSurface(kind="plastic", reflectance="#7b4a2d", roughness=0.2)

    @model_validator(mode="after")
    def _ordered(self) -> Hallway:
        if self.far_m <= self.near_m:
            raise ValueError("far_m must be above near_m")
        return self


class Foliage(Placed):
    """Leaves on thin stems, scattered through a block of space about its centre."""

    kind: Literal["foliage"]
    width_mm: Positive
    height_mm: Positive
    length_mm: Positive
    """extent along z"""
    leaves: Annotated[int, Field(ge=1, le=20000)] = 300
    leaf_mm: Positive = 8.0
    slenderness: Annotated[float, Field(ge=1, le=40)] = 3.0
    """length of a leaf over its width; blades of grass have 20 and more"""
    stems: Annotated[int, Field(ge=0, le=500)] = 12
    stem_mm: Positive = 0.4
    upright: Annotated[float, Field(ge=0, le=1)] = 0.3
    """0: leaves point anywhere; 1: they all stand up"""
    surface: AnySurface = MattSurface(
        kind="matt", texture=NoiseTexture(kind="noise", first="#2f5a1e", second="#9dbb4a", grain=0.05)
    )
    anchor: Literal["centre", "base"] = "centre"


class Facade(Placed):
    """The front of a dark house with rows of windows, some of them lit."""

    kind: Literal["facade"]
    width_mm: Positive
    height_mm: Positive
    columns: Annotated[int, Field(ge=1, le=200)] = 8
    rows: Annotated[int, Field(ge=1, le=200)] = 6
    lit: Annotated[float, Field(ge=0, le=1)] = 0.4
    radiance: NotNegative = 5.0
    illuminant: str = "LED-B1"
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.08)


class CloudBank(Placed):
    """A picture of cumulus clouds on blue, to be put so far away that it is at infinity for any lens.

    It scatters the scene's light, so it is as bright as a white paper there; `cover` is the fraction of
    the sky behind clouds."""

    kind: Literal["clouds"]
    width_mm: Positive
    height_mm: Positive
    cover: Annotated[float, Field(ge=0.05, le=0.95)] = 0.5
    pixels: Annotated[int, Field(ge=64, le=4096)] = 1024
    """texture pixels along the longer side"""
    blue: str = "#3f74b5"
    anchor: Literal["centre", "base"] = "centre"
