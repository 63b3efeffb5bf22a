"""What records say of the process."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from edofsim import record

CHILD = "from edofsim.record import peak_memory_mib; print(peak_memory_mib())"
PARENT = f"""
import subprocess, sys
import numpy
held = numpy.ones(100_000_000)  # 763 MiB
print(subprocess.run([sys.executable, "-c", {CHILD!r}], capture_output=True, text=True).stdout)
"""


def test_peak_memory_is_that_of_the_process_alone():
    """Not of the one that started it, which the kernel counts in a child's largest resident size."""
    alone, child = (
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout)
        for code in (CHILD, PARENT)
    )
    assert 5 < alone < 500
    assert abs(child - alone) < 50


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_the_commit_of_a_checkout_and_whether_files_differ_from_it(tmp_path: Path):
    assert record.commit_of(tmp_path) == "unknown"

    def git(*arguments: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        command = ["git", "-C", str(tmp_path), *who, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    git("init", "-q")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("commit", "-qm", "first")
    commit = git("rev-parse", "--short", "HEAD")
    assert record.commit_of(tmp_path) == commit
    (tmp_path / "file").write_text("two")
    assert record.commit_of(tmp_path) == f"{commit}-dirty"
    (tmp_path / "package" / "inside").mkdir(parents=True)
    assert record.commit_of(tmp_path / "package") == f"{commit}-dirty"
    assert record.commit_of(tmp_path / "package" / "inside") == "unknown"  # installed in another's checkout


def test_a_record_says_what_was_typed_when_and_with_which_code(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "argv", ["/some/bin/edofsim", "run", "a scene.toml", "--quiet"])
    found = record.record("run", figures={"a": 1})
    assert found["typed"] == "edofsim run 'a scene.toml' --quiet"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", found["date"])
    assert found["commit"] == record.commit_of(Path(record.__file__).parents[1])
