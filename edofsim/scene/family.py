"""Families: one recipe with distributions and a seed gives as many different scenes as one asks for."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from ..core.json_values import Json
from ..errors import InputError
from ..recipe.family import TomlValue, Vary
from ..recipe.load import Loaded
from ..recipe.scene import SceneRecipe

NAMED_LISTS = ("objects", "lights")


def member(recipe: SceneRecipe, seed: int) -> SceneRecipe:
    """The member of a recipe's family that `seed` chooses: the same seed gives the same scene.

    Each distribution draws from a generator of its own, so that one added at the end leaves the others'
    values as they were. The member's seed is `seed`, its name ends in it, and it is no family any more.
    Raises InputError for keys that lead nowhere and for values that the recipe's models refuse.
    """
    if recipe.family is None:
        raise InputError(f"{recipe.name}: the recipe has no [family], so it has one member: itself")
    data = recipe.model_dump(mode="python", by_alias=True)
    absent: list[tuple[str, str | int]] = []
    for number, vary in enumerate(recipe.family.vary):
        rng = np.random.default_rng([seed, number])
        where = f"{recipe.name}: family.vary[{number}] ({vary.key!r})"
        holder, last = _find(data, vary.key, where)
        if vary.present is None:
            holder[last] = draw(vary, rng)
        elif vary.key.split(".")[0] not in NAMED_LISTS or len(vary.key.split(".")) != 2:
            raise InputError(f"{where}: only objects and lights can be present or not")
        elif rng.random() >= vary.present:
            absent.append((vary.key.split(".")[0], last))
    for kind in NAMED_LISTS:
        gone = {index for name, index in absent if name == kind}
        data[kind] = [item for index, item in enumerate(data[kind]) if index not in gone]
    data |= {"family": None, "seed": seed, "name": f"{recipe.name[:53]}-{seed}"}
    try:
        return SceneRecipe.model_validate(data)
    except ValidationError as error:
        problems = {
            f"{recipe.name}, member {seed}: {'.'.join(map(str, item['loc']))}: {item['msg']}"
            for item in error.errors()
        }
        raise InputError(sorted(problems)) from None


def members(recipe: SceneRecipe, count: int, seed: int | None = None) -> list[SceneRecipe]:
    """`count` members with the seeds `seed`, `seed` + 1, ... (from the recipe's own seed on if None).

    Raises InputError for fewer than one."""
    if count < 1:
        raise InputError(f"members = {count}: at least 1")
    first = recipe.seed if seed is None else seed
    return [member(recipe, first + index) for index in range(count)]


def in_place_of(scenes: Sequence[Loaded[SceneRecipe]], count: int, seed: int) -> list[Loaded[SceneRecipe]]:
    """`count` members of each scene's family in its place, the first of `seed`; for 0 the scenes."""
    if not count:
        return list(scenes)
    return [replace(each, recipe=recipe) for each in scenes for recipe in members(each.recipe, count, seed)]


def draw(vary: Vary, rng: np.random.Generator) -> TomlValue:
    """One value of a distribution."""
    if vary.uniform is not None:
        return float(rng.uniform(*vary.uniform))
    if vary.inverse_uniform is not None:
        near, far = vary.inverse_uniform
        return float(1 / rng.uniform(1 / far, 1 / near))
    if vary.log_uniform is not None:
        return float(np.exp(rng.uniform(*np.log(vary.log_uniform))))
    if vary.normal is not None:
        return float(rng.normal(*vary.normal))
    if vary.integer is not None:
        return int(rng.integers(vary.integer[0], vary.integer[1], endpoint=True))
    assert vary.choice is not None  # the model holds exactly one
    return vary.choice[int(rng.integers(len(vary.choice)))]


def _find(data: Json, key: str, where: str) -> tuple[TomlValue, str | int]:
    """The table or list that holds the value of a dotted key, and the value's key or index in it."""
    holder: TomlValue = data
    steps = key.split(".")
    for depth, step in enumerate(steps):
        at: str | int = step
        if isinstance(holder, (tuple, list)):
            at = _index(holder, step, where)
        elif not isinstance(holder, dict) or step not in holder:
            known = list(holder) if isinstance(holder, dict) else []
            near = difflib.get_close_matches(step, known, 1, 0.5)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"{where}: there is no {'.'.join(steps[: depth + 1])!r} in the recipe{hint}")
        if depth == len(steps) - 1:
            return holder, at
        if isinstance(holder[at], tuple):
            holder[at] = list(holder[at])  # values inside can then be replaced
        holder = holder[at]
    raise InputError(f"{where}: the key is empty")


def _index(items: Sequence[TomlValue], step: str, where: str) -> int:
    """Place of an item by its name, or by its number."""
    names = [item.get("name") if isinstance(item, dict) else None for item in items]
    if step in names:
        return names.index(step)
    if step.isdigit() and int(step) < len(items):
        return int(step)
    known = [name for name in names if name]
    near = difflib.get_close_matches(step, known, 1, 0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(f"{where}: there is no {step!r}; {hint}known: {', '.join(map(repr, known)) or 'none'}")
