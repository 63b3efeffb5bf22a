"""Bands: each is refracted differently, so each has PSFs of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level, overall
from ..facts import Facts, rms

GATHERED = ((1, 1), (1, 2), (1, 0), (2, 2), (2, 0), (3, 2), (4, 0), (6, 0))
"""Groups of bands a channel, and wavelengths a group (0: all of them), from coarse to fine."""


def absent(facts: Facts) -> str:
    if facts.bands_a_channel > 1:
        return ""
    return "every channel of the sensor sees one band only"


def levels(facts: Facts) -> list[Level]:
    channels = len(facts.response)
    few = [
        Level(
            _label(groups, colours, channels),
            {"band_groups": groups, "group_wavelengths": colours},
        )
        for groups, colours in GATHERED
        if groups * max(colours, 1) < facts.bands_a_channel
    ]
    return [*few, Level(f"{facts.view.bands} bands", {"band_groups": 0, "group_wavelengths": 0})]


def _label(groups: int, colours: int, channels: int) -> str:
    wavelengths = {0: "every wavelength", 1: "1 wavelength"}.get(colours, f"{colours} wavelengths")
    return f"{groups * channels} groups, PSFs of {wavelengths}"


def why(facts: Facts) -> str:
    return f"the view holds {facts.view.bands} bands, {facts.nm()}, and the optics bend each differently"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """By spectra, which know no division by what covers what: this adds as much as coarse photos show of it,
    the less the more groups there are; nothing to what errs by more than is allowed anyway."""
    found = []
    for level in levels:
        change = facts.spectra.by_bands(facts.full.changed(level.change))
        size = overall(rms(change))
        if facts.full.occlusion == "hidden" and len(facts.cuts) > 1 and 0 < size <= facts.allowed:
            others = facts.coarse.by_gathering(facts.full) / level.change["band_groups"]
            change = change * math.hypot(1, others / size)
        found.append(change)
    return found


EFFECT = Effect("bands", levels, why, absent, differences)
