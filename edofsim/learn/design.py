"""A mask designed alone, for the best linear restoration: where a joint training starts well.

From a flat start a joint training spends most of its time on the coarse shape of the mask: the gradient
through single patches and an untrained network is noise for the most part. The error that Wiener
deconvolution leaves has a closed form, and its gradient no noise; a few hundred steps on it give a mask that
is near-invariant over depth and passes most frequencies, and the joint training refines both.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

from .imaging import good_size
from .schedule import generator_of, rate_factor
from .system import Optics

DEPTHS = 6  # PSFs a step, one in each of as many equal parts of the depth range
RATE_RAD = 0.2
FIRST_RAD = 0.5  # size of the smooth disturbance that a flat map starts with
CONTRAST = 0.05  # variance of photographs with full scale 1
COARSEST_PX = 300.0  # below this frequency their spectrum is taken as level
NOISE = 0.008  # read noise, the middle of the training's range
DESIGN = 3  # purpose of the random numbers


def linear_error(psf: Tensor, noise: float = NOISE) -> Tensor:
    """Mean square error that Wiener deconvolution leaves where every PSF is equally likely, [channel].

    psf: [depth, channel, y, x], light landing in each pixel. With the scene's power spectrum S, the noise's
    N and the transfer functions H of the depths, the filter E[H*] S / (E|H|^2 S + N) leaves
    S - |E[H]|^2 S^2 / (E|H|^2 S + N) at each frequency. S falls with the square of the frequency (Field, JOSA
    A 4, 1987) and holds the contrast of photographs.
    """
    size = good_size(psf.shape[-1])
    transfer = torch.fft.rfft2(psf, s=(size, size))
    mean, power = transfer.mean(0), transfer.abs().square().mean(0)
    spectrum, share = _spectrum(size, psf)
    passed = mean.real.square() + mean.imag.square()
    left = spectrum - passed * spectrum.square() / (power * spectrum + noise**2)
    return (left * share).sum((-1, -2))


def design(
    mask: nn.Module,
    optics: Optics,
    steps: int,
    depth_range: tuple[float, float],
    *,
    height_noise: float,
    stray: float,
    seed: int,
    progress: Callable[[float, str], None] | None = None,
) -> float:
    """Move a learning mask to where `linear_error` is small over the depth range (inverse depths, 1/m).

    height_noise: metres, as in the training; stray: weight of the light that leaves the PSFs' window.
    Returns the error's PSNR in dB at the end, mean of channels. In place; deterministic for a seed.
    """
    low, high = depth_range
    parameters = list(mask.parameters())
    _disturb(parameters, generator_of(seed, DESIGN, 0, 0))
    optimiser = torch.optim.Adam(parameters, lr=RATE_RAD)
    quality = math.nan
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = RATE_RAD * rate_factor(step / steps, "cosine", 0.0, 0.02)
        generator = generator_of(seed, DESIGN, step + 1, 0)
        shares = (torch.arange(DEPTHS) + torch.rand(DEPTHS, generator=generator)) / DEPTHS
        depths = low + (high - low) * shares
        height = mask()
        noise = torch.randn(height.shape, generator=generator).to(height)
        psf = optics.psfs(depths, height + height_noise * noise)
        error = linear_error(psf).mean()
        lost = 1 - psf.sum((-1, -2)).mean()
        optimiser.zero_grad(set_to_none=True)
        # relative to the error, so that the weight means the same at the start and at the end
        (error.log() + stray * lost).backward()
        optimiser.step()
        quality = -10 * math.log10(float(error.detach()))
        if progress and step % 10 == 0:
            progress(0.0, f"mask alone, step {step}: {quality:.2f} dB")
    return quality


def _disturb(parameters: list[nn.Parameter], generator: torch.Generator) -> None:
    """Leave the exact symmetry of a flat map, from which its gradient could never lead out."""
    with torch.no_grad():
        for parameter in parameters:
            if parameter.ndim == 2 and parameter.shape[0] == parameter.shape[1]:
                coarse = torch.randn(1, 1, 16, 16, generator=generator)
                smooth = nn.functional.interpolate(coarse, size=parameter.shape, mode="bicubic")[0, 0]
                parameter.add_(FIRST_RAD * smooth.to(parameter))


def _spectrum(size: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """(S, share of each half-plane frequency in the whole plane), [y, x // 2 + 1]."""
    fy = torch.fft.fftfreq(size, device=like.device)[:, None]
    fx = torch.fft.rfftfreq(size, device=like.device)[None, :]
    spectrum = 1 / (fy.square() + fx.square() + COARSEST_PX**-2)
    share = torch.full_like(spectrum, 2.0)
    share[:, 0] = 1
    if size % 2 == 0:
        share[:, -1] = 1
    share = share / share.sum()
    return CONTRAST * spectrum / (spectrum * share).sum(), share
