"""Which parts of a picture to show enlarged: textured ones, near, at focus and far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..core.images import srgb_encode
from ..restore.scores import Noise, TruthNoise
from .words import depth_range

ENOUGH = 0.01  # a depth range counts as present from this fraction of the pixels on
LARGEST_OVERLAP = 0.25  # of a crop with another one


@dataclass(frozen=True)
class DepthRange:
    """Depths from near_m to far_m, both included; far_m may be infinite. `name` says what is special."""

    near_m: float
    far_m: float
    name: str = ""

    def mask(self, inverse_depth: Tensor) -> Tensor:
        """Where inverse_depth [y, x] in 1/m lies inside: bool [y, x]. NaN lies nowhere.

        inverse_depth: [y, x], 1/m.
        """
        nearest = math.inf if self.near_m <= 0 else 1 / self.near_m
        slack = 1e-6  # float32 depths that equal a bound belong to the range
        return (inverse_depth <= nearest * (1 + slack)) & (inverse_depth >= 1 / self.far_m * (1 - slack))

    def __str__(self) -> str:
        return depth_range(self.near_m, self.far_m)


@dataclass(frozen=True)
class Detail:
    """A square of `size` pixels from the top left (x, y), for one depth range."""

    x: int
    y: int
    size: int
    range: DepthRange
    depth_m: float  # mean inverse depth of the pixels in range, as a depth

    def cut(self, image: Tensor) -> Tensor:
        """The square out of an image [..., y, x].

        image: [..., y, x].
        """
        return image[..., self.y : self.y + self.size, self.x : self.x + self.size]

    def cut_noise(self, noise: TruthNoise) -> TruthNoise:
        """The square out of what an image is scored without."""
        return Noise(self.cut(noise.truth), self.cut(noise.image)) if isinstance(noise, Noise) else noise


def choose_crops(
    inverse_depth: Tensor, ideal: Tensor, size: int, ranges: Sequence[DepthRange]
) -> tuple[Detail, ...]:
    """For each depth range that the picture holds, the square with the most texture at these depths.

    inverse_depth: [y, x] in 1/m.
    ideal: linear [3, y, x].
    size: pixels, made smaller for small pictures.

    Texture is the gradient of the encoded picture, as the eye sees it, summed over the square's pixels in
    range; squares with few such pixels are passed over where better filled ones exist, and so are squares
    that overlap an earlier one by more than a quarter. Without any texture the most central square wins.
    """
    rows, columns = inverse_depth.shape
    size = max(1, min(size, rows, columns))
    depth = inverse_depth.detach().cpu().double()
    texture = _gradient(ideal.detach().cpu().double())
    y, x = torch.meshgrid(torch.arange(rows - size + 1), torch.arange(columns - size + 1), indexing="ij")
    off_centre = torch.hypot(y - (rows - size) / 2, x - (columns - size) / 2) / math.hypot(rows, columns)
    crops: list[Detail] = []
    for wanted in ranges:
        mask = wanted.mask(depth)
        if not mask.any():
            continue
        filled = _box_sum(mask.double(), size) / size**2
        merit = _box_sum(texture * mask, size) / size**2 - 1e-6 * off_centre
        allowed = filled >= min(0.6, 0.8 * float(filled.max()))
        apart = torch.ones_like(allowed)
        for other in crops:
            shared = (size - (y - other.y).abs()).clamp_min(0) * (size - (x - other.x).abs()).clamp_min(0)
            apart &= shared <= LARGEST_OVERLAP * size**2
        if (allowed & apart).any():
            allowed &= apart
        best = int(torch.where(allowed, merit, -math.inf).argmax())
        top, left = divmod(best, columns - size + 1)
        seen = depth[top : top + size, left : left + size][mask[top : top + size, left : left + size]]
        mean = float(seen.mean())
        crops.append(Detail(left, top, size, wanted, math.inf if mean <= 0 else 1 / mean))
    return tuple(crops)


def near_focus_far(
    inverse_depth: Tensor, ranges: Sequence[DepthRange], focus_m: float | None
) -> tuple[DepthRange, ...]:
    """The nearest and farthest of `ranges` that hold at least 1 % of the pixels, and depths around focus.

    inverse_depth: [y, x], 1/m.

    Depths within 0.1 1/m of focus, or as far from it as the nearest 5 % of the pixels are. Without
    `ranges` (or without enough pixels in any) the whole depth of the picture is one range. Ranges that
    another one of the three covers already are left out.
    """
    depth = inverse_depth.detach().cpu().double()
    finite = depth[torch.isfinite(depth)]
    if not finite.numel():
        return ()
    present = [r for r in ranges if float(r.mask(depth).double().mean()) >= ENOUGH]
    present.sort(key=lambda r: r.near_m)
    if not present:
        nearest, farthest = float(finite.max()), float(finite.min())
        present = [DepthRange(_depth(nearest), _depth(farthest))]
    if len(present) == 1:
        return (DepthRange(present[0].near_m, present[0].far_m, "Scene"),)
    near = DepthRange(present[0].near_m, present[0].far_m, "Nearest")
    far = DepthRange(present[-1].near_m, present[-1].far_m, "Farthest")
    if focus_m is None:
        return near, far
    away = (finite - 1 / focus_m).abs()
    half = float(away.kthvalue(max(1, round(0.05 * away.numel()))).values)
    name = "At focus" if half <= 0.1 else "Nearest to focus"
    half = max(0.1, half)
    focus = DepthRange(_depth(1 / focus_m + half), _depth(1 / focus_m - half), name)
    inside = focus.mask(depth)
    if float((inside & ~near.mask(depth) & ~far.mask(depth)).sum()) < 0.5 * float(inside.sum()):
        return near, far
    return near, focus, far


def _depth(inverse_depth: float) -> float:
    return 1 / inverse_depth if inverse_depth > 0 else math.inf


def _gradient(ideal: Tensor) -> Tensor:
    """Sum of the absolute differences to the right and lower neighbour, mean of channels, [y, x]."""
    seen = srgb_encode(torch.nan_to_num(ideal, nan=0.0))
    strength = torch.zeros_like(seen)
    strength[..., :, :-1] += seen.diff(dim=-1).abs()
    strength[..., :-1, :] += seen.diff(dim=-2).abs()
    return strength.mean(0)


def _box_sum(values: Tensor, size: int) -> Tensor:
    """Sum over each square of `size` pixels that fits: [y, x] to [y - size + 1, x - size + 1]."""
    total = torch.nn.functional.pad(values.cumsum(0).cumsum(1), (1, 0, 1, 0))
    return total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]
