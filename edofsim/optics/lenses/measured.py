"""Lenses that are known by their PSFs alone."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field as Key
from torch import Tensor

from ...errors import InputError
from ...recipe.base import NotNegative, Positive
from ..measured.bank import MeasuredBank, psfs_between
from ..measured.files import Stated, digest, read_bank
from .base import Field
from .ideal import ThinLens

MOST = 10_000
"""PSFs along an axis."""


class MeasuredLens(ThinLens):
    """A lens by PSFs in a `file`: .npy, .npz, .mat, .exr, or a folder of pictures called `0.5m_543nm.png` or
    `10deg_0.5m_543nm.png`. They hold what stood in its pupil, and the pixels they were measured on.

    Focal length and f-number say what a pixel of the camera sees, and how wide blurs are about.
    What a file does not state itself is stated here: arrays are [field, depth, wavelength, y, x], and an axis
    of one may be left out.
    """

    kind: Literal["measured"]
    file: str
    """file or folder with the PSFs"""
    inverse_depths_per_m: Annotated[tuple[NotNegative, ...], Key(max_length=MOST)] = ()
    """inverse depths of the PSFs, 1/m; 0 is infinity"""
    wavelengths_nm: Annotated[tuple[Positive, ...], Key(max_length=MOST)] = ()
    """wavelengths of the PSFs, nm"""
    fields_deg: Annotated[tuple[NotNegative, ...], Key(max_length=MOST)] = ()
    """angles above the axis, deg; off it, PSFs are turned, as round lenses do"""
    pixel_um: Positive | None = None
    """pitch of the samples of the PSFs, um"""
    orientation: Literal["upright", "sensor"] | None = None
    """"upright": as a picture that people look at, "sensor": as on the sensor, upside down"""
    centre: Literal["pixel", "middle", "peak", "centroid"] | None = None
    """where the chief ray lands: "pixel" n // 2, "middle" of the array, or of the light of each PSF"""
    normalisation: Literal["light", "sum"] | None = None
    """"light": values are fractions of all light of the point, "sum": what is in the array is all of it"""
    hold: tuple[Literal["field", "depth", "wavelength"], ...] = ()
    """axes along which the outermost PSFs stand for what lies beyond them"""

    @property
    def measured(self) -> bool:
        return True

    @property
    def varies(self) -> bool:
        return self.bank().varies

    def in_folder(self, base: Path) -> MeasuredLens:
        return self.model_copy(update={"file": str(base / self.file)})

    def bank(self) -> MeasuredBank:
        """What the file holds. Raises InputError, naming every problem."""
        return _bank(self, digest(Path(self.file)))

    def psfs(
        self, field: Field, wavelengths: Tensor, inverse_depths: Tensor, pixel: float, window: int
    ) -> Tensor:
        return psfs_between(self.bank(), field, wavelengths, inverse_depths, pixel, window, self.hold)

    def illumination(self, field: Field) -> float:
        bank = self.bank()
        return float(bank.shares(field, self.hold)[0] @ bank.light)

    def identity(self) -> str:
        said = self.model_dump(mode="json", exclude={"file"})
        return json.dumps([said, digest(Path(self.file))], sort_keys=True)

    def problems(self) -> list[str]:
        try:
            self.bank()
        except InputError as error:
            return [f"lens.file: {problem}" for problem in error.problems]
        return []


@lru_cache(maxsize=8)
def _bank(lens: MeasuredLens, content: str) -> MeasuredBank:
    """content: its `digest`, so that a file that changed is read again."""
    return read_bank(
        Path(lens.file),
        Stated(
            fields_deg=[(0.0, each) for each in lens.fields_deg],
            inverse_depths=lens.inverse_depths_per_m,
            wavelengths_nm=lens.wavelengths_nm,
            pixel_um=lens.pixel_um,
            orientation=lens.orientation,
            centre=lens.centre,
            normalisation=lens.normalisation,
        ),
    )
