"""A mask designed alone, for the best linear restoration: where a joint training starts well.

From a flat start a joint training spends most of its time on the coarse shape of the mask: the gradient
through single patches and an untrained network is noise for the most part. The error that a linear filter
leaves has a closed form, and its gradient no noise; a few hundred steps on it give a mask whose blur such a
filter takes away at all depths, and the joint training refines both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from ..capture.planes import truncated_light
from ..core.progress import Progress
from .doe import maps_of
from .schedule import generator_of, rate_factor
from .training_camera import MIDDLE, TrainingCamera

DEPTHS = 9  # PSFs a step, evenly spaced, from a random start
PARTS = 7  # or this many parts of the depth range, where each has a filter of its own
RATE_RAD = 0.2
GENTLE_RAD = 0.05  # of a map that is not flat at the start
FLAT_RAD = 1e-3
FIRST_RAD = 0.5  # size of the smooth disturbance that a flat map starts with
EVENNESS = 10.0  # how much more what lacks most counts: the power of the errors that are added up
DB = 10 / math.log(10)
DESIGN = 3  # purpose of the random numbers


def design(
    mask: nn.Module,
    optics: TrainingCamera,
    steps: int,
    depth_range: tuple[float, float],
    *,
    error: Callable[[Tensor, int], Tensor],
    groups: int = 1,
    broadband: bool = False,
    wanted_db: Sequence[tuple[float, float]] = (),
    height_noise: float,
    truncated_energy: float,
    seed: int,
    progress: Progress | None = None,
) -> float:
    """Move a learning mask to where `error` is small over the depth range (inverse depths, 1/m).

    error: (PSFs [depth, channel, y, x], number of filters) to the mean square error of each, [depth, channel]
        (see `linear`); what falls is the mean of its logarithm, as of a PSNR averaged over depth.
    broadband: whether light is a few wavelengths, others in each step, in place of three lines.
    wanted_db: (inverse depth in 1/m, PSNR in dB), ascending, and between them along lines: the mask is
        designed for the depths that most is lacking at; none for the mean.
    groups: this many filters restore, each for a part of the depth range; 1 for one filter for all.
    height_noise: standard deviation of the mask's samples in metres; what such errors do to the PSFs is taken
        in its mean.
    truncated_energy: weight of the light that leaves the PSFs' window.

    Returns the error's PSNR in dB at the end, mean of depths. In place; deterministic for a seed.
    """
    low, high = depth_range
    parameters = list(mask.parameters())
    flat = _disturb(parameters, generator_of(seed, DESIGN, 0, 0))
    # the latest gradients count: they follow the mask, and have no noise that a longer mean would take away
    rate = RATE_RAD if flat else GENTLE_RAD
    optimiser = torch.optim.Adam(parameters, lr=rate, betas=(0.9, 0.99))
    quality = math.nan
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = rate * rate_factor(step / steps, "cosine", 0.0, 0.01)
        generator = generator_of(seed, DESIGN, step + 1, 0)
        depths, filters = _depths(low, high, groups, generator)
        shift = float(torch.rand(1, generator=generator)) if broadband else MIDDLE
        psf = optics.with_mask(maps_of(mask)).psfs(depths, broadband, height_noise, shift)
        left = error(psf, filters).mean(1).log()
        relative = _lacking(left, depths, wanted_db) if wanted_db else left.mean()
        truncated = truncated_light(psf).mean()
        optimiser.zero_grad(set_to_none=True)
        (relative + truncated_energy * truncated).backward()
        optimiser.step()
        quality = -DB * float(left.detach().mean())
        if progress and step % 10 == 0:
            progress(0.0, f"mask alone, step {step}: {quality:.2f} dB")
    return quality


def _lacking(left: Tensor, depths: Tensor, wanted_db: Sequence[tuple[float, float]]) -> Tensor:
    """By how much errors, logarithms [depth], are larger than wanted, the largest for the most part."""
    places, levels = np.array(wanted_db).T
    wanted = np.interp(depths.numpy(), places, levels)
    return torch.logsumexp(EVENNESS * (left + torch.from_numpy(wanted).to(left) / DB), 0) / EVENNESS


def _depths(low: float, high: float, groups: int, generator: torch.Generator) -> tuple[Tensor, int]:
    """(inverse depths of a step, number of filters for them): two for each of a few parts, as far from each
    other as those that a filter is for. The ends of the range, which no neighbours lift, come more often than
    other places: all that would lie beyond them."""
    start = torch.rand(1, generator=generator)
    if groups == 1:
        return low + (high - low) * (torch.arange(DEPTHS) + start) / DEPTHS, 1
    count, part = min(PARTS, groups), (high - low) / groups
    middles = low - part + (high - low + 2 * part) * (torch.arange(count) + start) / count
    pairs = middles[:, None] + part / 4 * torch.tensor([-1.0, 1.0])
    return pairs.flatten().clamp(low, high), count


def _disturb(parameters: list[nn.Parameter], generator: torch.Generator) -> bool:
    """Leave the exact symmetry of a flat map, from which its gradient could never lead out. False for a mask
    that has a shape: a map that is not flat."""
    maps = [one for one in parameters if one.ndim == 2 and one.shape[0] == one.shape[1]]
    if any(float(one.detach().std()) > FLAT_RAD for one in maps):
        return False
    with torch.no_grad():
        for parameter in maps:
            coarse = torch.randn(1, 1, 16, 16, generator=generator)
            smooth = nn.functional.interpolate(coarse, size=parameter.shape, mode="bicubic")[0, 0]
            parameter.add_(FIRST_RAD * smooth.to(parameter))
    return True
