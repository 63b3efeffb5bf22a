"""Sheets of bars, rings and letters as training data."""

from __future__ import annotations

from pathlib import Path

import torch

from edofsim.learn.drawn import drawn
from edofsim.learn.reader import Wanted
from edofsim.learn.training_camera import TrainingCamera
from edofsim.optics import Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.kinds import TRAINING_DATA
from edofsim.recipe.train import TrainRecipe


def test_a_seed_draws_the_same_sheets_and_another_other_ones() -> None:
    first, again, other = drawn(3, 1, 64), drawn(3, 1, 64), drawn(3, 2, 64)
    assert [p.tolist() for p in first.pictures] == [p.tolist() for p in again.pictures]
    assert first.sha256 == again.sha256 != other.sha256
    assert all(picture.shape == (3, 64, 64) and picture.dtype == torch.uint8 for picture in first.pictures)
    assert drawn(2, 1, 64).pictures[1].equal(first.pictures[1])  # however many there are


def test_sheets_hold_sharp_edges_of_full_contrast_that_photographs_lack() -> None:
    from skimage import data

    def sharp(pictures: list[torch.Tensor]) -> float:
        """Share of neighbours that differ by more than half of full scale."""
        steps = [(p[:, :, 1:].float() - p[:, :, :-1].float()).abs() > 127 for p in pictures]
        return float(torch.cat([step.flatten() for step in steps]).float().mean())

    photographs = [torch.from_numpy(getattr(data, name)()).permute(2, 0, 1) for name in ("coffee", "chelsea")]
    sheets = list(drawn(8, 5).pictures)
    assert sharp(sheets) > 10 * sharp(photographs)
    grey = [bool((p[0] == p[1]).all() and (p[1] == p[2]).all()) for p in drawn(24, 5, 96).pictures]
    assert 6 <= sum(grey) <= 18
    finest = [p for p in sheets if p.min() == 0 or p.max() == 255]
    assert len(finest) >= 2  # black or white ink


def test_a_recipe_trains_on_them_and_holds_others_back() -> None:
    sources = [{"kind": "drawn", "sheets": 5}]
    data = {"patch_px": 16, "validation": 0.2, "sources": sources}
    recipe = TrainRecipe(name="r", camera="paper-clear", seed=3, data=data)
    camera = Camera.from_recipe(CameraRecipe(name="c", mask={"kind": "height-map"}, psf={"window_px": 16}))
    table = TRAINING_DATA["drawn"].model_validate(sources[0])
    source = table.open(Wanted(recipe, TrainingCamera(camera, 16, torch.device("cpu")), Path(), None))
    sheets = drawn(5, 3).pictures
    assert [len(images.pictures) for images in (source.training, source.held_back)] == [4, 1]
    known = [*source.training.pictures, *source.held_back.pictures]
    assert all(any(sheet.equal(other) for other in known) for sheet in sheets)
    scenes = source.draw(2, torch.Generator().manual_seed(1))
    assert scenes.sharp.shape == (2, 3, 31, 31)
