"""How close an image is to the truth: PSNR and SSIM, whole and by depth, without the truth's own noise.

Every score of a photo or a restored image, whatever the command, is `image_psnr` or of `score_parts`: both
images as a sensor of full scale 1 can hold them. `psnr` takes two images as they are, to tell how far apart
two simulations of one photo are.

A rendered truth is off by noise e, and an image that was restored from a photo of the same samples by some
part L e of it. Of two independent halves of the samples either would be off by noise of its own; half of what
the halves differ by, d, has the mean and the variance of e, and is independent of it. So of the error x - y,

    the product of the errors of both halves is (x - y)^2 - (L d - d)^2,

whose mean is the square of the error that an image without noise has against a truth without noise, however
neighbours' noise is alike and whatever it shares. The second moments in SSIM's terms are freed of it alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from torch import Tensor

from ..core.images import srgb_encode
from ..errors import InputError

DEPTH_EDGES_M = (0.0, 0.6, 0.85, 1.15, 1.6, 3.0, math.inf)
SSIM_WINDOW = 11  # pixels across the Gaussian of Wang et al. (2004), sigma 1.5 cut at 3.5 sigma
BLOCK = 16
"""Side in pixels of the blocks whose noise counts as independent: optics and restoration spread it less."""
MOST_UNCERTAIN_DB = 1.0
"""Standard error from which on a PSNR is not known."""


@dataclass(frozen=True)
class Score:
    """psnr_db: infinite for equal images, NaN where noise leaves it unknown.
    ssim: NaN where the image is smaller than the SSIM window.
    pixels: how many it was taken over.
    psnr_db_se, ssim_se: standard errors by the noise of the samples that image and truth were made of, 0
        where they have none, NaN where it is in the score.
    """

    psnr_db: float
    ssim: float
    pixels: int
    psnr_db_se: float = 0.0
    ssim_se: float = 0.0


@dataclass(frozen=True)
class DepthScore:
    """A score over the pixels with near_m <= depth < far_m."""

    near_m: float
    far_m: float
    score: Score


@dataclass(frozen=True)
class Noise:
    """Half of what two independent halves of the samples differ by, [channel, y, x] each: in the truth, and
    in the image that is judged, neither of them clipped."""

    truth: Tensor
    image: Tensor


TruthNoise = Noise | Literal["none", "included"]
"""Noise that scores are without; that there is none; or that nothing is known of it, so that it counts as an
error of the image."""


def within_scale(image: Tensor) -> Tensor:
    """What full scale 1 can hold of an image. A saturated highlight may be many times as bright: it would
    decide a score alone, by how it is clipped and not by how anything is restored.

    image: any shape [...], full scale 1.
    """
    return image.clamp(0, 1)


def _clipped(image: Tensor, truth: Tensor, noise: TruthNoise) -> tuple[Tensor, Tensor, Noise | None]:
    """Two images as full scale holds them, and what their halves differ by then."""

    def half(middle: Tensor, off: Tensor) -> Tensor:
        return (within_scale(middle + off) - within_scale(middle - off)) / 2

    known = Noise(half(truth, noise.truth), half(image, noise.image)) if isinstance(noise, Noise) else None
    return within_scale(image), within_scale(truth), known


def psnr(image: Tensor, truth: Tensor, mask: Tensor | None = None) -> float:
    """Peak signal-to-noise ratio in dB for full scale 1, over all channels together.

    image, truth: [channel, y, x].
    mask: bool [y, x]. Infinite where they are equal.
    """
    _same_shape(image, truth)
    error = (image.double() - truth.double()).square().mean(0)
    mse = float((error if mask is None else error[mask]).mean())
    return math.inf if mse == 0 else -10 * math.log10(mse)


def image_psnr(image: Tensor, truth: Tensor, noise: TruthNoise = "none") -> float:
    """PSNR in dB of a photo or a restored image against the truth, both within full scale 1; see `psnr`.

    image, truth: [channel, y, x].
    noise: of the truth, as of `score`.
    """
    return level_and_error(image, truth, noise)[0]


def level_and_error(
    image: Tensor, truth: Tensor, noise: TruthNoise, mask: Tensor | None = None
) -> tuple[float, float]:
    """`Score.psnr_db` and its standard error, without the time that SSIM takes.

    image, truth: [channel, y, x].
    mask: bool [y, x].
    noise: of the truth, as of `score`.
    """
    _same_shape(image, truth)
    errors, wander = _errors(*_clipped(image, truth, noise))
    return _level(errors, wander, noise, torch.ones_like(errors, dtype=torch.bool) if mask is None else mask)


def light_error(image: Tensor, truth: Tensor, mask: Tensor | None = None) -> float:
    """By what part of the truth's mean that of the image is off, in the channel where it is most off; NaN
    where a channel of the truth is black.

    image, truth: [channel, y, x].
    mask: bool [y, x].
    """
    _same_shape(image, truth)
    inside = (..., slice(None)) if mask is None else (..., mask)
    image, truth = (values.double()[inside].flatten(1).mean(1) for values in (image, truth))
    return math.nan if bool((truth == 0).any()) else float((image / truth - 1).abs().max())


def ssim_map(image: Tensor, truth: Tensor) -> Tensor | None:
    """Structural similarity of each pixel, mean of channels, [y, x] (Wang et al., IEEE TIP 13, 2004: Gaussian
    window of sigma 1.5, full scale 1); None where the image is smaller than the window.

    image, truth: [channel, y, x].
    """
    _same_shape(image, truth)
    if min(image.shape[-2:]) < SSIM_WINDOW:
        return None
    return torch.from_numpy(_similarity(_moments(image, truth)))


def flip_map(image: Tensor, truth: Tensor) -> Tensor | None:
    """Difference that the eye sees when the two images alternate, [y, x] from 0 to 1 (Andersson et al., Proc.
    ACM Comput. Graph. Interact. Tech. 3, 2020, at 67 pixels a degree): both within full scale and encoded as
    sRGB. None where flip-evaluator, of the extra `benchmark`, is not installed.

    image, truth: [3, y, x].
    """
    _same_shape(image, truth)
    try:
        from flip_evaluator import evaluate
    except ImportError:
        return None
    encoded = (srgb_encode(within_scale(each.detach().cpu().float())) for each in (truth, image))
    seen = (np.ascontiguousarray(each.numpy().transpose(1, 2, 0)) for each in encoded)
    errors, _, _ = evaluate(*seen, "LDR", applyMagma=False, computeMeanError=False)
    return torch.from_numpy(np.asarray(errors)[..., 0].copy())


def ssim_without(image: Tensor, truth: Tensor, noise: Noise) -> tuple[Tensor, Tensor] | None:
    """As `ssim_map`, with second moments that are freed of the noise, and what it wanders by (see `_errors`).

    image, truth: [channel, y, x].
    noise: of the truth.

    The moments have no bias then; but SSIM, their ratio, is bent, so that what they wander by biases it. With
    the halves' noise added, and twice its moments taken off, they wander by twice as much: what that changes
    is taken off once.
    """
    if min(image.shape[-2:]) < SSIM_WINDOW:
        return None
    off = _moments(noise.image, noise.truth)
    middle = _similarity(_moments(image, truth), off)
    one, other = (
        _similarity(_moments(image + s * noise.image, truth + s * noise.truth), off, 2) for s in (1, -1)
    )
    return torch.from_numpy(2 * middle - (one + other) / 2), torch.from_numpy((one - other) / 2)


def _moments(x: Tensor, y: Tensor) -> list[np.ndarray]:
    """Means of x and y about each pixel, and of their squares and product, float64 [channel, y, x] each."""

    one, other = (each.detach().cpu().double().numpy() for each in (x, y))
    about = partial(gaussian_filter, sigma=1.5, truncate=3.5, axes=(1, 2))
    return [about(each) for each in (one, other, one * one, other * other, one * other)]


def _similarity(moments: list[np.ndarray], noise: list[np.ndarray] | None = None, k: int = 1) -> np.ndarray:
    """SSIM of moments, mean of channels, [y, x], freed of `k` times those of the noise."""
    x, y, xx, yy, xy = moments
    products = [x * x, y * y, x * y, xx - x * x, yy - y * y, xy - x * y]
    if noise is not None:
        p, q, pp, qq, pq = noise
        alike = (p * p, q * q, p * q, pp - p * p, qq - q * q, pq - p * q)
        products = [whole - k * off for whole, off in zip(products, alike, strict=True)]
    mean_xx, mean_yy, mean_xy, var_x, var_y, both = products
    var_x, var_y = np.maximum(var_x, 0), np.maximum(var_y, 0)
    mean_xx, mean_yy = np.maximum(mean_xx, 0), np.maximum(mean_yy, 0)
    first, second = 0.01**2, 0.03**2
    likeness = (2 * mean_xy + first) * (2 * both + second)
    return (likeness / ((mean_xx + mean_yy + first) * (var_x + var_y + second))).mean(0)


def score(image: Tensor, truth: Tensor, noise: TruthNoise = "none") -> Score:
    """PSNR and SSIM over the whole image, [channel, y, x] each.

    image, truth: [channel, y, x].
    noise: of the truth, see `TruthNoise`; "none" where it has none.
    """
    return score_parts(image, truth, [None], noise)[0]


def score_parts(
    image: Tensor, truth: Tensor, parts: Sequence[Tensor | None], noise: TruthNoise = "none"
) -> list[Score]:
    """Scores over parts of the image, each a mask, bool [y, x], that holds a pixel at least; None: all of it.
    Image and truth are taken within full scale 1, and their noise alike.

    image, truth: [channel, y, x].
    parts: masks [y, x], bool; None for the whole image.
    noise: of the truth, as of `score`.
    """
    _same_shape(image, truth)
    image, truth, known = _clipped(image, truth, noise)
    errors, wander = _errors(image, truth, known)
    if known is None:
        similarity, swing = ssim_map(image, truth), None
    else:
        similarity, swing = ssim_without(image, truth, known) or (None, None)
    unknown = math.nan if noise == "included" else 0.0
    found = []
    for mask in parts:
        inside = torch.ones_like(errors, dtype=torch.bool) if mask is None else mask.to(errors.device)
        alike, alike_se = math.nan, unknown
        if similarity is not None:
            alike = float(similarity[inside.cpu()].mean())
        if swing is not None:
            alike_se = _standard_error(swing, inside.cpu())
        level, level_se = _level(errors, wander, noise, inside)
        found.append(Score(level, alike, int(inside.sum()), level_se, alike_se))
    return found


def _errors(image: Tensor, truth: Tensor, noise: Noise | None) -> tuple[Tensor, Tensor | None]:
    """Squared error of each pixel, mean of channels, without the noise; and what it wanders by: a number
    whose square has the variance of the error's mean as its mean, where pixels' noise is added up. Both [y,
    x].

    Of an error b + e with e and d alike and independent, (b + e)^2 - d^2 has the variance 4 b^2 v + 4 v^2,
    which is the mean of 4 (b + e)^2 d^2.
    """
    error = image.double() - truth.double()
    if noise is None:
        return error.square().mean(0), None
    half = noise.image.double() - noise.truth.double()
    return (error.square() - half.square()).mean(0), 2 * (error * half).mean(0)


def _standard_error(wander: Tensor, inside: Tensor) -> float:
    """Of the mean over a part, from what its pixels wander by [y, x]; blocks of pixels count as
    independent."""
    some = torch.where(inside, wander, torch.zeros_like(wander))
    rows, columns = some.shape
    some = torch.nn.functional.pad(some, (0, -columns % BLOCK, 0, -rows % BLOCK))
    blocks = some.unflatten(0, (-1, BLOCK)).unflatten(2, (-1, BLOCK)).sum((1, 3))
    return float(blocks.square().sum().sqrt() / inside.sum())


def _level(errors: Tensor, wander: Tensor | None, noise: TruthNoise, inside: Tensor) -> tuple[float, float]:
    """PSNR in dB over a part, and its standard error, of what `_errors` found."""
    deviation = math.nan if noise == "included" else 0.0
    if wander is not None:
        deviation = _standard_error(wander, inside)
    error = float(errors[inside].mean())
    if error == 0 and not deviation > 0:
        return math.inf, deviation
    if error <= 0:
        return math.nan, math.inf
    uncertain = 10 / math.log(10) * deviation / error
    return (math.nan if uncertain > MOST_UNCERTAIN_DB else -10 * math.log10(error)), uncertain


def depth_ranges(
    inverse_depth: Tensor, edges_m: Sequence[float] = DEPTH_EDGES_M
) -> list[tuple[float, float, Tensor]]:
    """Depth ranges that hold any pixel: near_m, far_m, and where near_m <= depth < far_m, bool [y, x]; the
    last one includes infinity.

    inverse_depth: [y, x] in 1/m.
    edges_m: ascending.
    """
    depth = inverse_depth.double().reciprocal()  # 1 / 0 is infinity, as it should be
    ranges = []
    for near, far in zip(edges_m, edges_m[1:], strict=False):
        mask = (depth >= near) & (
            (depth < far) if math.isfinite(far) else torch.ones_like(depth, dtype=torch.bool)
        )
        if mask.any():
            ranges.append((near, far, mask))
    return ranges


def score_by_depth(
    image: Tensor,
    truth: Tensor,
    noise: TruthNoise,
    inverse_depth: Tensor,
    edges_m: Sequence[float] = DEPTH_EDGES_M,
) -> tuple[Score, tuple[DepthScore, ...]]:
    """The score of the whole image, and those of the pixels in each depth range that holds any (see
    `depth_ranges`).

    image, truth: [channel, y, x].
    inverse_depth: [y, x], 1/m.
    """
    ranges = depth_ranges(inverse_depth, edges_m)
    whole, *scores = score_parts(image, truth, [None, *(mask for _, _, mask in ranges)], noise)
    parts = (DepthScore(near, far, each) for (near, far, _), each in zip(ranges, scores, strict=True))
    return whole, tuple(parts)


def _same_shape(image: Tensor, truth: Tensor) -> None:
    if image.ndim != 3 or image.shape != truth.shape:
        raise InputError(
            f"images of shape {list(image.shape)} and {list(truth.shape)} cannot be compared; "
            "both must be [channel, y, x] and alike"
        )
