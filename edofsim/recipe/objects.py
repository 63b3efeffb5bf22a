"""Objects and lights of a scene recipe.

An object is placed by `depth_m` and either `x_mm`, `y_mm` or `x_frame`, `y_frame` (fractions of half the
frame at that depth: -1 is its left or lower edge, +1 its right or upper edge). `on` names an object given
earlier in the recipe, on whose highest point this one stands.

Local axes before turning: x right, y up, z away from the camera; the front of an object faces the camera.
Turns are made in the order roll (in the picture plane, counter-clockwise as seen), tilt (about x: positive
leans the top away), turn (about the vertical: positive turns the front towards the left).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import NotNegative, Positive, RecipeModel, Triple
from .surfaces import (
    AnySurface,
    MattSurface,
    MetalSurface,
    PlasticSurface,
    Reflectance,
    WoodTexture,
)

ObjectName = Annotated[str, Field(min_length=1, max_length=64)]


class Placed(RecipeModel):
    """Where an object is and how it is turned."""

    name: ObjectName | None = None
    depth_m: float
    x_mm: float | None = None
    y_mm: float | None = None
    x_frame: float | None = None
    y_frame: float | None = None
    on: ObjectName | None = None
    turn_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    anchor: Literal["centre", "base"] = "base"
    """what is placed: the object's own centre, or the middle of its base (its lowest point rests at y)"""

    @model_validator(mode="after")
    def _placed_once(self) -> Placed:
        if self.x_mm is not None and self.x_frame is not None:
            raise ValueError("give x_mm or x_frame, not both")
        if sum(value is not None for value in (self.y_mm, self.y_frame, self.on)) > 1:
            raise ValueError("give one of y_mm, y_frame and on")
        if self.on is not None and self.anchor != "base":
            raise ValueError('an object that stands on another needs anchor = "base"')
        return self


class Panel(Placed):
    """A flat rectangle: a poster, a card, a photograph."""

    kind: Literal["panel"]
    width_mm: Positive
    height_mm: Positive
    surface: AnySurface = MattSurface(kind="matt")
    anchor: Literal["centre", "base"] = "centre"


class Box(Placed):
    """A rectangular block. A texture covers each of its sides."""

    kind: Literal["box"]
    width_mm: Positive
    height_mm: Positive
    length_mm: Positive
    """its size along z"""
    surface: AnySurface = MattSurface(kind="matt")


class Sphere(Placed):
    """A ball."""

    kind: Literal["sphere"]
    radius_mm: Positive
    surface: AnySurface = PlasticSurface(kind="plastic")


class Cylinder(Placed):
    """An upright solid cylinder."""

    kind: Literal["cylinder"]
    radius_mm: Positive
    height_mm: Positive
    surface: AnySurface = PlasticSurface(kind="plastic")


class Mug(Placed):
    """A mug with a handle, open at the top."""

    kind: Literal["mug"]
    radius_mm: Positive = 40.0
    height_mm: Positive = 95.0
    wall_mm: Positive = 3.5
    handle: bool = True
    surface: AnySurface = PlasticSurface(kind="plastic")

    @model_validator(mode="after")
    def _hollow(self) -> Mug:
        if self.wall_mm >= min(self.radius_mm, self.height_mm) / 2:
            raise ValueError("wall_mm must be below half of the radius and half of the height")
        return self


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


class Book(Placed):
    """A closed book that stands upright with its front cover to the camera.

    `turn_deg = 90` shows its pages, -90 its spine; `roll_deg = 90, tilt_deg = 90` lays it on its back with
    the spine to the camera."""

    kind: Literal["book"]
    width_mm: Positive = 150.0
    height_mm: Positive = 210.0
    thickness_mm: Positive = 25.0
    cover: AnySurface = PlasticSurface(kind="plastic", reflectance="#27476e", roughness=0.2)
    """the binding's surface"""
    front: AnySurface | None = None
    """the front cover's, if another (a photograph)"""
    title: str = ""
    """printed on the spine"""


class Pencil(Placed):
    """A sharpened hexagonal pencil, standing on its end with the tip up.

    `tilt_deg = 90` lays it along z, tip away; `roll_deg = 90` along x."""

    kind: Literal["pencil"]
    length_mm: Positive = 175.0
    width_mm: Positive = 7.0
    tip_mm: Positive = 20.0
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="orange yellow", roughness=0.12)

    @model_validator(mode="after")
    def _longer_than_tip(self) -> Pencil:
        if self.tip_mm >= self.length_mm:
            raise ValueError("tip_mm must be below length_mm")
        return self


class Wire(Placed):
    """A round wire along a smooth curve through `points_mm` (local x, y, z)."""

    kind: Literal["wire"]
    points_mm: Annotated[tuple[Triple, ...], Field(min_length=2, max_length=1000)]
    radius_mm: Positive = 0.25
    closed: bool = False
    surface: AnySurface = MetalSurface(kind="metal", metal="copper", roughness=0.2)
    anchor: Literal["centre", "base"] = "centre"


class Bust(Placed):
    """A head and shoulders on a round plinth, different for every seed."""

    kind: Literal["bust"]
    height_mm: Positive = 300.0
    detail: Annotated[int, Field(ge=24, le=256)] = 96
    """grid points across the height of the implicit surface"""
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.75)


class UsafChart(Placed):
    """A USAF-1951 resolution chart (MIL-STD-150A), as large as its groups make it.

    `first_group` is the coarser group of the outermost pair; `pairs` nested pairs of groups are drawn."""

    kind: Literal["usaf_chart"]
    first_group: Annotated[int, Field(ge=-8, le=8)] = 0
    pairs: Annotated[int, Field(ge=1, le=3)] = 2
    border_mm: NotNegative | None = None
    """white border around the pattern; None: four bars of the largest element"""
    white: Reflectance = 0.85
    black: Reflectance = 0.03
    pixels_per_bar: Annotated[int, Field(ge=2, le=32)] = 4
    """texture pixels across the finest bar of the chart"""
    anchor: Literal["centre", "base"] = "centre"


class ColorChecker(Placed):
    """The 24 patches with their measured spectra, on a black card."""

    kind: Literal["color_checker"]
    width_mm: Positive = 280.0
    card: Reflectance = 0.03
    anchor: Literal["centre", "base"] = "centre"


class TextPage(Placed):
    """A page of printed text."""

    kind: Literal["text_page"]
    width_mm: Positive = 210.0
    height_mm: Positive = 297.0
    text: str | None = None
    """None: a text about depth of field"""
    lines: Annotated[int, Field(ge=3, le=120)] = 28
    paper: Reflectance = 0.82
    ink: Reflectance = 0.04
    anchor: Literal["centre", "base"] = "centre"


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


class MeshFile(Placed):
    """A mesh of yours (OBJ, PLY, GLB, STL); the path is relative to the recipe's folder.

    The file's axes are taken as x right, y up, z towards the viewer, as most programs write them."""

    kind: Literal["mesh"]
    path: str
    size_mm: Positive
    """longest side of the bounding box after scaling"""
    surface: AnySurface = MattSurface(kind="matt")
    smooth: bool = True


AnyObject = Annotated[
    Panel | Box | Sphere | Cylinder | Mug | Table | Wall | Book | Pencil | Wire | Bust | UsafChart
    | ColorChecker | TextPage | Hills | MeshFile,
    Field(discriminator="kind"),
]  # fmt: skip


class EnvironmentLight(RecipeModel):
    """The same light from every direction at infinity. Its luminance is that of an equal-energy light of
    `radiance` (W/m2/sr/nm)."""

    kind: Literal["environment"]
    illuminant: str = "D65"
    radiance: Positive = 1.0


class SkyLight(RecipeModel):
    """A daylight sky: blue overhead, white towards the horizon, the ground's reflection from below."""

    kind: Literal["sky"]
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


AnyLight = Annotated[EnvironmentLight | SkyLight | AreaLamp, Field(discriminator="kind")]

__all__ = ["AnyLight", "AnyObject", "Placed"]
