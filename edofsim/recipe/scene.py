"""The scene recipe: what is in front of the camera, and how finely it is rendered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny, model_validator

from ..errors import InputError
from .base import NonNegative, Positive, RecipeModel
from .family import Family
from .kinds import OBJECTS, OfKind
from .lights import AnyLight
from .placed import Thing
from .sources import AnySource


class Bands(RecipeModel):
    """Equally spaced spectral bands, both ends included."""

    start_nm: Annotated[float, Field(ge=360, le=830)] = 420.0
    """wavelength of the first band, nm"""
    stop_nm: Annotated[float, Field(ge=360, le=830)] = 720.0
    """wavelength of the last band, nm; above `start_nm`"""
    count: Annotated[int, Field(ge=1, le=128)] = 31
    """number of bands, both ends included"""

    @model_validator(mode="after")
    def _ordered(self) -> Bands:
        if self.stop_nm < self.start_nm or (self.count > 1 and self.stop_nm == self.start_nm):
            raise ValueError("stop_nm must be above start_nm")
        return self

    def wavelengths(self) -> np.ndarray:
        """Band centres in metres, shape [band], float64."""
        return np.linspace(self.start_nm, self.stop_nm, self.count) * 1e-9


ANGLE_DIGITS = 7
"""Of the angle of a camera's pixel, in mrad: cameras whose distances differ by rounding share their views."""
MOST_PIXELS = 8192
"""Of a frame's width or height."""


class Frame(RecipeModel):
    """The pixels of the view. One pixel sees `pixel_angle_mrad` (tangent, on the optical axis); "auto", as
    where none is given, follows the camera that looks at the scene."""

    width_px: Annotated[int, Field(ge=1, le=MOST_PIXELS)] = 512
    """width of the frame, pixels"""
    height_px: Annotated[int, Field(ge=1, le=MOST_PIXELS)] = 384
    """height of the frame, pixels"""
    pixel_angle_mrad: Positive | Literal["auto"] = 0.1626126
    """tangent of the angle that a pixel sees on the axis, mrad; "auto" follows the camera"""
    margin_px: Annotated[int, Field(ge=0, le=1024)] = 64
    """pixels rendered around the frame, whose light the blur brings in; at least half the widest blur"""

    @property
    def pixel_angle(self) -> float:
        """Tangent of the angle that one pixel sees. Raises InputError where it follows a camera yet to
        come."""
        if self.pixel_angle_mrad == "auto":
            raise InputError(
                'frame.pixel_angle_mrad = "auto" follows a camera, and there is none here: name it '
                "(`capture.framing.framed`), or give a number"
            )
        return self.pixel_angle_mrad * 1e-3


class SeenFrame(Frame):
    """A frame as a camera sees it whose lens distorts: no recipe says this, `capture.framing.framed` does."""

    chief_rays: tuple[tuple[NonNegative, Positive, float], ...]
    """at equal steps of the square of where they land: the tangent that a lens without distortion images
    there, the ray's own over that, and where it crosses the axis, mm behind the entrance pupil"""


def _seen(frame: object) -> object:
    """What was written of a frame that a camera saw is one again."""
    return SeenFrame.model_validate(frame) if isinstance(frame, Mapping) and "chief_rays" in frame else frame


class Render(RecipeModel):
    """How the path tracer works: samples a pixel, bounces, and what counts as two surfaces."""

    samples: Annotated[int, Field(ge=1, le=1 << 16)] = 64
    """light paths a pixel; the noise falls with their number"""
    max_depth: Annotated[int, Field(ge=1, le=64)] = 5
    """longest light path, in segments: 1 shows lamps alone, 2 direct light; a Mitsuba scene has its own"""
    fragments: Annotated[int, Field(ge=1, le=8)] = 3
    """most surfaces that a pixel keeps apart"""
    depth_gap_dpt: Positive = 0.03
    """surfaces of one pixel are kept apart from this difference in inverse depth on, 1/m"""
    hidden: bool = True
    """whether to render what lies behind depth edges, which a blur can uncover"""
    pupil_radius_mm: Positive = 3.0
    """widest pupil radius that the view is meant for: hidden surfaces exist as far as it sees behind edges"""


class SceneRecipe(RecipeModel):
    """A scene recipe. Positions are camera space: x right, y up, z the depth along the optical axis.

    A scene is built of `objects`, or read from a `source` of the user's. `family` makes it one of many:
    without a choice of member, the recipe is what its own values say.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    """name of the scene: letters, digits, _ and -, at most 64"""
    purpose: str = ""
    """what the scene is for, in a sentence"""
    camera: str = "paper-learned"
    """camera that photographs the scene unless another is named: a shipped name or a file"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    """seed of everything random in the scene and its rendering"""
    bands: Bands = Bands()
    """spectral bands"""
    frame: Annotated[SerializeAsAny[Frame], BeforeValidator(_seen)] = Frame()
    """pixels of the view"""
    render: Render = Render()
    """settings of the path tracer"""
    lights: tuple[AnyLight, ...] = ()
    """lights, each a table with its `kind`"""
    objects: tuple[Annotated[Thing, OfKind(OBJECTS)], ...] = ()
    """objects, each a table with its `kind`; or give a `source`"""
    source: AnySource | None = None
    """file that the scene is read from, in place of `objects`"""
    family: Family | None = None
    """values that vary among the members of a family"""

    @model_validator(mode="after")
    def _something_to_see(self) -> SceneRecipe:
        if self.source is None and not self.objects:
            raise ValueError("a scene needs [[objects]], or a [source] to read it from")
        if self.source is not None and self.objects:
            raise ValueError("give [[objects]] or [source], not both")
        if self.source is not None and self.lights and not self.source.rendered:
            raise ValueError("a picture brings its own light: take [[lights]] out")
        return self

    @property
    def follows_camera(self) -> bool:
        """Whether its pixels are those of the camera that looks at it."""
        return self.frame.pixel_angle_mrad == "auto" or "pixel_angle_mrad" not in self.frame.model_fields_set

    def seen_at(
        self, pixel_angle: float, chief_rays: tuple[tuple[float, float, float], ...] = ()
    ) -> SceneRecipe:
        """The scene in pixels that see an angle of this tangent, rounded to `ANGLE_DIGITS`; along chief rays,
        if any."""
        rounded = float(f"{pixel_angle * 1e3:.{ANGLE_DIGITS}g}")
        frame = self.frame.model_copy(update={"pixel_angle_mrad": rounded})
        return self.model_copy(update={"frame": frame}).seen_along(chief_rays)

    def seen_along(self, chief_rays: tuple[tuple[float, float, float], ...]) -> SceneRecipe:
        """The scene along chief rays; none for those of a pinhole."""
        frame = self.frame.model_dump(exclude_unset=True, exclude={"chief_rays"})
        seen = SeenFrame(**frame, chief_rays=chief_rays) if chief_rays else Frame(**frame)
        return self.model_copy(update={"frame": seen})
