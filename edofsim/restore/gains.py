"""How much better a restored image is than what one has without restoring it so: always the same three."""

from __future__ import annotations

import math
from collections.abc import Mapping

RIVALS: Mapping[str, str] = {
    "photo": "the photo",
    "lens_alone": "the lens alone",
    "wiener": "Wiener deconvolution",
}
"""What a restored image is compared with, by the name of its figures, and in words."""
ALIKE_DB = 0.05
"""Scores nearer than this are printed as the same number."""


def gains(psnr_db: Mapping[str, float], restored: str = "restored") -> dict[str, float]:
    """The gains of a restored image over each rival, in dB, by the rival's name.

    psnr_db: PSNR in dB by image, rivals by the names of `RIVALS`.
    restored: whose gains. Rivals without a PSNR are left out, and so is a gain that is no number.
    """
    mine = psnr_db.get(restored, math.nan)
    found = {name: mine - psnr_db[name] for name in RIVALS if name in psnr_db and name != restored}
    return {name: gain for name, gain in found.items() if math.isfinite(gain)}


def gain_figures(found: Mapping[str, float], where: str = "") -> dict[str, float]:
    """Gains as figures, flat: gain_db[.WHERE].over_{photo,lens_alone,wiener}."""
    base = f"gain_db.{where}" if where else "gain_db"
    return {f"{base}.over_{name}": gain for name, gain in found.items()}


def gains_in_words(found: Mapping[str, float]) -> str:
    """Gains as a sentence, and one more where the photo is better than what was made of it; empty without
    any gain."""
    if not found:
        return ""
    said = []
    for name, gain in found.items():
        size = f"{abs(gain):.1f}\u00a0dB"
        near = "as good as" if abs(gain) < ALIKE_DB else f"{size} {'above' if gain > 0 else 'below'}"
        said.append(f"{near} {RIVALS[name]}")
    listed = " and ".join([", ".join(said[:-1]), said[-1]] if len(said) > 1 else said)
    worse = found.get("photo", 0.0) <= -ALIKE_DB
    return f"Restored is {listed}." + (" The photo is better than the restored image." if worse else "")
