"""Measured PSFs as data, and the PSFs of a camera between them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ...errors import InputError

SLACK = 1e-6
"""Beyond the ends of what was measured, relative to them, that is rounding."""
WORDS = {"field": ("degrees", 1.0), "depth": ("1/m of inverse depth", 1.0), "wavelength": ("nm", 1e9)}
"""Unit of an axis in messages, and what its values are multiplied by."""


@dataclass(frozen=True, eq=False)
class MeasuredBank:
    """PSFs in upright-picture orientation, as they land on pixels of `pitch` [m].

    values: [place, depth, band, y, x], float32, each sample a fraction of the light through the pupil.
    centre: [place, depth, band, 2], (y, x) in samples of where the chief ray lands.
    rights, ups: ascending angles [deg] of a grid of places in the field, row by row in `ups`; without
        `rights`, the places lie above the axis, and others have theirs turned, as round lenses do.
        inverse_depths [1/m], wavelengths [m]: ascending.
    light: [place], on the sensor relative to the axis.
    """

    values: Tensor
    centre: Tensor
    pitch: float
    rights: tuple[float, ...]
    ups: tuple[float, ...]
    inverse_depths: tuple[float, ...]
    wavelengths: tuple[float, ...]
    light: Tensor

    @property
    def varies(self) -> bool:
        return len(self.values) > 1

    def shares(self, field: tuple[float, float], hold: Collection[str]) -> tuple[Tensor, float]:
        """Shares [place] of a place in the field, by its tangents, and the angle [rad] that PSFs are turned
        by, counter-clockwise. Raises InputError outside of what was measured, unless `hold` names it."""
        right, up = (math.degrees(math.atan(each)) for each in field)
        if self.rights:
            across = _hats("field", self.rights, [right], hold)[0]
            return torch.outer(_hats("field", self.ups, [up], hold)[0], across).flatten(), 0.0
        away = math.degrees(math.atan(math.hypot(*field)))
        turn = math.atan2(field[1], field[0]) - math.pi / 2 if away else 0.0
        if not self.varies and self.ups == (0.0,):
            return torch.ones(1, dtype=torch.float64), 0.0
        return _hats("field", self.ups, [away], hold)[0], turn


def psfs_between(
    bank: MeasuredBank,
    field: tuple[float, float],
    wavelengths: Tensor,
    inverse_depths: Tensor,
    pixel: float,
    window: int,
    hold: Collection[str] = (),
) -> Tensor:
    """PSFs [depth, band, y, x] on a window of pixels, the chief ray's in the middle, n // 2: float64.

    Between places, inverse depths and wavelengths they are mixed linearly; a sample's light is spread evenly
    over it.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    hold: axes, of "field", "depth", "wavelength", along which the outermost PSFs stand for what lies beyond
        them.
    bank: what was measured.
    field: tangents (right, up) of the chief ray.
    pixel: side of a pixel, metres.
    window: pixels along a side.

    Raises InputError outside of what was measured.
    """
    shares, turn = bank.shares(field, hold)
    by_depth = _hats("depth", bank.inverse_depths, inverse_depths.tolist(), hold)
    by_band = _hats("wavelength", bank.wavelengths, wavelengths.tolist(), hold)
    total = torch.zeros(len(inverse_depths), len(wavelengths), window, window, dtype=torch.float64)
    for place in torch.nonzero(shares).flatten().tolist():
        for depth in torch.nonzero(by_depth.any(0)).flatten().tolist():
            for band in torch.nonzero(by_band.any(0)).flatten().tolist():
                psf = bank.values[place, depth, band].double()
                seen = _on_pixels(psf, bank.centre[place, depth, band], bank.pitch / pixel, window, turn)
                weight = float(shares[place]) * by_depth[:, depth, None] * by_band[None, :, band]
                total += weight[..., None, None] * seen
    return total


def left_by_mixing(bank: MeasuredBank) -> dict[str, float]:
    """By axis, how far off mixed PSFs are at most, in percent of their light: a quarter of what is between a
    PSF and the mix of its two neighbours, twice as far apart as those that are mixed. Axes of three or more
    alone; for places in the field, those above the axis."""
    axes = {"depth": (1, bank.inverse_depths), "wavelength": (2, bank.wavelengths)}
    if not bank.rights:
        axes["field"] = (0, bank.ups)
    found = {}
    for name, (axis, known) in axes.items():
        if len(known) > 2:
            at = torch.tensor(known, dtype=torch.float32)
            part = ((at[1:-1] - at[:-2]) / (at[2:] - at[:-2])).view(-1, *[1] * (4 - axis))
            first, middle, last = (bank.values.narrow(axis, start, len(at) - 2) for start in (0, 1, 2))
            off = (middle - torch.lerp(first, last, part)).abs().sum((-1, -2)) / middle.sum((-1, -2))
            found[name] = 100 * float(off.max()) / 8  # half of the sum is light in the wrong place
    return found


def _hats(axis: str, known: Sequence[float], asked: Sequence[float], hold: Collection[str]) -> Tensor:
    """Shares of values that are asked for among ascending known ones, [asked, known], float64."""
    at = torch.tensor(known, dtype=torch.float64)
    wanted = torch.tensor(asked, dtype=torch.float64)
    slack = SLACK * float(at.abs().max())
    outside = (wanted < at[0] - slack) | (wanted > at[-1] + slack)
    if axis not in hold and bool(outside.any()):
        unit, times = WORDS[axis]
        first, last = at[0] * times, at[-1] * times
        measured = f"{first:.6g} to {last:.6g}" if len(known) > 1 else f"{first:.6g} alone"
        raise InputError(
            f"PSFs at {float(wanted[outside][0]) * times:.6g} {unit} are asked for, and measured at"
            f' {measured}; measure them, or take the nearest with hold = ["{axis}"] in [lens]'
        )
    wanted = wanted.clamp(at[0], at[-1])
    if len(at) == 1:
        return torch.ones(len(wanted), 1, dtype=torch.float64)
    place = torch.searchsorted(at, wanted).clamp(1, len(at) - 1)
    part = (wanted - at[place - 1]) / (at[place] - at[place - 1])
    shares = torch.zeros(len(wanted), len(at), dtype=torch.float64)
    rows = torch.arange(len(wanted))
    shares[rows, place - 1] = 1 - part
    shares[rows, place] += part
    return shares


def _on_pixels(psf: Tensor, centre: Tensor, ratio: float, window: int, turn: float) -> Tensor:
    """A PSF [y, x] on the pixels of a window, each of `1 / ratio` samples, turned about its centre (y, x)."""
    if abs(math.remainder(turn, 2 * math.pi)) > 1e-9:
        psf, centre = _turned(psf, centre, turn)
    down, across = (
        _overlaps(size, float(at), ratio, window) for size, at in zip(psf.shape, centre, strict=True)
    )
    return down @ psf @ across.T


def _overlaps(size: int, centre: float, ratio: float, window: int) -> Tensor:
    """Part of each sample's width that falls on each pixel, [pixel, sample]."""
    edges = (torch.arange(size + 1, dtype=torch.float64) - 0.5 - centre) * ratio + window // 2 + 0.5
    pixels = torch.arange(window, dtype=torch.float64)[:, None]
    low, high = torch.maximum(edges[:-1], pixels), torch.minimum(edges[1:], pixels + 1)
    return (high - low).clamp_min(0) / ratio


def _turned(psf: Tensor, centre: Tensor, turn: float) -> tuple[Tensor, Tensor]:
    """A PSF turned counter-clockwise, on a square that holds all of it, and its centre there; as much light
    as before."""
    rows, columns = psf.shape
    y, x = centre.tolist()
    reach = math.ceil(max(math.hypot(a, b) for a in (y, rows - 1 - y) for b in (x, columns - 1 - x)))
    axis = torch.arange(-reach, reach + 1, dtype=torch.float64)
    right, up = axis[None, :], -axis[:, None]
    cosine, sine = math.cos(turn), math.sin(turn)
    at_x, at_y = x + right * cosine + up * sine, y - (up * cosine - right * sine)
    grid = torch.stack([(2 * at_x + 1) / columns - 1, (2 * at_y + 1) / rows - 1], -1)
    seen = functional.grid_sample(psf[None, None], grid[None], "bicubic", "zeros", align_corners=False)[0, 0]
    total = float(seen.sum())
    middle = torch.tensor([reach, reach], dtype=torch.float64)
    return (seen * (float(psf.sum()) / total) if total > 0 else seen), middle
