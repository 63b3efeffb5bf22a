"""Families: one recipe with distributions gives as many different scenes as one asks for."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import Field, model_validator

from .base import Fraction, RecipeModel

Range = tuple[float, float]
# checked where it is put into the members' recipes
TomlValue: TypeAlias = Any  # pyrefly: ignore[explicit-any]


class Vary(RecipeModel):
    """One value that differs from member to member, or a thing that some members do not have.

    `key` is a dotted path: `lights.lamp.radiance`, `objects.bust.surface.reflectance`, `seed`-free keys of
    the recipe such as `frame.margin_px` too; lights and objects by name, or by number from 0. Exactly one
    distribution is given: `uniform`, `inverse_uniform` (uniform in 1/x, as defocus sees depth),
    `log_uniform`, `normal` (mean, standard deviation), `integer` (both ends included), `choice`, or
    `present` (the probability that the object or light named by `key` is there).
    """

    key: Annotated[str, Field(min_length=1)]
    """dotted path of what varies, such as `lights.lamp.radiance` or `frame.margin_px`"""
    uniform: Range | None = None
    """uniform between two ends"""
    inverse_uniform: Range | None = None
    """uniform in 1/x between two ends above 0, as defocus sees depth"""
    log_uniform: Range | None = None
    """uniform in the logarithm between two ends above 0"""
    normal: Range | None = None
    """normal distribution: mean and standard deviation"""
    integer: tuple[int, int] | None = None
    """whole number between two ends, both included"""
    choice: Annotated[tuple[TomlValue, ...], Field(min_length=1)] | None = None
    """one of these values, each as likely"""
    present: Fraction | None = None
    """probability that the object or light of `key` is there"""

    @model_validator(mode="after")
    def _one_distribution(self) -> Vary:
        kinds = ("uniform", "inverse_uniform", "log_uniform", "normal", "integer", "choice", "present")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(kinds)}; given: {', '.join(given) or 'none'}")
        for kind in ("uniform", "inverse_uniform", "log_uniform", "integer"):
            ends = getattr(self, kind)
            if ends is not None and ends[1] < ends[0]:
                raise ValueError(f"{kind}: the first end must not be above the second")
            if ends is not None and kind in ("inverse_uniform", "log_uniform") and ends[0] <= 0:
                raise ValueError(f"{kind} needs ends above 0")
        if self.normal is not None and self.normal[1] < 0:
            raise ValueError("normal: the standard deviation must not be negative")
        return self


class Family(RecipeModel):
    """What varies among the members of a family, drawn in this order."""

    vary: Annotated[tuple[Vary, ...], Field(min_length=1)]
    """what varies, drawn in this order"""
