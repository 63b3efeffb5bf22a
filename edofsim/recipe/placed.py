"""Where an object of a scene recipe is, and how it is turned.

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

from .kinds import KindModel

ObjectName = Annotated[str, Field(min_length=1, max_length=64)]


class Thing(KindModel):
    """An object of a scene."""

    name: ObjectName | None = None
    """name of the object, for `on` and `family`"""


class Placed(Thing):
    """Where an object is and how it is turned."""

    depth_m: float
    """distance from the lens along the axis, m"""
    x_mm: float | None = None
    """place to the right of the axis, mm; or give `x_frame`"""
    y_mm: float | None = None
    """place above the axis, mm; or give `y_frame` or `on`"""
    x_frame: float | None = None
    """place across the frame at that depth: -1 is its left edge, +1 its right"""
    y_frame: float | None = None
    """place up the frame at that depth: -1 is its lower edge, +1 its upper"""
    on: ObjectName | None = None
    """name of an object given earlier, on whose highest point this one stands"""
    turn_deg: float = 0.0
    """turn about the vertical, degrees; positive turns the front to the left"""
    tilt_deg: float = 0.0
    """tilt about x, degrees; positive leans the top away"""
    roll_deg: float = 0.0
    """roll in the picture plane, degrees, counter-clockwise as seen"""
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
