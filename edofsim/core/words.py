"""Words of messages."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """`1 view`, `2 views`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
