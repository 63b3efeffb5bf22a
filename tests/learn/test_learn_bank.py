"""Filters that are told the mask, and a mask that is designed for them and kept."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from edofsim.errors import InputError
from edofsim.learn.setup import prepare
from edofsim.learn.trainer import draw_batch, train
from edofsim.learn.workers import Workers
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.filter_bank import FilterBank

WORKERS = Workers(0, 1, torch.device("cpu"))
SMALL = {"groups": 3, "distances": 2, "support": 9, "width": 4, "blocks": [1, 1]}


def _recipe(steps: int = 2, **doe: object) -> Loaded[TrainRecipe]:
    recipe = TrainRecipe.model_validate(
        {
            "name": "bank",
            "camera": "paper-clear",
            "seed": 1,
            "mask": {"kind": "height-map"},
            "psf": {"window_px": 32, "pupil_sampling_um": 21.0},
            "capture": {"inverse_depth_per_m": [1.0, 1.4]},  # out of focus, within the window
            "network": {"kind": "filter-bank", "settings": SMALL},
            "doe": doe,
            "data": {"patch_px": 64, "validation_patches": 4, "sources": [{"kind": "packaged"}]},
            "optimiser": {"steps": steps, "batch": 4},
        }
    )
    return Loaded(recipe, Path("bank.toml"), "")


def test_told_the_mask_it_restores_before_it_is_trained() -> None:
    """The lens alone: the filters of the likely distances take away a part of its blur, untold ones none."""
    setup = prepare(_recipe(), None, WORKERS)
    gains = []
    with torch.no_grad():
        draws = [draw_batch(setup, step, WORKERS) for step in range(4)]
        for _ in range(2):
            outcomes = [setup.system(draw) for draw in draws]
            errors, photos = (
                torch.cat([(image - o.ideal).square().mean((1, 2, 3)) for o, image in pairs]).log10().mean()
                for pairs in (
                    [(o, o.restored) for o in outcomes],
                    [(o, o.photo) for o in outcomes],
                )
            )
            gains.append(float(10 * (photos - errors)))
            setup.system.set_initial_psfs(0.005)
            draws = [draw_batch(setup, step, WORKERS) for step in range(4)]
    assert gains[0] == pytest.approx(0, abs=1e-3)
    assert gains[1] > 2


def test_a_training_repeats_itself(tmp_path: Path) -> None:
    first, second = (train(_recipe(design_steps=2), tmp_path / name) for name in ("first", "second"))
    assert first.checkpoint.read_bytes() == second.checkpoint.read_bytes()


def test_its_border_is_not_judged() -> None:
    setup = prepare(_recipe(), None, WORKERS)
    outcome = setup.system(draw_batch(setup, 0, WORKERS))
    assert outcome.restored.shape == outcome.ideal.shape == (4, 3, 64 - 8, 64 - 8)


def test_a_mask_without_a_rate_is_designed_and_kept(tmp_path: Path) -> None:
    """However long the network is trained. The design alone moves it from a flat map."""
    kept = [
        load_checkpoint(
            train(_recipe(steps, design_steps=2, learning_rate_rad=0.0), tmp_path / name).checkpoint
        )
        for steps, name in ((1, "short"), (4, "long"))
    ]
    assert torch.equal(kept[0].height, kept[1].height) and kept[0].height.std() > 0
    moved = train(_recipe(4, design_steps=2), tmp_path / "moved")
    assert not torch.equal(load_checkpoint(moved.checkpoint).height, kept[0].height)


def test_it_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    straight = train(_recipe(4, design_steps=2, learning_rate_rad=0.0), tmp_path / "straight")
    loaded = _recipe(4, design_steps=2, learning_rate_rad=0.0)
    stopped = tmp_path / "stopped"
    with pytest.MonkeyPatch.context() as patch:
        from edofsim.learn import trainer

        drawn = trainer.draw_batch

        def dying(setup: object, step: int, workers: object, part: int = 0) -> object:
            if step == 2:
                raise InputError("power cut")
            return drawn(setup, step, workers, part)

        patch.setattr(trainer, "draw_batch", dying)
        every = {"save_every": 2, "validate_every": 100}
        journal = loaded.recipe.journal.model_copy(update=every)
        broken = Loaded(loaded.recipe.model_copy(update={"journal": journal}), loaded.base, "")
        with pytest.raises(InputError, match="power cut"):
            train(broken, stopped)
    resumed = train(broken, stopped, resume=True)
    first, second = (load_checkpoint(each.checkpoint).network.state_dict() for each in (straight, resumed))
    assert all(torch.equal(first[name], second[name]) for name in first)


def _with_network(**network: object) -> Loaded[TrainRecipe]:
    plain = _recipe(2, learning_rate_rad=0.0)
    data = plain.recipe.model_dump(mode="json", by_alias=True)
    return Loaded(TrainRecipe.model_validate({**data, "network": network}), plain.base, "")


def test_it_is_trained_with_an_auxiliary_d_cnn_which_is_kept(tmp_path: Path) -> None:
    """Both are conditioned on the mask, and one file holds both, and where they come from."""
    small = {"kernels": 6, "dilations": [1, 2], "distances": 3}
    first = train(_with_network(kind="dcnn", settings=small), tmp_path / "first").checkpoint
    recipe = _with_network(kind="filter-bank", settings=SMALL, auxiliary=str(first))
    both = load_checkpoint(train(recipe, tmp_path / "both").checkpoint)
    assert isinstance(both.network, FilterBank) and both.network.dcnn is not None
    own = load_checkpoint(first).network.state_dict()
    auxiliary = both.network.dcnn.state_dict()
    assert own.keys() == auxiliary.keys()
    assert all(torch.equal(own[name], auxiliary[name]) for name in own if name != "transfer")
    # given the PSFs of the same mask, by the same errors
    torch.testing.assert_close(auxiliary["transfer"], own["transfer"], rtol=0, atol=2e-3)
    assert both.card["recipe"]["network"]["auxiliary"] == first.name
    assert [each["name"] for each in both.card["auxiliary"]] == ["bank"]
    with pytest.raises(InputError, match=r"network\.auxiliary = .*takes no auxiliary network"):
        train(_with_network(kind="local-unet", auxiliary=str(first)), tmp_path / "refused")
    with pytest.raises(InputError, match="it was trained with another mask"):
        train(_with_network(kind="filter-bank", settings=SMALL, auxiliary="paper-dcnn"), tmp_path / "refused")
