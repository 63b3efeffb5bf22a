"""What lies behind depth edges, guessed for views that do not hold it: pictures with a depth map, renderings
without hidden surfaces.

What is behind an edge is continued into where the front hides it, as wide as the two blurs that meet there:
its depth from the plane through what is known on all four sides, or from the nearest pixel next to the front;
its light by a pyramid of averages of all that lies behind (push and pull: Gortler et al. 1996, *The
Lumigraph*, Sec. 3.4). The composite then treats it as what was rendered. Levels of depth tell what is behind,
those that part the most edges at the least cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt
from torch import Tensor
from torch.nn.functional import interpolate, pad

from ..core.threads import in_threads
from ..optics import Camera
from ..render.view import View
from .occlusion.slabs import Hides, cuts
from .prepare import blur_per_dioptre

BEYOND = 2
"""Pixels that are filled beyond the geometric blurs: for a pixel on either side."""
NEXT_TO_FRONT = 1e-3
"""Weight of the light of pixels next to the front, which may hold some of the front's."""
LEAST = 1e-3
"""Coverage that is worth a fragment."""
FARTHER = 3
"""Pixels by which a clean pixel may be farther than the edge is, for its depth to be taken."""
ROUNDING = 1e-11
"""Share of the light's energy that is rounding."""


def lacks_hidden(view: View) -> bool:
    """Whether what lies behind edges is not known: no fragment is hidden, and nobody looked for any."""
    known = str(view.metadata.get("hidden", "")).startswith(("behind", "none"))
    return not known and not bool(view.hidden.any())


def guessed_fragments(view: View) -> int:
    """How many of a view's hidden fragments are guesses."""
    return int(str(view.metadata.get("guessed_fragments", 0)))


def with_guessed(view: View, camera: Camera) -> View:
    """The view with what is behind its depth edges continued from around; the same one where that is
    known.

    What was added is hidden; the metadata say under `hidden` what it is, and under `guessed_fragments` how
    many fragments. Gradients reach the light that it is made of; the same view and camera give the same
    fragments.
    """
    if not lacks_hidden(view):
        return view
    found = _found(view, camera)
    return _joined(view, found) if found else _said(view, "none: no depth edge")


def _found(view: View, camera: Camera) -> list[_Filled]:
    """What lies behind edges, near levels first."""
    gap = 1 / blur_per_dioptre(camera)
    low, high = view.inverse_depth.detach().aminmax() if view.inverse_depth.numel() else (0.0, 0.0)
    if float(high) - float(low) < gap:
        return []
    dark = {"radiance": view.radiance[:0].detach(), "wavelengths": view.wavelengths[:0]}
    plain = replace(view, **dark, half_difference=None)
    edges = edges_of(plain, camera)
    if not edges.behind.numel():
        return []
    # a pair counts for all that is filled behind it
    times = edges.width[edges.at].long().clamp_min(1)
    pairs = Hides(edges.front.repeat_interleave(times), edges.behind.repeat_interleave(times))
    nearest = _by_pixel(plain, "amax")
    before = torch.full_like(nearest, math.inf)
    basis = _spectra(view.radiance)
    lit = view.radiance if basis is None else basis.T @ view.radiance
    found: list[_Filled] = []
    levels = cuts(plain, gap, pairs)

    def behind(level: float) -> _Filled | None:
        return _filled(plain, lit, edges, level, gap)

    every = map(behind, levels) if lit.requires_grad else in_threads(behind, levels, lit.device)
    for filled in every:
        if filled is None:
            continue
        some = filled.farther(torch.minimum(nearest - gap, before))
        if some.pixel.numel():
            found.append(some)
            before = before.flatten().index_put((some.pixel,), some.depth - gap).reshape(before.shape)
    if basis is None:
        return found
    return [replace(each, radiance=(basis @ each.radiance).clamp_min(0)) for each in found]


def _spectra(radiance: Tensor) -> Tensor | None:
    """Few orthonormal spectra, [band, k], of which all light [band, n] is a mixture to rounding: a picture
    has three. Filling is linear and alike in all bands, so that it may fill mixtures. None: no fewer than
    half the bands, or gradients are wanted, which would miss other spectra."""
    if radiance.requires_grad or float(radiance.min()) < 0:
        return None
    light = radiance.double()
    energy, spectra = torch.linalg.eigh(light @ light.T)
    kept = energy > ROUNDING * energy[-1]
    return spectra[:, kept].to(radiance) if 0 < 2 * int(kept.sum()) < len(energy) else None


def _said(view: View, hidden: str, count: int = 0) -> View:
    return replace(view, metadata={**view.metadata, "hidden": hidden, "guessed_fragments": count})


@dataclass(frozen=True)
class Edges:
    """Pairs of fragments on the two sides of depth edges, int64 [pair].

    at: the pixel behind of each.
    width: [pixel of the padded frame], how far what is behind goes on from it, in pixels.
    """

    front: Tensor
    behind: Tensor
    at: Tensor
    width: Tensor


def edges_of(view: View, camera: Camera) -> Edges:
    """The depth edges of a view without hidden surfaces: where two of its surfaces meet whose blurs differ by
    a pixel or more, in a pixel or between neighbours. A slanted surface has none: what counts between
    neighbours is by how much more the depth changes than on either side of them."""
    rows, columns = view.padded_shape
    per_dioptre = blur_per_dioptre(camera)
    counts = torch.bincount(view.pixel, minlength=rows * columns)
    first = torch.cumsum(counts, 0) - counts
    last = first + counts - 1
    depth = view.inverse_depth.detach().double()
    several = torch.nonzero(counts > 1).squeeze(1)
    pairs = [torch.stack([first[several], last[several]])]
    of_one = torch.where(counts > 0, first, 0)
    seen = depth[of_one].reshape(rows, columns)
    single = (counts == 1).reshape(rows, columns)
    number = first.reshape(rows, columns)
    for axis in (0, 1):
        step = seen.diff(dim=axis)
        here, there = (number.narrow(axis, k, number.shape[axis] - 1) for k in (0, 1))
        both = single.narrow(axis, 0, step.shape[axis]) & single.narrow(axis, 1, step.shape[axis])
        edge = both & (_beyond_slope(step, axis) * per_dioptre >= 1)
        pairs.append(torch.stack([here[edge], there[edge]]))
    one, other = torch.cat(pairs, 1)
    parted = (depth[one] - depth[other]).abs() * per_dioptre >= 1
    one, other = one[parted], other[parted]
    nearer = depth[one] >= depth[other]
    front, behind = torch.where(nearer, one, other), torch.where(nearer, other, one)
    at = view.pixel[behind]
    focus = 1 / camera.recipe.focus.distance_m
    blurs = ((depth[front] - focus).abs() + (depth[behind] - focus).abs()) * per_dioptre / 2
    width = depth.new_zeros(rows * columns)
    reach = camera.recipe.psf.window_px // 2
    width = width.scatter_reduce(0, at, (blurs + BEYOND).ceil().clamp_max(reach), "amax")
    return Edges(front, behind, at, width)


def _beyond_slope(step: Tensor, axis: int) -> Tensor:
    """By how much each step [y, x] along an axis exceeds the smaller of the steps before and after it, where
    these go the same way: of a plane nothing, of an edge all."""
    size = step.shape[axis]
    if size < 2:
        return step.abs()
    before = torch.cat([step.narrow(axis, 1, 1), step.narrow(axis, 0, size - 1)], axis)
    after = torch.cat([step.narrow(axis, 1, size - 1), step.narrow(axis, size - 2, 1)], axis)
    sign = step.sign()
    slope = torch.minimum((before * sign).clamp_min(0), (after * sign).clamp_min(0))
    return (step.abs() - slope).clamp_min(0)


@dataclass(frozen=True)
class _Filled:
    """Fragments behind a level: pixel int64 [n], depth in 1/m and coverage [n], radiance [band, n]."""

    pixel: Tensor
    depth: Tensor
    coverage: Tensor
    radiance: Tensor

    def farther(self, than: Tensor) -> _Filled:
        """Those that are no nearer than inverse depths [y, x] say."""
        some = self.depth <= than.flatten()[self.pixel]
        return _Filled(self.pixel[some], self.depth[some], self.coverage[some], self.radiance[:, some])


def _filled(view: View, lit: Tensor, edges: Edges, level: float, gap: float) -> _Filled | None:
    """What lies behind a level of inverse depth, continued to where it is hidden. lit: light [k, fragment] to
    fill with; gap: of inverse depths that are one surface."""
    rows, columns = view.padded_shape
    depth = view.inverse_depth.detach().double()
    seeds = torch.unique(edges.at[(depth[edges.behind] <= level) & (depth[edges.front] > level)])
    if not seeds.numel():
        return None
    which = torch.nonzero(depth <= level).squeeze(1)
    weight = depth.new_zeros(rows * columns).index_add(0, view.pixel[which], view.coverage[which].double())
    total = torch.zeros_like(weight)
    total.index_add_(0, view.pixel[which], view.coverage[which].double() * depth[which])
    mean = (total / weight.clamp_min(1e-9)).reshape(rows, columns)
    weight = weight.clamp(0, 1).reshape(rows, columns)
    to_edge, edge = _nearest(seeds, rows, columns, view.pixel.device)
    clean = _away_from_front(weight)
    to_clean, source = _nearest(torch.nonzero(clean.flatten()).squeeze(1), rows, columns, view.pixel.device)
    source = torch.where(to_clean <= to_edge + FARTHER, source, edge)
    wanted = (to_edge <= edges.width[edge]) & (1 - weight > LEAST)
    if not bool(wanted.any()):
        return None
    y, x = torch.nonzero(wanted, as_tuple=True)
    margin = int(edges.width.max())
    top, left = max(0, int(y.min()) - margin), max(0, int(x.min()) - margin)
    part = (slice(top, int(y.max()) + margin + 1), slice(left, int(x.max()) + margin + 1))
    light = lit.index_select(1, which)
    image = light.new_zeros(len(light), rows * columns).index_add(1, view.pixel[which], light)
    image = image.reshape(-1, rows, columns)[:, *part]
    share = torch.where(clean | ((weight > 0) & (weight < 1)), 1.0, NEXT_TO_FRONT).to(image)[part]
    colour = push_pull(image * share, weight.to(image)[part] * share)[:, y - top, x - left]
    deep = _continued(mean, clean, mean.flatten()[source], gap)[y, x]
    pixel = y * columns + x
    coverage = (1 - weight).flatten()[pixel].to(view.coverage)
    return _Filled(pixel, deep, coverage, colour * coverage)


def _continued(depth: Tensor, known: Tensor, nearest: Tensor, gap: float) -> Tensor:
    """Inverse depth where it is not known, [y, x]: that of the plane through what is known above and below,
    left and right, where both lines tell the same within a gap; else that of the nearest pixel."""
    across, along = _between(depth, known), _between(depth.T, known.T).T
    one = (across - along).abs() < gap  # not where either is NaN
    return torch.where(one, (across + along) / 2, nearest)


def _between(depth: Tensor, known: Tensor) -> Tensor:
    """Depth along rows, linear between the known pixels on both sides, NaN where one is missing."""
    columns = depth.shape[1]
    x = torch.arange(columns, device=depth.device).expand_as(depth)
    left = torch.where(known, x, -1).cummax(1).values
    right = columns - 1 - torch.where(known.flip(1), x, -1).cummax(1).values.flip(1)
    inside = (left >= 0) & (right < columns)
    begin, end = left.clamp_min(0), right.clamp_max(columns - 1)
    share = (x - begin) / (end - begin).clamp_min(1)
    found = torch.lerp(depth.gather(1, begin), depth.gather(1, end), share.to(depth))
    return torch.where(inside, found, math.nan)


def push_pull(light: Tensor, weight: Tensor) -> Tensor:
    """Light where it is not known, from averages about it, the farther the coarser: [k, y, x].

    light: [k, y, x], of as much as `weight` [y, x] from 0 to 1 says is known; where that is 1, it stays.
    weight: [y, x], from 0 to 1.
    """
    rows, columns = weight.shape
    if max(rows, columns) == 1:
        return light / weight.clamp_min(torch.finfo(light.dtype).tiny)
    both = torch.cat([light, weight[None]])
    even = pad(both, (0, columns % 2, 0, rows % 2))
    sums = even.unflatten(1, (-1, 2)).unflatten(3, (-1, 2)).sum((2, 4))
    sums = sums / sums[-1:].clamp_min(1)
    coarse = push_pull(sums[:-1], sums[-1])
    up = interpolate(coarse[None], size=even.shape[1:], mode="bilinear", align_corners=False)[0]
    return light + (1 - weight) * up[:, :rows, :columns]


def _nearest(pixels: Tensor, rows: int, columns: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Of some pixels, the nearest to each of the padded frame, [y, x]: its distance in pixels, infinite where
    there are none, and its number."""
    if not pixels.numel():
        nowhere = torch.full((rows, columns), math.inf, dtype=torch.float64, device=device)
        return nowhere, torch.zeros(rows, columns, dtype=torch.int64, device=device)
    away = np.ones(rows * columns, bool)
    away[pixels.cpu().numpy()] = False
    distance = np.empty((rows, columns))
    places = np.empty((2, rows, columns), np.int32)
    distance_transform_edt(
        away.reshape(rows, columns), return_indices=True, distances=distance, indices=places
    )
    number = torch.from_numpy(places[0].astype(np.int64) * columns + places[1])
    return torch.from_numpy(distance).to(device), number.to(device)


def _away_from_front(weight: Tensor) -> Tensor:
    """Pixels that are behind as a whole, and their neighbours too: bool [y, x]."""
    around = pad((weight < 1)[None].double(), (1, 1, 1, 1), mode="replicate")[0].bool()
    front = around[1:-1, 1:-1].clone()
    for part in (around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]):
        front |= part
    return ~front


def _by_pixel(view: View, reduce: str) -> Tensor:
    """Largest or smallest inverse depth of each pixel of the padded frame, [y, x]."""
    rows, columns = view.padded_shape
    depth = view.inverse_depth.detach().double()
    empty = depth.new_zeros(rows * columns)
    return empty.scatter_reduce(0, view.pixel, depth, reduce, include_self=False).reshape(rows, columns)


def _joined(view: View, found: list[_Filled]) -> View:
    """A view with more fragments, sorted."""
    count = sum(each.pixel.numel() for each in found)
    pixel = torch.cat([view.pixel, *(each.pixel for each in found)])
    depth = torch.cat([view.inverse_depth, *(each.depth.to(view.inverse_depth) for each in found)])
    order = torch.argsort(depth, descending=True, stable=True)
    order = order[torch.argsort(pixel[order], stable=True)]
    hidden = torch.arange(len(pixel), device=pixel.device) >= view.pixel.numel()
    was = view.metadata.get("hidden", "missing: the view holds none")
    said = _said(view, f"guessed: {count} fragments continued from the edges' surroundings; {was}", count)
    half = view.half_difference
    if half is not None:  # what is guessed has the noise of nothing
        half = torch.cat([half, half.new_zeros(len(half), count)], 1).index_select(1, order)
    return replace(
        said,
        pixel=pixel[order],
        coverage=torch.cat([view.coverage, *(each.coverage for each in found)])[order],
        inverse_depth=depth[order],
        radiance=torch.cat([view.radiance, *(each.radiance for each in found)], 1).index_select(1, order),
        hidden=hidden[order],
        half_difference=half,
    )
