"""Depth maps of the user's: read from many formats, turned into inverse depth, holes filled."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.measurements import read_numbers
from ..errors import InputError
from ..recipe.sources import DepthMap

UPRIGHT_ADVICE = "the file of depths, or the picture, lies on its side: turn it by 90 degrees"


def read_inverse_depth(source: DepthMap, base: Path) -> np.ndarray:
    """Inverse depth in 1/m, float64 [y, x], NaN in holes, 0 at infinity.

    Depth of a disparity d is baseline focal / (d + offset), Scharstein et al., GCPR 2014. Raises InputError
    for files that cannot be read, for the wrong shape, and where nothing is known.
    """
    values = read_numbers(source.path, source.key, Path(base), "depth map").astype(float) * source.unit
    if values.ndim == 3 and values.shape[2] in (3, 4) and np.array_equal(values[..., 0], values[..., 1]):
        values = values[..., 0]
    if values.ndim != 2:
        raise InputError(f"depth map {source.path!r} has the shape {values.shape}; it needs [y, x]")
    inverse = _inverse(values, source) / source.scale
    if not np.isfinite(inverse).any():
        raise InputError(f"depth map {source.path!r} holds no depth at all")
    return inverse


def _inverse(values: np.ndarray, source: DepthMap) -> np.ndarray:
    """Inverse depth of a file's numbers in their unit, [1/m], NaN in holes."""
    moved = values + source.offset
    with np.errstate(divide="ignore", invalid="ignore"):
        match source.holds:
            case "depth":
                return np.where(moved > 0, 1 / moved, np.nan)
            case "inverse_depth":
                return np.where(np.isfinite(moved) & (moved >= 0), moved, np.nan)
            case "relative_inverse_depth":
                return _between(values, source)
            case "disparity":
                assert source.baseline_mm is not None and source.focal_length_px is not None
                shifted = moved + source.disparity_offset_px
                known = np.isfinite(values) & (values != 0) & (shifted > 0)
                return np.where(known, shifted / (source.baseline_mm * 1e-3 * source.focal_length_px), np.nan)


def _between(values: np.ndarray, source: DepthMap) -> np.ndarray:
    """Relative inverse depth: the largest number at near_m, the smallest at far_m, straight between."""
    assert source.near_m is not None and source.far_m is not None
    known = np.isfinite(values)
    low, high = (values[known].min(), values[known].max()) if known.any() else (0.0, 0.0)
    if not high > low:
        raise InputError(f"depth map {source.path!r} holds the same number everywhere; nothing lies nearer")
    near, far = 1 / source.near_m, 1 / source.far_m
    return np.where(known, far + (values - low) / (high - low) * (near - far), np.nan)


def resized(inverse: np.ndarray, shape: tuple[int, int], source: DepthMap) -> np.ndarray:
    """A map at the size of its picture, each pixel the nearest number's.

    inverse: [y, x], 1/m.

    Raises InputError where the sizes differ and the recipe does not ask for it, or by proportions.
    """
    rows, columns = inverse.shape
    if inverse.shape == shape:
        return inverse
    sizes = f"depth map {source.path!r} has {columns} x {rows} pixels, the picture {shape[1]} x {shape[0]}"
    turned = f"; {UPRIGHT_ADVICE}" if inverse.shape == shape[::-1] else ""
    if not source.resize:
        advice = turned or "; resample one of them, or set resize = true in its table (--resize)"
        raise InputError(sizes + advice)
    larger = max(rows / shape[0], columns / shape[1], shape[0] / rows, shape[1] / columns)
    if abs(rows * shape[1] - columns * shape[0]) > 2 * larger * max(shape[0], shape[1]):
        raise InputError(f"{sizes}{turned or '; their proportions differ: cut one to what the other shows'}")
    row, column = (
        ((np.arange(new) + 0.5) * old / new).astype(int)
        for new, old in zip(shape, inverse.shape, strict=True)
    )
    return inverse[np.ix_(row, column)]


def inverse_of(depths: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Inverse depth in 1/m, [y, x] of the shape, of metres [y, x] or one number for all, holes filled from
    behind.

    depths: [y, x] in metres, or one number [].

    Raises InputError for whole numbers, whose unit nobody knows, for another shape, and for no depth.
    """
    if depths.ndim and usual_unit(depths) != 1:
        raise InputError(
            "the depth map is an array of whole numbers, whose unit is not known: give floats in metres, "
            "of millimetres depth / 1000"
        )
    metres = depths.astype(float)
    if metres.ndim and metres.shape != shape:
        raise InputError(
            f"the depth map has the shape {list(metres.shape)}, the picture {list(shape)}: give "
            "[y, x] in metres for each pixel, or one number"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(metres > 0, 1 / metres, np.nan)
    if not np.isfinite(inverse).any():
        raise InputError("the depth map holds no depth: metres above 0, inf for background")
    return fill_holes(np.broadcast_to(inverse, shape), "background", "the depth map")


def usual_unit(depths: np.ndarray) -> float:
    """Metres in one unit of what a depth map holds, where nobody says: whole numbers are millimetres.

    depths: [y, x].
    """
    return 0.001 if np.issubdtype(depths.dtype, np.integer) else 1.0


def fill_holes(inverse_depth: np.ndarray, method: str, what: str) -> np.ndarray:
    """Inverse depth without NaN, same shape.

    inverse_depth: [y, x], 1/m; NaN where it is not known.

    `background`: the farther of the nearest known pixels to the left and right, because what a stereo pair
    could not match lies mostly behind an edge; rows of holes alone take the nearest known one's. `nearest`:
    the nearest known pixel's. `refuse`: raises InputError if there is a hole.
    """
    holes = ~np.isfinite(inverse_depth)
    if not holes.any():
        return inverse_depth
    if method == "refuse":
        raise InputError(
            f'{what}: {holes.mean():.1%} of its pixels are holes; fill them, or choose holes = "background"'
        )
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    filled = inverse_depth[tuple(np.asarray(nearest))]
    if method == "nearest":
        return filled
    left = _carried(inverse_depth)
    right = _carried(inverse_depth[:, ::-1])[:, ::-1]
    neighbour = np.fmin(left, right)  # the farther one; a missing side counts for nothing
    return np.where(holes & np.isfinite(neighbour), neighbour, filled)


def _carried(values: np.ndarray) -> np.ndarray:
    """Each row's last known value carried on to the right; NaN before the first."""
    columns = np.arange(values.shape[1])
    last = np.maximum.accumulate(np.where(np.isfinite(values), columns, -1), axis=1)
    carried = np.take_along_axis(values, np.maximum(last, 0), axis=1)
    return np.where(last >= 0, carried, np.nan)
