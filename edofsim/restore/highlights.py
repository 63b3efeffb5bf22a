"""Highlights beyond full scale: what full pixels do not tell of a lamp, its halo tells.

A sensor records a lamp many times brighter than full scale as a white disc, as wide as its blur. No
restoration gives back what it was: it takes the disc for a thing, and draws rings around it. But the light
around the disc is recorded, and that is the lamp's, blurred by PSFs that are known. So an ellipse is fitted
to it: its place, size and shape, its distance, its colour and how soft its edge is, before a background as
smooth as blurred ones are. What the ellipse has beyond full scale is taken off the photo, with its blur. What
remains is the photo of a scene that ends at full scale, as its truth does, and is restored as any other. What
a white surface explains as well, or nothing well, is left as it is.

That the halo of known optics tells how bright a highlight is: Rouf et al., CVPR 2011 (a star filter);
Metzler et al., CVPR 2020 (a learned DOE). That full pixels do not obey the convolution: Whyte et al., IJCV
110, 185, 2014.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from scipy import ndimage
from scipy.fft import next_fast_len
from torch import Tensor
from torch.nn import functional

from ..core.threads import in_threads, one_thread_an_operation
from .halo_background import background

FULL = 0.98
"""From here on a pixel counts as full."""
SIZES_PX = (4, 64)
"""Across what is full, least and most: less does little harm, more is no lamp."""
AROUND_PX = 48
"""How far around it a photo is looked at, at most."""
HALO_PX = 14.0
"""Distance from what is full at which a pixel counts half."""
LEAST_WEIGHT = 0.03
"""Pixels that count less are left out."""
RADII_PX = (0.6, 1.0, 1.5, 2.2, 3.2, 4.5, 6.5, 9.0, 13.0)
"""Of the ellipses that are tried first, where what is full is larger,"""
LARGER_PX = (1.0, 3.0, 6.0)
"""and by how much others are larger than that: what is white need not be full at its border."""
PLACES = 8
"""Distances at which they are tried, at most."""
AT_ONCE = 16
"""Ellipses that are tried together."""
BEGUN = 0.9
"""Part of the squared error without a lamp that one leaves which is worth refining."""
UNLIKE, STARTS = (3.0, 0.5), 2
"""By what two that are refined differ, in place or in the logarithm of the radius; and how many are."""
ROUNDS, ENDS = 12, 1e-3
"""Of refining, at most; the last is one that gains a smaller part."""
EXPLAINED = 0.72
"""Part of the squared error without a lamp that may be left with it."""
BARELY, CONTRADICTED = 0.95, 0.1
"""Part of the full pixels for which a lamp may give less light than this."""
BRIGHT = 2.5
"""Times full scale, in the brightest colour: what is dimmer is white, and no lamp."""
PREFERRED = 1.15
"""By this what is white must leave more of the error than a lamp; else nothing is taken off."""

STEPS = (0.1, 0.1, 0.05, 0.05, 0.05, 0.25, 0.1)
"""Of a shape, for its derivatives,"""
FARTHEST = (2.0, 2.0, 0.5, 0.3, 0.3, 3.0, 0.7)
"""the most that one round changes it,"""
SOFT = 1.0
"""Logarithm of the softness that what is dimmer begins with, too."""
LOG_RADIUS, STRETCH, LOG_SOFTNESS = (-1.2, 3.0), (-1.2, 1.2), (-1.0, 1.7)
"""and where it ends; a pixel blurs an edge by the least, and what is softer than the most is no lamp."""


@one_thread_an_operation()
def without_highlights(
    photo: Tensor, psfs: Callable[[float, float], Tensor], noise: float
) -> tuple[Tensor, int]:
    """The photo as if its scene ended at full scale, and how many lamps were brighter; without any it is the
    same object.

    photo: [3, y, x], full scale 1, of a sensor that saturates or not.
    psfs: gives those of a place in the photo, row and column in pixels: [depth, 3, y, x] of neighbouring
        distances.
    noise: standard deviation of the photo's, relative to full scale.
    """
    light = found = photo.detach().double().cpu()
    full = light >= FULL
    count = 0
    for own, box in _lamps(full.any(0)):
        psf = psfs(*((part.start + part.stop - 1) / 2 for part in box)).detach().double().cpu()
        around = min(AROUND_PX, psf.shape[-1] // 2)
        rows, columns = (slice(max(0, part.start - around), part.stop + around) for part in box)
        parts = found[:, rows, columns], full[:, rows, columns], own[rows, columns], psf, noise
        begun = _Patch.of(*_halved(*parts), scale=2).searched()
        less = _Patch.of(*parts).without_lamp(begun) if begun else None
        if less is not None:
            found = found.clone() if found is light else found
            found[:, rows, columns] = less
            count += 1
    return (photo + (found - light).to(photo) if count else photo), count


def _lamps(full: Tensor) -> Iterator[tuple[Tensor, tuple[slice, slice]]]:
    """What is full of each lamp, bool [y, x], and its box; the largest first."""
    labels, count = ndimage.label(ndimage.binary_opening(full.numpy()))
    boxes = ndimage.find_objects(labels)
    sizes = ndimage.sum_labels(full.numpy(), labels, range(1, count + 1))
    for index in sorted(range(count), key=lambda i: -sizes[i]):
        across = [part.stop - part.start for part in boxes[index]]
        if min(across) >= SIZES_PX[0] and max(across) <= SIZES_PX[1]:
            yield torch.from_numpy(labels == index + 1), boxes[index]


@dataclass(frozen=True)
class _Fit:
    """Ellipses, and what explains the patch best with each.

    shapes: [ellipse, 7]: row and column of the middle, logarithm of the radius, two of stretching, place
        among the PSFs, logarithm of the softness of its edge.
    colours: [ellipse, 3], times full scale.
    waves: [ellipse, 3, wave], of the background.
    error: [ellipse], weighed squares of what is left.
    cover: [ellipse, y, x].
    halo: [ellipse, 3, y, x], blurred, of light 1.
    """

    shapes: Tensor
    colours: Tensor
    waves: Tensor
    error: Tensor
    cover: Tensor
    halo: Tensor

    @property
    def is_lamp(self) -> bool:
        """Whether the one ellipse is bright, and has an edge."""
        return float(self.colours.max()) >= BRIGHT and float(self.shapes[0, 6]) < LOG_SOFTNESS[1]


@dataclass(frozen=True)
class _Patch:
    """A part of a photo about what is full, and what explains it without a lamp: a background of cosines.

    light: [3, y, x].
    full: bool [3, y, x], pixels of this lamp that do not tell their light, and their neighbours.
    transfer: [depth, 3, y, x // 2 + 1], of the PSFs.
    size: of the transforms.
    scale: pixels of the photo to one of these.
    start: [2], middle of what is full.
    axes: [2, 2], its half axes, the longer first.
    radius: of as large a disc.
    cosines: [wave, y * x].
    ridge: [wave], keeps each cosine small.
    near: [pixel], those that count.
    weights: [3, pixel], of these.
    seen: [3, wave, pixel], the cosines by the weights.
    factors: [3, wave, wave], Cholesky's, of their products.
    waves: [3, wave], of the background.
    rest: [3, pixel], what that leaves, by the weights.
    error: weighed squares of it.
    """

    light: Tensor
    full: Tensor
    transfer: Tensor
    size: tuple[int, ...]
    scale: int
    start: Tensor
    axes: Tensor
    radius: float
    cosines: Tensor
    ridge: Tensor
    near: Tensor
    weights: Tensor
    seen: Tensor
    factors: Tensor
    waves: Tensor
    rest: Tensor
    error: float

    @classmethod
    def of(
        cls, light: Tensor, full: Tensor, own: Tensor, psf: Tensor, noise: float, scale: int = 1
    ) -> _Patch:
        """full: bool [3, y, x], what is full here. own: bool [y, x], this lamp. scale: see above."""
        away = scale * torch.from_numpy(ndimage.distance_transform_edt(~own.numpy()))
        weights = 1 / (1 + (away / HALO_PX) ** 4)
        unknown = _grown(full)
        weights = (~unknown * weights.where(weights > LEAST_WEIGHT, 0.0)).flatten(1)
        near = weights.any(0).nonzero()[:, 0]
        weights, values = weights[:, near], light.flatten(1)[:, near]
        cosines, ridge = background(light, away, noise, scale)
        seen = cosines[:, near] * weights[:, None]
        factors = torch.linalg.cholesky(seen @ cosines[:, near].mT + torch.diag(ridge.square()))
        waves = torch.cholesky_solve(seen @ values[..., None], factors)[..., 0]
        rest = weights * (values - waves @ cosines[:, near])
        places = own.nonzero().double()
        reach = places.new_tensor(light.shape[-2:]) - 1 - places
        room = torch.minimum(places.amin(0), reach.amin(0))  # from the lamp to the nearer border
        beyond = (psf.shape[-1] // 2 - room).clamp_min(0).tolist()  # where its halo would come round again
        size = tuple(next_fast_len(n + int(more), True) for n, more in zip(own.shape, beyond, strict=True))
        return cls(
            light=light,
            full=unknown & _grown(own[None]),
            transfer=_transfer(psf, size),
            size=size,
            scale=scale,
            start=places.mean(0),
            axes=_half_axes(places),
            radius=math.sqrt(len(places) / math.pi),
            cosines=cosines,
            ridge=ridge,
            near=near,
            weights=weights,
            seen=seen,
            factors=factors,
            waves=waves,
            rest=rest,
            error=float((rest * values).sum()),
        )

    def without_lamp(self, begun: Sequence[Tensor]) -> Tensor | None:
        """The patch without what its lamp has beyond full scale, [3, y, x]; None where none explains it.

        begun: shapes [7] to begin with.
        """
        fits = in_threads(self.refined, begun, self.light.device)
        lamps = [fit for fit in fits if fit.is_lamp]
        others = [float(fit.error) for fit in fits if not fit.is_lamp]
        if not lamps:
            return None
        fit = min(lamps, key=lambda each: float(each.error))
        if float(fit.error) > min([EXPLAINED * self.error, *(error / PREFERRED for error in others)]):
            return None
        colours, halo = fit.colours[0, :, None, None], fit.halo[0]
        explained = (fit.waves[0] @ self.cosines).view_as(halo) + colours * halo
        if float((explained[self.full & (self.light >= FULL)] < BARELY).double().mean()) > CONTRADICTED:
            return None
        beyond = (colours * fit.cover[0] - 1).clamp_min(0)
        return torch.where(self.full, explained, self.light) - self.blurred(beyond[None], fit.shapes[:, 5])[0]

    def searched(self) -> list[Tensor]:
        """Shapes [7], in pixels of the photo, that may explain it: the best lamps, unlike each other, and the
        best that is dimmer, hard and soft: a white disc in focus may look like a lamp and its blur."""
        depths = len(self.transfer)
        places = torch.linspace(0, depths - 1, min(PLACES, depths)).tolist()
        full = self.scale * self.radius
        pixels = (*(r for r in RADII_PX if r < full), *(full + more for more in LARGER_PX))
        radii = [math.log(r / self.scale) for r in pixels]
        begun = [[*self.start.tolist(), radius, *self.stretched(radius)] for radius in radii]
        shapes = self.light.new_tensor(
            [[*shape, place, LOG_SOFTNESS[0]] for place in places for shape in begun]
        )
        parts = in_threads(self._errors, shapes.split(AT_ONCE), shapes.device)
        errors, bright = (torch.cat(each) for each in zip(*parts, strict=True))
        found: list[Tensor] = []
        for index in errors.argsort(stable=True).tolist():
            shape = shapes[index]
            if bright[index] and errors[index] < BEGUN * self.error and len(found) < STARTS:
                apart = [(shape - other).abs()[[5, 2]] > shape.new_tensor(UNLIKE) for other in found]
                if all(bool(each.any()) for each in apart):
                    found.append(shape)
        dim = errors.where(~bright, math.inf)
        if found and not bool(bright.all()):
            white = shapes[dim.argmin()]
            found += [white, torch.cat([white[:-1], white.new_tensor([SOFT])])]
        middle, radius, others = (torch.stack(found) if found else shapes[:0]).split([2, 1, 4], 1)
        middle, radius = (middle + 0.5) * self.scale - 0.5, radius + math.log(self.scale)
        return list(torch.cat([middle, radius, others], 1))

    def stretched(self, radius: float) -> list[float]:
        """How an ellipse of this logarithm of the radius is stretched if a blur made what is full of it: both
        its half axes are as much longer."""
        longer, shorter = self.axes.norm(dim=1).tolist()
        least = 0.3 * math.exp(radius)
        blur = self.radius - math.exp(radius)
        size = math.log(max(longer - blur, least) / max(shorter - blur, least)) / 2
        row, column = (self.axes[0] / longer).tolist()
        size = min(size, STRETCH[1])
        return [size * (row**2 - column**2), 2 * size * row * column]

    def _errors(self, shapes: Tensor) -> tuple[Tensor, Tensor]:
        """Of shapes [ellipse, 7], and whether each is bright."""
        fit = self.fitted(shapes)
        return fit.error, fit.colours.amax(1) >= BRIGHT

    def refined(self, shape: Tensor) -> _Fit:
        """The ellipse next to a shape [7] that explains the patch best (Levenberg-Marquardt)."""
        steps, farthest = shape.new_tensor(STEPS), shape.new_tensor(FARTHEST)
        fit, damping = self.fitted(shape[None]), 1e-3
        for _ in range(ROUNDS):
            left = self.left(fit)
            slopes = (self.left(self.fitted(fit.shapes + steps.diag())) - left) / steps[:, None]
            square, slope = slopes @ slopes.mT, slopes @ left[0]
            before = float(fit.error)
            for _ in range(5):
                damped = square + torch.diag(damping * square.diagonal() + 1e-9)
                change = torch.linalg.solve(damped, slope).clamp(-farthest, farthest)
                tried = self.fitted(self.within(fit.shapes - change))
                if float(tried.error) < before:
                    fit, damping = tried, damping / 3
                    break
                damping *= 5
            if float(fit.error) > (1 - ENDS) * before:
                break
        return fit

    def within(self, shapes: Tensor) -> Tensor:
        """Shapes [ellipse, 7] that are ellipses of some pixels, at distances that have PSFs."""
        middle, radius, stretch, place, softness = shapes.split([2, 1, 2, 1, 1], -1)
        ellipse = radius.clamp(*LOG_RADIUS), stretch.clamp(*STRETCH)
        place, softness = place.clamp(0, len(self.transfer) - 1), softness.clamp(*LOG_SOFTNESS)
        return torch.cat([middle, *ellipse, place, softness], -1)

    def fitted(self, shapes: Tensor) -> _Fit:
        """The best light of each ellipse [ellipse, 7], with the background that is likeliest next to it."""
        cover = covered(shapes, *self.light.shape[-2:])
        halo = self.blurred(cover[:, None], shapes[:, 5])
        near = halo.flatten(2)[..., self.near].transpose(0, 1)  # [3, ellipse, pixel]
        projected = self.seen @ near.mT
        solved = torch.cholesky_solve(projected, self.factors)
        alone = (self.weights[:, None] * near.square()).sum(-1) - (projected * solved).sum(1)
        both = (near @ self.rest[..., None])[..., 0]
        colours = (both / alone.clamp_min(1e-12)).clamp_min(0)
        error = self.error - (both * colours).sum(0)
        waves = self.waves[:, :, None] - solved * colours[:, None]
        return _Fit(shapes, colours.mT, waves.permute(2, 0, 1), error, cover, halo)

    def left(self, fit: _Fit) -> Tensor:
        """What ellipses leave, weighed, [ellipse, value]: the sum of its squares is their error."""
        explained = fit.waves @ self.cosines[:, self.near]
        explained = explained + fit.colours[..., None] * fit.halo.flatten(2)[..., self.near]
        pixels = (self.light.flatten(1)[:, self.near] - explained) * self.weights.sqrt()
        return torch.cat([pixels.flatten(1), (fit.waves * self.ridge).flatten(1)], 1)

    def blurred(self, images: Tensor, places: Tensor) -> Tensor:
        """Images [n, 1 or 3, y, x] by the PSFs at places [n] among the distances, linear between these."""
        last = len(self.transfer) - 1
        lower = places.floor().clamp(0, max(0, last - 1)).long()
        share = (places - lower)[:, None, None, None].to(self.transfer)
        transfer = self.transfer[lower].lerp(self.transfer[(lower + 1).clamp_max(last)], share)
        found = torch.fft.irfft2(torch.fft.rfft2(images, s=self.size) * transfer, s=self.size)
        return found[..., : images.shape[-2], : images.shape[-1]]


def covered(shapes: Tensor, rows: int, columns: int) -> Tensor:
    """How much light of ellipses each pixel has, 0 to 1, [ellipse, y, x]: by the distance from their border,
    a step that a Gaussian blurs.

    shapes: [ellipse, 7], see `_Fit`.
    """
    row = torch.arange(rows, dtype=shapes.dtype)[:, None] - shapes[:, 0, None, None]
    column = torch.arange(columns, dtype=shapes.dtype) - shapes[:, 1, None, None]
    radius, first, second = (shapes[:, i, None, None] for i in (2, 3, 4))
    # by the exponential of a symmetric matrix without trace an ellipse becomes a disc of the same area
    size = first.hypot(second).clamp_min(1e-9)
    even, odd = size.cosh(), size.sinh() / size
    one, mixed, other = even - odd * first, -odd * second, even + odd * first
    down, across = one * row + mixed * column, mixed * row + other * column
    distance = down.hypot(across).clamp_min(1e-9)
    slope = (one * down + mixed * across).hypot(mixed * down + other * across) / distance
    inside = (radius.exp() - distance) / slope.clamp_min(1e-9)
    return torch.special.ndtr(inside / shapes[:, 6, None, None].exp())


def _halved(
    light: Tensor, full: Tensor, own: Tensor, psf: Tensor, noise: float
) -> tuple[Tensor, Tensor, Tensor, Tensor, float]:
    """What `_Patch.of` takes, in pixels twice as large; one that is full in part is full."""
    kept = [2 * (n // 2) for n in light.shape[-2:]]
    light, full, own = (each[..., : kept[0], : kept[1]] for each in (light, full, own))
    full, own = (functional.max_pool2d(each[None].double(), 2)[0] > 0 for each in (full, own[None]))
    return functional.avg_pool2d(light, 2), full, own[0], 4 * functional.avg_pool2d(psf, 2), noise / 2


def _half_axes(places: Tensor) -> Tensor:
    """Of an ellipse that holds places [n, 2] as evenly, [2, 2], the longer first."""
    off = places - places.mean(0)
    sizes, directions = torch.linalg.eigh(off.mT @ off / len(places))
    return (2 * sizes.clamp_min(0.01).sqrt()[:, None] * directions.mT).flip(0)


def _transfer(psf: Tensor, size: tuple[int, ...]) -> Tensor:
    """Transfer functions of PSFs [depth, 3, y, x] about their middle pixel, for transforms of a size."""
    rows, columns = psf.shape[-2:]
    padded = functional.pad(psf, (0, size[1] - columns, 0, size[0] - rows))
    return torch.fft.rfft2(padded.roll((-(rows // 2), -(columns // 2)), (-2, -1)))


def _grown(mask: Tensor) -> Tensor:
    """A bool image [channel, y, x] with the neighbours of all that is true."""
    return functional.max_pool2d(mask[None].float(), 3, 1, 1)[0] > 0
