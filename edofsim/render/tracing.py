"""Launches on the engine: depths of a survey, and sums of a group's samples.

Nothing here needs the host between the first ray of a launch and its sums. Samples of one pixel are
neighbours in memory and are summed block by block, which gives the same bytes with any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from . import foreign, paths
from .foreign import ForeignStage
from .passes import Group, Launch, LaunchResult, pass_sizes
from .rays import Lens, Samples, behind, camera_rays
from .settings import SURVEY_SAMPLES, RenderSettings
from .translate import Stage

SURVEY_LAUNCH = 1 << 22


def lens_of(settings: RenderSettings) -> Lens:
    """What the rays of a view go through."""
    rows, columns = settings.padded_shape
    return Lens(columns, rows, settings.pixel_angle, settings.chief_rays)


def depth_tiles(
    stage: Stage | ForeignStage,
    settings: RenderSettings,
    pixels: np.ndarray,
    limits: list[np.ndarray],
    progress: Callable[[float], None] | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Inverse depths that samples see behind as many surfaces as there are limits (float32
    [pixel of the frame]): (pixels, float32 [pixel, sample], NaN for nothing).

    pixels: [pixel], numbers.
    limits: [pixel] each, 1/m, float32.

    These are the very rays of the first passes (up to SURVEY_SAMPLES samples), so that what is rendered falls
    on the surfaces that were found.
    """
    sizes: list[int] = []
    total = 0
    for size in pass_sizes(settings):
        sizes.append(size)
        total += size
        if total >= min(SURVEY_SAMPLES, settings.samples):
            break
    tile = max(1, SURVEY_LAUNCH // total)
    for start in range(0, len(pixels), tile):
        chosen = pixels[start : start + tile]
        parts = []
        for number, size in enumerate(sizes):
            samples = _samples(settings, chosen, size, number, [limit[chosen] for limit in limits])
            parts.append(np.array(_depths(stage, settings, samples)).reshape(len(chosen), size))
        if progress:
            progress(min(1.0, (start + tile) / len(pixels)))
        yield chosen, np.concatenate(parts, axis=1)


def _samples(
    settings: RenderSettings, pixels: np.ndarray, count: int, number: int, limits: Sequence[np.ndarray]
) -> Samples:
    limited = tuple(mi.Float(np.ascontiguousarray(limit, np.float32)) for limit in limits)
    return Samples(mi.UInt32(pixels.astype(np.uint32)), count, number, settings.seed, limited)


def _depths(stage: Stage | ForeignStage, settings: RenderSettings, samples: Samples) -> mi.Float:
    rays = camera_rays(lens_of(settings), samples)
    ray = stage.in_world(rays.ray)
    if samples.layer == 0:
        hit = stage.scene.ray_intersect_preliminary(ray, coherent=True)
        return dr.select(hit.is_valid(), dr.rcp(stage.depth_of(ray(hit.t))), 0.0)
    _, exists, inverse_depth = behind(stage, ray, rays.limits, dr.opaque(mi.Float, settings.gap))
    return dr.select(exists, inverse_depth, dr.nan)


def run_launch(
    stage: Stage | ForeignStage, settings: RenderSettings, group: Group, launch: Launch
) -> LaunchResult:
    """Trace the samples of a launch and sum them by pixel and surface."""
    where = slice(launch.start, launch.stop)
    limits = [limit[where] for limit in group.limits]
    samples = _samples(settings, group.pixels[where], launch.samples, launch.number, limits)
    lens, gap, depth = lens_of(settings), settings.gap, settings.max_depth
    if isinstance(stage, ForeignStage):
        radiance, inverse_depth, exists = foreign.trace(stage, lens, samples, gap, depth)
    else:
        radiance, inverse_depth, exists = paths.trace(stage, lens, samples, gap, depth)
    finite = dr.isfinite(dr.sum(radiance))
    broken = dr.select(exists & ~finite, mi.UInt32(1), mi.UInt32(0))
    radiance = dr.select(exists & finite, radiance, 0.0)
    # as many as samples, even where all exist: a literal has one entry, and its sums would be of that one
    weight = dr.select(exists, dr.full(mi.Float, 1.0, samples.size), mi.Float(0.0))
    inverse_depth = inverse_depth * weight
    dr.eval(radiance, inverse_depth, weight, broken)
    result = LaunchResult(broken=int(dr.sum(broken)[0]))
    if group.bounds is None:
        masks = [None]
    else:
        pixel = dr.arange(mi.UInt32, samples.size) // dr.opaque(mi.UInt32, samples.count)
        surface = mi.UInt32(0)
        for column in group.bounds[where].T:
            bound = dr.gather(mi.Float, mi.Float(np.ascontiguousarray(column)), pixel)
            surface += dr.select(inverse_depth < bound, mi.UInt32(1), mi.UInt32(0))
        dr.eval(surface)
        masks = [surface == number for number in range(group.surfaces)]
    for mask in masks:
        values = [radiance, weight, inverse_depth]
        if mask is not None:
            values = [dr.select(mask, value, 0.0) for value in values]
            dr.eval(values)
        sums = [dr.block_sum(value, launch.samples, mode="evaluated") for value in values]
        dr.eval(sums)
        # band by band: all at once would be a kernel for each number of pixels
        result.radiance.append(np.stack([np.array(band) for band in sums[0]]))
        result.count.append(np.array(sums[1]))
        result.inverse_depth.append(np.array(sums[2]))
    return result
