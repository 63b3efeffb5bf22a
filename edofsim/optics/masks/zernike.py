"""Phases of Zernike polynomials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field
from torch import Tensor

from ...recipe.base import RecipeModel
from ..zernike import zernike
from .base import Finite
from .basis import BasisMask


class ZernikeTerm(RecipeModel):
    """One Zernike polynomial in Noll's order, normalised to an RMS of 1 over the pupil."""

    noll: Annotated[int, Field(ge=1, le=1000)]
    """index in Noll's order, 1 is piston"""
    rms_rad: Finite
    """RMS phase over the pupil, rad"""


class ZernikeMask(BasisMask):
    """Phase as a sum of Zernike polynomials (R. J. Noll, J. Opt. Soc. Am. 66, 207, 1976).

    The basis in which V. Sitzmann et al., "End-to-end optimization of optics and image processing for
    achromatic extended depth of field and super-resolution imaging", ACM Trans. Graph. 37, 114 (2018),
    search.
    """

    kind: Literal["zernike"] = "zernike"
    terms: Annotated[tuple[ZernikeTerm, ...], Field(min_length=1, max_length=1000)] = (
        ZernikeTerm(noll=7, rms_rad=2.0),
        ZernikeTerm(noll=8, rms_rad=2.0),
        ZernikeTerm(noll=11, rms_rad=1.5),
    )
    """polynomials that are summed"""

    def shapes(self, u: Tensor, v: Tensor) -> Iterator[tuple[float, Tensor]]:
        for term in self.terms:
            yield term.rms_rad, zernike(term.noll, u, v)
