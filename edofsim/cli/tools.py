"""`edofsim doctor` and `edofsim schema`."""

from __future__ import annotations

import json as json_text
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..options import JsonOption
from ..record import writable_folder
from .shared import Done, begun, finish


class RecipeKind(StrEnum):
    scene = "scene"
    camera = "camera"
    train = "train"
    dataset = "dataset"


def doctor(
    again: Annotated[
        bool, typer.Option("--again", help="Test the engines again; do not use remembered results.")
    ] = False,
    json: JsonOption = None,
) -> Done:
    """Test render engines and devices.

    It says which work, and what to install for a faster one."""
    with begun("doctor", json, quiet=True):
        from ..render import engine

        probes = engine.find_engines(again=again)
        chosen = engine.choose(probes)  # raises EngineError with the command to type
        table = Table("engine", "version", "library", "works", "used", box=None)
        for probe in probes:
            works = "yes" if probe.works else f"no: {probe.reason}"
            used = "*" if probe == chosen else ""
            table.add_row(probe.variant, probe.version, probe.library, works, used)
        numbers = {"engines.found": len(probes), "engines.working": sum(probe.works for probe in probes)}
        return finish("doctor", [table, engine.hint(probes, chosen)], numbers, {}, json)


def schema(
    kind: Annotated[RecipeKind, typer.Argument(help="Kind of recipe.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write to this file instead of printing.")
    ] = None,
) -> Done:
    """Print the JSON Schema of a recipe, for editors."""
    from ..recipe.schema import json_schema, model_of, write_schema

    model, title = model_of(kind.value), f"edofsim {kind.value} recipe"
    if out is None:
        return Done([json_text.dumps(json_schema(model, title), indent=1, sort_keys=True)])
    writable_folder(out.parent)
    return Done(outputs={"schema": write_schema(model, title, out)})
