"""Builders of objects, one module a family: the table of an object, and its parts in local metres."""

from .context import Builder, Context, Part

__all__ = ["Builder", "Context", "Part"]
