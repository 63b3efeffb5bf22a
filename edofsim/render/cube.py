"""A spectral cube as a view, at one depth or with a depth map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..recipe.scene import SceneRecipe
from ..recipe.sources import CubeSource
from ..scene.cubes import read_cube
from .rgbd import depths, frame_indices, plain_view
from .view import View


def cube_view(source: CubeSource, recipe: SceneRecipe, base: Path) -> View:
    """The cube's middle as one fragment a pixel. At one depth nothing can be hidden, and the view says so.

    Raises InputError for files that cannot be used (`scene.cubes.read_cube`) and depths of another shape.
    """
    cube = read_cube(source, base, recipe.bands.wavelengths())
    shape = cube.shape[1:]
    if source.depth is None:
        assert source.depth_m is not None  # the model holds one of the two
        inverse, facts = np.full(shape, 1 / source.depth_m), {"hidden": "none: no depth edge"}
    else:
        left, top, right, bottom = source.crop
        whole = (shape[0] + top + bottom, shape[1] + left + right)
        inverse, facts = depths(source.depth, base, whole)
        inverse = inverse[top : whole[0] - bottom, left : whole[1] - right]
    rows, columns, border = frame_indices(shape, recipe)
    radiance = np.ascontiguousarray(cube[:, rows[:, None], columns[None]])
    facts = {**facts, "beyond the border": border}
    return plain_view(recipe, radiance, inverse[np.ix_(rows, columns)], "read from a spectral cube", facts)
