"""`edofsim list`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.markup import escape
from rich.table import Table

from ..core.registry import Registry
from ..errors import EdofsimError
from ..experiments import EXPERIMENTS
from .shared import Done

if TYPE_CHECKING:
    from ..recipe.base import RecipeModel


Things = StrEnum(
    "Things", "scenes cameras masks lenses objects sources networks checkpoints trainings effects plugins"
)
T = TypeVar("T")

USUAL = (Things.scenes, Things.cameras, Things.masks, Things.networks, Things.checkpoints)
"""What is listed where nothing is asked for."""


def list_(
    things: Annotated[
        Things | None,
        typer.Argument(help="What to list; default: scenes, cameras, masks, networks and checkpoints."),
    ] = None,
) -> Done:
    """List scenes, cameras, masks, networks and more.

    Those of other packages are included; `plugins` lists these alone.
    """
    shown = USUAL if things is None else (things,)
    return Done([_table(each) for each in shown])


def _table(things: Things) -> Table:
    table = Table(things.value, "", box=None)
    for name, line in _lines(things).items():
        table.add_row(name, escape(line))
    return table


def _lines(things: Things) -> dict[str, str]:
    from ..recipe import kinds, load_camera, load_scene, shipped, shipped_folder
    from ..recipe.load import load_train

    match things:
        case Things.scenes:
            return _purposes(shipped(shipped_folder("scenes")), lambda path: load_scene(path).recipe)
        case Things.cameras:
            folder = shipped_folder("scenes") / "cameras"
            return _purposes(shipped(folder), lambda path: load_camera(path).recipe)
        case Things.trainings:
            return _purposes(shipped(shipped_folder("train")), lambda path: load_train(path).recipe)
        case Things.checkpoints:
            return _checkpoints()
        case Things.effects:
            from ..plan.effects import EFFECTS

            lines = _kinds(EFFECTS)
            return {name: line.partition(": ")[2] or line for name, line in lines.items()}
        case Things.plugins:
            return _of_others()
        case _:
            return _kinds(getattr(kinds, things.upper()))


def _purposes(paths: Mapping[str, Path], load: Callable[[Path], RecipeModel]) -> dict[str, str]:
    """Recipes with the beginning of their purpose, or of why they cannot be read."""
    found = {}
    for name, path in paths.items():
        try:
            found[name] = first_sentence(str(getattr(load(path), "purpose", "")))
        except EdofsimError as error:
            found[name] = first_sentence(str(error))
    return found


def _kinds(registry: Registry[T]) -> dict[str, str]:
    return {name: first_sentence(registry.about(name)) for name in registry}


def _of_others() -> dict[str, str]:
    """What other packages add, and where it is defined, or why it cannot be used."""
    from ..plan.effects import EFFECTS
    from ..recipe import kinds

    every = [each for each in vars(kinds).values() if isinstance(each, Registry)]
    found = {}
    for registry in (*every, EFFECTS, EXPERIMENTS):
        for name in filter(registry.of_another, registry):
            try:
                registry[name]
                said = registry.place(name)
            except EdofsimError as error:
                said = str(error)
            found[f"{registry.kind} {name}"] = said
    return found or {"none": "`edofsim new plugin` writes a package to start from"}


def _checkpoints() -> dict[str, str]:
    from ..restore.checkpoint import (
        any_camera_checkpoints,
        comparison_checkpoints,
        purpose_of,
        shipped_checkpoints,
    )

    known = shipped_checkpoints() | any_camera_checkpoints() | comparison_checkpoints()
    return {name: first_sentence(purpose_of(path)) for name, path in known.items()}


def first_sentence(text: str) -> str:
    """The first sentence of a text, or as much as stands before a semicolon, without sources in brackets."""
    plain = re.sub(r" \([^()]*\. [^()]*\)", "", " ".join(text.split()))
    return re.split(r"[.;]\s", plain, maxsplit=1)[0].rstrip(".:;")
