"""Patches in other light: what is drawn, nothing where nothing varies, and what training makes of it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import torch

from edofsim.learn import train
from edofsim.learn.doe import maps_of
from edofsim.learn.setup import prepare
from edofsim.learn.system import Draw, Planes
from edofsim.learn.variation import Variation, evenly, varied
from edofsim.learn.workers import Workers
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe
from edofsim.restore.restorer import Restorer

PATCH, WINDOW = 32, 16
COUNT = 400


def _generator(seed: int = 1) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _patches(count: int = COUNT) -> tuple[torch.Tensor, torch.Tensor]:
    sharp = torch.rand(count, 3, 6, 6, generator=_generator(2))
    return sharp, sharp.mean((-1, -2))


def test_exposures_are_even_in_their_logarithm_and_means_follow() -> None:
    sharp, means = _patches()
    dim, dim_means = varied(sharp, means, Variation(exposure=(0.02, 2.0)), _generator())
    torch.testing.assert_close(dim_means, dim.mean((-1, -2)))
    factors = (dim / sharp).flatten(1)
    assert (factors.amax(1) / factors.amin(1)).max() < 1 + 1e-4
    place = (factors[:, 0].log() - math.log(0.02)) / math.log(100)
    assert place.min() >= 0 and place.max() <= 1
    assert abs(float(place.mean()) - 0.5) < 4 * (1 / 12 / COUNT) ** 0.5  # of an even distribution
    ordered, _ = evenly(sharp, means, Variation(exposure=(0.02, 2.0), white_balance=0.5))
    spread = (ordered / sharp)[:, :, 0, 0].log()
    torch.testing.assert_close(
        spread.diff(dim=0), torch.full((COUNT - 1, 3), math.log(100) / COUNT), atol=1e-4, rtol=0
    )


def test_white_balance_changes_each_colour_by_itself() -> None:
    sharp, means = _patches()
    other, other_means = varied(sharp, means, Variation(white_balance=0.3), _generator())
    factors = (other / sharp)[..., 0, 0]
    assert factors.max() <= math.exp(0.3) and factors.min() >= math.exp(-0.3)
    assert torch.corrcoef(factors.T).triu(1).abs().max() < 4 / COUNT**0.5
    torch.testing.assert_close(other_means, other.mean((-1, -2)))


def test_colours_go_to_grey_and_beyond() -> None:
    sharp, means = _patches()
    grey, _ = varied(sharp, means, Variation(colourfulness=(0.0, 0.0)), _generator())
    torch.testing.assert_close(grey, sharp.mean(1, keepdim=True).expand_as(sharp))
    gaudy, _ = varied(sharp, means, Variation(colourfulness=(2.0, 2.0)), _generator())
    assert gaudy.min() == 0  # no colour is darker than black
    assert gaudy.std(1).mean() > 1.5 * sharp.std(1).mean()


def test_nothing_varies_unless_it_is_asked_for() -> None:
    assert not Variation().changes and Variation(white_balance=0.1).changes
    sharp, means = _patches()
    torch.testing.assert_close(varied(sharp, means, Variation(), _generator())[0], sharp)


def _recipe(
    vary: dict[str, Any] | None = None,
    kind: str = "dcnn",
    kept: bool = False,
    network: dict[str, Any] | None = None,
    steps: int = 3,
) -> Loaded[TrainRecipe]:
    small = {"groups": 2, "distances": 1, "support": 5, "width": 4, "blocks": [1]}
    recipe = TrainRecipe.model_validate(
        {
            "name": "small",
            "camera": "paper-clear",
            "mask": {"kind": "height-map"},
            "psf": {"window_px": WINDOW, "pupil_sampling_um": 21.0},
            "network": {"kind": kind, "settings": small if kind == "filter-bank" else {}, **(network or {})},
            "loss": {"light_kept": kept},
            "data": {
                "patch_px": PATCH,
                "validation_patches": 2,
                "sources": [{"kind": "packaged", "vary": vary or {}}],
            },
            "optimiser": {"steps": steps, "batch": 2, "precision": "float32"},
        }
    )
    return Loaded(recipe, Path("small.toml"), "")


@pytest.mark.parametrize("kind", ["dcnn", "filter-bank"])
def test_a_training_on_any_exposure_with_the_light_kept_repeats_itself(kind: str, tmp_path: Path) -> None:
    vary = {"exposure": [0.02, 2.0], "white_balance": 0.3, "colourfulness": [0.0, 1.6]}
    first, second = (train(_recipe(vary, kind, kept=True), tmp_path / name) for name in ("first", "second"))
    assert first.checkpoint.read_bytes() == second.checkpoint.read_bytes()
    assert math.isfinite(first.figures["validation_loss"])


def test_a_wrong_level_is_not_judged_where_the_light_is_kept() -> None:
    """A network that is right but for a level costs next to nothing, and else as much as the level."""
    losses = {}
    for kept in (False, True):
        setup = prepare(_recipe(kept=kept), None, Workers(0, 1, torch.device("cpu")))
        size = PATCH + WINDOW - 1
        flat = Planes(torch.full((1, 3, size, size), 0.5), torch.tensor([1.0]))
        setup.system.network = _Darker()
        draw = Draw(flat, torch.zeros(1), _generator())
        loss = (
            setup.system(draw).loss
            - setup.system.truncated_energy * setup.system.capture(draw, maps_of(setup.system.mask)).truncated
        )
        losses[kept] = float(loss.detach())
    assert losses[False] == pytest.approx(0.02, rel=0.05)
    assert losses[True] < 1e-4


class _Darker(Restorer):
    """Restores every pixel to the photo less a level."""

    def forward(self, photo: torch.Tensor) -> torch.Tensor:
        return photo - 0.02
