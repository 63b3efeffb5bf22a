"""Lenses, one kind a file."""

from .base import Lens

__all__ = ["Lens"]
