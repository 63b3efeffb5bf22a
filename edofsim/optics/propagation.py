"""From pupil functions to PSFs, in blocks of depths, with its own adjoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from torch import Tensor
from torch.autograd.function import FunctionCtx

from ..core.threads import in_threads
from .transform import (
    Bases,
    across,
    down,
    even_energy,
    fold,
    intensity,
    intensity_gradient,
    is_even,
    pairs,
    shared_intensity,
    unfold,
    waves,
    waves_gradient,
    windowed,
)

BLOCK_BYTES = 16 << 20
"""Working memory of one block of depths on a core of a CPU: a few PSFs at a time stay near it."""
DEVICE_BLOCK_BYTES = 1 << 30
"""The same on an accelerator, where large blocks keep it busy."""
KEPT_BYTES = 256 << 20
"""Fields that are kept for the backward pass; more are computed again."""

Fields = tuple[Tensor, Tensor]
Part = Sequence[tuple[int, int]]
"""Of the pupil: windows along y and along x whose products it is the sum of."""


@dataclass(frozen=True)
class Wave:
    """One wavelength on its way to the sensor.

    pupil: the pupil function without defocus, complex [s, s].
    chirps: the defocus of each depth along half an axis of the pupil, complex [depth, half].
    bases: what turns them into pixels.
    bend: what defocus is in addition, phases [2, s, s] that grow with the steps [depth] from one depth to
        each, and with their squares.
    """

    pupil: Tensor
    chirps: Tensor
    bases: Bases
    bend: Tensor | None = None
    steps: Tensor | None = None

    def part(self, depths: slice) -> Wave:
        """That of some of the depths."""
        steps = None if self.steps is None else self.steps[depths]
        return replace(self, chirps=self.chirps[depths], steps=steps)

    def turned(self) -> Tensor | None:
        """What the pupil is multiplied by at each depth, [depth, s, s]; None: by nothing."""
        if self.bend is None or self.steps is None:
            return None
        steps = self.steps[:, None, None]
        phase = steps * (self.bend[0] + steps * self.bend[1])
        return torch.complex(torch.cos(phase), torch.sin(phase))

    def quarter(self) -> Wave:
        """The same whose bend is known on a quarter of the pupil, where it is its own mirror image."""
        if self.bend is None or not all(torch.equal(self.bend, self.bend.flip(axis)) for axis in (1, 2)):
            return self
        half = self.bend.shape[-1] // 2
        return replace(self, bend=self.bend[:, half:, half:].contiguous())

    def at_depths(self) -> Tensor:
        """The pupil function without the chirps, [s, s] or [depth, s, s]."""
        turned = self.turned()
        return self.pupil if turned is None else self.pupil * turned


def energies(wave: Wave, keep: list[Fields] | None = None) -> Tensor:
    """Energy in each pixel of the symmetric window, [depth, pixel, pixel].

    keep: a list that gets the fields of each block, for `pupil_gradient`.
    """
    size, real = 2 * len(wave.bases.pixels) - 1, wave.bases.fourier
    energy = torch.empty(len(wave.chirps), size, size, dtype=real.dtype, device=real.device)
    whole = parts = fold(wave.pupil)
    even = keep is None and is_even(parts)
    at_once = depths_at_once(wave.bases)
    wave = wave.quarter()
    for start, out in zip(range(0, len(energy), at_once), energy.split(at_once), strict=True):
        some = wave.part(slice(start, start + at_once))
        if some.bend is not None and some.bend.shape[-1] < wave.pupil.shape[-1]:
            parts = _turned(whole[:1, :, :1] if even else whole, some)
        elif some.bend is not None:
            parts = fold(some.at_depths())
            even = keep is None and is_even(parts)
        if even:
            out.copy_(even_energy(parts, some.chirps, wave.bases))
            continue
        fields = waves(parts, some.chirps, wave.bases.fourier)
        out.copy_(intensity(*fields, wave.bases))
        if keep is not None:
            keep.append(fields)
    return energy


def _turned(parts: Tensor, wave: Wave) -> Tensor:
    """`fold` of a pupil times what it is `turned` by, of parts of the pupil alone."""
    turned = wave.turned()
    assert turned is not None
    turned = turned.movedim(0, 1)
    (re, im), (real, imaginary) = parts.unbind(1), (turned.real, turned.imag)
    return torch.stack([re * real - im * imaginary, re * imaginary + im * real], 1)


def shared_energies(wave: Wave, along: Tensor, parts: Sequence[Part]) -> Tensor:
    """What sub-apertures add to the energy in each pixel, [part, depth, pixel, pixel]: Re(F* F_j).

    along: [window, s], windows along an axis of the pupil that sum to 1.
    parts: each a sum of products of one along y and one along x. Parts in one row share the transform along
        y, which is most of the work.
    wave: from the pupil to the window.
    """
    alike = None if wave.bend is not None else _rows(wave.pupil, along)  # at all depths
    size = 2 * len(wave.bases.pixels) - 1
    energy = along.new_empty(len(parts), len(wave.chirps), size, size)
    at_once = max(1, depths_at_once(wave.bases) // len(along))
    for start in range(0, len(wave.chirps), at_once):
        some = wave.part(slice(start, start + at_once))
        block = some.chirps
        rows = _rows(some.at_depths(), along) if alike is None else alike
        half = [down(row, block, wave.bases.fourier, lit) for row, lit in rows]
        whole = pairs(*across(_summed(half), wave.bases.fourier))
        for out, part in zip(energy, parts, strict=True):
            lit = _lit(along[[x for _, x in part]].sum(0))
            mine = [
                windowed(half[row], along[[x for y, x in part if y == row]].sum(0), lit)
                for row in sorted({y for y, _ in part})
            ]
            own = across(_summed(mine), wave.bases.fourier[..., lit])
            out[start : start + at_once] = shared_intensity(whole, own, wave.bases)
    return energy


def _rows(pupil: Tensor, along: Tensor) -> list[tuple[Tensor, slice]]:
    """`fold` of a pupil [s, s] or [depth, s, s] under each window [window, s] along y, and where it is lit:
    of no more than that where the pupil has no middle row."""
    found = []
    for window in along:
        lit, half = _lit(window), len(window) // 2
        if len(window) % 2:
            found.append((fold(pupil * window[:, None]), lit))
            continue
        there = [slice(half - lit.stop, half - lit.start), slice(half + lit.start, half + lit.stop)]
        parts = [pupil[..., part, :] * window[part, None] for part in there]
        found.append((fold(torch.cat(parts, -2)), lit))
    return found


def _summed(pairs: Sequence[Fields]) -> Fields:
    even, odd = zip(*pairs, strict=True)
    return reduce(torch.add, even), reduce(torch.add, odd)


def _lit(window: Tensor) -> slice:
    """Where a window [s] along an axis, or its mirror image, is not zero on half of that axis."""
    half = len(window) // 2
    there = torch.nonzero(window[half:] + window[: len(window) - half].flip(0)).squeeze(1)
    return slice(int(there[0]), int(there[-1]) + 1)


def pupil_gradient(wave: Wave, upstream: Tensor, kept: list[Fields]) -> Tensor:
    """Adjoint of `energies`: gradient of a loss by the pupil, complex [s, s], from that by the energies.

    upstream: gradient by the energies, [depth, pixel, pixel].
    wave: from the pupil to the window.
    kept: what `energies` kept of each block of depths.
    """
    parts = fold(wave.pupil)
    total = torch.zeros_like(wave.pupil)
    at_once = depths_at_once(wave.bases)
    for index, given in enumerate(upstream.split(at_once)):
        some = wave.part(slice(index * at_once, (index + 1) * at_once))
        if some.bend is not None:
            parts = fold(some.at_depths())
        fields = kept[index] if kept else waves(parts, some.chirps, wave.bases.fourier)
        gradients = intensity_gradient(given, *fields, wave.bases)
        found = waves_gradient(*gradients, some.chirps, wave.bases.fourier, some.bend is not None)
        pupils, turned = unfold(found, wave.pupil.shape[-1]), some.turned()
        total += pupils if turned is None else (pupils * turned.conj()).sum(0)
    return total


def propagate(wave_of_band: Sequence[Wave]) -> Tensor:
    """`energies` of wavelengths, [depth, band, pixel, pixel], differentiable by pupil functions.

    The adjoint is written by hand: between the passes it keeps the fields on the sensor, or where they are
    large the pupil alone, and nothing else, so that it takes less memory than automatic differentiation and
    less time (`make bench` measures both).
    """
    return _Propagation.apply(list(wave_of_band), *(wave.pupil for wave in wave_of_band))


class _Between(FunctionCtx):
    """What the forward pass leaves for the backward pass."""

    bands: list[Wave]
    blocks: list[int]
    needs_input_grad: tuple[bool, ...]
    saved_tensors: tuple[Tensor, ...]


class _Propagation(torch.autograd.Function):
    # torch calls both with what it kept and what `apply` was given, whatever that is
    @staticmethod
    # pyrefly: ignore[bad-override]
    def forward(ctx: _Between, wave_of_band: list[Wave], *pupils: Tensor) -> Tensor:
        size = sum(_field_bytes(wave) for wave in wave_of_band)
        keep = any(ctx.needs_input_grad) and size <= KEPT_BYTES
        kept: list[list[Fields]] = [[] for _ in wave_of_band]
        work = list(zip(wave_of_band, kept if keep else [None] * len(kept), strict=True))
        energy = in_threads(lambda item: energies(*item), work, pupils[0].device)
        ctx.bands, ctx.blocks = wave_of_band, [len(fields) for fields in kept]
        ctx.save_for_backward(*(tensor for fields in kept for pair in fields for tensor in pair))
        return torch.stack(energy, dim=1)

    @staticmethod
    @torch.autograd.function.once_differentiable
    # pyrefly: ignore[bad-override]
    def backward(ctx: _Between, upstream: Tensor) -> tuple[Tensor | None, ...]:
        saved = iter(ctx.saved_tensors)
        kept = [[(next(saved), next(saved)) for _ in range(count)] for count in ctx.blocks]
        work = list(zip(ctx.bands, upstream.unbind(1), kept, strict=True))
        return None, *in_threads(lambda item: pupil_gradient(*item), work, upstream.device)


def depths_at_once(bases: Bases) -> int:
    """How many depths make a block whose work fits the working memory."""
    sensor, pupil = bases.halves
    numbers = 12 * pupil**2 + 8 * sensor * pupil + 24 * sensor**2
    limit = BLOCK_BYTES if bases.fourier.device.type == "cpu" else DEVICE_BLOCK_BYTES
    return max(1, limit // (numbers * bases.fourier.element_size()))


def _field_bytes(wave: Wave) -> int:
    return 8 * len(wave.chirps) * wave.bases.halves[0] ** 2 * wave.bases.fourier.element_size()
