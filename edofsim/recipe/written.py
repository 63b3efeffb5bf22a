"""Recipes written by programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from pydantic import BaseModel


def toml_of(recipe: BaseModel, remark: str = "") -> str:
    """A recipe as TOML, without what is not given in it, below a remark of its first lines."""
    lines = [f"# {line}" for line in remark.splitlines()]
    return "\n".join([*lines, *_table(recipe.model_dump(exclude_unset=True, exclude_none=True), "")]) + "\n"


def _table(table: Mapping[str, object], name: str) -> list[str]:
    """Lines of a table: first what is no table, then tables and lists of tables."""
    lines: list[str] = []
    for key, value in table.items():
        if not isinstance(value, Mapping) and not _tables(value):
            lines.append(f"{key} = {_value(value)}")
    for key, value in table.items():
        whole = f"{name}.{key}" if name else key
        if isinstance(value, Mapping):
            lines += ["", f"[{whole}]", *_table(value, whole)]
        for each in _tables(value):
            lines += ["", f"[[{whole}]]", *_table(each, whole)]
    return lines


def _tables(value: object) -> list[Mapping[str, object]]:
    """What of a value are tables in a list."""
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    return [each for each in value if isinstance(each, Mapping)] if listed else []


def _value(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
