"""Words of messages."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """`1 view`, `2 views`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def duration(seconds: float) -> str:
    """A time a person reads at a glance: `85 ms`, `1.4 s`, `24 s`, `3 min 05 s`, `2 h 10 min`."""
    if seconds < 0.0995:
        return f"{1e3 * seconds:.0f} ms"
    if seconds < 99.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes = round(seconds / 60) if seconds >= 3600 else int(seconds // 60)
    if seconds >= 3600:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {int(seconds % 60):02d} s"


def metres(inverse_depth: float) -> str:
    """A depth by its inverse in 1/m."""
    return "infinity" if inverse_depth <= 0 else f"{1 / inverse_depth:.2f} m"
