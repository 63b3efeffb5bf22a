"""All benchmarks behind one name: figures are ratios measured in one run, with medians."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from edofsim.core.progress import Progress, part
from edofsim.errors import InputError

BENCHES = {"optics": "optics", "render": "render", "expose": "photos", "learn": "learn"}
"""Names as they are asked for, and their modules."""


SIZED = ("render", "expose")
"""Benchmarks that take more cases on request."""
WRITE = ("expose",)
"""Benchmarks that keep what they have finished in a folder."""


def run(
    names: Sequence[str],
    progress: Progress | None = None,
    out: Path | None = None,
    full: bool = False,
) -> dict[str, float]:
    """Figures of the named benchmarks, each under its own prefix; out: a folder for what they write; full:
    larger frames and more cases.

    Raises InputError for an unknown name.
    """
    unknown = [name for name in names if name not in BENCHES]
    if unknown:
        raise InputError(f"no benchmark {unknown[0]!r}; known: {', '.join(BENCHES)}")
    found: dict[str, float] = {}
    for index, name in enumerate(names):
        tell = part(progress, index / len(names), (index + 1) / len(names), name)
        bench = import_module(f".{BENCHES[name]}", __package__)
        more: dict[str, object] = {"out": out} if name in WRITE else {}
        more |= {"full": full} if name in SIZED else {}
        found |= {f"{name}.{key}": value for key, value in bench.run(progress=tell, **more).items()}
    return found
