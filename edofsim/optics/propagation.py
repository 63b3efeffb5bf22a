"""From the pupil function of one wavelength to its PSFs at all depths, in blocks, with its own adjoint."""

from __future__ import annotations

import torch
from torch import Tensor

from .transform import Bases, fold, intensity, intensity_gradient, unfold, waves, waves_gradient

BLOCK_BYTES = 16 << 20
"""Working memory of one block on a CPU: a few PSFs at a time stay near its cores."""
DEVICE_BLOCK_BYTES = 1 << 30
"""The same on an accelerator, where large blocks keep it busy."""
KEPT_BYTES = 64 << 20
"""Fields of one wavelength that are kept for the backward pass; larger ones are computed again."""


def propagate(pupil: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
    """Energy in each pixel of the symmetric window, [depth, pixel, pixel], from a complex pupil [s, s].

    chirps: complex [depth, half], the defocus of each depth along one axis of the pupil, from its centre
    outwards. Differentiable by the pupil, through an adjoint written by hand: it keeps the field on the
    sensor, or where that is large the pupil alone, and nothing in between, so that it takes less memory than
    automatic differentiation, and less time (`make bench` measures both).
    """
    return _Propagation.apply(pupil, chirps, bases)


class _Propagation(torch.autograd.Function):
    @staticmethod
    def forward(ctx, pupil: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
        parts, size = fold(pupil), 2 * len(bases.pixels) - 1
        energy = torch.empty(len(chirps), size, size, dtype=parts.dtype, device=parts.device)
        keep = ctx.needs_input_grad[0] and _field_bytes(chirps, bases) <= KEPT_BYTES
        fields: list[Tensor] = []
        for block, out in zip(*(x.split(depths_at_once(bases)) for x in (chirps, energy)), strict=True):
            even, odd = waves(parts, block, bases.fourier)
            out.copy_(intensity(even, odd, bases))
            fields += [even, odd] if keep else []
        ctx.bases = bases
        ctx.save_for_backward(pupil, chirps, *fields)
        return energy

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream: Tensor) -> tuple[Tensor | None, ...]:
        pupil, chirps, *fields = ctx.saved_tensors
        bases = ctx.bases
        parts = fold(pupil)
        total = torch.zeros_like(parts)
        blocks = zip(*(x.split(depths_at_once(bases)) for x in (chirps, upstream)), strict=True)
        for index, (block, given) in enumerate(blocks):
            even, odd = fields[2 * index : 2 * index + 2] or waves(parts, block, bases.fourier)
            gradients = intensity_gradient(given, even, odd, bases)
            total += waves_gradient(*gradients, block, bases.fourier)
        return unfold(total, pupil.shape[-1]), None, None


def depths_at_once(bases: Bases) -> int:
    """How many depths make a block whose work fits the working memory."""
    sensor, pupil = bases.halves
    numbers = 12 * pupil**2 + 8 * sensor * pupil + 24 * sensor**2
    limit = BLOCK_BYTES if bases.fourier.device.type == "cpu" else DEVICE_BLOCK_BYTES
    return max(1, limit // (numbers * bases.fourier.element_size()))


def _field_bytes(chirps: Tensor, bases: Bases) -> int:
    return 8 * len(chirps) * bases.halves[0] ** 2 * bases.fourier.element_size()
