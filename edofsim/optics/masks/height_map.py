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
    """heights [n, n], relative to the recipe: .safetensors and .npy in metres, others (NPZ, MAT, HDF5, TIFF,
    PNG, CSV) in `unit`; NaN outside the pupil is legal. Without it a flat map"""
    key: str | None = None
    """array in an NPZ, MAT or HDF5 file; dots go into its structures"""
    unit: Literal["m", "mm", "um", "nm"] | Positive | None = None
    """of the file's numbers, by name or in metres; None: metres, in .npy and .safetensors alone"""
    pitch_um: Positive = 21.0
    """pitch of the samples, um"""

    def files(self) -> tuple[str, ...]:
        return () if self.file is None else (self.file,)
