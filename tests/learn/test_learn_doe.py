"""Masks that learn stay makeable and pass gradients; fixed points are the recipes' own masks."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from edofsim.errors import InputError
from edofsim.learn.doe import FreeHeight, maps_of, metres_per_radian
from edofsim.learn.setup import build_mask
from edofsim.optics import Camera, psf_bank
from edofsim.optics.masks.coded import CodedMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.masks.fourier import FourierMask
from edofsim.optics.masks.height_map import HeightMapMask
from edofsim.optics.masks.rings import RingsMask
from edofsim.optics.masks.zernike import ZernikeMask
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.recipe.train import DoeTable, TrainRecipe
from edofsim.restore.checkpoint import save_checkpoint
from edofsim.restore.network import build_network

GREEN = torch.tensor([543e-9], dtype=torch.float64)


def _build(mask: object, learn: bool = True):
    recipe = TrainRecipe(name="t", camera="paper", doe=DoeTable(learn=learn))
    return build_mask(recipe, CameraRecipe(name="c", mask=mask), Path())


def test_one_radian_of_height_is_one_radian_of_phase() -> None:
    """Eq. `dtophi`: 2 pi / lambda (n - 1) d."""
    height = metres_per_radian(1.6, 600e-9)
    assert 2 * math.pi / 600e-9 * (1.6 - 1) * height == pytest.approx(1)


def test_a_free_height_starts_where_it_is_told_and_stays_makeable() -> None:
    start = torch.linspace(0.05e-6, 1.1e-6, 25).reshape(5, 5)
    mask = FreeHeight(start, 1.2e-6, 1.4e-7)
    assert torch.allclose(mask(), start, atol=1e-12)
    with torch.no_grad():
        mask.phase += 1e3 * torch.randn(5, 5, generator=torch.Generator().manual_seed(1))
    assert mask().min() >= 0 and mask().max() <= 1.2e-6


def test_a_free_height_moves_by_a_radian_a_radian() -> None:
    mask = FreeHeight(torch.full((3, 3), 0.6e-6), 1.2e-6, 1.4e-7)
    mask().sum().backward()
    assert torch.allclose(mask.phase.grad, torch.full((3, 3), 1.4e-7), rtol=1e-5)


def test_the_paper_mask_has_239_samples() -> None:
    mask, sampling, camera = _build(HeightMapMask())
    assert mask().shape == (239, 239)
    assert sampling == pytest.approx(21e-6)
    assert isinstance(camera.mask, HeightMapMask)


@pytest.mark.parametrize("learn", [True, False])
@pytest.mark.parametrize(
    "mask", [CubicMask(alpha_rad=12.0), ZernikeMask(), FourierMask(), RingsMask()], ids=lambda mask: mask.kind
)
def test_a_mask_turned_into_a_height_map_has_the_psf_of_its_recipe(mask: object, learn: bool) -> None:
    """The optics' own route from the recipe is the reference, on the same 21 um grid. Smooth masks are the
    same to rounding. Exact rings have edges inside the samples, and the optics know what those scatter; a
    height map has its edges between samples, which moves some percent of the light."""
    psf = PsfSettings(window_px=32, pupil_sampling_um=21.0)
    camera = CameraRecipe(name="c", mask=mask, psf=psf)
    learner, _, height_map = _build(mask, learn)
    with torch.no_grad():
        height = maps_of(learner).height
    height_map = Camera.from_recipe(height_map.model_copy(update={"psf": psf}))
    found = psf_bank(height_map.with_height(height), GREEN, [1.0]).values
    wanted = psf_bank(Camera.from_recipe(camera), GREEN, [1.0]).values
    tolerance = 0.1 if isinstance(mask, RingsMask) else 1e-5
    assert (found - wanted).abs().sum() < tolerance * wanted.sum()


@pytest.mark.parametrize(
    "mask", [ZernikeMask(), FourierMask(), RingsMask(), HeightMapMask()], ids=lambda m: m.kind
)
def test_gradients_reach_every_value_of_the_mask(mask: object) -> None:
    learner, _, height_map = _build(mask)
    bank = psf_bank(Camera.from_recipe(height_map).with_height(learner()), GREEN, [0.4], window_px=32)
    weights = torch.rand(bank.values.shape, generator=torch.Generator().manual_seed(2))
    (bank.values * weights).sum().backward()
    for name, value in learner.named_parameters():
        assert torch.isfinite(value.grad).all(), name
        # samples in the corners of the square lie outside the pupil
        assert (value.grad != 0).double().mean() > 0.75, name


def test_a_mask_without_relief_has_no_height() -> None:
    mask, sampling, camera = _build(CodedMask())
    assert mask() is None and sampling is None
    assert isinstance(camera.mask, CodedMask)


def _checkpoint(path: Path, height: torch.Tensor) -> str:
    """A network with a mask of the default camera."""
    card = {"name": "before", "camera": CameraRecipe(name="c").model_dump(mode="json", exclude={"schema_"})}
    network = build_network("local-unet", {"width": 4, "blocks": [1, 1]})
    return str(save_checkpoint(path / "before.safetensors", network, card, height=height, sampling=21e-6))


def _started(mask: object, doe: DoeTable) -> torch.Tensor | None:
    recipe = TrainRecipe(name="t", camera="paper", doe=doe)
    return maps_of(build_mask(recipe, CameraRecipe(name="c", mask=mask), Path())[0]).height


def test_the_mask_of_a_checkpoint_is_kept_or_refused(tmp_path: Path) -> None:
    """Never pressed into what a recipe allows: 1.6 um deep rings would be another mask in 1.2 um."""
    ramp = torch.linspace(0, 1.6e-6, 239 * 239).reshape(239, 239)
    start = _checkpoint(tmp_path, ramp)
    for mask in (RingsMask(), HeightMapMask()):
        assert torch.equal(_started(mask, DoeTable(start=start, learn=False)), ramp)
    with pytest.raises(InputError, match=r"is 1\.6 um deep; set doe\.height_limit_um, which is 1\.2, to as"):
        _started(HeightMapMask(), DoeTable(start=start))
    found = _started(HeightMapMask(), DoeTable(start=start, height_limit_um=1.6)).detach().numpy()
    assert found == pytest.approx(ramp.numpy(), abs=0.021 * 1.6e-6)  # just inside the limits
    for mask in (RingsMask(), ZernikeMask(), FourierMask()):
        with pytest.raises(InputError, match=f"kind '{mask.kind}' learns by values of its own"):
            _started(mask, DoeTable(start=start, height_limit_um=1.6))
