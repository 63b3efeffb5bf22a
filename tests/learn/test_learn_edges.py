"""One photograph in front of another: what each patch shows, and where its edge is."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from edofsim.capture.planes import surroundings
from edofsim.learn.edges import Edges, draw_covers
from edofsim.learn.sources import draw_patches, packaged_images
from edofsim.learn.system import Planes
from edofsim.learn.trainer import train
from edofsim.learn.training_camera import TrainingCamera
from edofsim.learn.training_data import gather
from edofsim.optics import Camera
from edofsim.recipe.load import Loaded, load_camera
from edofsim.recipe.train import TrainRecipe

WINDOW, PATCH = 32, 40
DEPTHS = torch.tensor([0.5, 0.7, 1.1])
NEAR, FAR = [2, 1, 2], [0, 0, 1]  # by hand: each in front of the one before, the last in front of the first


@pytest.fixture(scope="module")
def optics() -> TrainingCamera:
    recipe = load_camera("paper-clear").recipe
    settings = recipe.psf.model_copy(update={"pupil_sampling_um": 21.0})
    return TrainingCamera(
        Camera.from_recipe(recipe.model_copy(update={"psf": settings})), WINDOW, torch.device("cpu")
    )


def _patches() -> torch.Tensor:
    images = packaged_images(PATCH)
    return draw_patches(images, 3, PATCH, surroundings(WINDOW), torch.Generator().manual_seed(5))[0]


@pytest.mark.parametrize(("cover", "shown"), [(1.0, NEAR), (0.0, FAR)])
def test_where_one_covers_all_there_is_only_that(
    optics: TrainingCamera, cover: float, shown: list[int]
) -> None:
    sharp = _patches()
    whole = torch.full((3, 1, *sharp.shape[-2:]), cover)
    found = Edges(sharp, whole, DEPTHS).photograph(optics)
    plane = Planes(sharp[shown], DEPTHS[shown]).photograph(optics)
    assert torch.allclose(found.clean, plane.clean, atol=1e-5)
    assert torch.equal(found.ideal, plane.ideal)


def test_a_grey_world_has_no_edges(optics: TrainingCamera) -> None:
    """Both pictures the same grey: whatever covers what, the photo is that grey, and no seam shows."""
    sharp = torch.full_like(_patches(), 0.4)
    covers = draw_covers(3, sharp.shape[-1], torch.Generator().manual_seed(6))
    found = Edges(sharp, covers, DEPTHS).photograph(optics)
    assert torch.allclose(found.clean, torch.full_like(found.clean, 0.4), atol=1e-5)
    assert torch.allclose(found.ideal, torch.full_like(found.ideal, 0.4), atol=1e-6)


def test_far_from_the_edge_it_is_a_plane(optics: TrainingCamera) -> None:
    """A straight edge: on either side of it, farther than half a window, one picture alone."""
    sharp = _patches()
    size = sharp.shape[-1]
    before, _ = surroundings(WINDOW)
    cover = (torch.arange(size) < before + PATCH // 2).float().expand(3, 1, size, size)
    found = Edges(sharp, cover, DEPTHS).photograph(optics).clean
    near, far = (Planes(sharp[i], DEPTHS[i]).photograph(optics).clean for i in (NEAR, FAR))
    # the glare of a cut picture has another mean: a part in a hundred of the light leaves so small a window
    side = PATCH // 2 - WINDOW // 2
    assert torch.allclose(found[..., :side], near[..., :side], atol=0.02)
    assert torch.allclose(found[..., -side:], far[..., -side:], atol=0.02)
    assert not torch.allclose(found[..., :side], far[..., :side], atol=0.1)


def test_covers_have_borders_of_a_pixel() -> None:
    covers = draw_covers(64, 128, torch.Generator().manual_seed(7))
    assert covers.shape == (64, 1, 128, 128) and covers.min() == 0 and covers.max() == 1
    assert 0.4 < covers.mean() < 0.6
    between = ((covers > 0) & (covers < 1)).double().mean()
    crossings = ((covers[..., 1:] > 0.5) != (covers[..., :-1] > 0.5)).double().mean()
    assert crossings > 0 and between < 4 * crossings


def _recipe(edges: float) -> Loaded[TrainRecipe]:
    recipe = TrainRecipe.model_validate(
        {
            "name": "edges",
            "camera": "paper-clear",
            "mask": {"kind": "height-map"},
            "psf": {"window_px": WINDOW, "pupil_sampling_um": 21.0},
            "data": {
                "patch_px": PATCH,
                "validation_patches": 2,
                "sources": [{"kind": "packaged", "edges": edges}],
            },
            "optimiser": {"steps": 3, "batch": 2, "network_steps": 2},
        }
    )
    return Loaded(recipe, Path("edges.toml"), "")


def test_the_share_of_edges_is_that_of_the_recipe(optics: TrainingCamera) -> None:
    training_data = gather(_recipe(0.3).recipe, optics, Path(), None)
    generator = torch.Generator().manual_seed(8)
    drawn = [training_data.draw(2, generator) for _ in range(300)]
    share = sum(isinstance(scenes, Edges) for scenes in drawn) / 300
    assert abs(share - 0.3) < 4 * (0.3 * 0.7 / 300) ** 0.5
    assert all((scenes.inverse_depths.diff() >= 0).all() for scenes in drawn)


def test_a_training_with_edges_repeats_itself(tmp_path: Path) -> None:
    first, second = (train(_recipe(0.5), tmp_path / name) for name in ("first", "second"))
    assert first.checkpoint.read_bytes() == second.checkpoint.read_bytes()
