"""How a mask is made: what separates the surface on the bench from the one that was designed."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import NotNegative, Positive, RecipeModel

PRESETS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "paper-device": {
            "pitch_um": 3.0,
            "levels": 98,
            "height_limit_um": 1.2,
            "height_bias_nm": 44.0,
            "height_noise_nm": 49.5,
        },
        "paper-training": {"height_noise_nm": 40.0},
        "paper-test": {"pitch_um": 3.0, "height_noise_nm": 30.0},
    }
)
"""Values that a preset stands for; a key given next to it wins. `paper-device` is the photoresist mask that
Akpinar et al. made and measured (section Experimental Results), the others what they simulate."""


class Fabrication(RecipeModel):
    """Making a mask: upsampled (bicubic, wraps kept), wrapped, limited, quantised, and with height errors,
    drawn anew for each sample of the made surface."""

    preset: Literal["paper-device", "paper-training", "paper-test"] | None = None
    """values of the paper: its made device, its training, its tests; a key that is given replaces one"""
    pitch_um: Positive | None = None
    """pitch of the flat squares made, um; without it a smooth surface, with errors of the designed pitch"""
    height_limit_um: Positive | None = None
    """largest height, um"""
    levels: Annotated[int, Field(ge=1, le=65536)] | None = None
    """grey levels from 0 to the largest height"""
    level_nm: Positive | None = None
    """height between two grey levels, nm"""
    wrap_wavelength_nm: Positive | None = None
    """heights beyond the limit are taken modulo whole waves of this wavelength, nm"""
    height_bias_nm: float = 0.0
    """mean of the Gaussian height error, nm"""
    height_noise_nm: NotNegative = 0.0
    """standard deviation of the Gaussian height error, nm"""
    height_scale: Positive = 1.0
    """factor on all heights"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    """seed of the height error"""

    @model_validator(mode="before")
    @classmethod
    def _fill_preset(cls, data: object) -> object:
        if isinstance(data, Mapping) and data.get("preset") in PRESETS:
            return {**PRESETS[data["preset"]], **data}
        return data

    @model_validator(mode="after")
    def _makeable(self) -> Fabrication:
        problems = []
        if self.levels == 1:
            problems.append("levels = 1 leaves a flat surface; a height map needs at least 2 grey levels")
        if self.levels is not None and self.height_limit_um is None and self.level_nm is None:
            problems.append("levels need height_limit_um or level_nm to say how far apart they are")
        if self.level_nm and self.height_limit_um and self.height_limit_um * 1e3 < self.level_nm:
            problems.append(
                f"height_limit_um = {self.height_limit_um:g} is below one grey level"
                f" (level_nm = {self.level_nm:g}); raise the limit or make the levels finer"
            )
        if self.wrap_wavelength_nm is not None and self.height_limit_um is None:
            problems.append("wrap_wavelength_nm needs height_limit_um, the height to wrap into")
        if problems:
            raise ValueError("; ".join(problems))
        return self
