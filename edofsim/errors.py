"""The two ways a command can end badly, distinguished by their exit status."""

from __future__ import annotations

from collections.abc import Iterable


class EdofsimError(Exception):
    """Work that could not be finished: exit status 1, one message, no traceback."""


class InputError(EdofsimError):
    """What the user gave cannot be used: exit status 2.

    Each problem is a sentence that says what is wrong, where, and what to do. Several problems found
    together are reported together, so that a file is mended in one go.
    """

    def __init__(self, problems: str | Iterable[str]) -> None:
        self.problems: tuple[str, ...] = (problems,) if isinstance(problems, str) else tuple(problems)
        super().__init__("\n".join(self.problems))

    # keeps the problems when a worker process sends the error back
    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[str, ...]]]:
        return type(self), (self.problems,)


class EngineError(EdofsimError):
    """No usable render engine: the message names the command that installs one."""


class DiskFullError(EdofsimError):
    """There is no room for a file."""


def first_line(error: BaseException) -> str:
    """The beginning of another library's error, short enough for one sentence."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:160]
