"""Benchmarks by name: what is asked for is what runs, and the commit is told."""

from __future__ import annotations

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
    assert "commit" in str(found.shown[-1])
