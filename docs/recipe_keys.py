"""The page of all keys of recipes, `docs/recipes.md`, which `make docs` makes of the schemas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from edofsim.recipe.schema import json_schema, model_of

PAGE = Path(__file__).parent / "recipes.md"
HEAD = """# Recipe keys

All keys of scene, camera, training and dataset recipes, with their meaning, values and defaults. Editors that
read JSON Schema show the same text while you type; `edofsim schema scene`, `camera`, `train` and `dataset`
print it.
"""
Table = dict[str, Any]


def page() -> str:
    """The page as Markdown: a section a recipe, a table for each of its tables."""
    parts = [HEAD]
    shown: set[str] = set()
    for recipe in ("scene", "camera", "train", "dataset"):
        schema = json_schema(model_of(recipe), recipe)
        parts.append(f"## {recipe.capitalize()} recipe\n\n{_keys(schema)}")
        for name, table in sorted(schema["$defs"].items()):
            if "properties" in table and name not in shown:
                shown.add(name)
                kind = table["properties"].get("kind", {}).get("const")
                title = f'{name}: `kind = "{kind}"`' if kind else name
                first = table.get("description", "").split("\n\n")[0].replace("\n", " ")
                parts.append(f"### {title}\n\n{_plain(first)}\n\n{_keys(table)}")
    return "\n".join(parts)


def _keys(table: Table) -> str:
    rows = ["| key | meaning | value | default |", "|---|---|---|---|"]
    required = table.get("required", ())
    for key, entry in table["properties"].items():
        default = "required" if key in required else _code(entry.get("default"))
        rows.append(f"| `{key}` | {_plain(entry.get('description', ''))} | {_value(entry)} | {default} |")
    return "\n".join(rows) + "\n"


def _value(entry: Table) -> str:
    """What may stand there, in a few words."""
    if "const" in entry:
        return _code(entry["const"])
    if "enum" in entry:
        return ", ".join(_code(each) for each in entry["enum"])
    if "$ref" in entry:
        return f"table {entry['$ref'].rsplit('/', 1)[-1]}"
    if many := entry.get("anyOf", entry.get("oneOf")):
        values = list(dict.fromkeys(_value(each) for each in many if each.get("type") != "null"))
        tables = [value.removeprefix("table ") for value in values if value.startswith("table ")]
        values = [value for value in values if not value.startswith("table ")]
        return " or ".join([*values, *([f"table {', '.join(tables)}"] if tables else [])])
    if entry.get("type") == "array":
        inner = entry.get("items") or (entry.get("prefixItems") or [{}])[0]
        return f"list of {_value(inner)}" if inner else "list"
    names = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    bounds = [f"{sign} {entry[name]:g}" for name, sign in names.items() if name in entry]
    words = {"string": "text", "boolean": "true, false", "integer": "whole number", "object": "table"}
    kind = str(entry.get("type", ""))
    return " ".join([words.get(kind, kind or "value"), ", ".join(bounds)]).strip()


def _code(value: object) -> str:
    text = json.dumps(value)
    return "" if value is None else f"`{text if len(text) <= 48 else text[:45] + '...'}`"


def _plain(text: str) -> str:
    return text.replace("|", r"\|").replace("<", r"\<")


def write() -> Path:
    PAGE.write_text(page(), encoding="utf-8")
    return PAGE


if __name__ == "__main__":
    print(write())
