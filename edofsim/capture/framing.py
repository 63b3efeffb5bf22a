"""The pixels of a scene are those of the camera that looks at it, unless the scene says otherwise."""

from __future__ import annotations

from ..errors import InputError
from ..optics import Camera
from ..recipe.scene import SceneRecipe
from .checks import PIXEL_ANGLE_SLACK

DIGITS = 7
"""Of a pixel's angle: so that cameras whose distances differ by rounding share their views."""


def framed(recipe: SceneRecipe, camera: Camera) -> SceneRecipe:
    """A scene as a camera frames it: where its recipe gives no `frame.pixel_angle_mrad`, or "auto", one pixel
    sees what one of the camera's does.

    Raises InputError for a scene whose recipe gives another angle: its view could not be photographed.
    """
    own = float(f"{camera.pixel_angle * 1e3:.{DIGITS}g}")
    if follows(recipe):
        frame = recipe.frame.model_copy(update={"pixel_angle_mrad": own})
        return recipe.model_copy(update={"frame": frame})
    given = recipe.frame.pixel_angle * 1e3
    if abs(given / own - 1) > PIXEL_ANGLE_SLACK:
        raise InputError(
            f"a pixel of the scene {recipe.name} sees {given:.6g} mrad and one of the camera "
            f'{camera.recipe.name} {own:.6g} mrad: set frame.pixel_angle_mrad = "auto" to have the scene '
            "follow the camera, or choose another camera"
        )
    return recipe


def follows(recipe: SceneRecipe) -> bool:
    """Whether the pixels of a scene are those of its camera."""
    frame = recipe.frame
    return frame.pixel_angle_mrad == "auto" or "pixel_angle_mrad" not in frame.model_fields_set
