"""What all recipe models share: unknown keys are refused, values are finite, models are frozen."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo

LOG = logging.getLogger(__name__)


class RecipeModel(BaseModel):
    """Base of every table in a recipe."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Pair = tuple[float, float]
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
