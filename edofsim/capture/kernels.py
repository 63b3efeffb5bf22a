"""PSFs at depth nodes, as the methods ask for them: held in memory, or computed as they are needed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from ..errors import InputError
from ..optics.band_limited import band_limited_weights


class Kernels(Protocol):
    """PSFs of every band at ascending depth nodes.

    nodes: [node] inverse depths in 1/m; wavelengths: [band], metres; window: side of the PSFs in pixels;
    layer(k): [band, y, x] at node k, each pixel the fraction of the light through the pupil that lands in it;
    truncated(k): [band], the fraction that lands outside the window; at(nodes, per_dioptre): those of other
    depths between these nodes, where they are enough for band-limited PSFs (see `BandLimit`).
    """

    @property
    def nodes(self) -> Tensor: ...

    @property
    def wavelengths(self) -> Tensor: ...

    @property
    def window(self) -> int: ...

    def layer(self, node: int) -> Tensor: ...

    def truncated(self, node: int) -> Tensor: ...

    def at(self, nodes: Tensor, per_dioptre: float) -> Kernels: ...


@dataclass(frozen=True)
class HeldKernels:
    """values: [node, band, y, x]; nodes: [node] inverse depths, ascending; wavelengths: [band]."""

    values: Tensor
    nodes: Tensor
    wavelengths: Tensor

    def __post_init__(self) -> None:
        if self.values.ndim != 4 or self.values.shape[:2] != (self.nodes.numel(), self.wavelengths.numel()):
            raise ValueError(
                f"PSFs of shape {list(self.values.shape)} for {self.nodes.numel()} nodes and "
                f"{self.wavelengths.numel()} bands: [node, band, y, x] is needed"
            )

    @property
    def window(self) -> int:
        return int(self.values.shape[-1])

    def layer(self, node: int) -> Tensor:
        return self.values[node]

    def truncated(self, node: int) -> Tensor:
        return 1 - self.values[node].sum((-2, -1))

    def at(self, nodes: Tensor, per_dioptre: float) -> HeldKernels:
        weights = band_limited_weights(nodes, self.nodes, per_dioptre).to(self.values)
        return HeldKernels(torch.tensordot(weights, self.values, 1), nodes, self.wavelengths)


@dataclass(frozen=True)
class StreamedKernels:
    """PSFs computed a few nodes at a time and forgotten: for more depths than memory holds.

    compute: inverse depths [n] to PSFs [n, band, y, x]; ahead: how many nodes are computed together.
    """

    compute: Callable[[Tensor], Tensor]
    nodes: Tensor
    wavelengths: Tensor
    window: int
    ahead: int = 4
    _block: dict[str, object] = field(default_factory=dict, repr=False, compare=False)
    _rest: dict[int, Tensor] = field(default_factory=dict, repr=False, compare=False)

    def layer(self, node: int) -> Tensor:
        start = node - node % self.ahead
        if self._block.get("start") != start:
            self._block.update(start=start, values=self.compute(self.nodes[start : start + self.ahead]))
        values = self._block["values"][node - start]  # type: ignore[index]
        self._rest[node] = 1 - values.detach().sum((-2, -1))
        return values

    def truncated(self, node: int) -> Tensor:
        if node not in self._rest:
            self.layer(node)
        return self._rest[node]

    def at(self, nodes: Tensor, per_dioptre: float) -> StreamedKernels:
        return StreamedKernels(self.compute, nodes, self.wavelengths, self.window, self.ahead)


DEFOCUS_STEP = 2.5
"""Change of the paper's Psi (Eq. `defocus`) at the shortest wavelength from one node to the next, in radians,
for 50 dB when the number of layers is left to us. Linear interpolation between PSFs errs with its square."""


def depth_nodes(
    inverse_depth: Tensor, layers: int | str, defocus_per_dioptre: float, tolerance_db: float = 50.0
) -> Tensor:
    """Depth nodes for fragments: [node], ascending, equally spaced in inverse depth over what they span.

    inverse_depth: [fragment] in 1/m; layers: how many, or "auto" for steps of `DEFOCUS_STEP`, smaller for a
    higher tolerance; defocus_per_dioptre: change of Psi with inverse depth at the shortest wavelength, rad m.
    A scene with no more depths than layers gets exactly its depths: nothing is interpolated then.
    Raises InputError for fewer than one layer.
    """
    if layers != "auto" and (not isinstance(layers, int) or layers < 1):
        raise InputError(f'{layers!r} depth layers: give a whole number of at least 1, or "auto"')
    values = inverse_depth.detach().double()
    if values.numel() == 0:
        return values.new_zeros(1)
    low, high = (float(end) for end in values.aminmax())
    if low == high:
        return values[:1].clone()
    if layers == "auto":
        step = DEFOCUS_STEP * 10 ** ((50 - tolerance_db) / 40)
        layers = 2 + math.floor((high - low) * defocus_per_dioptre / step)
    # a smooth depth map has as many depths as pixels: a few from all over it tell, without sorting all
    sample = torch.unique(values[:: max(1, values.numel() // (4 * layers))])
    if sample.numel() <= layers:
        distinct = torch.unique(values)
        if distinct.numel() <= layers:
            return distinct
    if layers == 1:
        return values.new_tensor([(low + high) / 2])
    return torch.linspace(low, high, layers, dtype=torch.float64, device=values.device)
