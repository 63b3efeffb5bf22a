"""From an object's local metres to camera space: turning, and the place that the recipe names."""

from __future__ import annotations

import numpy as np

from ..recipe.placed import Placed
from ..recipe.scene import Frame


def rotation(turn_deg: float, tilt_deg: float, roll_deg: float) -> np.ndarray:
    """Rotation matrix, float64 [3, 3]: first roll about z (counter-clockwise as the camera sees it), then
    tilt about x (positive leans the top away), then turn about y (positive turns the front to the left)."""
    r, t, u = np.radians([roll_deg, tilt_deg, turn_deg])
    roll = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])
    turn = np.array([[np.cos(u), 0, np.sin(u)], [0, 1, 0], [-np.sin(u), 0, np.cos(u)]])
    return turn @ tilt @ roll


def half_frame(frame: Frame, depth_m: float) -> tuple[float, float]:
    """Half width and half height of the frame (without its margin) at a depth, in metres."""
    per_pixel = frame.pixel_angle * depth_m
    return frame.width_px / 2 * per_pixel, frame.height_px / 2 * per_pixel


def place(recipe: Placed, frame: Frame, top_of: float | None) -> np.ndarray:
    """The point of camera space that an object is put at, float64 [3], in metres.

    top_of: height (y) of the highest point of the object that it stands on, where it names one.
    """
    half_x, half_y = half_frame(frame, recipe.depth_m)
    x = recipe.x_frame * half_x if recipe.x_frame is not None else (recipe.x_mm or 0.0) * 1e-3
    if top_of is not None:
        y = top_of
    elif recipe.y_frame is not None:
        y = recipe.y_frame * half_y
    else:
        y = (recipe.y_mm or 0.0) * 1e-3
    return np.array([x, y, recipe.depth_m])
