"""Highlights many times brighter than full scale: in patches, in photos, in what is asked of a network."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.errors import InputError
from edofsim.learn.edges import Edges, draw_covers
from edofsim.learn.highlights import BRIGHTNESS, with_highlights
from edofsim.learn.setup import prepare
from edofsim.learn.system import Draw, Planes
from edofsim.learn.trainer import train
from edofsim.learn.training_camera import TrainingCamera
from edofsim.learn.workers import Workers
from edofsim.optics import Camera
from edofsim.recipe import load_camera
from edofsim.recipe.load import Loaded, load_train
from edofsim.recipe.train import TrainRecipe
from edofsim.restore.checkpoint import load_arrays, load_checkpoint, save_arrays
from edofsim.restore.restorer import Restorer

WINDOW, PATCH = 16, 32
SIZE = PATCH + WINDOW - 1


@pytest.fixture(scope="module")
def optics() -> TrainingCamera:
    loaded = load_camera("paper-clear")
    return TrainingCamera(Camera.from_recipe(loaded.recipe, loaded.base), WINDOW, torch.device("cpu"))


def _generator(seed: int = 1) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _patches(count: int = 2) -> torch.Tensor:
    return torch.rand(count, 3, SIZE, SIZE, generator=_generator(2))


def test_without_a_share_patches_stay_as_they_are() -> None:
    torch.testing.assert_close(with_highlights(_patches(), 0.0, _generator()), _patches(), rtol=0, atol=0)


def test_lamps_are_bright_and_small_and_the_rest_is_dimmed() -> None:
    patches = _patches(200)
    lit = with_highlights(patches, 1.0, _generator())
    assert float(lit.max()) <= BRIGHTNESS[1]
    brightest = lit.amax((1, 2, 3))
    assert float((brightest > 1).float().mean()) > 0.9  # a highlight thinner than a pixel may stay below
    assert float((lit > 1).float().mean()) < 0.1
    # dimming is one factor for all of a patch: beside highlights, the median of the ratios is that factor
    ratio = (lit / patches.clamp_min(1e-3)).flatten(1)
    factor = ratio.median(1, keepdim=True).values
    assert bool((factor <= 1 + 1e-6).all())
    assert float(((ratio - factor).abs() < 1e-3).float().mean()) > 0.7


def test_a_share_of_the_patches_is_lit() -> None:
    dark = torch.full((400, 3, 8, 8), 0.5)
    lit = (with_highlights(dark, 0.3, _generator()) != dark).any(-1).any(-1).any(-1)
    assert abs(float(lit.float().mean()) - 0.3) < 4 * (0.3 * 0.7 / 400) ** 0.5


@pytest.mark.parametrize("edges", [False, True])
def test_a_sensor_that_saturates_sees_no_more_than_full_scale(optics: TrainingCamera, edges: bool) -> None:
    sharp = _patches()
    sharp[..., SIZE // 2, SIZE // 2] = 1000.0
    depths = torch.tensor([0.6, 0.7])
    scenes = Edges(sharp, draw_covers(2, SIZE, _generator()), depths) if edges else Planes(sharp, depths)
    free = scenes.photograph(optics)
    held = replace(scenes, saturates=True).photograph(optics)
    assert float(free.clean.max()) > 1
    torch.testing.assert_close(held.clean, free.clean.clamp_max(1), rtol=0, atol=0)
    for captured in (free, held):
        assert float(captured.ideal.max()) == 1


def _recipe(highlights: float, kind: str = "filter-bank") -> Loaded[TrainRecipe]:
    small = {"groups": 3, "distances": 2, "support": 9, "width": 4, "blocks": [1, 1]}
    recipe = TrainRecipe.model_validate(
        {
            "name": "highlights",
            "camera": "paper-clear",
            "mask": {"kind": "height-map"},
            "psf": {"window_px": WINDOW, "pupil_sampling_um": 21.0},
            "network": {"kind": kind, "settings": small if kind == "filter-bank" else {}},
            "data": {
                "patch_px": 2 * PATCH,
                "validation_patches": 2,
                "sources": [{"kind": "packaged", "saturated_highlights": highlights, "edges": 0.5}],
            },
            "optimiser": {"steps": 3, "batch": 2, "network_steps": 2},
        }
    )
    return Loaded(recipe, Path("highlights.toml"), "")


def test_a_training_with_highlights_repeats_itself(tmp_path: Path) -> None:
    first, second = (train(_recipe(0.5), tmp_path / name) for name in ("first", "second"))
    assert first.checkpoint.read_bytes() == second.checkpoint.read_bytes()
    other = train(_recipe(0.0), tmp_path / "third")
    assert other.checkpoint.read_bytes() != first.checkpoint.read_bytes()


class _Brighter(Restorer):
    """Restores every pixel to the photo times a factor."""

    def __init__(self, factor: float) -> None:
        super().__init__()
        self.factor = torch.nn.Parameter(torch.tensor(factor))

    def forward(self, photo: torch.Tensor) -> torch.Tensor:
        return photo * self.factor


def test_beyond_full_scale_more_is_not_wrong() -> None:
    """Where the truth is at full scale, a restoration beyond it is shown as the truth is."""
    setup = prepare(_recipe(0.0, "dcnn"), None, Workers(0, 1, torch.device("cpu")))
    system = setup.system
    white = Planes(torch.full((1, 3, SIZE, SIZE), 5.0), torch.tensor([1.0]))
    losses = []
    for factor in (1.0, 2.0):
        system.network = _Brighter(factor)
        outcome = system(Draw(white, torch.zeros(1), _generator()))
        outcome.loss.backward()
        assert float(system.network.factor.grad) == 0
        losses.append(float(outcome.loss.detach()))
    assert losses[0] == losses[1]
    grey = Planes(torch.full((1, 3, SIZE, SIZE), 0.5), torch.tensor([1.0]))
    system.network = _Brighter(2.5)
    assert float(system(Draw(grey, torch.zeros(1), _generator())).loss.detach()) > 0.5


def test_a_recipe_and_a_card_with_the_names_of_before_are_read(tmp_path: Path, caplog) -> None:
    """Recipes and checkpoints were written when the two keys were called `stray` and `lamps`."""
    path = tmp_path / "old.toml"
    path.write_text(
        'name = "old"\ncamera = "paper-clear"\n[loss]\nstray = 0.3\n'
        '[[data.sources]]\nkind = "packaged"\nlamps = 0.25\n',
        encoding="utf-8",
    )
    with caplog.at_level(logging.WARNING):
        recipe = load_train(path).recipe
    (source,) = recipe.data.sources
    assert recipe.loss.truncated_energy == 0.3 and source.saturated_highlights == 0.25
    assert any("old.toml: stray = 0.3 is now truncated_energy = 0.3" in line for line in caplog.messages)
    assert any("lamps = 0.25 is now saturated_highlights = 0.25" in line for line in caplog.messages)
    caplog.clear()
    bank = load_checkpoint("paper-dcnn").card["recipe"]
    assert "stray" in bank["loss"] and not caplog.messages
    today = TrainRecipe.model_validate(bank)
    assert today.loss.truncated_energy == bank["loss"]["stray"]


def test_a_training_saved_with_the_names_of_before_goes_on(tmp_path: Path) -> None:
    recipe = _recipe(0.5)
    train(recipe, tmp_path)
    path = tmp_path / "state.safetensors"
    arrays, metadata = load_arrays(path, "training state")
    about = json.loads(metadata["state"])
    (source,) = about["recipe"]["data"]["sources"]
    about["recipe"]["loss"]["stray"] = about["recipe"]["loss"].pop("truncated_energy")
    source["lamps"] = source.pop("saturated_highlights")
    save_arrays(path, arrays, {"state": json.dumps(about)})
    assert train(recipe, tmp_path, resume=True).figures["steps"] == 3
    source["lamps"] = 0.25
    save_arrays(path, arrays, {"state": json.dumps(about)})
    with pytest.raises(InputError, match=r"saved with another \[data\]"):
        train(recipe, tmp_path, resume=True)
