"""Trainings for a lens whose PSFs vary over the frame: each patch is photographed from its own place."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.crop import crop
from edofsim.errors import InputError
from edofsim.learn import setup as of_setup
from edofsim.learn.edges import Edges
from edofsim.learn.setup import prepare
from edofsim.learn.sources import Images, central_patches, draw_patches
from edofsim.learn.system import Planes
from edofsim.learn.trainer import draw_batch, train
from edofsim.learn.training_camera import TrainingCamera
from edofsim.learn.views import ViewParts, Views
from edofsim.learn.workers import Workers
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.optics.field import relative_light
from edofsim.recipe import CameraRecipe
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe
from edofsim.render.view import View
from edofsim.restore.checkpoint import load_checkpoint

sys.path.insert(0, str(Path(__file__).parents[1] / "example_package"))
from edofsim_example.off_axis_lens import OffAxisLens

WINDOW, PATCH = 16, 24
WORKERS = Workers(0, 1, torch.device("cpu"))
PLACES = torch.tensor([[300.0, -500.0], [0.0, 0.0], [-700.0, 40.0]])
DEPTHS = torch.tensor([0.5, 0.8, 1.1])


def _recipe() -> CameraRecipe:
    lens = {"kind": "ideal", "focal_length_mm": 25, "f_number": 5}
    values = {
        "name": "off-axis",
        "lens": lens,
        "mask": {"kind": "height-map"},
        "focus": {"distance_m": 1.0, "wavelength_nm": 550},
        "sensor": {"pixel_um": 6, "response": "lines", "exposure": 1.0, "read_noise": 0.0},
        "psf": {"window_px": WINDOW},
    }
    varying = OffAxisLens(**{**lens, "kind": "off-axis"}, coma=12.0, shadow=3.0)
    return CameraRecipe.model_validate(values).model_copy(update={"lens": varying})


@pytest.fixture(scope="module")
def optics() -> TrainingCamera:
    recipe = _recipe().model_copy(update={"mask": CameraRecipe(name="clear").mask})
    return TrainingCamera(Camera.from_recipe(recipe), WINDOW, torch.device("cpu"))


def _sharp(count: int = 3, size: int = PATCH + WINDOW - 1) -> Tensor:
    return torch.rand(count, 3, size, size, generator=torch.Generator().manual_seed(3))


def test_each_patch_is_photographed_from_its_place(optics: TrainingCamera) -> None:
    """Written out: a convolution by the PSF of its place, with the glare, by the light of the axis."""
    sharp = _sharp()
    found = Planes(sharp, DEPTHS, places=PLACES).photograph(optics)
    angle = optics.camera.pixel_angle
    for one, depth, (right, up), clean in zip(sharp, DEPTHS, PLACES.tolist(), found.clean, strict=True):
        there = optics.camera.at_field((right * angle, up * angle))
        psf = psf_bank(there, PAPER_COLOURS, [float(depth)]).values[0]
        direct = torch.nn.functional.conv2d(one[None], psf.flip(-2, -1)[:, None], groups=3)[0]
        glare = (1 - psf.sum((1, 2))) * one.mean((1, 2))
        assert torch.allclose(clean, direct + glare[:, None, None], atol=1e-5)
    lights = [relative_light(optics.camera.at_field((r * angle, u * angle))) for r, u in PLACES.tolist()]
    assert found.light is not None and found.light.tolist() == pytest.approx(lights)
    assert lights[0] < 0.9 and lights[1] == 1
    assert found.psf is None  # no other patch may have it


def test_what_saturates_is_full_scale_by_the_light_of_its_place(optics: TrainingCamera) -> None:
    found = Planes(3 + _sharp(), DEPTHS, places=PLACES, saturates=True).photograph(optics)
    assert found.light is not None
    sensor = found.clean * found.light[:, None, None, None]
    assert torch.allclose(sensor, torch.ones_like(sensor), atol=1e-6)


def test_both_sides_of_an_edge_are_at_its_place(optics: TrainingCamera) -> None:
    sharp = _sharp()
    for cover, shown in ((1.0, [2, 1, 2]), (0.0, [0, 0, 1])):
        whole = torch.full((3, 1, *sharp.shape[-2:]), cover)
        found = Edges(sharp, whole, DEPTHS, places=PLACES).photograph(optics)
        plane = Planes(sharp[shown], DEPTHS[shown], places=PLACES).photograph(optics)
        assert torch.allclose(found.clean, plane.clean, atol=1e-5)


def test_places_are_those_of_patches_in_their_pictures() -> None:
    """Pictures whose colours say where: red grows to the right, green upwards, with the turned picture."""
    rows, columns, patch = 60, 100, 8
    right = (torch.arange(columns) + 0.5 - columns / 2).expand(rows, columns)
    up = -(torch.arange(rows) + 0.5 - rows / 2)[:, None].expand(rows, columns)
    values = (torch.stack([right, up, torch.zeros(rows, columns)]) + 99.5).to(torch.uint8)
    images = Images((values,), ("a",), "")
    patches, _, places = draw_patches(images, 40, patch, (0, 0), torch.Generator().manual_seed(4))
    seen = patches[:, :2].mean((2, 3)) * 255 - 99.5  # of the picture before it was turned
    across, down = patches.diff(dim=3).mean((2, 3)) * 255, patches.diff(dim=2).mean((2, 3)) * 255
    for (x, y), place, (rx, gx, _), (ry, gy, _) in zip(seen, places, across, down, strict=True):
        # how the colours grow to the right and downwards says how the picture was turned
        turned = torch.stack([x * rx + y * gx, -(x * ry + y * gy)])
        assert torch.allclose(turned, place, atol=0.6)
    _, _, kept = central_patches(images, 3, patch, (0, 0))
    assert kept.tolist() == [[0, 0], [23, 13], [46, 26]]


def test_a_part_of_a_view_is_seen_from_its_place(optics: TrainingCamera) -> None:
    light = torch.rand(3, 40 + 32, 48 + 32, generator=torch.Generator().manual_seed(6))
    how = {"wavelengths": PAPER_COLOURS, "pixel_angle": optics.camera.pixel_angle, "margin": 16}
    view = replace(View.flat(light, 0.7, **how, metadata={"hidden": "none"}), axis=(-400.0, 900.0))
    part = crop(view, 8, 12, PATCH, PATCH, 8)
    table = Views(scenes=("desk",), layers=2)
    found = ViewParts((part,), torch.ones(1, 3), table).photograph(optics)
    # the whole, photographed with places close to each other, which are as bright as they are
    whole = capture(view, optics.camera, Fidelity(layers=2, field_step_px=16)).clean[:, 8:32, 12:36]
    assert found.light is not None and float(found.light) < 0.95
    error = float((found.clean[0].double() * found.light - whole).square().mean().sqrt())
    on_axis = ViewParts((replace(part, axis=None),), torch.ones(1, 3), table).photograph(optics)
    assert error < 0.01 < 0.05 < float((on_axis.clean[0] - whole).square().mean().sqrt())


def _training(monkeypatch: pytest.MonkeyPatch, **tables: object) -> Loaded[TrainRecipe]:
    values: dict[str, object] = {
        "name": "varying",
        "camera": "paper-clear",
        "seed": 1,
        "network": {"kind": "local-unet", "settings": {"width": 4}},
        "data": {"patch_px": 48, "validation_patches": 2, "sources": [{"kind": "packaged", "edges": 0.5}]},
        "optimiser": {"steps": 2, "batch": 2, "network_steps": 2},
    }
    monkeypatch.setattr(of_setup, "_camera", lambda recipe, base: (_recipe(), base))
    return Loaded(TrainRecipe.model_validate({**values, **tables}), Path("varying.toml"), "")


def test_two_steps_of_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gradients reach the mask, all is finite, and the checkpoint can be read."""
    loaded = _training(monkeypatch)
    setup = prepare(loaded, None, WORKERS)
    outcome = setup.system(draw_batch(setup, 0, WORKERS))
    outcome.loss.backward()
    (height,) = setup.system.mask.parameters()
    assert height.grad is not None and float(height.grad.abs().sum()) > 0
    found = train(loaded, tmp_path)
    assert found.figures["steps"] == 2 and found.figures["psnr_db.validation"] > 5
    card = load_checkpoint(found.checkpoint).card
    assert card["camera"]["lens"]["kind"] == "off-axis"


ONCE = {"sources": [{"kind": "views", "scenes": ["desk"], "once": True}]}


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"network": {"kind": "filter-bank"}}, "conditioned on one set of PSFs.*local-unet"),
        ({"doe": {"design_steps": 3}}, "design_steps.*leave them out"),
        ({"data": ONCE, "doe": {"learn": False}}, "once = true.*leave it out"),
    ],
)
def test_what_asks_for_one_set_of_psfs_is_refused(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        prepare(_training(monkeypatch, **tables), None, WORKERS)
