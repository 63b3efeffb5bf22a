"""Small renderings of a scene that take seconds, to decide on."""

from __future__ import annotations

from ..recipe import SceneRecipe

SIDE_PX = 64
SAMPLES = 16
PREVIEW_SAMPLES = 4


def thumbnail(recipe: SceneRecipe) -> SceneRecipe:
    """The same scene with pixels so large that its longer side has at most 64, and 16 samples each."""
    frame = recipe.frame
    coarser = max(1, -(-max(frame.width_px, frame.height_px) // SIDE_PX))
    small = frame.model_copy(
        update={
            "width_px": max(1, frame.width_px // coarser),
            "height_px": max(1, frame.height_px // coarser),
            "margin_px": -(-frame.margin_px // coarser),
            "pixel_angle_mrad": frame.pixel_angle * 1e3 * coarser,
        }
    )
    render = recipe.render.model_copy(update={"samples": min(SAMPLES, recipe.render.samples)})
    return recipe.model_copy(update={"frame": small, "render": render})


def preview_of(recipe: SceneRecipe) -> SceneRecipe:
    """The same frame, pixel for pixel, with few samples: right depths and edges, noisy light."""
    render = recipe.render.model_copy(update={"samples": min(PREVIEW_SAMPLES, recipe.render.samples)})
    return recipe.model_copy(update={"render": render})
