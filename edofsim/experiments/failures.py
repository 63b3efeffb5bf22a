"""Systems of a comparison that cannot be judged: each is named, and the others are finished."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from ..errors import InputError


@dataclass
class Failures:
    """What is wrong, by whom it concerns."""

    found: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @contextmanager
    def of(self, name: str) -> Generator[None]:
        """Take note of an InputError in place of raising it."""
        try:
            yield
        except InputError as error:
            self.found[name] = error.problems

    @property
    def sentences(self) -> list[str]:
        """One a problem; whom it concerns is named before it, once where several have the same."""
        by_text: dict[str, list[str]] = {}
        for name, texts in self.found.items():
            for text in texts:
                by_text.setdefault(text, []).append(name)
        return [_named(text, names) for text, names in by_text.items()]

    def check(self, done: int) -> None:
        """Raise InputError with all that is wrong, where nothing is done and something failed."""
        if self.found and not done:
            raise InputError(self.sentences)


def _named(text: str, names: Sequence[str]) -> str:
    begun = len(names) == 1 and text.startswith(names[0])
    return text if begun else f"{', '.join(names)}: {text}"
