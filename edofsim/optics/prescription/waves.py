"""Waves behind a lens: polynomials of the path, and of where rays met the stop and the rims.
 Places in the pupil are those on the sphere about the place on the sensor, over its radius, times
`Focused.scale`, in millimetres: direction cosines, less the chief ray's. The field there is a plain Fourier
transform of the wave, at any angle. t runs outwards, towards the point of the scene; s across. What lies on
the axis lies there for all wavelengths: the sphere's centre is where the chief ray of the reference
wavelength lands, so that lateral colour is a tilt.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ...errors import InputError
from .aim import Focused, chief_planes, launch, on_sphere
from .polynomials import REACH, fit, values_at
from .trace import Rays, trace, why_lost

LOOK = 17
"""Rays along each side of the grid that the pupil is looked for with; it is half as wide across."""
LOOKS = 3
"""Each with a finer grid where light gets through."""
RINGS = 12
OUTSIDE = 0.03
"""Weight of rays that stop or rims shut out: they keep polynomials from growing beyond the edges."""
EDGE = 1.05
"""Rays count as inside out to so many radii of what shuts them out."""


Through = Callable[..., tuple[Rays, Tensor, Tensor, Tensor]]


@dataclass(frozen=True, eq=False)
class Wave:
    """What light from one place in the field, at one wavelength, does.

    landing: height [mm] on the sensor, below the axis, of the chief ray at the reference wavelength. middle,
    half: of t, and the radius of the disc that the polynomials hold in [mm]. even: coefficients [term,
    quantity] of the path [mm] less the chief ray's, of the place in the stop over its radius along the field,
    and of the square of the distance from the axis over the clear radius at each rim; odd: of the place in
    the stop across the field. residual: root mean square [mm] of the path that the polynomials leave.
    """

    landing: float
    middle: float
    half: float
    even: Tensor
    odd: Tensor
    residual: float


def waves(held: Focused, tangents: Tensor, wavelengths: Tensor, distance: float | None = None) -> list[Wave]:
    """Waves of places in the field at wavelengths [m], both [batch]; distance [mm] of the points before the
    entrance pupil, along the axis, None for what is in focus.

    Raises InputError outside the data of a glass, and where no light gets through.
    """
    lens = held.lens
    away = held.distance if distance is None else distance
    index = lens.index(wavelengths)[:, None, :]
    tangent = tangents[:, None]
    plane = chief_planes(held, tangents)[:, None]
    vergence = 1 / (away + plane - held.first.entrance)
    rims = tuple(n for n, clear in enumerate(lens.clear) if clear is not None and n != lens.stop)

    def through(x: Tensor, y: Tensor, at: Tensor = index) -> tuple[Rays, Tensor, Tensor, Tensor]:
        """Rays at places of the pupil's plane: on the sensor's plane, with their paths, squares of their
        distances from the axis at stop and rims over the radii [rim, batch, ray], and places in the stop [2,
        batch, ray]."""
        start, direction, longer = launch(plane, tangent, vergence, x, y)
        rays = trace(lens, at, start, direction, (lens.stop, *rims)).to_plane(held.sensor)
        stop = torch.stack(rays.at[lens.stop]) / lens.stop_radius
        shut = [stop.square().sum(0)]
        for rim in rims:
            clear = lens.clear[rim]
            assert clear is not None
            shut.append((rays.at[rim][0].square() + rays.at[rim][1].square()) / clear**2)
        return rays, rays.path + longer, torch.stack(shut), stop

    zero = torch.zeros_like(tangent)
    reference = lens.index(torch.tensor([held.wavelength], dtype=torch.float64))[:, None, :]
    landing = through(zero, zero, reference.expand_as(index))[0]
    _refuse_lost(held, landing.lost[:, 0], tangents)
    centre = landing.y[:, 0]
    chief = zero
    for _ in range(3):
        _, _, _, stop = through(zero.expand(-1, 2), torch.cat([chief, chief + 1e-4], -1))
        chief = chief - stop[1, :, :1] * 1e-4 / (stop[1, :, 1:] - stop[1, :, :1])
    with torch.no_grad():
        middle, half = _look(held, through, centre, tangents)
    rings = _rings()
    x, y = rings[0] * half[0], middle + rings[1] * half[1]
    rays, path, shut, stop = through(torch.cat([zero, x], -1), torch.cat([chief, y], -1))
    _refuse_lost(held, rays.lost[:, 0], tangents)
    across, up, back = on_sphere(held, rays, centre)
    longer = path - back
    longer = longer - longer[:, :1]
    s, t = across * held.scale, (up - up[:, :1]) * held.scale
    fine = torch.isfinite(longer)
    inside = fine & (shut.amax(0) < EDGE**2)
    low, high = t.where(inside, torch.inf).amin(-1), t.where(inside, -torch.inf).amax(-1)
    mid = (low + high) / 2
    size = torch.hypot(s, t - mid[:, None]).where(inside, 0.0).amax(-1)
    a, b = s / size[:, None], (t - mid[:, None]) / size[:, None]
    used = fine & (torch.hypot(a, b) < REACH)
    weight = torch.where(inside, 1.0, OUTSIDE) * used
    a, b = a.where(used, 0.0), b.where(used, 0.0)
    quantities = torch.stack([longer, stop[1], *shut[1:]], -1).where(used[..., None], 0.0)
    even = fit(a, b, weight, quantities)
    odd = fit(a, b, weight, stop[0].where(used, 0.0)[..., None], odd=True)
    found = []
    for k in range(len(tangents)):
        left = values_at(even[k], odd[k], a[k], b[k])[0] - quantities[k, :, 0]
        residual = float(left[inside[k]].square().mean().sqrt())
        found.append(Wave(-float(centre[k]), float(mid[k]), float(size[k]), even[k], odd[k], residual))
    return found


def landings(held: Focused, tangents: Tensor) -> Tensor:
    """How far from the axis [mm] chief rays of tangents [field] land on the sensor, at the reference
    wavelength."""
    index = held.lens.index(torch.tensor([held.wavelength], dtype=torch.float64))[:, None, :]
    plane = chief_planes(held, tangents)[None]
    vergence = 1 / (held.distance + plane - held.first.entrance)
    zero = torch.zeros_like(plane)
    start, direction, _ = launch(plane, tangents[None], vergence, zero, zero)
    rays = trace(held.lens, index, start, direction).to_plane(held.sensor)
    _refuse_lost(held, rays.lost[0], tangents)
    return -rays.y[0]


def _refuse_lost(held: Focused, lost: Tensor, tangents: Tensor) -> None:
    """Raise InputError where a chief ray [field] is lost."""
    if bool((lost > 0).any()):
        raise InputError(
            f"rays from {_degrees(tangents[lost > 0][0])} degrees off the axis through the centre of the stop"
            f" {why_lost(held.lens, lost)}"
        )


def _degrees(tangent: Tensor) -> str:
    return f"{math.degrees(math.atan(float(tangent))):.3g}"


def _rings() -> Tensor:
    """Places (across, along) in half a disc, a little beyond its edge, [2, place]."""
    places = []
    for ring in range(1, RINGS + 1):
        radius = (REACH + 0.04) * (ring / RINGS) ** 0.75
        angles = torch.linspace(-math.pi / 2, math.pi / 2, max(6, round(3.2 * ring)), dtype=torch.float64)
        places.append(radius * torch.stack([torch.cos(angles), torch.sin(angles)]))
    return torch.cat(places, -1)


def _look(
    held: Focused, through: Through, centre: Tensor, tangents: Tensor
) -> tuple[Tensor, tuple[Tensor, Tensor]]:
    """Where in the pupil's plane light gets through: (middle along the field, (half width across, along)) of
    an ellipse, each [batch, 1], that the disc of polynomials comes from. Raises InputError where there is no
    light."""
    side = LOOK // 2
    y, x = torch.meshgrid(
        torch.linspace(-1, 1, LOOK, dtype=torch.float64),
        torch.linspace(0, 1, side + 1, dtype=torch.float64),
        indexing="ij",
    )
    across = along = torch.full((len(tangents), 1), 2 * held.entrance_radius, dtype=torch.float64)
    middle = torch.zeros_like(across)

    def seen() -> tuple[Tensor, Tensor, Rays, Tensor, Tensor]:
        """Places, rays, which are inside, and the least of what shuts them out."""
        at_x, at_y = x.flatten() * across, middle + y.flatten() * along
        rays, _, shut, _ = through(at_x, at_y)
        worst = shut.amax(0).where(rays.lost == 0, torch.inf)
        least = worst.amin(-1, keepdim=True)
        # the ray that is nearest to getting through, where none does
        return at_x, at_y, rays, worst < least.clamp_min(1) + 1e-9, least

    for _ in range(LOOKS - 1):
        at_x, at_y, _, inside, _ = seen()
        low = at_y.where(inside, torch.inf).amin(-1, keepdim=True) - along / side
        high = at_y.where(inside, -torch.inf).amax(-1, keepdim=True) + along / side
        across = at_x.where(inside, 0.0).amax(-1, keepdim=True) + across / side
        middle, along = (low + high) / 2, (high - low) / 2
    _, _, rays, inside, least = seen()
    dark = ~(least[:, 0] < 1)
    if bool(dark.any()):
        raise InputError(
            f"no light from {_degrees(tangents[dark][0])} degrees off the axis gets through the lens"
        )
    s, t, _ = on_sphere(held, rays, centre)
    s = s.abs().where(inside, 0.0).amax(-1, keepdim=True)
    t = t.where(inside, -torch.inf).amax(-1, keepdim=True) - t.where(inside, torch.inf).amin(-1, keepdim=True)
    size = torch.maximum(s, t / 2)
    return middle, (across * size / s.maximum(size / 8), along * size / (t / 2).maximum(size / 8))
