"""How close an image is to the truth: PSNR and SSIM, whole and by depth.

Every score of a photo or a restored image, whatever the command, is `image_psnr` or of `score_parts`: both
images as a sensor of full scale 1 can hold them. `psnr` takes two images as they are, to tell how far apart
two simulations of one photo are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import InputError

DEPTH_EDGES_M = (0.0, 0.6, 0.85, 1.15, 1.6, 3.0, math.inf)
SSIM_WINDOW = 11  # pixels across the Gaussian of Wang et al. (2004), sigma 1.5 cut at 3.5 sigma


@dataclass(frozen=True)
class Score:
    """psnr_db: infinite for equal images; ssim: NaN where the image is smaller than the SSIM window;
    pixels: how many it was taken over."""

    psnr_db: float
    ssim: float
    pixels: int


@dataclass(frozen=True)
class DepthScore:
    """A score over the pixels with near_m <= depth < far_m."""

    near_m: float
    far_m: float
    score: Score


def within_scale(image: Tensor) -> Tensor:
    """What full scale 1 can hold of an image. A saturated highlight may be many times as bright: it would
    decide a score alone, by how it is clipped and not by how anything is restored."""
    return image.clamp(0, 1)


def psnr(image: Tensor, truth: Tensor, mask: Tensor | None = None) -> float:
    """Peak signal-to-noise ratio in dB for full scale 1, over all channels together.

    image, truth: [channel, y, x]; mask: bool [y, x]. Infinite where they are equal.
    """
    _same_shape(image, truth)
    error = (image.double() - truth.double()).square().mean(0)
    mse = float((error if mask is None else error[mask]).mean())
    return math.inf if mse == 0 else -10 * math.log10(mse)


def image_psnr(image: Tensor, truth: Tensor, mask: Tensor | None = None) -> float:
    """PSNR in dB of a photo or a restored image against the truth, both within full scale 1; see `psnr`."""
    return psnr(within_scale(image), within_scale(truth), mask)


def light_error(image: Tensor, truth: Tensor, mask: Tensor | None = None) -> float:
    """By what part of the truth's mean that of the image is off, in the channel where it is most off; NaN
    where a channel of the truth is black. image, truth: [channel, y, x]; mask: bool [y, x]."""
    _same_shape(image, truth)
    inside = (..., slice(None)) if mask is None else (..., mask)
    image, truth = (values.double()[inside].flatten(1).mean(1) for values in (image, truth))
    return math.nan if bool((truth == 0).any()) else float((image / truth - 1).abs().max())


def ssim_map(image: Tensor, truth: Tensor) -> Tensor | None:
    """Structural similarity of each pixel, mean of channels, [y, x] (Wang et al., IEEE TIP 13, 2004:
    Gaussian window of sigma 1.5, full scale 1); None where the image is smaller than the window."""
    _same_shape(image, truth)
    if min(image.shape[-2:]) < SSIM_WINDOW:
        return None
    from skimage.metrics import structural_similarity  # takes a seventh of a second

    _, values = structural_similarity(
        image.detach().cpu().double().numpy(),
        truth.detach().cpu().double().numpy(),
        channel_axis=0,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return torch.from_numpy(values).mean(0)


def score(image: Tensor, truth: Tensor) -> Score:
    """PSNR and SSIM over the whole image, [channel, y, x] each."""
    return score_parts(image, truth, [None])[0]


def score_parts(image: Tensor, truth: Tensor, parts: Sequence[Tensor | None]) -> list[Score]:
    """Scores over parts of the image, each a mask, bool [y, x], that holds a pixel at least; None: all of
    it. Image and truth are taken within full scale 1."""
    image, truth = within_scale(image), within_scale(truth)
    similarity = ssim_map(image, truth)
    found = []
    for mask in parts:
        alike = math.nan
        if similarity is not None:
            alike = float((similarity if mask is None else similarity[mask.cpu()]).mean())
        pixels = truth[0].numel() if mask is None else int(mask.sum())
        found.append(Score(psnr(image, truth, mask), alike, pixels))
    return found


def depth_ranges(
    inverse_depth: Tensor, edges_m: Sequence[float] = DEPTH_EDGES_M
) -> list[tuple[float, float, Tensor]]:
    """Depth ranges that hold any pixel: near_m, far_m, and where near_m <= depth < far_m, bool [y, x]; the
    last one includes infinity. inverse_depth: [y, x] in 1/m; edges_m: ascending."""
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
    image: Tensor, truth: Tensor, inverse_depth: Tensor, edges_m: Sequence[float] = DEPTH_EDGES_M
) -> tuple[Score, tuple[DepthScore, ...]]:
    """The score of the whole image, and those of the pixels in each depth range that holds any (see
    `depth_ranges`)."""
    ranges = depth_ranges(inverse_depth, edges_m)
    whole, *scores = score_parts(image, truth, [None, *(mask for _, _, mask in ranges)])
    parts = (DepthScore(near, far, each) for (near, far, _), each in zip(ranges, scores, strict=True))
    return whole, tuple(parts)


def _same_shape(image: Tensor, truth: Tensor) -> None:
    if image.ndim != 3 or image.shape != truth.shape:
        raise InputError(
            f"images of shape {list(image.shape)} and {list(truth.shape)} cannot be compared; "
            "both must be [channel, y, x] and alike"
        )
