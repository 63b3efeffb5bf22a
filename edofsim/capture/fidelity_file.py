"""Fidelities as files: what a run, a plan or a person wrote is simulated again, to the last field."""

from __future__ import annotations

import json
import logging
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, get_type_hints

from pydantic import ConfigDict, ValidationError, create_model

from ..core.files import write_text
from ..core.json_values import Json
from ..errors import InputError

if TYPE_CHECKING:
    from .fidelity import Fidelity

F = TypeVar("F", bound="Fidelity")

WHERE = ("fidelity", "settings")
"""Keys under which a run's or a plan's JSON holds one: today, and before."""


LOG = logging.getLogger(__name__)


def values_of(fidelity: Fidelity) -> Json:
    """All fields as JSON values; simplifications of other packages by their names, and kinds of the sensor's
    effects where any is left out."""
    found = {each.name: getattr(fidelity, each.name) for each in fields(fidelity)}
    if not found["without_sensor"]:
        del found["without_sensor"]
    return {**found, "simplifications": [each.name for each in fidelity.simplifications]}


def write_fidelity(path: Path, fidelity: Fidelity) -> Path:
    """Write it as JSON. Returns the path; raises what `core.files.whole` raises."""
    return write_text(path, json.dumps({"fidelity": values_of(fidelity)}, indent=1) + "\n")


def read_fidelity(path: Path, kind: type[F], keys: Sequence[str] = WHERE) -> F:
    """The fidelity that a file holds: JSON that `run`, `expose`, `plan` or `Fidelity.save` wrote, or TOML
    with the fields of `Fidelity`, in a table [fidelity] or alone. Others have their defaults.

    kind: `Fidelity`.
    keys: where it may stand in JSON, the first that is there counts.

    Raises InputError, naming every field, for what is no fidelity.
    """
    content = _content(path)
    if "fidelities" in content:
        named = ", ".join(content["fidelities"])
        raise InputError(f"{path}: holds the fidelities of several scenes ({named}): give one scene's JSON")
    for key in keys:
        if isinstance(content.get(key), dict):
            return fidelity_of_values(content[key], str(path), kind)
    if "command" in content:
        raise InputError(f"{path}: a JSON of `edofsim {content['command']}` that holds no fidelity")
    return fidelity_of_values(content, str(path), kind)


def fidelity_of_values(values: Mapping[str, object], where: str, kind: type[F]) -> F:
    """A fidelity from values by field.

    where: what holds them, for messages.
    kind: `Fidelity`.

    Raises InputError.
    """
    given = _of_today(dict(values), where)
    if given.pop("simplifications", None):
        raise InputError(
            f"{where}: simplifications of other packages cannot be read from a file: give --without EFFECT"
        )
    if isinstance(kinds := given.get("without_sensor"), list):
        given["without_sensor"] = tuple(kinds)
    hints = get_type_hints(kind)
    known = {each.name: (hints[each.name], each.default) for each in fields(kind)}
    del known["simplifications"]
    strict = ConfigDict(extra="forbid", strict=True)
    try:
        model = create_model("Values", __config__=strict, **known)(**given)  # pyrefly: ignore
    except ValidationError as error:
        problems = [f"{where}: {'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()]
        raise InputError([problem.replace("Extra inputs are", "this is") for problem in problems]) from None
    return kind(**dict(model))


def _of_today(given: dict[str, object], where: str) -> dict[str, object]:
    """Values without the fields that fidelities had; what they asked for is kept, said in one line, or, where
    there is no such photo any more, refused with InputError."""
    way, in_full = given.pop("method", "layered"), given.pop("sub_apertures_in_full", False)
    if way == "constant":
        LOG.warning("%s: method = constant is layers = 1 now", where)
        given["layers"] = 1
    elif way != "layered":
        raise InputError(f"{where}: method {way} was removed: delete it")
    if in_full:
        raise InputError(f"{where}: sub_apertures_in_full was removed: delete it")
    return given


def _content(path: Path) -> Json:
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: no fidelity can be read there (no ordinary file)")
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)
    except OSError as error:
        raise InputError(f"{path}: no fidelity can be read there ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: neither JSON nor TOML of a fidelity ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no fields of a fidelity")
    return content
