"""Camera rays: a pinhole at the origin that looks along +z, or the chief rays of a lens that distorts, and
how rays go on behind what they met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np

from .sampling import combined, pair
from .translate import CLOSED, FIELDS

if TYPE_CHECKING:
    from .foreign import ForeignStage
    from .translate import Stage

JITTER, PATH = 1, 2
"""What a pixel's random numbers are used for: its ray must be the same in every layer, its path must not."""

MAX_SURFACES = 256
"""A ray gives up looking for a hidden surface after this many; it has then left any scene of use."""


@dataclass(frozen=True)
class Lens:
    """The pinhole that a view is rendered through: padded frame in pixels, tangent of one pixel's angle.

    chief_rays: those that take the place of its rays, none for a pinhole (see `recipe.scene.SeenFrame`).
    """

    width: int
    height: int
    pixel_angle: float
    chief_rays: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Samples:
    """One launch: which pixels, which samples of each, and how far behind what they see.

    pixels: UInt32 [pixel] numbers in the padded frame, row by row.
    count: samples a pixel.
    number: of the pass, each pass being an independent set of samples.
    seed: of the whole view.
    limits: Float [pixel] for each surface that is passed: what lies behind it is looked at only if its
        inverse depth is above that.
    """

    pixels: mi.UInt32
    count: int
    number: int
    seed: int
    limits: tuple[mi.Float, ...] = ()

    @property
    def layer(self) -> int:
        """0 for what the pinhole sees, n for what is behind n surfaces."""
        return len(self.limits)

    @property
    def size(self) -> int:
        return dr.width(self.pixels) * self.count


@dataclass(frozen=True)
class CameraRays:
    """Rays of a launch [pixel * count]: ray; index of the sample within its pass; seed of its path;
    limits."""

    ray: mi.Ray3f
    index: mi.UInt32
    seed: mi.UInt32
    limits: tuple[mi.Float, ...]


def camera_rays(lens: Lens, samples: Samples) -> CameraRays:
    """Rays of a launch, the samples of a pixel side by side.

    A pixel is a box: its rays are spread over its square (row 0 is the top of the picture).
    """
    number = dr.arange(mi.UInt32, samples.size)
    count = dr.opaque(mi.UInt32, samples.count)
    place = number // count
    index = number - place * count
    pixel = dr.gather(mi.UInt32, samples.pixels, place)
    seed = combined(combined(dr.opaque(mi.UInt32, samples.seed), pixel), dr.opaque(mi.UInt32, samples.number))
    width = dr.opaque(mi.UInt32, lens.width)
    row = pixel // width
    column = pixel - row * width
    across, down = pair(index, combined(seed, mi.UInt32(JITTER)), mi.Float)
    half_width, half_height = dr.opaque(mi.Float, 0.5 * lens.width), dr.opaque(mi.Float, 0.5 * lens.height)
    angle = dr.opaque(mi.Float, lens.pixel_angle)
    x = (mi.Float(column) - half_width + across) * angle
    y = (half_height - mi.Float(row) - down) * angle
    start = mi.Point3f(0.0)
    if lens.chief_rays:
        ratio, start.z = _chief_ray(lens.chief_rays, dr.square(x) + dr.square(y))
        x, y = x * ratio, y * ratio
    ray = mi.Ray3f(start, dr.normalize(mi.Vector3f(x, y, 1.0)))
    limits = tuple(dr.gather(mi.Float, limit, place) for limit in samples.limits)
    return CameraRays(ray, index, combined(seed, mi.UInt32(PATH)), limits)


def _chief_ray(rays: tuple[tuple[float, float, float], ...], squared: mi.Float) -> tuple[mi.Float, mi.Float]:
    """How much steeper than a pinhole's the chief rays are that land at squared tangents, and where [m] they
    cross the axis, along z: between the nearest two, and beyond the last one as there."""
    place, ratio, crossing = np.array(rays, np.float32).T
    last = len(rays) - 1
    at = dr.minimum(squared * dr.opaque(mi.Float, last / float(place[-1]) ** 2), last * (1 - 1e-6))
    low = mi.UInt32(at)
    part = at - mi.Float(low)
    found = []
    for values in (ratio, -1e-3 * crossing):
        table = mi.Float(np.ascontiguousarray(values))
        found.append(dr.lerp(dr.gather(mi.Float, table, low), dr.gather(mi.Float, table, low + 1), part))
    return found[0], found[1]


def object_row(stage: Stage | ForeignStage, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.UInt32:
    """The row of what was hit in the table of objects, [lane]."""
    entry = dr.gather(mi.UInt32, stage.object_of, dr.reinterpret_array(mi.UInt32, si.shape), active)
    if stage.face_rows is None:
        return entry
    return dr.gather(mi.UInt32, stage.face_rows, entry + si.prim_index, active)


@dr.syntax
def behind(
    stage: Stage | ForeignStage, ray: mi.Ray3f, limits: tuple[mi.Float, ...], gap: mi.Float
) -> tuple[mi.Ray3f, mi.Bool, mi.Float]:
    """Carry rays on past as many surfaces as there are limits (Float [ray], see `Samples`).

    A surface counts if it is farther than the last one by `gap` (in 1/m), and not the inside of a closed
    object. Returns (ray that meets the next surface or nothing, whether there is one to be seen, its inverse
    depth, 0 for the background). A ray that passed all surfaces sees the background behind the last.
    """
    layer = dr.opaque(mi.UInt32, len(limits))
    passed = mi.UInt32(0)
    limit = mi.Float(limits[0])
    last = mi.Float(dr.inf)
    searching = mi.Bool(True)
    exists = mi.Bool(False)
    inverse_depth = mi.Float(0.0)
    steps = mi.UInt32(0)
    ray = mi.Ray3f(ray)
    while dr.hint(searching, exclude=[stage]):
        si = stage.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent=steps == 0, active=searching)
        valid = si.is_valid()
        here = dr.select(valid, dr.rcp(stage.depth_of(si.p)), 0.0)
        row = object_row(stage, si, valid)
        closed = dr.gather(mi.UInt32, stage.objects, row * FIELDS + CLOSED, valid) != 0
        inside = closed & (dr.dot(si.n, ray.d) > 0) & (steps > 0)
        counts = valid & ~inside & (here < last - gap)
        found = searching & (passed == layer) & (counts | ~valid)
        exists |= found
        inverse_depth = dr.select(found, here, inverse_depth)
        passing = searching & counts & ~found
        searching &= valid & ~found & (~passing | (here > limit)) & (steps < MAX_SURFACES)
        last = dr.select(passing, here, last)
        passed = dr.select(passing, passed + 1, passed)
        for number in range(1, len(limits)):
            limit = dr.select(passed == number, limits[number], limit)
        on = si.spawn_ray(ray.d)
        ray.o = dr.select(searching, on.o, ray.o)
        steps += 1
    return ray, exists, inverse_depth
