"""What all recipe models share: unknown keys are refused, values are finite, models are frozen."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Annotated, TypeAlias, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

from ..core.json_values import Json
from .described import descriptions

LOG = logging.getLogger(__name__)


Schema: TypeAlias = dict[str, object]
"""Part of what pydantic validates by, as plain data."""


def _numbers_only(schema: Schema | Sequence[object]) -> None:
    """Have each number in a model's schema refuse true, false and text. Models within have done so."""
    for part in schema.values() if isinstance(schema, dict) else schema:
        if isinstance(part, dict):
            table = cast(Schema, part)
            if table.get("type") in ("int", "float"):
                number = cast(core_schema.CoreSchema, dict(table))
                table.clear()
                table.update(core_schema.no_info_before_validator_function(_refuse_words, number))
            elif table.get("type") != "model":
                _numbers_only(table)
        elif isinstance(part, Sequence) and not isinstance(part, str | bytes):
            _numbers_only(part)


def _refuse_words(value: object) -> object:
    if isinstance(value, bool | str | bytes):
        raise PydanticCustomError("number", "a number")
    return value


class RecipeModel(BaseModel):
    """Base of every table in a recipe."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[BaseModel], handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        schema = handler(source)
        inner = cast(Schema, schema)
        while inner["type"] != "model":  # inside its own validators
            inner = cast(Schema, inner["schema"])
        _numbers_only(inner)
        return schema

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = handler(core)
        keys = handler.resolve_ref_schema(schema).get("properties", {})
        for key, text in descriptions(cls).items():
            keys[key]["description"] = text
        return schema


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Triple = tuple[float, float, float]


def renamed(
    data: Mapping[str, object], old: str, new: str, values: Mapping[str, str], info: ValidationInfo
) -> dict[str, object]:
    """A table as it was read, with the key `new` in place of `old`, as it was once called; `values` that have
    other names now, too. One line says so where the table is of a recipe that someone wrote."""
    table = dict(data)
    if old in table and new not in table:
        given = table.pop(old)
        table[new] = values.get(given, given) if isinstance(given, str) else given
        if info.context:
            LOG.warning("%s: %s = %r is now %s = %r", info.context["path"], old, given, new, table[new])
    return table


def without(data: object, *gone: str) -> object:
    """A table as it was read, without keys that are gone and were off in it. Raises ValueError for one that
    was on: what it asked for is not there any more."""
    if not isinstance(data, Mapping):
        return data
    if asked := [key for key in gone if data.get(key)]:
        raise ValueError(f"{asked[0]} is removed since version 0.2; delete the key")
    return {key: value for key, value in data.items() if key not in gone}


def in_new_names(model: type[BaseModel], table: Json) -> Json:
    """A whole recipe that an earlier version wrote into a file of its own, as this version writes it; what is
    no whole recipe is given back as it is."""
    try:
        return model.model_validate(table).model_dump(mode="json", by_alias=True)
    except ValidationError:
        return table
