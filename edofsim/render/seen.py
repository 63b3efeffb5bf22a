"""A scene as it is, without a camera: the angle that its file has, and what was taken for granted."""

from __future__ import annotations

import math
from pathlib import Path

from ..errors import InputError
from ..recipe.scene import SceneRecipe
from ..scene.foreign import MitsubaSource
from ..scene.foreign.read import read_nodes
from .view import View

FACTS = ("route", "picture", "cube", "depths", "holes filled", "light")
"""What a view says of how it was made, in the order of interest."""


def by_itself(recipe: SceneRecipe, base: Path) -> tuple[SceneRecipe | None, str]:
    """The scene in pixels that see what its recipe says, or else what its file's own sensor sees; and a
    phrase that says which. None where both leave it to a camera."""
    if not recipe.follows_camera:
        return recipe, "the recipe's"
    if isinstance(recipe.source, MitsubaSource):
        angle = pixel_angle(recipe.source, base, recipe.frame.width_px, recipe.frame.height_px)
        if angle is not None:
            return recipe.seen_at(angle), f"that of the sensor in {recipe.source.path}"
    return None, f"that of the scene's camera, {recipe.camera}"


def pixel_angle(source: MitsubaSource, base: Path, width: int, height: int) -> float | None:
    """Tangent of the angle that a pixel sees where a frame of width x height pixels shows what the file's
    sensor shows; None where the file has no sensor with a field of view that can be read."""
    try:
        sensors = read_nodes(Path(base) / source.path).of_kind("sensor")
        values = sensors[0].values if sensors else {}
        fov = float(values["fov"])
    except (InputError, KeyError, ValueError, TypeError):
        return None
    if not 0 < fov < 180:
        return None
    sides = {"x": width, "y": height, "diagonal": math.hypot(width, height)}
    sides |= {"smaller": min(width, height), "larger": max(width, height)}
    side = sides.get(str(values.get("fov_axis", "x")))
    return None if side is None else 2 * math.tan(math.radians(fov) / 2) / side


def for_preview(recipe: SceneRecipe, samples: int) -> SceneRecipe:
    """A scene without the surroundings that only blur needs, at a number of light paths a pixel."""
    frame = recipe.frame.model_copy(update={"margin_px": 0})
    paths = recipe.render.model_copy(update={"samples": samples, "hidden": False})
    return recipe.model_copy(update={"frame": frame, "render": paths})


def assumptions(view: View, angle_of: str) -> list[str]:
    """Lines that say what a view shows and what was assumed.

    angle_of: whose pixels' angle it has.
    """
    across = 2 * math.degrees(math.atan(view.width * view.pixel_angle / 2))
    lines = [view.caption()]
    lines.append(
        f"field of view: {across:.3g} degrees across, {view.pixel_angle * 1e3:.4g} mrad a pixel, {angle_of}"
    )
    lines += [f"{name}: {view.metadata[name]}" for name in FACTS if view.metadata.get(name)]
    notes = view.metadata.get("notes")
    if isinstance(notes, dict):
        lines += [f"{name}: {note}" for name, note in notes.items()]
    return lines
