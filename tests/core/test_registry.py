"""Classes of a script, registered by a decorator."""

from __future__ import annotations

from typing import Literal

import pytest
import torch
from torch import Tensor

import edofsim
from edofsim.errors import InputError
from edofsim.optics import psf_bank
from edofsim.optics.cache import identity
from edofsim.plugins import Finite, Restorer, SmoothMask, register
from edofsim.recipe.kinds import MASKS, NETWORKS
from edofsim.restore.network import build_network

pytestmark = pytest.mark.usefixtures("registered_for_a_test")


def test_a_mask_of_a_script_is_made_by_its_kind() -> None:
    """The same wavefront as the cubic mask that ships, so the same PSFs."""

    @register
    class Slopes(SmoothMask):
        """Its own."""

        kind: Literal["slopes"] = "slopes"
        strength: Finite = 3.0

        def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
            return self.strength * (u**3 + v**3)

    hers = edofsim.camera(mask={"kind": "slopes", "strength": 20.0}, name="hers", window=32)
    ours = edofsim.camera(mask={"kind": "cubic", "alpha_rad": 20.0}, window=32)
    assert (hers.recipe.name, type(hers.mask)) == ("hers", Slopes)
    found, expected = (psf_bank(one, [543e-9], [0.0]).values for one in (hers, ours))
    assert torch.allclose(found, expected, atol=1e-7)
    assert "slopes" in MASKS and MASKS.of_another("slopes") and identity(hers) != identity(ours)

    @register
    class Again(Slopes):
        """Typed anew, as in a notebook: the later one counts."""

    assert type(edofsim.camera(mask={"kind": "slopes"}).mask) is Again


def test_a_network_of_a_script_is_built_by_its_kind() -> None:
    @register
    class Half(Restorer):
        kind = "half"

        def forward(self, photo: Tensor) -> Tensor:
            return photo / 2

    assert torch.equal(build_network("half")(torch.ones(1, 3, 4, 4)), torch.full((1, 3, 4, 4), 0.5))
    assert "dcnn" in NETWORKS and "half" not in MASKS


def test_what_is_no_plug_in_or_ours_is_refused() -> None:
    with pytest.raises(InputError, match="base class of edofsim.plugins"):
        register(torch.nn.Conv2d)

    with pytest.raises(InputError, match="'cubic' is this package's"):

        @register
        class Cubic(SmoothMask):
            kind: Literal["cubic"] = "cubic"
