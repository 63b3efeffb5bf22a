"""A hard case: Wiener deconvolution of an unknown depth does not depend on how many depths it looks at."""

from __future__ import annotations

import sys

import pytest
import torch
from skimage import data
from torch import Tensor

from edofsim.experiments.protocols import of_three_lines
from edofsim.optics import PAPER_COLOURS, Camera, focus_distance, psf_bank
from edofsim.optics.nodes import nodes_between
from edofsim.recipe import CameraRecipe, load_camera
from edofsim.restore import channel_psfs, restore
from edofsim.restore.scores import psnr, within_scale

FIXED = 9
"""Depths of the mutant: evenly spaced, whatever the camera."""
STRIPS = 6
WITHIN_DB = 0.1


def ideal(focal_mm: float, f_number: float, pixel_um: float, focus_m: float, window: int = 128) -> Camera:
    recipe = {
        "name": "ideal",
        "lens": {"kind": "ideal", "focal_length_mm": focal_mm, "f_number": f_number},
        "focus": {"distance_m": focus_m},
        "sensor": {"pixel_um": pixel_um, "response": "lines"},
        "psf": {"window_px": window},
    }
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


def shipped(name: str) -> Camera:
    found = load_camera(name)
    return of_three_lines(Camera.from_recipe(found.recipe, found.base))


SHIPPED = ("paper-clear", "paper-cubic", "paper-device", "paper-learned", "paper-levin", "paper-rings")
# camera, nearest inverse depth in 1/m: so that the windows hold most of the light
CAMERAS = {name: (lambda name=name: shipped(name), 2.0) for name in SHIPPED}
CAMERAS |= {
    "35 mm f/4": (lambda: ideal(35, 4, 3.45, 1.0), 2.0),
    "50 mm f/2": (lambda: ideal(50, 2, 3.45, 2.0), 0.7),
    "phone": (lambda: shipped("phone-5mm-f2"), 2.0),
    "100 mm f/4": (lambda: ideal(100, 4, 6.0, 3.0), 0.5),
}
QUICK = ("paper-clear", "paper-cubic", "phone")


def picture(size: int = 96) -> Tensor:
    return (
        torch.from_numpy(data.astronaut()[20 : 20 + size, 180 : 180 + size] / 255.0).permute(2, 0, 1).float()
    )


def photo_of_strips(camera: Camera, near: float) -> tuple[Tensor, Tensor]:
    """A picture in strips, each at a depth of its own, one of them in focus, and its photo; periodic."""
    sharp = picture()
    focus = float((1 / focus_distance(camera, 543e-9)).clamp(0, near))
    depths = sorted([focus, *torch.linspace(0.02 * near, 0.98 * near, STRIPS - 1).tolist()])
    psfs = psf_bank(camera, PAPER_COLOURS, depths).values
    rows = torch.arange(sharp.shape[-2]) * STRIPS // sharp.shape[-2]
    photo = torch.zeros_like(sharp)
    for strip, psf in enumerate(psfs):
        beyond = psf.shape[-1] // 2
        around = sharp.tile(1, 3, 3)[:, 96 - beyond : 192 + beyond, 96 - beyond : 192 + beyond]
        kernel = torch.fft.rfft2(psf, s=around.shape[-2:])
        seen = torch.fft.irfft2(torch.fft.rfft2(around) * kernel, s=around.shape[-2:])
        lost = (1 - psf.sum((-1, -2)))[:, None, None] * sharp.mean((-1, -2), keepdim=True)
        seen = seen[:, 2 * beyond :, 2 * beyond :][:, :96, :96] + lost
        photo += torch.where((rows == strip)[None, :, None], seen, 0)
    noise = torch.randn(photo.shape, generator=torch.Generator().manual_seed(1))
    return sharp, photo + camera.read_noise * noise


def change_db(camera: Camera, near: float) -> float:
    """By how much the PSNR of `restore` changes where each gap between its nodes gets another node."""
    sharp, photo = photo_of_strips(camera, near)
    ends = torch.tensor([0.0, near], dtype=torch.float64)
    module = sys.modules[restore.__module__]
    nodes = module.nodes_between(camera, PAPER_COLOURS, *ends)
    twice = torch.cat([nodes, (nodes[1:] + nodes[:-1]) / 2]).sort().values
    psfs = channel_psfs(camera, PAPER_COLOURS, twice)
    first, _ = restore(photo, camera, PAPER_COLOURS, ends)
    second, _ = restore(photo, camera, PAPER_COLOURS, twice, psfs=psfs)
    scores = [psnr(within_scale(each), sharp) for each in (first, second)]
    print(f"{len(nodes)} nodes {scores[0]:.3f} dB, {len(twice)} nodes {scores[1]:.3f} dB")
    return abs(scores[0] - scores[1])


def fixed(camera: Camera, wavelengths: Tensor, far: Tensor | float, near: Tensor | float) -> Tensor:
    return torch.linspace(float(far), float(near), FIXED, dtype=torch.float64)


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CAMERAS]
)
def test_twice_as_many_depths_change_nothing(name: str):
    make, near = CAMERAS[name]
    assert change_db(make(), near) < WITHIN_DB


@pytest.mark.parametrize(
    "near_m", [0.55, *(pytest.param(near, marks=pytest.mark.slow) for near in (0.38, 0.40, 0.45, 0.50))]
)
def test_nor_do_they_wherever_the_near_limit_of_a_fast_lens_is(near_m: float):
    """Nine evenly spaced depths lie in its depth of field by chance."""
    assert change_db(ideal(35, 4, 3.45, 1.0, window=160), 1 / near_m) < WITHIN_DB


@pytest.mark.parametrize("near_m, window", [(0.55, 128), (0.40, 160)])
def test_a_fixed_count_is_caught(near_m: float, window: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys.modules[restore.__module__], "nodes_between", fixed)
    assert change_db(ideal(35, 4, 3.45, 1.0, window=window), 1 / near_m) > WITHIN_DB


def test_the_nodes_are_those_of_the_one_function():
    assert sys.modules[restore.__module__].nodes_between is nodes_between
