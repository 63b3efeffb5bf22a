"""Numbers as a reader expects them: units, a true minus sign, a dash where there is no value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import SupportsFloat

from ..core import words

DASH = "–"  # no value
NBSP = "\u00a0"  # keeps a number and its unit on one line
MINUS = "\u2212"


def number(value: SupportsFloat | None, digits: int = 1) -> str:
    """`value` with `digits` decimals; a dash for None and NaN, the sign for infinity."""
    if value is None:
        return DASH
    x = float(value)
    if math.isnan(x):
        return DASH
    if math.isinf(x):
        return "∞" if x > 0 else MINUS + "∞"
    text = f"{x:.{digits}f}"
    if float(text) == 0:  # never "-0.0"
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def listed(parts: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(parts[:-1]), *parts[-1:]] if len(parts) > 1 else parts)


def significant(value: SupportsFloat | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits: 0.00312, 12.3, 45600, 1.2e-9."""
    if value is None or not math.isfinite(float(value)):
        return number(value)
    x = float(value)
    if x == int(x) and abs(x) < 1e7:
        return number(x, 0)
    if abs(x) >= 1e7 or abs(x) < 1e-4:
        return f"{x:.{digits - 1}e}".replace("-", MINUS)
    return number(x, max(0, digits - 1 - math.floor(math.log10(abs(x)))))


def decibels(value: SupportsFloat | None) -> str:
    """A PSNR: `31.2 dB`."""
    text = number(value, 1)
    return text if text == DASH else f"{text}{NBSP}dB"


def duration(seconds: SupportsFloat | None) -> str:
    """A time a person reads at a glance: `85 ms`, `1.4 s`, `24 s`, `3 min 05 s`, `2 h 10 min`."""
    if seconds is None or not math.isfinite(float(seconds)):
        return number(seconds)
    return words.duration(float(seconds)).replace(" ", NBSP)


def shorten(text: str, most: int) -> str:
    """At most `most` characters, for a place in a plot that cannot grow."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def percent(fraction: float) -> str:
    """A part of a whole: `0 %`, `< 0.1 %`, `0.96 %`, `57 %`."""
    if not 0 < fraction < math.inf:
        return number(100 * fraction, 0) + (f"{NBSP}%" if math.isfinite(fraction) else "")
    share = 100 * fraction
    text = f"<{NBSP}0.1" if share < 0.1 else number(share, 2 if share < 1 else 1 if share < 10 else 0)
    return f"{text}{NBSP}%"


def metres(depth_m: SupportsFloat) -> str:
    """A depth without its unit: `0.50`, `4.5`, `12`, `∞`."""
    z = float(depth_m)
    if not math.isfinite(z):
        return number(z)
    return number(z, 2 if z < 2 else 1 if z < 10 else 0)


def distance(depth_m: SupportsFloat) -> str:
    """A depth with its unit: `0.50 m`; infinity stands without one."""
    text = metres(depth_m)
    return text if text in (DASH, "∞") else f"{text}{NBSP}m"


def depth_range(near_m: float, far_m: float) -> str:
    """`0.60 to 0.85 m`, `up to 0.60 m`, `beyond 3.0 m`, `all depths`."""
    if near_m <= 0 and math.isinf(far_m):
        return "all depths"
    if near_m <= 0:
        return f"up to {distance(far_m)}"
    if math.isinf(far_m):
        return f"beyond {distance(near_m)}"
    if near_m == far_m:
        return distance(near_m)
    return f"{metres(near_m)}{NBSP}to{NBSP}{distance(far_m)}"
