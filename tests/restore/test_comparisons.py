"""Systems for comparison are not in the wheel: what needs them says where they are."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from edofsim.errors import InputError
from edofsim.experiments import systems
from edofsim.restore import checkpoint

WHERE = r"unpack edofsim-comparisons-\d+\.\d+\.\d+\.zip of the release into {}"


def test_missing_systems_are_named_with_the_place_to_put_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    """By name in a message; where all are evaluated, in a warning, and the others are evaluated."""
    there = {*checkpoint.comparison_checkpoints()}
    assert "levin-dcnn" in there and not checkpoint.comparisons_left_out()
    monkeypatch.setattr(checkpoint, "comparisons_folder", lambda: tmp_path)
    with pytest.raises(InputError, match=WHERE.format(tmp_path)):
        checkpoint.find_checkpoint("levin-dcnn")
    monkeypatch.setattr(systems, "evaluated_system", lambda name, camera: SimpleNamespace(name=name))
    found, _ = systems.usable_systems(None, every=True)
    assert "paper-dcnn" in {each.name for each in found} and not there & {each.name for each in found}
    assert "edofsim-comparisons" in caplog.text
