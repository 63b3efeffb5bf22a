"""The training loop: exact resume, stops that lose nothing, and recipes that cannot be followed."""

from __future__ import annotations

import itertools
import json
import os
import signal
from pathlib import Path

import pytest
import torch
from PIL import Image
from pydantic import ValidationError

from edofsim.errors import EdofsimError, InputError
from edofsim.learn import train, trainer
from edofsim.learn.setup import Setup
from edofsim.learn.system import Draw
from edofsim.recipe.load import Loaded, load_train
from edofsim.recipe.train import NetworkTable, TrainRecipe
from edofsim.restore.checkpoint import load_arrays, load_checkpoint
from edofsim.restore.network import apply_network

CAMERA = """
name = "small"
[mask]
kind = "height-map"
[psf]
window_px = 16
oversampling = 1
pupil_sampling_um = 21.0
"""
RECIPE = """
name = "small"
camera = "camera.toml"
seed = 3
device = "cpu"
{extra}
[data]
patch_px = 16
validation_patches = 4
[[data.sources]]
kind = "packaged"
[optimiser]
steps = {steps}
batch = 2
precision = "float32"
[journal]
log_every = 1
save_every = 2
validate_every = 3
pictures_every = 2
"""


def _recipe(folder: Path, steps: int = 4, extra: str = "", text: str = RECIPE) -> Loaded[TrainRecipe]:
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "train.toml").write_text(text.format(steps=steps, extra=extra))
    return load_train(folder / "train.toml")


def _losses(out: Path) -> list[tuple[int, float]]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [(line["step"], line["loss"]) for line in lines if "loss" in line]


def _stop_after(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Press Ctrl-C within step `steps` (counted from the start of this part)."""
    real, count = trainer.draw_batch, iter(range(1, 10**9))

    def counting(*arguments: object) -> object:
        if next(count) == steps:
            os.kill(os.getpid(), signal.SIGINT)
        return real(*arguments)

    monkeypatch.setattr(trainer, "draw_batch", counting)


def _interrupted_equals_straight(
    tmp_path: Path, steps: int, stop: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = _recipe(tmp_path, steps)
    straight = train(loaded, tmp_path / "straight")
    with monkeypatch.context() as patch:
        _stop_after(stop, patch)
        first = train(loaded, tmp_path / "parts")
    assert straight.finished and not first.finished
    assert first.figures["steps"] == stop
    second = train(loaded, tmp_path / "parts", resume=True)
    assert second.finished
    assert _losses(tmp_path / "parts") == _losses(tmp_path / "straight")
    states = [
        load_arrays(tmp_path / name / "state.safetensors", "state")[0] for name in ("straight", "parts")
    ]
    assert states[0].keys() == states[1].keys()
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    assert second.figures["psnr_db.validation"] == straight.figures["psnr_db.validation"]


def test_an_interrupted_training_ends_bit_for_bit_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped by Ctrl-C at an odd step, resumed: same losses, weights, moments and height map."""
    _interrupted_equals_straight(tmp_path, 6, 3, monkeypatch)


@pytest.mark.slow
def test_200_steps_straight_equal_100_and_100(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _interrupted_equals_straight(tmp_path, 200, 100, monkeypatch)


def test_the_checkpoint_tells_how_it_came_to_be(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path)
    result = train(loaded, tmp_path / "out")
    checkpoint = load_checkpoint(result.checkpoint)
    card = checkpoint.card
    assert checkpoint.height.shape == (239, 239) and checkpoint.sampling == pytest.approx(21e-6)
    assert card["step"] == 4 and card["seed"] == 3
    assert card["recipe"]["optimiser"]["steps"] == 4
    assert card["camera"]["psf"]["window_px"] == 16
    assert card["data"]["sources"][0]["name"] == "skimage.data"
    assert card["figures"]["psnr_db.validation"] == result.figures["psnr_db.validation"]
    assert all(path.is_file() for path in result.outputs)
    assert (tmp_path / "out/pictures/0000004.png").is_file()


def test_a_card_tells_the_trainings_before_its_own(tmp_path: Path) -> None:
    """Of the file that the weights came from its name alone: its folder is nobody else's."""
    first = train(_recipe(tmp_path), tmp_path / "first").checkpoint
    loaded = _recipe(tmp_path, 2)
    started = loaded.recipe.network.model_copy(update={"start": str(first)})
    again = Loaded(loaded.recipe.model_copy(update={"network": started}), loaded.path, "")
    card = load_checkpoint(train(again, tmp_path / "second").checkpoint).card
    assert [(one["step"], one["seed"]) for one in card["history"]] == [(4, 3)]
    assert card["history"][0]["data"] == card["data"]
    assert card["step"] == 2 and card["recipe"]["network"]["start"] == first.name
    assert "history" not in load_checkpoint(first).card


def test_sources_for_validation_are_never_drawn_and_scored_apart(tmp_path: Path) -> None:
    """A folder of grey pictures beside photographs: no step sees grey; its PSNR is told by itself, and of a
    training that starts from a checkpoint before the first step, too."""
    grey = tmp_path / "grey"
    grey.mkdir()
    for number in range(3):
        Image.new("RGB", (40, 40), (90 + number,) * 3).save(grey / f"{number}.png")
    only = f'[[data.validation_sources]]\nkind = "natural"\nfolder = "{grey}"\n[optimiser]'
    loaded = _recipe(tmp_path, 10, text=RECIPE.replace("[optimiser]", only))
    sharp: list[torch.Tensor] = []
    with pytest.MonkeyPatch.context() as patch:
        drawn = trainer.draw_batch

        def watched(*arguments: object) -> Draw:
            draw = drawn(*arguments)
            sharp.append(draw.scenes.sharp)
            return draw

        patch.setattr(trainer, "draw_batch", watched)
        first = train(loaded, tmp_path / "first")
    assert all(float(one.std()) > 0.01 for batch in sharp for one in batch)
    photos, greys = (first.figures[f"psnr_db.validation.{name}"] for name in ("1-packaged", "2-natural"))
    assert min(photos, greys) < first.figures["psnr_db.validation"] < max(photos, greys)
    card = load_checkpoint(first.checkpoint).card
    assert [source.get("only") for source in card["data"]["sources"]] == [None, "validation"]
    network = loaded.recipe.network.model_copy(update={"start": str(first.checkpoint)})
    again = Loaded(loaded.recipe.model_copy(update={"network": network}), loaded.path, "")
    second = train(again, tmp_path / "second")
    start = json.loads((tmp_path / "second/log.jsonl").read_text().splitlines()[0])
    assert start["step"] == 0 and start["psnr_db.validation.2-natural"] > 0
    resumed = train(again, tmp_path / "second", resume=True)  # ended already: its figures again
    for after, before in (("start", first), ("validation", second)):
        for source in ("", ".1-packaged", ".2-natural"):
            validated = before.figures[f"psnr_db.validation{source}"]
            for told in (second, resumed):
                assert told.figures[f"psnr_db.{after}{source}"] == pytest.approx(validated, abs=0.01)
    assert not any("start" in name for name in first.figures)


def test_what_is_new_in_a_larger_network_follows_the_seed(tmp_path: Path) -> None:
    """Whatever was drawn at random before it."""
    first = train(_recipe(tmp_path), tmp_path / "first").checkpoint
    loaded = _recipe(tmp_path)
    network = loaded.recipe.network.model_copy(update={"start": str(first), "settings": {"kernels": 34}})
    found = []
    for seed in (1, 2):
        torch.manual_seed(seed)
        larger = Loaded(loaded.recipe.model_copy(update={"network": network}), loaded.path, "")
        found.append(load_checkpoint(train(larger, tmp_path / f"{seed}").checkpoint).network.state_dict())
    assert all(torch.equal(found[0][name], value) for name, value in found[1].items())


def test_keys_that_are_gone_are_read_where_they_were_off_and_refused_where_they_were_on() -> None:
    assert NetworkTable.model_validate({"start_share": 0.0}) == NetworkTable()
    with pytest.raises(ValidationError, match="start_share is removed since version 0.2"):
        NetworkTable.model_validate({"start_share": 0.5})


def test_frozen_statistics_stay_while_the_weights_learn(tmp_path: Path) -> None:
    """From halfway on: what the first half left, the second keeps."""
    saved: list[dict[str, torch.Tensor]] = []
    loaded = _recipe(tmp_path, 4)
    settings = loaded.recipe.optimiser.model_copy(update={"frozen_statistics": 0.5})
    halfway = Loaded(loaded.recipe.model_copy(update={"optimiser": settings}), loaded.path, "")
    with pytest.MonkeyPatch.context() as patch:
        drawn = trainer.draw_batch

        def watched(setup: Setup, *arguments: object) -> object:
            saved.append({name: value.clone() for name, value in setup.system.network.state_dict().items()})
            return drawn(setup, *arguments)

        patch.setattr(trainer, "draw_batch", watched)
        result = train(halfway, tmp_path / "out")
    states = [*saved[-4:], load_checkpoint(result.checkpoint).network.state_dict()]
    means = [name for name in states[0] if "running" in name]
    moved = [any(not torch.equal(a[name], b[name]) for name in means) for a, b in itertools.pairwise(states)]
    assert moved == [True, True, False, False]
    weights = [name for name in states[0] if name.endswith("weight")]
    assert all(not torch.equal(states[2][name], states[4][name]) for name in weights)


def test_a_long_gradient_is_clipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The optimiser never sees a longer one; without the setting it does."""
    seen: list[float] = []
    real = torch.optim.Adam.step

    def watched(self: torch.optim.Adam, *arguments: object) -> object:
        grads = [p.grad for p in self.param_groups[0]["params"] if p.grad is not None]
        seen.append(float(torch.stack([grad.square().sum() for grad in grads]).sum().sqrt()))
        return real(self, *arguments)

    monkeypatch.setattr(torch.optim.Adam, "step", watched)
    train(_recipe(tmp_path, 3), tmp_path / "free")
    free = list(seen)
    seen.clear()
    loaded = _recipe(tmp_path, 3)
    settings = loaded.recipe.optimiser.model_copy(update={"clip_gradient": min(free) / 2})
    clipped = Loaded(loaded.recipe.model_copy(update={"optimiser": settings}), loaded.path, "")
    train(clipped, tmp_path / "clipped")
    assert max(seen) <= min(free) / 2 * (1 + 1e-4)
    assert min(seen) > 0


def test_a_network_without_a_gradient_ends_the_training(tmp_path: Path) -> None:
    """All black before the clamp: nothing could change any more, and nobody would be told."""

    real = trainer.prepare

    def prepared(*arguments: object, **options: object) -> Setup:
        setup = real(*arguments, **options)
        final = setup.system.network.refine[-1].bias
        with torch.no_grad():
            final.fill_(-50.0)
        return setup

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "prepare", prepared)
        patch.setattr(trainer, "NO_GRADIENT", 10)
        with pytest.raises(EdofsimError, match="no gradient for 10 updates"):
            train(_recipe(tmp_path, 20), tmp_path / "out")
    assert _losses(tmp_path / "out")[-1][0] < 11


def test_a_training_learns(tmp_path: Path) -> None:
    """Forty small steps: the loss falls, the photo is improved on, and the mask has moved."""
    loaded = _recipe(tmp_path, 40)
    result = train(loaded, tmp_path / "out")
    losses = [loss for _, loss in _losses(tmp_path / "out")]
    assert sum(losses[-5:]) < 0.7 * sum(losses[:5])
    height = load_checkpoint(result.checkpoint).height
    assert height.std() > 1e-9


def test_a_network_alone_leaves_the_mask(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path, 2, extra="[doe]\nlearn = false")
    height = load_checkpoint(train(loaded, tmp_path / "out").checkpoint).height
    assert torch.equal(height, torch.full_like(height, 0.6e-6))


def test_a_training_is_not_overwritten(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path, 1)
    train(loaded, tmp_path / "out")
    with pytest.raises(InputError, match="--resume"):
        train(loaded, tmp_path / "out")


def test_another_recipe_does_not_resume(tmp_path: Path) -> None:
    train(_recipe(tmp_path, 1), tmp_path / "out")
    changed = _recipe(tmp_path, 1, extra="[loss]\nalpha = 0.5\n[doe]\nlearning_rate_rad = 0.1")
    with pytest.raises(InputError) as caught:
        train(changed, tmp_path / "out", resume=True)
    assert [problem.split("[")[1].split("]")[0] for problem in caught.value.problems] == ["doe", "loss"]


def test_a_damaged_state_does_not_resume(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path, 1)
    train(loaded, tmp_path / "out")
    state = tmp_path / "out/state.safetensors"
    state.write_bytes(state.read_bytes()[:5000])
    with pytest.raises(InputError, match="not a whole training state"):
        train(loaded, tmp_path / "out", resume=True)


def test_a_loss_that_is_not_finite_stops_with_state_and_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = trainer.draw_batch

    def poisoned(setup: object, step: int, workers: object, part: int = 0) -> object:
        draw = real(setup, step, workers, part)
        if step == 2:
            draw.scenes.sharp[0, 0, 10, 10] = torch.nan
        return draw

    loaded = _recipe(tmp_path)
    monkeypatch.setattr(trainer, "draw_batch", poisoned)
    with pytest.raises(EdofsimError, match="step 2: the loss or its gradient is not finite"):
        train(loaded, tmp_path / "out")
    weights, about = load_arrays(tmp_path / "out/nan-state.safetensors", "state")
    assert json.loads(about["state"])["step"] == 2
    assert any(name.startswith("system.network.") for name in weights)
    with pytest.raises(InputError, match="not finite"):  # the batch holds what went wrong
        load_arrays(tmp_path / "out/nan-batch.safetensors", "batch")


def test_time_ends_a_training_with_its_decay_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by a second whenever it is read."""
    clock = itertools.count()
    monkeypatch.setattr(trainer.time, "perf_counter", lambda: float(next(clock)))
    result = train(_recipe(tmp_path, 10**6), tmp_path / "out", max_minutes=0.5)
    lines = [json.loads(line) for line in (tmp_path / "out/log.jsonl").read_text().splitlines()]
    rates = [line["learning_rate"] for line in lines if "learning_rate" in line]
    assert result.finished and result.figures["steps"] < 10**6
    assert rates[-1] < 0.05 * rates[0]


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_cuda_is_refused_where_there_is_none(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path)
    with pytest.raises(InputError, match="asks for CUDA"):
        train(loaded, tmp_path / "out", device="cuda")


def test_photographs_are_asked_for(tmp_path: Path) -> None:
    loaded = _recipe(tmp_path, text=RECIPE.replace('"packaged"', '"natural"'))
    with pytest.raises(InputError, match="--data DIR"):
        train(loaded, tmp_path / "out")
    with pytest.raises(InputError, match="no such folder"):
        train(loaded, tmp_path / "out", data=tmp_path / "none")


def test_a_filter_and_its_mask_learn_together(tmp_path: Path) -> None:
    """Zernike terms and Wiener deconvolution: the terms move, and the checkpoint's filter stands alone."""
    extra = '[network]\nkind = "wiener"\nsettings = {depths = 3}\n[mask]\nkind = "zernike"'
    result = train(_recipe(tmp_path, 3, extra), tmp_path / "out")
    state, _ = load_arrays(tmp_path / "out/state.safetensors", "state")
    assert not torch.equal(state["system.mask.phase"], torch.tensor([2.0, 2.0, 1.5]))
    checkpoint = load_checkpoint(result.checkpoint)
    assert checkpoint.network.psf.shape == (3, 3, 16, 16)
    assert float(checkpoint.network.psf[0].sum()) > 0.5
    restored = apply_network(checkpoint.network, torch.rand(3, 40, 40))
    assert restored.shape == (3, 40, 40) and torch.isfinite(restored).all()
