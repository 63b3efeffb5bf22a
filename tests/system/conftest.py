"""Commands run in this process, and small disks."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from edofsim import console
from edofsim.cli import invoke

LARGE = 256 << 20


@pytest.fixture
def edofsim(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run a command in this process: (exit status, what it said on the error channel)."""

    def run(*arguments: str | Path) -> tuple[int, str]:
        status = console.exit_status(lambda: invoke([str(a) for a in arguments]))
        return status, capfd.readouterr().err

    return run


@dataclass(frozen=True)
class Disk:
    """A file system of its own, in memory."""

    folder: Path

    def change(self, options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(self.folder)], check=True)

    def size(self, size: int) -> None:
        """Make it so many bytes large; what is on it must fit."""
        self.change(f"size={max(size, 4096)}")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={LARGE}", "tmpfs", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no mount command here")
    if done.returncode:
        pytest.skip("mounting a small disk is not allowed here (it takes root)")
    yield Disk(folder)
    subprocess.run(["umount", "-l", str(folder)], check=True)
