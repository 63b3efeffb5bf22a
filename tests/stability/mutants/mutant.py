"""What a mutant is, and how the simulator is changed and put back."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import TypeVar
from unittest.mock import patch

from torch import Tensor

from edofsim.optics import cache, transform

R = TypeVar("R")


@dataclass(frozen=True)
class Mutant:
    """A simulator that is broken on purpose. does: in a sentence; groups: of hard cases that must notice;
    broken: the context in which the simulator is so."""

    name: str
    does: str
    groups: tuple[str, ...]
    broken: Callable[[], AbstractContextManager[object]]


def forget() -> None:
    """Empty what is kept in memory of optics, so that nothing is left of another simulator."""
    cache.forget()
    transform.pixel_weights.cache_clear()


@contextmanager
def applied(mutant: Mutant) -> Generator[None]:
    """The simulator broken as the mutant says, and whole again afterwards."""
    forget()
    try:
        with mutant.broken():
            yield
    finally:
        forget()


def swapped(where: ModuleType | type, name: str, other: object) -> AbstractContextManager[object]:
    """An attribute of a module or a class replaced."""
    return patch.object(where, name, other)


def after(where: ModuleType | type, name: str, change: Callable[[R], R]) -> AbstractContextManager[object]:
    """A function whose result is changed before anyone sees it."""
    inner: Callable[..., R] = getattr(where, name)

    def changed(*given: object, **options: object) -> R:
        return change(inner(*given, **options))

    return patch.object(where, name, changed)


def scaled(where: ModuleType | type, name: str, times: float) -> AbstractContextManager[object]:
    """A function whose result, a number or a tensor, is multiplied."""
    inner: Callable[..., Tensor] = getattr(where, name)

    def changed(*given: object, **options: object) -> Tensor:
        return times * inner(*given, **options)

    return patch.object(where, name, changed)


@contextmanager
def together(*changes: AbstractContextManager[object]) -> Generator[None]:
    """Several changes at once."""
    with ExitStack() as stack:
        for each in changes:
            stack.enter_context(each)
        yield
