"""The choice of a filter bank, trained alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from edofsim.learn.choosing import learn_choice
from edofsim.learn.setup import Setup, prepare
from edofsim.learn.system import Draw
from edofsim.learn.trainer import draw_batch, train
from edofsim.learn.workers import Workers
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe

WORKERS = Workers(0, 1, torch.device("cpu"))


def _recipe(kind: str = "filter-bank", **network: object) -> Loaded[TrainRecipe]:
    settings = {"groups": 3, "support": 9, "width": 4, "blocks": [1, 1]} if kind == "filter-bank" else {}
    recipe = TrainRecipe.model_validate(
        {
            "name": "choice",
            "camera": "paper-clear",
            "seed": 1,
            "mask": {"kind": "height-map"},
            "psf": {"window_px": 32, "pupil_sampling_um": 21.0},
            "network": {"kind": kind, "settings": settings, **network},
            "data": {"patch_px": 48, "validation_patches": 4, "sources": [{"kind": "packaged"}]},
            "optimiser": {"steps": 2, "batch": 4},
        }
    )
    return Loaded(recipe, Path("choice.toml"), "")


def _learn(setup: Setup, steps: int) -> float:
    def draw(step: int) -> Draw:
        return draw_batch(setup, step, WORKERS)

    return learn_choice(setup.system, draw, steps)


def test_the_choice_comes_near_the_best_filter() -> None:
    """The lens alone blurs each part of the depth range otherwise: filters of the others do harm."""
    short = []
    for steps in (20, 100):
        setup = prepare(_recipe(), None, WORKERS)
        setup.system.prime()
        trunk = [value.clone() for value in setup.system.network.trunk.state_dict().values()]
        short.append(_learn(setup, steps))
        now = setup.system.network.trunk.state_dict().values()
        assert all(torch.equal(old, new) for old, new in zip(trunk, now, strict=True))
    assert short[1] < 0.6 * short[0]


def test_only_a_bank_has_a_choice() -> None:
    with pytest.raises(TypeError, match="dcnn"):
        _learn(prepare(_recipe("dcnn"), None, WORKERS), 1)


def test_a_training_of_a_bank_repeats_itself(tmp_path: Path) -> None:
    first, second = (train(_recipe(choice_steps=3), tmp_path / name) for name in ("first", "second"))
    assert first.checkpoint.read_bytes() == second.checkpoint.read_bytes()
