"""Networks are called by what they are; their earlier names are read, with one line."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from edofsim.core.shipped import RENAMED
from edofsim.experiments.training import training_of
from edofsim.recipe.load import load_train
from edofsim.restore.checkpoint import find_checkpoint, load_checkpoint


@pytest.mark.parametrize("old, new", RENAMED.items())
def test_earlier_names_are_read_with_one_line(old: str, new: str, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        assert find_checkpoint(old) == find_checkpoint(new)
        assert load_train(old).path == load_train(new).path
    assert [record.getMessage() for record in caplog.records] == [f"{old} is called {new} now"] * 2
    assert load_checkpoint(new).name == load_train(new).recipe.name == new


def test_an_auxiliary_network_is_read_by_its_earlier_key(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    today = load_train("paper-bank")
    earlier = tmp_path / "earlier.toml"
    text = today.path.read_text(encoding="utf-8").replace("auxiliary =", "beside =")
    earlier.write_text(text.replace("../scenes/", f"{today.path.parents[1]}/scenes/"), encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        assert load_train(str(earlier)).recipe.network == today.recipe.network
    assert [record.getMessage() for record in caplog.records] == [
        f"{earlier}: beside = 'depth-dcnn' is now auxiliary = 'depth-dcnn'"
    ]


def test_steps_under_an_earlier_name_are_its_own():
    before = training_of(load_checkpoint("depth-dcnn").card)
    card = {
        "name": "depth-dcnn",
        "step": 7,
        "history": [{"name": "told-dcnn", "step": 5}, {"name": "x", "step": 3}],
    }
    after = training_of(card)
    assert (after.steps, after.before) == (12, 3)
    assert (before.steps, before.before) == (8855, 34440)
