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
    crop: tuple[Fraction, Fraction, Fraction, Fraction] | None = None
    """left, top, right, bottom as fractions of the picture"""


class FileTexture(RecipeModel):
    """A PNG, JPEG or TIFF of yours; the path is relative to the recipe's folder."""

    kind: Literal["file"]
    path: str


class WoodTexture(RecipeModel):
    """Wood grain along v, without seams when repeated."""

    kind: Literal["wood"]
    dark: str = "#6b4426"
    light: str = "#b98a58"
    rings: Positive = 9.0


class CheckerTexture(RecipeModel):
    """Squares of two reflectances."""

    kind: Literal["checker"]
    first: Reflectance = 0.1
    second: Reflectance = 0.8
    columns: Annotated[int, Field(ge=1, le=512)] = 8
    rows: Annotated[int, Field(ge=1, le=512)] = 8


class NoiseTexture(RecipeModel):
    """Smooth random variation between two colours, without seams when repeated."""

    kind: Literal["noise"]
    first: str = "#4a6b2f"
    second: str = "#8aa35c"
    grain: Annotated[float, Field(ge=0.001, le=1)] = 0.05
    """size of the spots as a fraction of the texture"""


AnyTexture = Annotated[
    PhotoTexture | FileTexture | WoodTexture | CheckerTexture | NoiseTexture, Field(discriminator="kind")
]


class MattSurface(RecipeModel):
    """Light leaves equally in all directions (Lambert)."""

    kind: Literal["matt"]
    reflectance: Reflectance = 0.5
    texture: AnyTexture | None = None


class PlasticSurface(RecipeModel):
    """A matt body under a clear coat, which shines. `roughness` is the coat's GGX alpha."""

    kind: Literal["plastic"]
    reflectance: Reflectance = 0.5
    texture: AnyTexture | None = None
    roughness: Alpha = 0.1
    refractive_index: Annotated[float, Field(gt=1, le=3)] = 1.49


class MetalSurface(RecipeModel):
    """A metal: its reflectance at normal incidence from measured n and k, used at every angle."""

    kind: Literal["metal"]
    metal: str = "aluminium"
    roughness: Alpha = 0.15


class PrincipledSurface(RecipeModel):
    """Disney's principled model, without its tints."""

    kind: Literal["principled"]
    reflectance: Reflectance = 0.5
    texture: AnyTexture | None = None
    roughness: Fraction = 0.5
    metallic: Fraction = 0.0
    specular: Fraction = 0.5
    clearcoat: Fraction = 0.0
    clearcoat_gloss: Fraction = 0.0
    sheen: NotNegative = 0.0


class GlassSurface(RecipeModel):
    """Clear glass with a smooth surface. With `dispersion`, every band has its own refractive index
    (Sellmeier's formula) and takes its own way, which needs more samples."""

    kind: Literal["glass"]
    glass: str = "N-BK7"
    dispersion: bool = True


AnySurface = Annotated[
    MattSurface | PlasticSurface | MetalSurface | PrincipledSurface | GlassSurface,
    Field(discriminator="kind"),
]
