"""Phases of harmonics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import torch
from pydantic import Field
from torch import Tensor

from ...recipe.base import RecipeModel
from .base import Finite
from .basis import BasisMask


class FourierTerm(RecipeModel):
    """cosine cos(pi (p u + q v)) + sine sin(pi (p u + q v)): p and q are periods across the pupil's
    diameter.
    """

    p: Annotated[int, Field(ge=-200, le=200)]
    """periods across the pupil's diameter along u"""
    q: Annotated[int, Field(ge=-200, le=200)]
    """periods across the pupil's diameter along v"""
    cosine_rad: Finite = 0.0
    """amplitude of the cosine, rad"""
    sine_rad: Finite = 0.0
    """amplitude of the sine, rad"""


class FourierMask(BasisMask):
    """Phase as a sum of harmonics over the square around the pupil.

    The second basis of Sitzmann et al., ACM Trans. Graph. 37, 114 (2018).
    """

    kind: Literal["fourier"] = "fourier"
    terms: Annotated[tuple[FourierTerm, ...], Field(min_length=1, max_length=4096)] = (
        FourierTerm(p=1, q=0, sine_rad=8.0),
        FourierTerm(p=0, q=1, sine_rad=8.0),
        FourierTerm(p=2, q=1, cosine_rad=2.0),
    )
    """harmonics that are summed"""

    def shapes(self, u: Tensor, v: Tensor) -> Iterator[tuple[float, Tensor]]:
        for term in self.terms:
            angle = math.pi * (term.p * u + term.q * v)
            yield term.cosine_rad, torch.cos(angle)
            yield term.sine_rad, torch.sin(angle)
