"""Rays that are aimed: the real stop, chief rays, and where the sensor is. Lengths in millimetres.
 A place in the field is the tangent of the angle between its chief ray, in front of the lens, and the axis;
points of it lie above the axis, so rays from there go down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...errors import InputError
from .first_order import FirstOrder, first_order
from .surfaces import Stack
from .trace import Rays, trace, why_lost

CHIEF_RAYS = 257
"""In the table that chief rays are looked up in, before they are aimed."""
AIMED = 1e-13
"""Tangents of chief rays are met to within this."""
PUPILS = (0.5, 1000.0)
"""Radius of the reference sphere on the axis, in focal lengths: the exit pupil's distance, but within
these."""


@dataclass(frozen=True, eq=False)
class Focused:
    """A lens with a sensor behind it. stop_radius of the lens is known.

    wavelength [m], and the first order there: of these are focus and pupils.

    distance: of what is in focus, before the entrance pupil's centre, may be infinite.
    sensor: behind the last vertex.
    scale: height on the sensor of a paraxial chief ray for each unit of its tangent.
    sphere: radius of the reference sphere on the axis.
    rim: what the marginal ray's direction cosine behind the lens is.
    """

    lens: Stack
    wavelength: float
    first: FirstOrder
    distance: float
    sensor: float
    scale: float
    sphere: float
    rim: float

    @property
    def entrance_radius(self) -> float:
        return self.first.opening * self.lens.stop_radius


def focused(
    lens: Stack, wavelength: float, distance: float, opening: float | None, moved: float = 0.0
) -> Focused:
    """A lens that is focused, paraxially, at a distance before its entrance pupil.

    opening: height of a ray parallel to the axis that just passes the stop; None where the stop's radius is
        known.
    moved: how far the sensor is behind where it is in focus.

    Raises InputError where there is no image, or no ray reaches the rim of the stop.
    """
    index = lens.index(torch.tensor([wavelength], dtype=torch.float64))
    first = first_order(lens, index[0])
    if not 0 < first.focal < math.inf or not math.isfinite(first.entrance):
        raise InputError("these surfaces do not focus light; look at the signs of their radii")
    if opening is not None:
        lens = replace(lens, stop_radius=_stop_radius(lens, index, opening))
    plane, scale = first.image(distance - first.entrance, moved)
    if not 0 < plane < math.inf or not scale > 0:
        raise InputError(
            f"light from {distance * 1e-3:.4g} m does not meet behind the lens (focal length"
            f" {first.focal:.4g} mm): nothing there can be sharp; focus farther away"
        )
    least, most = (each * first.focal for each in PUPILS)
    sphere = min(max(abs(plane - first.exit), least), most)
    held = Focused(lens, wavelength, first, distance, plane, scale, sphere, math.nan)
    return replace(held, rim=_rim(held, index))


def launch(
    plane: Tensor, tangent: Tensor, vergence: Tensor, x: Tensor, y: Tensor
) -> tuple[tuple[Tensor, Tensor, Tensor], tuple[Tensor, Tensor, Tensor], Tensor]:
    """Rays through places (x, y) of a plane, each [batch, ray], from a point of the field.

    plane: from the first vertex, where the chief ray crosses the axis: [batch, ray] or what broadcasts.
    tangent: [batch, ray] or what broadcasts, of the place in the field.
    vergence: one over the distance of the point from there along the axis: [batch, ray] or what broadcasts.
    x, y: [batch, ray], millimetres.

    Returns places, directions, and how much longer the way there is than the chief ray's.
    """
    secant = torch.sqrt(1 + tangent.square())
    sine, cosine, slant = -tangent / secant, 1 / secant, vergence / secant
    slanted, squared = y * sine, x.square() + y.square()
    ratio = torch.sqrt(1 + 2 * slanted * slant + squared * slant.square())
    longer = (squared * slant + 2 * slanted) / (ratio + 1)
    direction = x * slant / ratio, (sine + y * slant) / ratio, cosine / ratio
    return (x, y, plane + torch.zeros_like(x)), (direction[0], direction[1], direction[2] + 0 * x), longer


def chief_planes(held: Focused, tangents: Tensor) -> Tensor:
    """Where chief rays of tangents [field], not negative, cross the axis in front, from the first vertex.

    tangents: [field].

    They go through the centre of the stop at the reference wavelength. Raises InputError where there is none.
    """
    lens = held.lens
    if lens.stop == 0:
        return torch.zeros_like(tangents)
    front = _front_reversed(lens)
    index = lens.index(torch.tensor([held.wavelength], dtype=torch.float64))[:, None, : lens.stop + 1].flip(
        -1
    )

    def seen(sine: Tensor) -> tuple[Tensor, Tensor]:
        """Tangents in front, and where the axis is crossed, of rays from the stop's centre."""
        zero = torch.zeros_like(sine)
        start = zero, zero, zero - lens.thickness[lens.stop - 1]
        rays = trace(front, index, start, (zero, sine, torch.sqrt(1 - sine.square())))
        return rays.up / rays.along, rays.y * rays.along / rays.up

    with torch.no_grad():
        table = torch.linspace(0, 1, CHIEF_RAYS, dtype=torch.float64)[None] ** 2 * 0.999
        out = seen(table)[0][0]
        rising = torch.cat([torch.ones(1, dtype=torch.bool), out.diff() > 0])
        known = int((torch.cumsum(~(rising & out.isfinite()), 0) == 0).sum())
        most = float(out[known - 1])
        if float(tangents.max()) > most:
            asked, least = (math.degrees(math.atan(each)) for each in (float(tangents.max()), most))
            raise InputError(
                f"no light from {asked:.3g} degrees off the axis gets through the centre of the stop;"
                f" there is none beyond {least:.3g}"
            )
        place = torch.searchsorted(out[:known].contiguous(), tangents).clamp(1, known - 1)
        part = (tangents - out[place - 1]) / (out[place] - out[place - 1])
        sine = torch.lerp(table[0, place - 1], table[0, place], part)[None]
        step = torch.full_like(sine, 1e-6)
        for _ in range(8):
            at, beyond = seen(sine)[0], seen(sine + step)[0]
            moved = (at - tangents) * step / (beyond - at)
            sine = (sine - moved).clamp(0, 0.9999)
            if not bool((moved.abs() > AIMED).any()):
                break
    plane = seen(sine)[1][0]
    return torch.where(tangents > 1e-7, plane, held.first.entrance)


def _front_reversed(lens: Stack) -> Stack:
    """What lies before the stop, as light from the stop meets it."""
    last = lens.stop
    thickness = torch.cat([lens.thickness[: last - 1].flip(0), lens.thickness.new_zeros(1)])
    return Stack(
        -lens.curvature[:last].flip(0),
        lens.conic[:last].flip(0),
        -lens.even[:last].flip(0),
        -lens.odd[:last].flip(0),
        thickness,
        lens.clear[:last][::-1],
        0,
        math.nan,
        lens.media[:last],
    )


def _stop_radius(lens: Stack, index: Tensor, opening: float) -> float:
    """How far from the axis a ray meets the stop that comes in parallel to it at a height."""
    zero = torch.zeros(1, 1, dtype=torch.float64)
    start, direction = (zero, zero + opening, zero), (zero, zero, zero + 1)
    rays = trace(lens, index[:, None], start, direction, (lens.stop,), lens.stop + 1)
    if bool((rays.lost > 0).any()):
        raise InputError(
            f"rays at the rim of the aperture {why_lost(lens, rays.lost)}; choose a larger f-number"
        )
    return float(rays.at[lens.stop][1].abs())


def axial(
    held: Focused, index: Tensor, heights: Tensor, distance: float | None = None
) -> tuple[Rays, Tensor]:
    """Rays at heights [batch, ray] of the entrance pupil from the point on the axis at a distance before it,
    None for that in focus, on the sensor's plane, and their paths from a sphere about that point to the
    sensor's plane.

    index: [wavelength, surface + 1].
    heights: [batch, ray], millimetres.
    """
    vergence = torch.tensor(1 / (held.distance if distance is None else distance), dtype=torch.float64)
    zero = torch.zeros((), dtype=torch.float64)
    start, direction, longer = launch(zero + held.first.entrance, zero, vergence, 0 * heights, heights)
    rays = trace(held.lens, index[:, None], start, direction, (held.lens.stop,)).to_plane(held.sensor)
    return rays, rays.path + longer


def _rim(held: Focused, index: Tensor) -> float:
    """Direction cosine, from the reference sphere to the sensor, of the ray through the rim of the stop."""
    height, step = held.entrance_radius, 1e-6 * held.entrance_radius
    for _ in range(20):
        rays, _ = axial(held, index, torch.tensor([[height, height + step]], dtype=torch.float64))
        if bool((rays.lost > 0).any()):
            raise InputError(
                f"rays at the rim of the stop {why_lost(held.lens, rays.lost)}; choose a smaller opening"
            )
        at, beyond = rays.at[held.lens.stop][1][0].abs().tolist()
        moved = (at - held.lens.stop_radius) * step / (beyond - at)
        height -= moved
        if abs(moved) < 1e-12 * held.entrance_radius:
            break
    return float(on_sphere(held, rays, torch.zeros(1, dtype=torch.float64))[1][0, 0].abs())


def on_sphere(held: Focused, rays: Rays, centre: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where rays [batch, ray] on the sensor's plane came through the sphere about a place (0, centre [batch])
    there, which goes through the middle of the exit pupil: (across, up), its offsets over the radius; and the
    way from there to the plane less the radius.

    centre: [batch], millimetres.
    """
    radius = torch.sqrt(held.sphere**2 + centre.square())[..., None]
    y = rays.y - centre[..., None]
    foot, squared = rays.x * rays.right + y * rays.up, rays.x.square() + y.square()
    left = foot.square() - squared
    back = foot + left / (
        torch.sqrt(left + radius * radius) + radius
    )  # less the radius, without cancellation
    whole = (back + radius) / radius
    return rays.x / radius - whole * rays.right, y / radius - whole * rays.up, back
