"""From the pupil function of one wavelength to its PSFs at all depths, in blocks, with its own adjoint."""

from __future__ import annotations

import torch
from torch import Tensor

from .transform import Bases, fold, intensity, intensity_gradient, unfold, waves, waves_gradient

BLOCK_BYTES = 16 << 20
"""Working memory of one block on a CPU: a few PSFs at a time stay near its cores."""
DEVICE_BLOCK_BYTES = 1 << 30
"""The same on an accelerator, where large blocks keep it busy."""


def propagate(pupil: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
    """Energy in each pixel of the symmetric window, [depth, pixel, pixel], from a complex pupil [s, s].

    chirps: complex [depth, half], the defocus of each depth along one axis of the pupil, from its centre
    outwards. Differentiable by the pupil. The backward pass keeps only the pupil function and computes
    fields again, which takes less memory than automatic differentiation, and less time (`make bench`
    measures both).
    """
    return _Propagation.apply(pupil, chirps, bases)


class _Propagation(torch.autograd.Function):
    @staticmethod
    def forward(ctx, pupil: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
        ctx.save_for_backward(pupil, chirps)
        ctx.bases = bases
        parts, size = fold(pupil), 2 * len(bases.pixels) - 1
        energy = torch.empty(len(chirps), size, size, dtype=parts.dtype, device=parts.device)
        blocks = chirps.split(depths_at_once(bases))
        for block, out in zip(blocks, energy.split(depths_at_once(bases)), strict=True):
            out.copy_(intensity(*waves(parts, block, bases.fourier), bases))
        return energy

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream: Tensor) -> tuple[Tensor | None, ...]:
        pupil, chirps = ctx.saved_tensors
        bases = ctx.bases
        parts = fold(pupil)
        total = torch.zeros_like(parts)
        blocks = chirps.split(depths_at_once(bases))
        for block, given in zip(blocks, upstream.split(depths_at_once(bases)), strict=True):
            fields = waves(parts, block, bases.fourier)
            total += waves_gradient(*intensity_gradient(given, *fields, bases), block, bases.fourier)
        return unfold(total, pupil.shape[-1]), None, None


def depths_at_once(bases: Bases) -> int:
    """How many depths make a block whose work fits the working memory."""
    sensor, pupil = bases.halves
    numbers = 12 * pupil**2 + 8 * sensor * pupil + 24 * sensor**2
    limit = BLOCK_BYTES if bases.fourier.device.type == "cpu" else DEVICE_BLOCK_BYTES
    return max(1, limit // (numbers * bases.fourier.element_size()))
