"""Commented recipes to start from, and a package of plug-ins."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from ..core.files import write_text
from ..core.shipped import shipped_folder
from ..errors import InputError

TEMPLATES = Path(__file__).parent / "templates"


def new_recipe(kind: str, path: Path, values: Mapping[str, str] | None = None) -> Path:
    """Write a recipe to start from, a `scene`, `picture`, `camera` or `train`, named after its file. Returns
    the path, with the suffix `.toml` where it had none.

    values: what stands for @KEY@ in the template, next to @NAME@, by KEY.

    Raises InputError for a name that no recipe can have and for a file that is there already, and what
    `core.files.whole` raises.
    """
    path = check_name(path)
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    for key, value in {"NAME": path.stem, **(values or {})}.items():
        text = text.replace(f"@{key}@", value)
    return write_text(path, text)


def new_plugin(path: Path) -> Path:
    """Write a package that adds one of each kind of thing to edofsim, named after its folder. Returns it.

    path: of the folder; its name in lower case, with _ for -, is that of the package's module.

    Raises InputError for a name that no module can have or another one has, for a folder that is there
    already, and what `core.files.whole` raises.
    """
    name = path.name
    module = name.replace("-", "_").lower()
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,63}", name) or keyword.iskeyword(module):
        raise InputError(f"{name!r} cannot name a package: use letters, digits, _ and -, a letter first")
    if module in sys.stdlib_module_names or module == "edofsim":
        raise InputError(f"{name!r}: Python would take it for another module; choose another name")
    if path.exists():
        raise InputError(f"{path}: is there already; choose another name, or remove it")
    example = shipped_folder("plugin")
    for source in sorted(file for file in example.rglob("*") if file.suffix in (".py", ".toml", ".md")):
        text = source.read_text(encoding="utf-8")
        place = str(source.relative_to(example))
        text, place = (
            each.replace("edofsim-example", name).replace("edofsim_example", module) for each in (text, place)
        )
        write_text(path / place, text)
    return path


def check_name(path: Path) -> Path:
    """The file of a new recipe, with its suffix. Raises InputError for a name that none can have, and for a
    file that is there already."""
    name = path.name.removesuffix(".toml")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", name):
        given = name or str(path)
        raise InputError(f"{given!r} cannot name a recipe: use letters, digits, _ and -, at most 64")
    path = path.with_name(name + ".toml")
    if path.exists():
        other = f"{name}-2"
        raise InputError(f"{path}: is there already; choose another name, such as {other}, or remove it")
    return path
