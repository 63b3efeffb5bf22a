"""Light between depth nodes, blurred as a band-limited function of its depth."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ..optics.band_limited import band_limited_nodes, band_limited_weights


@dataclass(frozen=True)
class BandLimit:
    """How PSFs change with depth.

    per_dioptre: change of Psi with inverse depth at the shortest wavelength, rad m;
        error: that may be made between nodes, as `band_limited_nodes` counts it.
    """

    per_dioptre: float
    error: float

    def nodes(self, inverse_depth: Tensor) -> Tensor:
        """As few nodes [node] as suffice for fragments [fragment], at least one; 1/m, ascending.

        inverse_depth: [fragment], 1/m.
        """
        low, high = (float(end) for end in inverse_depth.aminmax())
        return band_limited_nodes(low, high, self.per_dioptre, self.error)

    def shares(self, inverse_depth: Tensor, nodes: Tensor) -> Tensor:
        """Shares [node, fragment] of the nodes in the blur of each fragment.

        inverse_depth: [fragment], 1/m.
        nodes: [node], 1/m, ascending.
        """
        return band_limited_weights(inverse_depth, nodes, self.per_dioptre).T.to(inverse_depth.dtype)
