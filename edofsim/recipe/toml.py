"""Reading recipes: every problem found at once, each with its line and, for a misspelt key, the nearest."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar, cast, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ..core.json_values import Json
from ..errors import InputError
from .described import descriptions
from .kinds import OfKind

Model = TypeVar("Model", bound=BaseModel)
Location: TypeAlias = tuple[str | int, ...]

_ABSENT = object()

_HEADER = re.compile(r"^\s*(\[\[|\[)\s*([^\]]+?)\s*\]")
_KEY = re.compile(r"^\s*([A-Za-z0-9_\-]+|\"[^\"]*\"|'[^']*')\s*(?:\.[^=]*)?=")
MAX_RECIPE_BYTES = 1 << 20
SHOWN_DIGITS = 30


_SHOULD_BE = "Input should be "
_OF_TYPE = ("_type", "_parsing")
"""How pydantic's names of errors end where a value is of a wrong type."""


def read_toml(path: Path) -> tuple[Json, str]:
    """The parsed TOML file and its text.

    Raises InputError for a missing, unreadable, oversized or malformed file.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise InputError(f"{path}: is a device or a pipe; a recipe is an ordinary file")
        with path.open("rb") as file:
            content = file.read(MAX_RECIPE_BYTES + 1)
        if len(content) > MAX_RECIPE_BYTES:
            raise InputError(f"{path}: larger than {MAX_RECIPE_BYTES >> 20} MiB, which no recipe is")
        # some editors begin a file with a byte-order mark
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; name a recipe, or a shipped one by its name") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; name the recipe file inside it") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}; a recipe is a TOML file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    try:
        return tomllib.loads(text), text
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # of int(): thousands of digits
        raise InputError(f"{path}: holds a number that cannot be read ({error})") from None


def validate(model: type[Model], data: Json, text: str = "", path: Path | None = None) -> Model:
    """`data` as a `model`; raises InputError that lists every problem with its line in `text`.

    path: file that `data` was read from; None for values that were given in Python.
    """
    try:
        return model.model_validate(data, context={"path": path} if path else None)
    except ValidationError as error:
        lines = line_numbers(text)
        found = error.errors()
        # a list of which every entry is wrong is called too short as well
        inner = {item["loc"][:end] for item in found for end in range(len(item["loc"]))}
        found = [item for item in found if item["type"] != "too_short" or item["loc"] not in inner]
        problems = [_sentence(item, model, data, lines, path) for item in _by_value(found, data)]
    raise InputError(dict.fromkeys(problems))


def line_numbers(text: str) -> dict[Location, int]:
    """Line of each table header and key, by location. Arrays of tables count from 0.

    Keys inside inline tables share the line of the key that holds them: `nearest_line` climbs to it.
    """
    lines: dict[Location, int] = {}
    counts: dict[tuple[str, ...], int] = {}
    table: Location = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            names = tuple(part.strip().strip("\"'") for part in header[2].split("."))
            if header[1] == "[[":
                counts[names] = counts.get(names, -1) + 1
            table = _with_indices(names, counts)
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines.setdefault((*table, key[1].strip("\"'")), number)
    return lines


def _with_indices(names: tuple[str, ...], counts: Mapping[tuple[str, ...], int]) -> Location:
    location: list[str | int] = []
    for depth, name in enumerate(names, start=1):
        location.append(name)
        if names[:depth] in counts:
            location.append(counts[names[:depth]])
    return tuple(location)


def nearest_line(location: Location, lines: Mapping[Location, int]) -> int | None:
    """Line of `location`, or of the closest table around it."""
    for end in range(len(location), 0, -1):
        if location[:end] in lines:
            return lines[location[:end]]
    return None


def _by_value(found: list[ErrorDetails], data: Json) -> list[ErrorDetails]:
    """One wrong value in a union is reported once for each member: what it must be, in one message."""
    values: dict[tuple[Location, str], ErrorDetails] = {}
    for item in found:
        key = _location_in_file(item["loc"], data), "" if item["type"].endswith(_OF_TYPE) else item["msg"]
        if key in values:
            other = item["msg"].removeprefix(_SHOULD_BE)
            values[key] = cast(ErrorDetails, {**values[key], "msg": f"{values[key]['msg']} or {other}"})
        else:
            values[key] = item
    return list(values.values())


def _sentence(
    item: ErrorDetails, model: type[BaseModel], data: Json, lines: Mapping[Location, int], path: Path | None
) -> str:
    location = _location_in_file(item["loc"], data)
    line = nearest_line(location, lines)
    where = f"{path}{f', line {line}' if line else ''}: " if path else ""
    name = ".".join(str(part) for part in location) or "the file"
    message = item["msg"].removeprefix("Value error, ").removeprefix(_SHOULD_BE)
    tables = _tables_at(model, item["loc"][:-1], data)
    key = str(location[-1]) if location else ""
    meaning = next((f" ({text})" for each in tables if (text := descriptions(each).get(key))), "")
    match item["type"]:
        case "extra_forbidden":
            known = sorted({key for each in tables for key in _keys(each)})
            near = difflib.get_close_matches(str(location[-1]), known, 1, 0.5)
            hint = f"did you mean {near[0]!r}? " if near else "remove it; "
            return f"{where}unknown key {name!r}; {hint}known: {', '.join(known)}"
        case "missing":
            return f"{where}{name!r} is missing{meaning}"
        case "union_tag_invalid":
            tags = [tag.strip("' ") for tag in str(item.get("ctx", {}).get("expected_tags", "")).split(",")]
            given = str(item.get("ctx", {}).get("tag", ""))
            near = difflib.get_close_matches(given, tags, 1, 0.5)
            hint = f"did you mean {near[0]!r}? " if near else ""
            return f"{where}{name} has the unknown kind {given!r}; {hint}known: {', '.join(tags)}"
        case "union_tag_not_found":
            return f"{where}{name} has no 'kind'"
        case "value_error":
            return f"{where}{name}: {message}"
        case _:
            return f"{where}{name} must be {_shorten(message)}, not {_shown(item.get('input'))}{meaning}"


def _shorten(message: str) -> str:
    return message[0].lower() + message[1:] if message else message


def _shown(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**SHOWN_DIGITS:
        return f"a number of more than {SHOWN_DIGITS} digits"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _entry(data: object, part: str | int) -> object:
    """What a table or a list holds at `part`; _ABSENT where it holds nothing there."""
    if isinstance(data, Mapping):
        return cast(Mapping[object, object], data).get(part, _ABSENT)
    if isinstance(data, list) and isinstance(part, int) and part < len(data):
        return cast(list[object], data)[part]
    return _ABSENT


def _location_in_file(loc: Location, data: object) -> Location:
    """pydantic puts the tag or type of a tried union member into the location; the file has no such level."""
    location: list[str | int] = []
    for position, part in enumerate(loc):
        entry = _entry(data, part)
        if entry is not _ABSENT:
            data = entry
            location.append(part)
        elif position == len(loc) - 1 and (
            (isinstance(data, Mapping) and _entry(data, "kind") != part)
            or (isinstance(data, list) and isinstance(part, int))
        ):
            location.append(part)
    return tuple(location)


def _keys(model: type[BaseModel]) -> list[str]:
    return [info.alias or name for name, info in model.model_fields.items()]


def _tables_at(model: type[BaseModel], loc: Location, data: object) -> list[type[BaseModel]]:
    """Models that the table at `loc` of `data` may be of, following the models' annotations."""
    candidates = [model]
    kinds: list[OfKind] = []  # of the tables that are to come
    for part in loc:
        entry = _entry(data, part)
        data = data if entry is _ABSENT else entry
        if isinstance(part, int):
            candidates += [found.model(kind) for found in kinds if (kind := found.kind_of(data))]
            continue
        following: list[type[BaseModel]] = []
        kinds = []
        for candidate in candidates:
            fields = candidate.model_fields
            by_name = {info.alias or name: info for name, info in fields.items()}
            if part in by_name:
                kinds += [extra for extra in by_name[part].metadata if isinstance(extra, OfKind)]
                following += _models_in(by_name[part].annotation, kinds)
            elif "kind" in fields and part in get_args(fields["kind"].annotation):
                following.append(candidate)  # the tag of the chosen union member
        candidates = following + [found.model(kind) for found in kinds if (kind := found.kind_of(data))]
    return candidates


def _models_in(annotation: object, kinds: list[OfKind]) -> list[type[BaseModel]]:
    """Models that an annotation names; where it leaves the model to the kind of a table, that goes to
    `kinds`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is Annotated:
        inner, *extras = get_args(annotation)
        found = [extra for extra in extras if isinstance(extra, OfKind)]
        kinds += found
        return [] if found else _models_in(inner, kinds)
    return [model for argument in get_args(annotation) for model in _models_in(argument, kinds)]
