"""Depth layers: the blur changes with depth; PSFs between the layers are interpolated."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts, metres
from ..sample import FINEST_LAYERS

LAYERS = (1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33)
FEW = 2
COARSE = {"layers": 13, "group_wavelengths": 2}
"""With one or two layers what errs is the size of the blur, which many wavelengths share: it is seen against
few layers and in several wavelengths, with occlusion, without which surfaces that meet at an edge would each
err there alone. With more it is the fine structure of each wavelength's PSF."""


def absent(facts: Facts) -> str:
    if facts.depth_count == 1:
        return f"everything lies at {metres(facts.sample.ends[1])}: one convolution a band is exact"
    return ""


def levels(facts: Facts) -> list[Level]:
    most = facts.depth_count or FINEST_LAYERS
    few = [Level(_label(n), {"layers": n}, sample=_sample(facts, n)) for n in LAYERS if n < most]
    full = f"{facts.depth_count} layers" if facts.depth_count else "all layers"
    return [*few, Level(full, {"layers": None})]


def _label(count: int) -> str:
    return f"{count} layer{'s'[: count > 1]}"


def _sample(facts: Facts, count: int) -> dict[str, object]:
    if facts.full.occlusion == "normalised":  # whose layers lie at the nodes: nothing is interpolated
        return {"occlusion": "normalised"}
    return {**COARSE, "occlusion": facts.full.occlusion} if count <= FEW else {}


def why(facts: Facts) -> str:
    far, near = facts.sample.ends
    spread = f"depths from {metres(near)} to {metres(far)} change the blur by {facts.blur_spread:.1f} pixels"
    filled = facts.view.metadata.get("holes filled")
    return f"{spread}; holes of the depth map were filled: {filled}" if filled else spread


EFFECT = Effect(
    "depth layers",
    levels,
    why,
    absent,
    sample={"band_groups": 1, "group_wavelengths": 1, "occlusion": "none", "layers": None},
)
