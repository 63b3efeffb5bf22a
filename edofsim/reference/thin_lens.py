"""The thin lens: the scene through Mitsuba's own `thinlens` sensor. Rays only, clear aperture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..core.progress import Progress, silent
from ..errors import InputError
from ..render.engine import use_engine
from ..render.translate import build_stage
from ..render.view import View
from ..scene.model import SceneModel
from .pinhole import Crop

if TYPE_CHECKING:
    import mitsuba as mi

    from ..render.translate import Stage

LAUNCH = 1 << 21
"""Samples of one launch."""


def thin_lens(
    model: SceneModel,
    view: View,
    where: Crop,
    *,
    aperture_radius: float,
    focus_distances: Sequence[float],
    samples: int = 1024,
    max_depth: int = 5,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> Tensor:
    """Radiance of a part of a view's frame through a lens: [band, y, x], float64.

    view: gives the frame and the pixel angle.
    aperture_radius: metres.
    focus_distances: metres along the axis, one for all bands or one a band (a real lens focuses each colour
        elsewhere; each distance that differs is a render of its own).
    samples: a pixel. A pixel is a box, as in a view.

    Raises InputError for a focus behind the lens, EngineError where nothing can render.
    """
    distances = list(focus_distances)
    bands = len(model.wavelengths)
    if len(distances) not in (1, bands):
        raise InputError(f"{len(distances)} focus distances for {bands} bands: give one, or one a band")
    if not all(math.isfinite(d) and d > 0 for d in distances) or not aperture_radius > 0:
        raise InputError("a thin lens needs finite focus distances and an aperture, all above 0")
    mi = use_engine(device)

    stage = build_stage(mi, model)
    say = progress or silent
    image = np.zeros((bands, where.height * where.width))
    each = np.array(distances * (bands // len(distances)))
    different = np.unique(each)
    for number, distance in enumerate(different.tolist()):
        sensor = _sensor(mi, view, aperture_radius, distance)

        def part(fraction: float, number: int = number) -> None:
            say((number + fraction) / len(different), f"thin lens, focus {number + 1} of {len(different)}")

        seen = _render(mi, stage, sensor, view, where, samples, max_depth, seed, part)
        image[each == distance] = seen[each == distance]
    return torch.from_numpy(image.reshape(bands, where.height, where.width))


def _sensor(mi: ModuleType, view: View, aperture_radius: float, distance: float) -> mi.Sensor:
    """Mitsuba's thin lens that looks along z, with the view's frame as film."""
    film = {"type": "hdrfilm", "width": view.width, "height": view.height, "rfilter": {"type": "box"}}
    angle = math.degrees(2 * math.atan(view.width / 2 * view.pixel_angle))
    return mi.load_dict(
        {
            "type": "thinlens",
            "aperture_radius": aperture_radius,
            "focus_distance": distance,
            "fov": angle,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
            "film": film,
        }
    )


def _render(
    mi: ModuleType,
    stage: Stage,
    sensor: mi.Sensor,
    view: View,
    where: Crop,
    samples: int,
    max_depth: int,
    seed: int,
    progress: Callable[[float], None],
) -> np.ndarray:
    """Mean radiance [band, pixel] of a crop."""
    import drjit as dr

    from ..render.paths import walk
    from ..render.sampling import combined, pair

    pixels = where.height * where.width
    total = np.zeros((stage.bands, pixels))
    per_launch = max(1, LAUNCH // pixels)
    done, number = 0, 0
    while done < samples:
        count = min(per_launch, samples - done)
        lane = dr.arange(mi.UInt32, pixels * count)
        pixel = lane // dr.opaque(mi.UInt32, count)
        index = lane - pixel * dr.opaque(mi.UInt32, count)
        row = pixel // dr.opaque(mi.UInt32, where.width)
        column = pixel - row * dr.opaque(mi.UInt32, where.width)
        own = combined(combined(dr.opaque(mi.UInt32, seed), pixel), dr.opaque(mi.UInt32, number))
        across, down = pair(index, combined(own, mi.UInt32(1)), mi.Float)
        lens = mi.Point2f(*pair(index, combined(own, mi.UInt32(2)), mi.Float))
        at = mi.Point2f(  # Mitsuba's picture has the camera's +x on its left
            1.0 - (mi.Float(column) + (across + float(where.left))) / float(view.width),
            (mi.Float(row) + (down + float(where.top))) / float(view.height),
        )
        ray, _ = sensor.sample_ray(mi.Float(0), mi.Float(0.5), at, lens)
        path_seed = combined(own, mi.UInt32(3))
        radiance, _ = walk(
            stage,
            mi.Ray3f(ray.o, ray.d),
            index,
            path_seed,
            dr.full(mi.Bool, True, pixels * count),
            dr.opaque(mi.UInt32, max_depth),
        )
        dr.eval(radiance)
        summed = dr.block_sum(radiance, count, mode="evaluated")
        total += np.array(summed).reshape(stage.bands, -1)
        done += count
        number += 1
        progress(done / samples)
    return total / samples
