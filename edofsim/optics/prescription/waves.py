"""Waves behind a lens: polynomials of the path, and of where rays met the stop and the rims.
 Places in the pupil are those on the sphere about the place on the sensor, over its radius, times
`Focused.scale`, in millimetres: direction cosines, less the chief ray's. The field there is a plain Fourier
transform of the wave, at any angle. t runs outwards, towards the point of the scene; s across. What lies on
the axis lies there for all wavelengths: the sphere's centre is where the chief ray of the reference
wavelength lands, so that lateral colour is a tilt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...errors import InputError
from .aim import Focused, on_sphere
from .polynomials import REACH, basis, fit
from .pupil import Pupil, chief_of, refuse_lost
from .trace import Hit

RINGS = 12
OUTSIDE = 0.03
"""Weight of rays that stop or rims shut out: they keep polynomials from growing beyond the edges."""
EDGE = 1.05
"""Rays count as inside out to this many radii of what shuts them out."""
MET = 1e-8
"""Relative difference to which tangents are found."""
NEAR = 0.85
"""Rims that no ray comes so near to, in radii, shut out nothing."""


@dataclass(frozen=True, eq=False)
class Wave:
    """What light from one place in the field, at one wavelength, does.

    landing: height [mm] on the sensor, below the axis, of the chief ray at the reference wavelength.
    middle, half: of t, and the radius of the disc that the polynomials hold in [mm].
    even: coefficients [term, quantity] of the path [mm] less the chief ray's, of the place in the stop over
        its radius along the field, and of the square of the distance from the axis over the clear radius at
        each rim.
    odd: of the place in the stop across the field.
    residual: root mean square [mm] of the path that the polynomials leave.
    """

    landing: float
    middle: float
    half: float
    residual: float
    even: Tensor
    odd: Tensor


@dataclass(frozen=True, eq=False)
class Sample:
    """Rays [batch, ray] from a place in the field, the chief ray first, then those with x from 0 on.

    longer: path [mm] beyond the chief ray's, to the sphere; shut, stop: as of `Pupil.through`; slant: what of
    the direction from the sphere to the sensor is along the axis. a, b: places in the disc of the polynomials
    (across, along), 0 where `used` is false; middle, half: of t and of that disc [mm], [batch]; up: of the
    chief ray on the sphere, over its radius, [batch, 1]. inside: which get through; used: which count at all.
    """

    longer: Tensor
    shut: Tensor
    stop: Tensor
    slant: Tensor
    a: Tensor
    b: Tensor
    middle: Tensor
    half: Tensor
    up: Tensor
    inside: Tensor
    used: Tensor

    @property
    def weight(self) -> Tensor:
        """Of rays in a fit."""
        return torch.where(self.inside, 1.0, OUTSIDE) * self.used


def sample(seen: Pupil, wavelengths: Tensor, hits: list[Hit] | None = None) -> Sample:
    """Rays in rings from places in the field, as of `waves`; hits: as of `trace`.

    wavelengths: [field] or, of one place, [wavelength], metres.

    Raises InputError outside the data of a glass.
    """
    held = seen.held
    index = held.lens.index(wavelengths)[:, None, :]
    x, y = starts(seen, len(wavelengths))
    rays, path, shut, stop = seen.through(index, x, y, hits)
    refuse_lost(held, rays.lost[:, 0], seen.tangent[:, 0].expand(len(wavelengths)))
    across, up, back = on_sphere(held, rays, seen.landing[:, 0])
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
    a, b = a.where(used, 0.0), b.where(used, 0.0)
    slant = torch.sqrt(1 - across.square() - up.square())
    return Sample(longer, shut, stop, slant, a, b, mid, size, up[:, :1], inside, used)


def starts(seen: Pupil, count: int) -> tuple[Tensor, Tensor]:
    """Places (x, y) in front of the lens, [count, ray], of the rays of `sample`."""
    zero = torch.zeros(count, 1, dtype=torch.float64)
    rings = _rings()
    x, y = zero + rings[0] * seen.half[0], zero + seen.middle + rings[1] * seen.half[1]
    return torch.cat([zero, x], -1), torch.cat([zero, y], -1)


def waves(seen: Pupil, wavelengths: Tensor) -> list[Wave]:
    """Waves of places in the field at wavelengths [m], [field], or of one place at several.

    wavelengths: [field] or, of one place, [wavelength], metres.

    Raises InputError outside the data of a glass.
    """
    rays = sample(seen, wavelengths)
    a, b, inside, used, size = rays.a, rays.b, rays.inside, rays.used, rays.half
    near = [each for each in rays.shut[1:] if bool((each.where(inside, 0.0) > NEAR**2).any())]
    quantities = torch.stack([rays.longer, rays.stop[1], *near], -1).where(used[..., None], 0.0)
    even = fit(a, b, rays.weight, quantities)
    odd = fit(a, b, rays.weight, rays.stop[0].where(used, 0.0)[..., None], odd=True)
    left = (basis(a, b) @ even[..., :1] - quantities[..., :1])[..., 0].where(inside, 0.0)
    residual = torch.sqrt(left.square().sum(-1) / inside.sum(-1))
    chief = (
        -rays.middle / size
    )  # of the reference wavelength; the others' go through the stop's centre next to it
    for _ in range(3):
        at = basis(torch.zeros(2, 1, dtype=torch.float64), torch.stack([chief, chief + 1e-4]))
        height, beyond = (at * even[..., 1]).sum(-1)
        chief = chief - height * 1e-4 / (beyond - height)
    here = basis(torch.zeros_like(chief), chief)
    even = even.clone()
    even[:, 0, 0] -= (here * even[..., 0]).sum(-1)  # the first term is constant
    mid = -chief * size
    landing = (-seen.landing[:, 0]).expand(len(wavelengths))
    numbers = zip(landing.tolist(), mid.tolist(), size.tolist(), residual.tolist(), even, odd, strict=True)
    return [Wave(*each) for each in numbers]


def landings(held: Focused, tangents: Tensor) -> Tensor:
    """How far from the axis [mm] chief rays land on the sensor, at the reference wavelength.

    tangents: [field].

    Raises InputError where there is no such ray.
    """
    return -chief_of(held, tangents).landing[:, 0]


def tangents_of(held: Focused, heights: Tensor) -> Tensor:
    """Tangents [field] of the chief rays that land at these heights: `landings` is the inverse.

    heights: [field], mm, above 0.

    Raises InputError where there are none.
    """
    tangents = heights / held.scale
    for _ in range(30):
        step = 1e-6 * tangents
        at, beyond = landings(held, torch.cat([tangents, tangents + step])).chunk(2)
        moved = (at - heights) * step / (beyond - at)
        tangents = tangents - moved.clamp(-tangents / 2, tangents / 2)
        if bool((moved.abs() < MET * tangents).all()):
            return tangents
    raise InputError(f"no chief ray lands {float(heights.max()):.4g} mm from the axis")


def _rings() -> Tensor:
    """Places (across, along) in half a disc, a little beyond its edge, [2, place]."""
    places = []
    for ring in range(1, RINGS + 1):
        radius = (REACH + 0.04) * (ring / RINGS) ** 0.75
        angles = torch.linspace(-math.pi / 2, math.pi / 2, max(6, round(3.2 * ring)), dtype=torch.float64)
        places.append(radius * torch.stack([torch.cos(angles), torch.sin(angles)]))
    return torch.cat(places, -1)
