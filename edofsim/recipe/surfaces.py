"""What surfaces in a scene recipe are made of: reflectances, textures, and the way light leaves them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .base import Fraction, NotNegative, Positive, RecipeModel

Reflectance = Fraction | str
"""A number (the same at every wavelength), `#rrggbb` (sRGB, turned into a smooth spectrum), or the name of
a measured spectrum: a ColorChecker patch such as `orange yellow`, or a surface of colour-science's PMC set
such as `Green Apple`."""

Alpha = Annotated[float, Field(ge=0.01, le=1)]


class PhotoTexture(RecipeModel):
    """A photograph that comes with scikit-image."""

    kind: Literal["photo"]
    name: str
    """name of a picture of skimage.data, such as coffee"""
    crop: tuple[Fraction, Fraction, Fraction, Fraction] | None = None
    """left, top, right, bottom as fractions of the picture"""


class FileTexture(RecipeModel):
    """A PNG, JPEG or TIFF of yours; the path is relative to the recipe's folder."""

    kind: Literal["file"]
    path: str
    """PNG, JPEG or TIFF, relative to the recipe's folder"""


class WoodTexture(RecipeModel):
    """Wood grain along v, without seams when repeated."""

    kind: Literal["wood"]
    dark: str = "#6b4426"
    """colour of the dark grain, #rrggbb"""
    light: str = "#b98a58"
    """colour of the light grain, #rrggbb"""
    rings: Positive = 9.0
    """rings across the texture"""


class CheckerTexture(RecipeModel):
    """Squares of two reflectances."""

    kind: Literal["checker"]
    first: Reflectance = 0.1
    """reflectance of the square at the top left"""
    second: Reflectance = 0.8
    """reflectance of the other squares"""
    columns: Annotated[int, Field(ge=1, le=512)] = 8
    """squares across"""
    rows: Annotated[int, Field(ge=1, le=512)] = 8
    """squares down"""


class NoiseTexture(RecipeModel):
    """Smooth random variation between two colours, without seams when repeated."""

    kind: Literal["noise"]
    first: str = "#4a6b2f"
    """one colour, #rrggbb"""
    second: str = "#8aa35c"
    """the other colour, #rrggbb"""
    grain: Annotated[float, Field(ge=0.001, le=1)] = 0.05
    """size of the spots as a fraction of the texture"""


class MeshTexture(RecipeModel):
    """The colours and pictures that the file of a mesh brings; what it does not paint has the reflectance."""

    kind: Literal["mesh"]


AnyTexture = Annotated[
    PhotoTexture | FileTexture | WoodTexture | CheckerTexture | NoiseTexture | MeshTexture,
    Field(discriminator="kind"),
]


class MattSurface(RecipeModel):
    """Light leaves equally in all directions (Lambert)."""

    kind: Literal["matt"]
    reflectance: Reflectance = 0.5
    """diffuse reflectance: a number, #rrggbb, or the name of a measured spectrum"""
    texture: AnyTexture | None = None
    """picture of the reflectance, in its place"""


class PlasticSurface(RecipeModel):
    """A matt body under a clear coat, which shines. `roughness` is the coat's GGX alpha."""

    kind: Literal["plastic"]
    reflectance: Reflectance = 0.5
    """diffuse reflectance of the body: a number, #rrggbb, or the name of a measured spectrum"""
    texture: AnyTexture | None = None
    """picture of the body's reflectance, in its place"""
    roughness: Alpha = 0.1
    """GGX alpha of the clear coat"""
    refractive_index: Annotated[float, Field(gt=1, le=3)] = 1.49
    """refractive index of the clear coat"""


class MetalSurface(RecipeModel):
    """A metal: its reflectance at normal incidence from measured n and k, used at every angle."""

    kind: Literal["metal"]
    metal: str = "aluminium"
    """the metal, such as aluminium, copper, gold or silver"""
    roughness: Alpha = 0.15
    """GGX alpha"""


class PrincipledSurface(RecipeModel):
    """Disney's principled model, without its tints."""

    kind: Literal["principled"]
    reflectance: Reflectance = 0.5
    """base colour: a number, #rrggbb, or the name of a measured spectrum"""
    texture: AnyTexture | None = None
    """picture of the base colour, in its place"""
    roughness: Fraction = 0.5
    """roughness of the body, GGX alpha is its square"""
    metallic: Fraction = 0.0
    """0: dielectric, 1: metal"""
    specular: Fraction = 0.5
    """strength of the dielectric's specular reflection; 0.5 is an index of 1.5"""
    clearcoat: Fraction = 0.0
    """strength of a second, clear coat"""
    clearcoat_gloss: Fraction = 0.0
    """gloss of the clear coat: 0 satin, 1 glossy"""
    sheen: NotNegative = 0.0
    """strength of the sheen at grazing angles, as of cloth"""


class GlassSurface(RecipeModel):
    """Clear glass with a smooth surface. With `dispersion`, every band has its own refractive index
    (Sellmeier's formula) and takes its own way, which needs more samples."""

    kind: Literal["glass"]
    glass: str = "N-BK7"
    """name of the glass, such as N-BK7, N-SF11 or fused-silica"""
    dispersion: bool = True
    """whether every band has its own refractive index, which takes more samples"""


AnySurface = Annotated[
    MattSurface | PlasticSurface | MetalSurface | PrincipledSurface | GlassSurface,
    Field(discriminator="kind"),
]
