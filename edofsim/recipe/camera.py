"""The camera recipe: lens, focus, mask at the pupil, sensor, and how finely its PSFs are computed."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .base import NotNegative, Positive, RecipeModel
from .fabrication import Fabrication
from .kinds import AnyLens, AnyMask, AnySensorEffect, named


class Focus(RecipeModel):
    """The distance that is sharp at one wavelength; it fixes the sensor's distance. `plane`: "paraxial" is
    where rays near the axis meet, "best" where the wave of the whole aperture departs least from a sphere.
    """

    distance_m: Positive = 1.5
    wavelength_nm: Positive = 587.6
    plane: Literal["paraxial", "best"] = "paraxial"


class Sensor(RecipeModel):
    """Pixel pitch, spectral response by name or CSV, and exposure. Noise is relative to full scale 1.

    Off unless given: `saturation` clips at 0 and full scale; `full_well_electrons` adds the shot noise of
    that many electrons at full scale; `bits` quantises; `bayer` is the mosaic's top left 2 x 2 pixels. What
    else a sensor does is listed in `effects`, each a table with its `kind`, and comes after these.
    """

    pixel_um: Positive = 6.0
    response: str = "paper"
    read_noise: NotNegative = 0.005
    exposure: Literal["auto"] | Positive = "auto"
    saturation: bool = False
    full_well_electrons: Positive | None = None
    bits: Annotated[int, Field(ge=1, le=24)] | None = None
    bayer: Literal["RGGB", "BGGR", "GRBG", "GBRG"] | None = None
    effects: tuple[AnySensorEffect, ...] = ()


class PsfSettings(RecipeModel):
    """Window in sensor pixels, samples along a pixel's side, and sampling of the pupil. Unless it is given,
    `oversampling` is 2, or what the diffraction limit of the aperture asks for."""

    window_px: Annotated[int, Field(ge=1, le=2048)] = 128
    oversampling: Literal["auto"] | Annotated[int, Field(ge=1, le=16)] = "auto"
    pupil_sampling_um: Literal["auto"] | Positive = "auto"


class CameraRecipe(RecipeModel):
    """A camera recipe. The defaults are the paper's camera with a clear aperture."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    purpose: str = ""
    lens: AnyLens = named("plano-convex")
    focus: Focus = Focus()
    mask: AnyMask = named("clear")
    fabrication: Fabrication | None = None
    sensor: Sensor = Sensor()
    psf: PsfSettings = PsfSettings()
