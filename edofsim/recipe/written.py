"""Recipes written by programs."""

from __future__ import annotations

import tomli_w
from pydantic import BaseModel


def toml_of(recipe: BaseModel, remark: str = "") -> str:
    """A recipe as TOML, without what is not given in it, below a remark of its first lines."""
    table = recipe.model_dump(exclude_unset=True, exclude_none=True)
    return "".join(f"# {line}\n" for line in remark.splitlines()) + tomli_w.dumps(table)
