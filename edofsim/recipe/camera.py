"""The camera recipe: lens, focus, mask at the pupil, sensor, and how finely its PSFs are computed."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .base import NotNegative, Positive, RecipeModel
from .fabrication import Fabrication
from .kinds import AnyLens, AnyMask, AnySensorEffect, named
from .tolerances import Tolerances


class Focus(RecipeModel):
    """The distance that is sharp at one wavelength; it fixes the sensor's distance. `plane`: "paraxial" is
    where rays near the axis meet, "best" where the wave of the whole aperture departs least from a sphere.
    """

    distance_m: Positive = 1.5
    """distance that is in focus, from the lens, m"""
    wavelength_nm: Positive = 587.6
    """wavelength at which it is in focus, nm"""
    plane: Literal["paraxial", "best"] = "paraxial"
    """"paraxial": where rays near the axis meet; "best": where the whole wave is nearest a sphere"""


class Sensor(RecipeModel):
    """Pixel pitch, spectral response by name or CSV, and exposure. Noise is relative to full scale 1.

    Off unless given: `saturation` clips at 0 and full scale; `full_well_electrons` adds the shot noise of
    that many electrons at full scale; `bits` quantises; `bayer` is the mosaic's top left 2 x 2 pixels. What
    else a sensor does is listed in `effects`, each a table with its `kind`, and comes after these.
    """

    pixel_um: Positive = 6.0
    """pixel pitch, um"""
    response: str = "paper"
    """spectral response: a shipped name, or a CSV with a column a channel"""
    read_noise: NotNegative = 0.005
    """standard deviation of the read noise, relative to full scale 1"""
    exposure: Literal["auto"] | Positive = "auto"
    """factor from radiance to full scale; "auto" puts the ideal image's 99.5th percentile at 0.9"""
    saturation: bool = False
    """whether values are clipped at 0 and at full scale"""
    full_well_electrons: Positive | None = None
    """electrons at full scale, whose shot noise is added; without it there is none"""
    bits: Annotated[int, Field(ge=1, le=24)] | None = None
    """bits of the converter; without it values are not rounded"""
    bayer: Literal["RGGB", "BGGR", "GRBG", "GBRG"] | None = None
    """top left 2 x 2 pixels of the colour mosaic; without it each pixel sees every channel"""
    effects: tuple[AnySensorEffect, ...] = ()
    """further sensor effects, each a table with its `kind`, after those above"""


class PsfSettings(RecipeModel):
    """Window in sensor pixels, samples along a pixel's side, and sampling of the pupil. Unless it is given,
    `oversampling` is 2, or what the diffraction limit of the aperture asks for."""

    window_px: Annotated[int, Field(ge=1, le=2048)] = 128
    """side of the square that PSFs are computed on, sensor pixels; light beyond is veiling glare"""
    oversampling: Literal["auto"] | Annotated[int, Field(ge=1, le=16)] = "auto"
    """samples along a pixel's side; "auto": 2, or what the diffraction limit asks for"""
    pupil_sampling_um: Literal["auto"] | Positive = "auto"
    """pitch of the pupil's samples, um; "auto": as fine as defocus and window ask for"""


class CameraRecipe(RecipeModel):
    """A camera recipe. The defaults are the paper's camera with a clear aperture."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    """name of the camera: letters, digits, _ and -, at most 64"""
    purpose: str = ""
    """what the camera is for, in a sentence"""
    lens: AnyLens = named("plano-convex")
    """the lens, by its `kind`"""
    focus: Focus = Focus()
    """distance in focus"""
    mask: AnyMask = named("clear")
    """the mask at the pupil, by its `kind`"""
    fabrication: Fabrication | None = None
    """how the mask is made, with the errors of making it; without it the mask is as designed"""
    sensor: Sensor = Sensor()
    """the sensor"""
    psf: PsfSettings = PsfSettings()
    """how finely PSFs are computed"""
    tolerances: Tolerances | None = None
    """how far it may be from all this where it is made; without it `evaluate tolerances` takes defaults"""
