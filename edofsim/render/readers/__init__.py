"""Readers of views, one kind a file."""

from .pictures import ViewReader, depths, frame_indices, picture_view, plain_view

__all__ = ["ViewReader", "depths", "frame_indices", "picture_view", "plain_view"]
