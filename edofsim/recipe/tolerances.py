"""How far a camera may be from its recipe where it is made."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .base import NotNegative, RecipeModel


class ElementTolerances(RecipeModel):
    """Of the element that a surface is part of, and of its own surfaces, in place of those of all."""

    surface: Annotated[int, Field(ge=0, lt=100)]
    """number of one of its surfaces in `lens.surfaces`, from 0 on"""
    decentre_um: NotNegative | None = None
    """as for all, um"""
    tilt_arcmin: NotNegative | None = None
    """as for all, minutes of arc"""
    spacing_um: NotNegative | None = None
    """as for all, of the ways behind its surfaces, um"""
    index: NotNegative | None = None
    """as for all, of its glasses"""
    radius_percent: NotNegative | None = None
    """as for all, of its surfaces, percent"""


class Tolerances(RecipeModel):
    """Standard deviations of what cameras of a series differ by, each error normal and by itself.

    An element is what lies between two ways in air: cemented surfaces move together. Lenses without surfaces
    have power, mask height and focus alone.
    """

    decentre_um: NotNegative = 20.0
    """decentre of an element, to the right and up, um"""
    tilt_arcmin: NotNegative = 2.0
    """tilt of an element about its middle, about both axes, minutes of arc"""
    spacing_um: NotNegative = 20.0
    """each way on the axis to the next surface, in glass and in air, um"""
    index: NotNegative = 5e-4
    """index of each glass, the same at all wavelengths"""
    radius_percent: NotNegative = 0.1
    """radius of each surface, percent: its power"""
    power_percent: NotNegative = 0.5
    """focal length of a lens without surfaces, percent"""
    mask_height_percent: NotNegative = 2.0
    """all heights of the mask, percent"""
    focus_um: NotNegative = 5.0
    """place of the sensor along the axis, after it was focused, um"""
    refocused: bool = True
    """whether each camera is focused by itself: the sensor is where the wave is nearest the designed one"""
    elements: Annotated[tuple[ElementTolerances, ...], Field(max_length=100)] = ()
    """single elements that are better or worse"""
