"""Commented recipes to start from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from ..core.files import write_text
from ..errors import InputError

TEMPLATES = Path(__file__).parent / "templates"


def new_recipe(kind: str, path: Path, values: Mapping[str, str] | None = None) -> Path:
    """Write a recipe to start from, a `scene`, `picture`, `camera` or `train`, named after its file. Returns
    the path, with the suffix `.toml` where it had none.

    values: what stands for @KEY@ in the template, beside @NAME@, by KEY.

    Raises InputError for a name that no recipe can have and for a file that is there already, and what
    `core.files.whole` raises.
    """
    path = path if path.suffix == ".toml" else path.with_name(path.name + ".toml")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", path.stem):
        raise InputError(f"{path.stem!r} cannot name a recipe: use letters, digits, _ and -, at most 64")
    if path.exists():
        raise InputError(f"{path}: is there already; choose another name, or remove it")
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    for key, value in {"NAME": path.stem, **(values or {})}.items():
        text = text.replace(f"@{key}@", value)
    return write_text(path, text)
