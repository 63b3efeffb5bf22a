"""From the pupil function of one wavelength to its PSFs at all depths, in blocks, with its own adjoint."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from .depths import Defocus
from .transform import Bases, fold, intensity, intensity_gradient, unfold, waves, waves_gradient

BLOCK_BYTES = 16 << 20
"""Working memory of one block on a CPU: a few PSFs at a time stay near its cores."""
DEVICE_BLOCK_BYTES = 1 << 30
"""The same on an accelerator, where large blocks keep it busy."""


def propagate(pupil: Tensor, defocus: Defocus, bases: Bases) -> Tensor:
    """Energy in each pixel of the symmetric window, [depth, pixel, pixel], from a complex pupil [s, s].

    Differentiable by the pupil. The backward pass keeps only the pupil function and computes fields again: less
    memory than automatic differentiation and less time (`edofsim evaluate bench-optics` measures both).
    """
    return _Propagation.apply(pupil if defocus.offset is None else pupil * defocus.offset, defocus, bases)


class _Propagation(torch.autograd.Function):
    @staticmethod
    def forward(ctx, pupil: Tensor, defocus: Defocus, bases: Bases) -> Tensor:
        ctx.save_for_backward(pupil)
        ctx.defocus, ctx.bases = defocus, bases
        return torch.cat([intensity(*fields, bases) for _, fields in _fields(fold(pupil), defocus, bases)])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream: Tensor) -> tuple[Tensor | None, ...]:
        (pupil,) = ctx.saved_tensors
        defocus, bases = ctx.defocus, ctx.bases
        parts = fold(pupil)
        total, done = torch.zeros_like(parts), 0
        by_terms: list[Tensor] | None = None
        for factor, (even, odd) in _fields(parts, defocus, bases):
            block = upstream[done : done + even.shape[3]]
            done += len(block)
            gradients = intensity_gradient(block, even, odd, bases)
            if defocus.weights is None:
                total += waves_gradient(*gradients, factor, bases.fourier)
            elif by_terms is None:
                by_terms = [factor.T @ gradient for gradient in gradients]
            else:
                for sum_, gradient in zip(by_terms, gradients, strict=True):
                    sum_ += factor.T @ gradient
        if by_terms is not None:
            done = 0
            for maps in defocus.blocks(_block(bases)):
                here = (sum_[:, :, :, done : done + maps.shape[2]] for sum_ in by_terms)
                total += waves_gradient(*here, maps, bases.fourier)
                done += maps.shape[2]
        return unfold(total, pupil.shape[-1]), None, None


def _fields(parts: Tensor, defocus: Defocus, bases: Bases) -> Iterator[tuple[Tensor, tuple[Tensor, Tensor]]]:
    """Blocks of depths: what made them (maps, or weights of the series) and their even and odd fields."""
    size = _block(bases)
    if defocus.weights is None:
        for maps in defocus.blocks(size):
            yield maps, waves(parts, maps, bases.fourier)
        return
    terms = [waves(parts, maps, bases.fourier) for maps in defocus.blocks(size)]
    even, odd = (torch.cat(component, dim=3) for component in zip(*terms, strict=True))
    for weights in defocus.weights.split(size):
        yield weights, (weights @ even, weights @ odd)


def _block(bases: Bases) -> int:
    """Depths a block whose work fits the working memory."""
    sensor, pupil = bases.halves
    numbers = 6 * pupil**2 + 8 * sensor * pupil + 16 * sensor**2
    limit = BLOCK_BYTES if bases.fourier.device.type == "cpu" else DEVICE_BLOCK_BYTES
    return max(1, limit // (numbers * bases.fourier.element_size()))
