"""Things that stand about in a scene: solids, what lies on desks, test charts, meshes of the user's."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import NotNegative, Positive, Triple
from .placed import Placed
from .surfaces import AnySurface, GlassSurface, MattSurface, MetalSurface, PlasticSurface, Reflectance


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


class MeshFile(Placed):
    """A mesh of yours (OBJ, PLY, GLB, STL); the path is relative to the recipe's folder.

    The file's axes are taken as x right, y up, z towards the viewer, as most programs write them."""

    kind: Literal["mesh"]
    path: str
    size_mm: Positive
    """longest side of the bounding box after scaling"""
    surface: AnySurface = MattSurface(kind="matt")
    smooth: bool = True
    allow_outside: bool = False
    """whether the mesh's file may name files outside its own folder"""


class Goblet(Placed):
    """An empty stemmed glass."""

    kind: Literal["goblet"]
    radius_mm: Positive = 35.0
    height_mm: Positive = 150.0
    wall_mm: Positive = 2.0
    surface: AnySurface = GlassSurface(kind="glass")

    @model_validator(mode="after")
    def _hollow(self) -> Goblet:
        if self.wall_mm >= self.radius_mm / 4:
            raise ValueError("wall_mm must be below a quarter of radius_mm")
        return self


class Prism(Placed):
    """A triangular prism lying along x: its sides are as long as `side_mm`."""

    kind: Literal["prism"]
    side_mm: Positive = 25.0
    length_mm: Positive = 60.0
    surface: AnySurface = GlassSurface(kind="glass", glass="N-SF11")


class Bus(Placed):
    """A toy bus that drives to the right; `turn_deg` shows its front."""

    kind: Literal["bus"]
    length_mm: Positive = 60.0
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="red", roughness=0.1)
    sign: str = "36 CITY"


class Car(Placed):
    """A toy car that drives to the right; `turn_deg` shows its front."""

    kind: Literal["car"]
    length_mm: Positive = 60.0
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="blue", roughness=0.06)
