"""PSFs over inverse depth and band, as one place in the field sees them: what every blur asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from .band_limited import band_limited_weights

AHEAD = 4
"""Inverse depths whose PSFs are computed together where not all are held."""


@dataclass(frozen=True, eq=False)
class PsfField:
    """PSFs of a camera: `values` [depth, band, y, x].

    Each pixel holds the light that lands in it as a fraction of what the mask lets through. The picture is
    upright: row 0 is the top, the centre pixel has index n // 2.

    source: the PSFs, or a function from inverse depths [n] to those of these, which is asked for a few at a
        time and forgets them: for more than memory holds.
    inverse_depths: [depth], 1/m.
    wavelengths: [band], metres; where a band is a group of bands, their mean.
    window: side of the PSFs in pixels; given with a function.
    """

    source: Tensor | Callable[[Tensor], Tensor]
    inverse_depths: Tensor
    wavelengths: Tensor
    window: int = 0
    _few: dict[int, Tensor] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.source, Tensor):
            return
        depths, bands = self.inverse_depths.numel(), self.wavelengths.numel()
        if self.source.ndim != 4 or self.source.shape[:2] != (depths, bands):
            raise ValueError(
                f"PSFs of shape {list(self.source.shape)} for {depths} depths and {bands} bands: "
                "[depth, band, y, x] is needed"
            )
        object.__setattr__(self, "window", int(self.source.shape[-1]))

    @property
    def values(self) -> Tensor:
        """All of them, [depth, band, y, x]."""
        if isinstance(self.source, Tensor):
            return self.source
        return torch.stack([self.layer(node) for node in range(self.inverse_depths.numel())])

    @cached_property
    def truncated(self) -> Tensor:
        """Light that lands outside the window, as a fraction: [depth, band]."""
        if isinstance(self.source, Tensor):
            return 1 - self.source.sum((-2, -1))
        each = [1 - self.layer(node).sum((-2, -1)) for node in range(self.inverse_depths.numel())]
        return torch.stack(each).detach()

    def layer(self, node: int) -> Tensor:
        """Those at one inverse depth, [band, y, x].

        node: index of the inverse depth.
        """
        if isinstance(self.source, Tensor):
            return self.source[node]
        first = node - node % AHEAD
        if first not in self._few:
            self._few.clear()
            self._few[first] = self.source(self.inverse_depths[first : first + AHEAD])
        return self._few[first][node - first]

    def at(self, inverse_depths: Tensor, per_dioptre: float) -> PsfField:
        """Those at other inverse depths between these, where these suffice for band-limited PSFs.

        inverse_depths: [depth], 1/m.
        per_dioptre: change of Psi with inverse depth, see `band_limited_weights`.
        """
        if not isinstance(self.source, Tensor):
            return PsfField(self.source, inverse_depths, self.wavelengths, self.window)
        weights = band_limited_weights(inverse_depths, self.inverse_depths, per_dioptre).to(self.source)
        return PsfField(torch.tensordot(weights, self.source, 1), inverse_depths, self.wavelengths)

    def grouped(self, shares: Tensor) -> PsfField:
        """PSFs of groups of bands: sums of those of the bands, by shares [group, band].

        shares: [group, band].
        """
        source, means = self.source, shares @ self.wavelengths

        def mixed(values: Tensor) -> Tensor:
            return torch.einsum("gm,nmyx->ngyx", shares.to(values), values)

        if isinstance(source, Tensor):
            return PsfField(mixed(source), self.inverse_depths, means)
        return PsfField(lambda depths: mixed(source(depths)), self.inverse_depths, means, self.window)
