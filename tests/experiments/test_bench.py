"""Benchmarks by name: what is asked for is what runs, and the commit is told."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

import benchmarks.photos
import benchmarks.render
from edofsim.core.progress import silent
from edofsim.experiments import bench


@pytest.mark.parametrize("full", [False, True])
def test_the_named_benchmarks_run_at_the_size_that_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full: bool
):
    asked: dict[str, object] = {}

    def render(progress: object, full: bool) -> dict[str, float]:
        asked["render"] = full
        return {"seconds": 2.0}

    def photos(progress: object, out: Path, full: bool) -> dict[str, float]:
        asked["photos"] = (out, full)
        return {"seconds": 3.0}

    monkeypatch.setattr(benchmarks.render, "run", render)
    monkeypatch.setattr(benchmarks.photos, "run", photos)
    found = bench.run(tmp_path, silent, ["render", "expose"], full=full)
    assert found.figures == {"render.seconds": 2.0, "expose.seconds": 3.0}
    assert asked == {"render": full, "photos": (tmp_path, full)}
    assert f"commit {found.record['commit']}" in str(found.shown[-1])


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_the_commit_of_a_checkout_and_whether_files_differ_from_it(tmp_path: Path):
    assert bench.commit_of(tmp_path) == "unknown"

    def git(*arguments: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        command = ["git", "-C", str(tmp_path), *who, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    git("init", "-q")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("commit", "-qm", "first")
    commit = git("rev-parse", "--short", "HEAD")
    assert bench.commit_of(tmp_path) == commit
    (tmp_path / "file").write_text("two")
    assert bench.commit_of(tmp_path) == f"{commit}-dirty"
