"""Free height maps."""

from __future__ import annotations

from typing import Literal

from ...recipe.base import Positive
from .base import PhaseMask


class HeightMapMask(PhaseMask):
    """A free height map [n, n] sampled every `pitch_um`, row 0 the top of the pupil, centred on the axis.

    `file` (.npy or .safetensors, metres) is relative to the recipe; without it the map is flat, the start
    of a training. The pitch of 21 um is that of Akpinar et al. for their depth range. Between its samples the
    surface is bicubic; a step of more than half a wave at `design_wavelength_nm` is a wrap, and stays a step.
    """

    kind: Literal["height-map"] = "height-map"
    file: str | None = None
    """heights [n, n] in metres (.npy, .safetensors), relative to the recipe; without it a flat map"""
    pitch_um: Positive = 21.0
    """pitch of the samples, um"""

    def files(self) -> tuple[str, ...]:
        return () if self.file is None else (self.file,)
