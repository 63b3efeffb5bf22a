"""PSF window: how far light is carried."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level, overall
from ..estimate import of_psfs
from ..facts import Facts, photo_changes, rms

WINDOWS = (16, 32, 48, 64, 96, 128, 192, 256, 384)
OFF_AXIS_SHARE = 0.5
"""Share of the recipe's window below which none is looked at for a lens that varies over the field: errors
are those of the axis, and PSFs of other places are wider."""
SMALLEST_WINDOW_SHARE = 0.25
"""Share of the recipe's window. Windows of at least that are also seen in coarse photos with occlusion."""
SMALLEST_WINDOW_PX = 4
"""Likewise, in large pixels: fewer reach much farther to one side than to the other."""


def levels(facts: Facts) -> list[Level]:
    most = facts.camera.recipe.psf.window_px
    least = OFF_AXIS_SHARE * most if facts.camera.lens.varies else 0
    few = [Level(f"{n} px", {"window_px": n}) for n in WINDOWS if least <= n < most]
    return [*few, Level(f"{most} px", {})]


def why(facts: Facts) -> str:
    return f"the recipe's PSFs reach {facts.camera.recipe.psf.window_px // 2} pixels"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of spectra and, where surfaces hide others, of coarse photos: the larger counts. By spectra, light that
    a narrow window loses lets as much through from behind; in photos a surface hides it all the same.
    Windows that err by more than is allowed anyway are not photographed."""
    found = of_psfs(facts, levels)
    if facts.full.occlusion != "hidden":
        return found
    share = SMALLEST_WINDOW_SHARE * facts.camera.recipe.psf.window_px
    least = min(share, SMALLEST_WINDOW_PX * facts.coarse.times)
    wide = [
        number
        for number, level in enumerate(levels)
        if level.change["window_px"] >= least and overall(rms(found[number])) <= facts.allowed
    ]
    for number, seen in zip(wide, photo_changes(facts, [levels[n].change for n in wide]), strict=True):
        found[number] = max(found[number], seen, key=lambda change: float(change.square().sum()))
    return found


EFFECT = Effect("PSF window", levels, why, differences=differences, stage="psf")
