"""The pixels of a scene are those of the camera that looks at it, unless the scene says otherwise."""

from __future__ import annotations

import math

from ..errors import InputError
from ..optics import Camera
from ..optics.lenses.base import ChiefRays
from ..recipe.scene import MOST_PIXELS, SceneRecipe
from ..render.view import View
from .checks import PIXEL_ANGLE_SLACK, check_near
from .resample import resampled, resampled_sides


def framed(recipe: SceneRecipe, camera: Camera, resample: bool = False) -> SceneRecipe:
    """A scene as a camera frames it: where its recipe gives no `frame.pixel_angle_mrad`, or "auto", one pixel
    sees what one of the camera's does. It is seen along the chief rays of a lens that distorts.

    resample: a scene whose recipe gives another angle is left as it is, for its view will be resampled (see
        `seen_through`).

    Raises InputError for such a scene otherwise, as its view could not be photographed, and for one whose
    frame would have too many pixels.
    """
    if recipe.follows_camera:
        return recipe.seen_at(camera.pixel_angle, chief_rays_of(recipe, camera))
    given, own = recipe.frame.pixel_angle * 1e3, camera.pixel_angle * 1e3
    if abs(given / own - 1) <= PIXEL_ANGLE_SLACK:
        return recipe.seen_along(chief_rays_of(recipe, camera))
    if not resample:
        raise InputError(
            f"a pixel of the scene {recipe.name} sees {given:.6g} mrad and one of the camera "
            f'{camera.recipe.name} {own:.6g} mrad: set frame.pixel_angle_mrad = "auto" to have the scene '
            "follow the camera, resample its view (--resample), or choose another camera"
        )
    as_resampled(recipe, camera)
    return recipe


def chief_rays_of(recipe: SceneRecipe, camera: Camera) -> ChiefRays:
    """The chief rays that a view is rendered through, out to the corners of its margin; none where it is made
    of a picture, which counts as distorted already."""
    if recipe.source is not None and not recipe.source.rendered:
        return ()
    frame = recipe.frame
    corner = math.hypot(frame.width_px / 2 + frame.margin_px, frame.height_px / 2 + frame.margin_px)
    return camera.lens.chief_rays(corner * camera.pixel_angle)


def as_resampled(recipe: SceneRecipe, camera: Camera) -> SceneRecipe:
    """A scene whose pixels are the camera's and whose frame sees what it saw before, to within a pixel.

    Raises InputError for a frame of more pixels than any recipe may have.
    """
    ratio = recipe.frame.pixel_angle / camera.pixel_angle
    sides = resampled_sides(recipe.frame.height_px, recipe.frame.width_px, ratio)
    if max(sides) > MOST_PIXELS:
        raise InputError(
            f"the scene {recipe.name}, resampled for the camera {camera.recipe.name}, has {sides[1]} x "
            f"{sides[0]} pixels, more than {MOST_PIXELS} a side: choose another camera or a smaller frame"
        )
    changed = {"pixel_angle_mrad": camera.pixel_angle * 1e3, "height_px": sides[0], "width_px": sides[1]}
    return recipe.model_copy(update={"frame": recipe.frame.model_copy(update=changed)})


def seen_through(camera: Camera, recipe: SceneRecipe, view: View) -> tuple[SceneRecipe, View]:
    """A scene and its view with the camera's pixels: resampled where theirs see another angle.

    Raises InputError for a picture whose depths lie within the lens's focal length."""
    if recipe.source is not None and not recipe.source.rendered:
        check_near(view, camera)
    if abs(view.pixel_angle / camera.pixel_angle - 1) <= PIXEL_ANGLE_SLACK:
        return recipe, view
    gap = recipe.render.depth_gap_dpt
    return as_resampled(recipe, camera), resampled(view, camera.pixel_angle, gap)
