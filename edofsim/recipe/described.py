"""What the keys of recipes mean: the text below each field of a model, for schemas, messages and pages."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from functools import cache

from pydantic import BaseModel


@cache
def descriptions(model: type[BaseModel]) -> Mapping[str, str]:
    """What the keys of a recipe table mean.

    model: class of the table; its source is read on the first call, so that reading a recipe does not wait.

    Returns the description of each key by the key's name, without keys that have none.
    """
    found: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if issubclass(owner, BaseModel) and owner is not BaseModel:
            found |= _own(owner)
    if "kind" in model.model_fields and "kind" not in found:
        first = (inspect.getdoc(model) or "").split("\n\n")[0].replace("\n", " ")
        found["kind"] = f"chooses this kind: {first[:1].lower()}{first[1:].split('. ')[0].rstrip('.')}"
    return {info.alias or name: found[name] for name, info in model.model_fields.items() if name in found}


def _own(model: type[BaseModel]) -> dict[str, str]:
    """Of the fields that a class itself annotates."""
    try:
        source = textwrap.dedent(inspect.getsource(model))
    except (OSError, TypeError):  # made at run time
        return {}
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    found: dict[str, str] = {}
    for field, text in zip(body, body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        ):
            found[field.target.id] = " ".join(text.value.value.split())
    return found
