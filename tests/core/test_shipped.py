"""What recipes are called where a command is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from edofsim.core.shipped import shipped, shipped_folder, typed_as
from edofsim.recipe import load_camera, load_scene


def test_a_command_names_shipped_recipes_and_paths_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each is what the command line takes: loading it again gives the same file."""
    assert typed_as(load_scene("desk").path) == "desk"
    assert typed_as(load_camera("paper-learned").path) == "paper-learned"
    monkeypatch.chdir(tmp_path)
    assert typed_as(tmp_path / "mine.toml") == "mine.toml"
    assert typed_as(Path("in") / "mine.toml") == str(Path("in") / "mine.toml")
    assert typed_as(tmp_path.parent / "mine.toml") == str(tmp_path.parent / "mine.toml")
    family = next(iter(shipped(shipped_folder("scenes") / "families").values()))
    assert load_scene(typed_as(family)).path == family
