"""Pairs to train on: a photo, and the sharp image that it should become."""

from __future__ import annotations

from .live import live
from .pairs import Pairs, PairStream

__all__ = ["PairStream", "Pairs", "live"]
