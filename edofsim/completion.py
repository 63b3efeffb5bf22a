"""What the shell completes where a name or a file is asked for. Names are those of files that ship, and files
lie in the folder that was begun to be typed: nothing is imported for it, but for effects."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from .core.shipped import comparisons_folder, shipped, shipped_folder

CHECKPOINT = ".safetensors"


def scenes(incomplete: str) -> list[str]:
    """Shipped scenes, and recipes in a folder."""
    return _fitting(incomplete, shipped(shipped_folder("scenes")), ".toml")


def cameras(incomplete: str) -> list[str]:
    """Shipped cameras, and recipes in a folder."""
    return _fitting(incomplete, shipped(shipped_folder("scenes") / "cameras"), ".toml")


def trainings(incomplete: str) -> list[str]:
    """Shipped training recipes, and recipes in a folder."""
    return _fitting(incomplete, shipped(shipped_folder("train")), ".toml")


def networks(incomplete: str) -> list[str]:
    """Shipped checkpoints, `wiener`, and checkpoints in a folder."""
    return _fitting(incomplete, ["wiener", *_checkpoints()], CHECKPOINT)


def systems(incomplete: str) -> list[str]:
    """Shipped checkpoints and cameras, `wiener`, and checkpoints and recipes in a folder."""
    known = ["wiener", "wiener-depth", *_checkpoints(), *shipped(shipped_folder("scenes") / "cameras")]
    found = [*_fitting(incomplete, known, CHECKPOINT), *_fitting(incomplete, (), ".toml")]
    return list(dict.fromkeys(found))


def effects(incomplete: str) -> list[str]:
    """Effects of a plan, with hyphens: a shell would take a name with spaces for several words."""
    from .plan.effects import EFFECTS

    return one_of(*(name.replace(" ", "-") for name in EFFECTS))(incomplete)


def one_of(*names: str) -> Callable[[str], list[str]]:
    """Completes these names."""

    def fitting(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return fitting


def _checkpoints() -> list[str]:
    folders = shipped_folder("train") / "checkpoints", comparisons_folder()
    return [name for folder in folders for name in shipped(folder, CHECKPOINT)]


def _fitting(incomplete: str, names: Iterable[str], suffix: str) -> list[str]:
    """Names that begin so, and files of that ending. No folders: a shell that gets nothing completes those
    by itself."""
    begun, slash, _ = incomplete.rpartition("/")
    folder = begun + slash
    there = sorted(path.name for path in Path(folder or ".").glob("*" + suffix))
    return [each for each in (*names, *(folder + name for name in there)) if each.startswith(incomplete)]
