"""Readers of views, and pictures with a depth map as views: one fragment a pixel, nothing behind the edges.

What such a picture does not have is said in the view's metadata, for the plan to name: light from behind
edges was never recorded, holes of the depth map were filled by a guess, and beyond the picture's border its
mirror image stands in for what is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from ...core.images import mirrored
from ...errors import InputError
from ...recipe.scene import SceneRecipe
from ...recipe.sources import DepthMap, Source
from ...scene import depth_maps
from ..view import View


class ViewReader(Source):
    """A source whose view is read, not rendered. A new one is a class in a file of its own."""

    rendered: ClassVar[bool] = False

    def view(self, recipe: SceneRecipe, base: Path) -> View:
        """The view in the recipe's frame, with its margin, at its bands.

        base: the folder of the recipe.
        recipe: the scene's.

        Raises InputError for files that cannot be used.
        """
        raise NotImplementedError


def picture_view(recipe: SceneRecipe, base: Path) -> View:
    """The view of a recipe whose source is read, not rendered.

    base: the recipe's folder.

    Raises InputError for files that cannot be used.
    """
    if not isinstance(recipe.source, ViewReader):
        raise InputError(f"{recipe.name}: its source is no picture; it has to be rendered")
    return recipe.source.view(recipe, Path(base))


def depths(source: DepthMap, base: Path, shape: tuple[int, int]) -> tuple[np.ndarray, dict[str, object]]:
    """Inverse depth [y, x] in 1/m without holes, and what is to be said of it. Raises InputError where the
    depth map has another shape than the picture, and is not to be resized."""
    stored = depth_maps.read_inverse_depth(source, base)
    inverse = depth_maps.resized(stored, shape, source)
    holes = float((~np.isfinite(inverse)).mean())
    filled = depth_maps.fill_holes(inverse, source.holes, f"depth map {source.path!r}")
    facts: dict[str, object] = {"holes": holes, "depths": _taken_for(source, stored.shape, shape)}
    if holes:
        way = {"background": "the farther neighbour in the row", "nearest": "the nearest known pixel"}
        facts["holes filled"] = f"{holes:.1%} of the depths, from {way[source.holes]}"
    return filled, facts


def _taken_for(source: DepthMap, stored: tuple[int, ...], shape: tuple[int, ...]) -> str:
    """What the numbers of a depth map are taken for."""
    unit = {"depth": "m", "inverse_depth": "1/m", "disparity": "pixels"}.get(source.holds)
    said = f"{source.path}: {source.holds.replace('_', ' ')}"
    if source.holds == "relative_inverse_depth":
        said += f" from {source.near_m:g} to {source.far_m:g} m"
    else:
        said += f", {source.unit:g} {unit} each" + (f" {source.offset:+g}" if source.offset else "")
    if source.key is not None:
        said += f", {source.key!r} of the file"
    if stored != shape:
        said += f", resized from {stored[1]} x {stored[0]} pixels"
    return said


def frame_indices(shape: tuple[int, ...], recipe: SceneRecipe) -> tuple[np.ndarray, np.ndarray, str]:
    """Rows and columns of the picture that the frame with its margin takes, its middle on the picture's.

    Beyond the border the picture goes on as its mirror image; the sentence says how much of the frame that
    is. Raises InputError if the frame itself (without its margin) is larger than the picture.

    shape: (rows, columns) of the picture.
    recipe: the scene's; its frame says what is taken.
    """
    frame = recipe.frame
    if frame.height_px > shape[0] or frame.width_px > shape[1]:
        raise InputError(
            f"{recipe.name}: the frame has {frame.width_px} x {frame.height_px} pixels, the picture only "
            f"{shape[1]} x {shape[0]}; make [frame] width_px and height_px smaller"
        )
    rows, columns = (
        (total - size) // 2 + np.arange(-frame.margin_px, size + frame.margin_px)
        for total, size in zip(shape, (frame.height_px, frame.width_px), strict=True)
    )
    outside = 1 - np.outer((rows >= 0) & (rows < shape[0]), (columns >= 0) & (columns < shape[1])).mean()
    said = "nothing is needed" if outside == 0 else f"{outside:.1%} of the frame with its margin is mirrored"
    return mirrored(rows, shape[0]), mirrored(columns, shape[1]), said


def plain_view(
    recipe: SceneRecipe,
    radiance: np.ndarray,
    inverse_depth: np.ndarray,
    route: str,
    facts: Mapping[str, object],
) -> View:
    """A view of one fragment a pixel.

    radiance: float32 [band, y, x].
    inverse_depth: [y, x] in 1/m.
    recipe: the scene's: name, bands and frame.
    route: how the view was made, in a word.
    facts: more about it, for the metadata.
    """
    return View.flat(
        radiance,
        inverse_depth,
        wavelengths=recipe.bands.wavelengths(),
        pixel_angle=recipe.frame.pixel_angle,
        margin=recipe.frame.margin_px,
        metadata={
            "scene": recipe.name,
            "route": route,
            "hidden": "missing: a picture holds no light from behind its edges",
            **facts,
        },
    )
