"""Several views in one photo: they share their PSFs, and gradients go through all that stands between."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import Tensor

import edofsim
from edofsim.optics import field
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.render.view import View

SIDE = 13


def camera() -> edofsim.Camera:
    sensor = {"read_noise": 0.01, "saturation": True}
    psf = PsfSettings(window_px=9, oversampling=1)
    table = {"name": "tiny", "psf": psf, "sensor": sensor}
    return edofsim.Camera.from_recipe(CameraRecipe.model_validate(table))


def two_sheets(seed: int, edge: int, optics: edofsim.Camera) -> View:
    """A near sheet from column 0 to `edge`, and all of a far one behind it, whose covered part is hidden."""
    generator = torch.Generator().manual_seed(seed)
    light = 0.2 + torch.rand(2, 2, SIDE, SIDE, dtype=torch.float64, generator=generator)
    inside = torch.arange(SIDE * SIDE).reshape(SIDE, SIDE) % SIDE < edge
    pixel = torch.cat([inside.flatten().nonzero().flatten(), torch.arange(SIDE * SIDE)])
    near = torch.arange(len(pixel)) < int(inside.sum())
    order = torch.argsort(2 * pixel + ~near)
    radiance = torch.cat([light[0][:, inside], light[1].flatten(1)], 1)
    return View(
        height=SIDE - 8,
        width=SIDE - 8,
        margin=4,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel), dtype=torch.float64),
        inverse_depth=torch.where(near, 1.0, 0.5).double()[order],
        radiance=radiance[:, order],
        hidden=(~near & inside.flatten()[pixel])[order],
        wavelengths=torch.tensor([480e-9, 620e-9], dtype=torch.float64),
        pixel_angle=optics.pixel_angle,
    )


SEEN = edofsim.Fidelity(occlusion="hidden", sub_apertures=1)


def test_gradients_of_a_batch_are_those_of_differences() -> None:
    """Of light and height map together, through occlusion, noise and saturation, in float64: the derivative
    along a random direction against central differences, and each view's alone."""
    optics = camera()
    views = [two_sheets(1, 6, optics), two_sheets(2, 8, optics)]
    generator = torch.Generator().manual_seed(4)
    height = torch.rand(6, 6, dtype=torch.float64, generator=generator) * 3e-7
    lights = [view.radiance for view in views]
    weights = torch.randn(2, 3, SIDE - 8, SIDE - 8, dtype=torch.float64, generator=generator)

    def total(height: Tensor, lights: list[Tensor]) -> Tensor:
        lit = [view.with_light(light) for view, light in zip(views, lights, strict=True)]
        how = {"exposure": 0.8, "seed": 5, "dtype": torch.float64}
        return (weights * edofsim.photograph(lit, optics.with_height(height), SEEN, **how).image).sum()

    given = [height, *lights]
    steps = [torch.randn(each.shape, dtype=torch.float64, generator=generator) for each in given]
    steps = [step * scale for step, scale in zip(steps, (1e-7, 1.0, 1.0), strict=True)]
    asked = [each.clone().requires_grad_() for each in given]
    slopes = torch.autograd.grad(total(asked[0], asked[1:]), asked)
    assert all(bool(slope.abs().max() > 0) for slope in slopes)
    for which in range(3):
        ends = []
        for sign in (1e-4, -1e-4):
            moved = [
                each + sign * step * (k == which)
                for k, (each, step) in enumerate(zip(given, steps, strict=True))
            ]
            ends.append(total(moved[0], moved[1:]))
        expected = float(ends[0] - ends[1]) / 2e-4
        assert float((slopes[which] * steps[which]).sum()) == pytest.approx(expected, rel=1e-5)


def test_a_batch_is_its_photos_one_by_one_with_psfs_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    optics = camera()
    views = [two_sheets(1, 6, optics), two_sheets(2, 8, optics)]
    height = torch.full((6, 6), 1e-7, dtype=torch.float64, requires_grad=True)
    asked: list[int] = []
    real = field.psf_bank

    def counted(*arguments: object, **more: object) -> object:
        asked.append(1)
        return real(*arguments, **more)

    monkeypatch.setattr(field, "psf_bank", counted)
    how = {"exposure": 1.0, "dtype": torch.float64}
    both = edofsim.photograph(views, optics.with_height(height), SEEN, seed=3, **how)
    assert len(asked) == 1 and both.image.shape == (2, 3, SIDE - 8, SIDE - 8)
    for k, view in enumerate(views):
        alone = edofsim.photograph(view, optics.with_height(height), SEEN, seed=3 + k, **how)
        assert torch.allclose(both.image[k], alone.image, atol=1e-12)
    assert len(asked) == 3
    full = edofsim.photograph(views, optics, exposure=1.0)
    assert full.how.occlusion == "hidden"


def test_what_is_no_batch_is_refused() -> None:
    optics = camera()
    view = two_sheets(1, 6, optics)
    with pytest.raises(edofsim.InputError, match="a View, or a list of them"):
        edofsim.photograph([view, 3], optics)
    with pytest.raises(edofsim.InputError, match="a plan is for one view"):
        edofsim.photograph([view, view], optics, accuracy="40dB")


def test_scores_are_those_of_another_library() -> None:
    """scikit-image's PSNR and SSIM; by depth, the PSNR of the pixels in each range."""
    optics = camera()
    photo = edofsim.photograph(_flat(optics), optics, SEEN, exposure=1.0)
    whole = edofsim.score(photo, photo)
    image, ideal = (each.clamp(0, 1).double().numpy() for each in (photo.image, photo.ideal))
    assert whole.psnr_db == pytest.approx(peak_signal_noise_ratio(ideal, image, data_range=1), abs=1e-6)
    how = {"data_range": 1, "channel_axis": 0, "gaussian_weights": True, "use_sample_covariance": False}
    _, each = structural_similarity(ideal, image, full=True, **how)
    assert whole.ssim == pytest.approx(float(each.mean()), abs=2e-3)
    parts = edofsim.score(photo.image, photo, by_depth=(0.5, 1.5, 3.0))
    assert [(part.near_m, part.far_m) for part in parts] == [(0.5, 1.5), (1.5, 3.0)]
    near = photo.inverse_depth.numpy() > 1 / 1.5
    error = np.square(image - ideal).mean(0)
    assert parts[0].score.psnr_db == pytest.approx(-10 * np.log10(error[near].mean()), abs=1e-6)
    assert len(edofsim.score(photo, photo, by_depth=True)) == 2
    with pytest.raises(edofsim.InputError, match="cannot be compared"):
        edofsim.score(photo.image[:, 1:], photo)


def _flat(optics: edofsim.Camera) -> View:
    light = torch.rand(2, 40, 48, generator=torch.Generator().manual_seed(1))
    inverse = torch.where(torch.arange(48) < 20, 1.0, 0.5).expand(40, 48)
    return View.flat(
        light,
        inverse,
        wavelengths=[480e-9, 620e-9],
        pixel_angle=optics.pixel_angle,
        margin=4,
        metadata={"hidden": "none"},
    )
