"""Light is kept: a lens moves light about, and a restoration has to give back as much of it.

PSFs sum to one. What changes slowly over a photo, over many times the width of the blur, a blur leaves as it
is, and so the lowest spatial frequencies of a restoration are known: they are the photo's. A network that was
trained on photographs of usual brightness knows them only for such: it gives dark photos too little light,
and changes hues.

Light that leaves the window of the PSFs comes back evenly over the photo, as veiling glare (see
`capture.planes`). How much that is follows from how the mask is made. It is taken off before photo and
restoration are compared.

Widths and bounds were chosen on photographs of scikit-image and of BSDS500's training part, at exposures from
0.03 to 3 and with saturated highlights, and on relatives of the shipped scenes.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

CELL = 8  # pixels across that are averaged before all else
SMOOTH_PX = 32.0  # standard deviation of the Gaussian that leaves the lowest frequencies
BLUR_PX = 9.0  # that of the blur of a photo, about: the restoration is blurred so before it is compared
DARK_PX = 16.0  # how far around light that clamping at 0 adds is taken off again,
ROUNDS = 2  # in this many steps, as some of it is clamped again
REACH = int(3 * (SMOOTH_PX + BLUR_PX + ROUNDS * DARK_PX)) + 2 * (1 + ROUNDS) * CELL
"""Pixels: what is farther away changes nothing."""

# next to what is brighter than full scale, photo and restoration do not hold the same light
SPILL_PX = 12.0  # how far its light spreads,
BRIGHTEST = 5.0  # how bright it counts at most,
NOTICED = 5e-3  # how much of it halves the weight of a place
LEAST = 1e-3  # the least weight
MOST = 0.04  # of full scale: a larger difference is no error of a level

AROUND_PX = 64  # beyond the frame, from where veiling glare comes, too


def keep_light(photo: Tensor, restored: Tensor, glare: Tensor | None = None) -> Tensor:
    """The restoration with the lowest spatial frequencies of its photo, at least 0.

    photo, restored: [.., 3, y, x], full scale 1, the restoration not clamped.
    glare: [3], the part of the light that is spread evenly over the photo, None for none.

    Places that highlights beyond full scale shine on count little: there a sharp image has less light than
    its photo.
    """
    light = photo if glare is None else without_glare(photo, glare)
    # of what is beyond full scale a restoration may hold any amount
    shown = torch.where(restored >= 1, torch.maximum(restored, light), restored)
    beyond = (photo - 1).clamp(0, BRIGHTEST - 1).amax(-3, keepdim=True)
    spilt = smooth(_cells(beyond), SPILL_PX) / NOTICED
    weight = LEAST + 1 / (1 + spilt.square())
    missing = (_cells(light) - smooth(_cells(shown), BLUR_PX)).clamp(-MOST, MOST)
    lowest = smooth(weight * missing, SMOOTH_PX) / smooth(weight, SMOOTH_PX)
    return _not_negative(restored + _pixels(lowest, restored))


def _not_negative(image: Tensor) -> Tensor:
    """Clamped at 0, with what that adds taken off around: noise about black would come back as grey. Deep
    rings around a highlight are no such noise, and count as little."""
    level = smooth(_cells(image.clamp(-MOST, 1)), DARK_PX).clamp_min(0)
    for _ in range(ROUNDS):
        image = image - _pixels(smooth(_cells(image.clamp(0, 1)), DARK_PX) - level, image)
    return image.clamp_min(0)


def without_glare(photo: Tensor, glare: Tensor) -> Tensor:
    """A photo [.., 3, y, x] without its glare: `glare` [3] is the part of the light that is spread evenly.

    photo: [..., 3, y, x].
    glare: [3], or [..., 3] of several photos.

    Of several photos `glare` is [.., 3]. What is spread is the mean of the world; beyond the frame that goes
    on as its border does.
    """
    part = glare.to(photo)[..., None, None]
    return (photo - part * _mean_of_world(photo)) / (1 - part)


def with_other_glare(photo: Tensor, glare: Tensor, wanted: Tensor) -> Tensor:
    """The same photo as it would be if the part `wanted` of the light were spread, in place of `glare`. What
    is beyond full scale counts as full scale in that: a lamp would outshine all the rest.

    photo: [..., 3, y, x].
    glare, wanted: [3], part of the light.
    """
    light = without_glare(photo, glare)
    mean = _mean_of_world(light.clamp_max(1))
    return mean + (1 - wanted.to(photo))[..., None, None] * (light - mean)


def _mean_of_world(photo: Tensor) -> Tensor:
    """[.., 3, 1, 1]."""
    for axis in (-2, -1):
        count = photo.new_ones(photo.shape[axis])
        count[0] += AROUND_PX
        count[-1] += AROUND_PX
        weight = (count / count.sum())[:, None] if axis == -2 else count / count.sum()
        photo = (photo * weight).sum(axis, keepdim=True)
    return photo


def without_truncated(psf: Tensor, noise: float, shares: Tensor | None = None) -> tuple[Tensor, float]:
    """PSFs [depth, 3, y, x] and the noise of photos without what in the mean over the depths leaves their
    window: what comes back evenly over a photo leaves the rest less contrast.

    psf: [depth, 3, y, x].
    shares: [depth], how much each counts in the mean, None for all alike.
    """
    kept = psf.sum((-1, -2))
    kept = kept.mean(0) if shares is None else shares.to(kept) @ kept
    return psf / kept[:, None, None], noise / float(kept.mean())


def smooth(cells: Tensor, deviation_px: float) -> Tensor:
    """Cells [.., y, x] of CELL pixels through a Gaussian; where it leaves the image, its rest counts.

    cells: [..., y, x].
    """
    down, across = (_gaussian(n, deviation_px / CELL).to(cells) for n in cells.shape[-2:])
    return down @ cells @ across.mT


def _gaussian(count: int, deviation: float) -> Tensor:
    """A Gaussian, cut off at three standard deviations, about each of `count` places; each adds up to 1."""
    place = torch.arange(count, dtype=torch.float64)
    distance = (place[:, None] - place) / deviation
    kernel = torch.where(distance.abs() <= 3, (-distance.square() / 2).exp(), 0.0)
    return kernel / kernel.sum(1, keepdim=True)


def _cells(image: Tensor) -> Tensor:
    """Means of cells; those at the lower and right border may hold fewer pixels."""
    batch = image.reshape(-1, *image.shape[-3:])
    means = functional.avg_pool2d(batch, CELL, ceil_mode=True, count_include_pad=False)
    return means.reshape(*image.shape[:-2], *means.shape[-2:])


def _pixels(cells: Tensor, like: Tensor) -> Tensor:
    """Cells [.., 3, row, column] at each pixel of an image [.., 3, y, x], linear between their centres."""
    sizes = zip(like.shape[-2:], cells.shape[-2:], strict=True)
    down, across = (_between_centres(pixels, count).to(cells) for pixels, count in sizes)
    return down @ cells @ across.mT


def _between_centres(pixels: int, count: int) -> Tensor:
    """How much each of `count` cells counts at each pixel, [pixel, cell]."""
    place = ((torch.arange(pixels, dtype=torch.float64) + 0.5) / CELL - 0.5).clamp(0, count - 1)
    return (1 - (place[:, None] - torch.arange(count)).abs()).clamp_min(0)
