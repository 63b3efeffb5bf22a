"""Commands run in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from edofsim import console
from edofsim.cli import invoke


@pytest.fixture
def edofsim(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run a command in this process: (exit status, what it said on the error channel)."""

    def run(*arguments: str | Path) -> tuple[int, str]:
        status = console.exit_status(lambda: invoke([str(a) for a in arguments]))
        return status, capfd.readouterr().err

    return run
