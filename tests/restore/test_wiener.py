"""Wiener deconvolution: limits that follow from its definition, and hard inputs."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
import torch
from skimage import data, restoration

from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.recipe import load_camera
from edofsim.restore import restore, wiener, wiener_by_depth
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.restore import channel_psfs
from edofsim.restore.scores import psnr


def photograph(size: int = 128) -> torch.Tensor:
    image = torch.from_numpy(data.astronaut()[:size, 100 : 100 + size] / 255.0)
    return image.permute(2, 0, 1).float()


def gaussian(sigma: float, size: int = 31) -> torch.Tensor:
    x = torch.arange(size) - size // 2
    g = torch.exp(-(x**2) / (2 * sigma**2))
    kernel = g[:, None] * g[None, :]
    return (kernel / kernel.sum()).expand(3, size, size)


def blurred(image: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
    reach = kernel.shape[-1] // 2
    padded = torch.nn.functional.pad(image, (reach,) * 4, mode="reflect")
    size = padded.shape[-2:]
    round_about = torch.fft.irfft2(torch.fft.rfft2(padded) * torch.fft.rfft2(kernel, s=size), s=size)
    return round_about[..., 2 * reach :, 2 * reach :]  # elsewhere the ends of the picture meet


def test_a_point_psf_without_noise_changes_nothing():
    """H = 1 and N = 0: the filter is 1."""
    delta = torch.zeros(3, 9, 9)
    delta[:, 4, 4] = 1
    image = photograph()
    torch.testing.assert_close(wiener(image, delta, 0.0), image, atol=1e-4, rtol=0)  # float32 floor


def test_a_shifted_psf_is_shifted_back():
    """A PSF that only moves the image by one pixel down is undone, which fixes the centre and direction."""
    delta = torch.zeros(3, 9, 9)
    delta[:, 5, 4] = 1
    image = photograph()
    moved = torch.roll(image, 1, -2)
    restored = wiener(moved, delta, 0.0)
    torch.testing.assert_close(restored[:, 20:-20, 20:-20], image[:, 20:-20, 20:-20], atol=0.05, rtol=0)


@pytest.mark.parametrize("sigma, noise", [(1.5, 0.005), (2.5, 0.005), (1.5, 0.02)])
def test_it_does_as_well_as_scikit_images_best_tuned_filter(sigma: float, noise: float):
    """scikit-image's Wiener-Hunt filter with its weight tuned on the truth, which ours never sees."""
    image, kernel = photograph(), gaussian(sigma)
    photo = blurred(image, kernel)
    photo = photo + noise * torch.randn(photo.shape, generator=torch.Generator().manual_seed(1))
    crop = (..., slice(20, -20), slice(20, -20))  # scikit-image wraps around the frame

    def tuned(balance: float) -> torch.Tensor:
        channels = [restoration.wiener(c.numpy(), kernel[0].numpy(), balance, clip=False) for c in photo]
        return torch.from_numpy(np.stack(channels))

    best = max(psnr(tuned(balance)[crop], image[crop]) for balance in np.logspace(-4, 1, 11))
    assert psnr(wiener(photo, kernel, noise)[crop], image[crop]) > best - 0.5


def test_light_beyond_the_window_is_a_veil_that_is_taken_off():
    """A tenth of the light is spread over all of the photo; the rest is blurred as ever."""
    image, kernel = photograph(), gaussian(1.5)
    mean = image.mean((1, 2), keepdim=True)
    restored = wiener(0.9 * blurred(image, kernel) + 0.1 * mean, 0.9 * kernel, 0.0045)
    without = wiener(blurred(image, kernel), kernel, 0.005)
    torch.testing.assert_close(restored, without, atol=1e-3, rtol=0)


@pytest.mark.parametrize("noise", [0.0, 1e-9, 0.02])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_images_without_contrast_stay_finite_and_level(noise: float, value: float):
    restored = wiener(torch.full((3, 17, 23), value), gaussian(3.0), noise)
    torch.testing.assert_close(restored, torch.full((3, 17, 23), value), atol=1e-4, rtol=0)


def test_zeros_of_the_transfer_function_without_noise_stay_finite():
    """A box blur has exact zeros; without noise the filter divides 0 by 0 there unless guarded."""
    box = torch.full((3, 8, 8), 1 / 64)
    image = photograph(64)
    restored = wiener(blurred(image, torch.nn.functional.pad(box, (0, 1, 0, 1))), box, 0.0)
    assert torch.isfinite(restored).all()


@pytest.mark.parametrize("shape", [(3, 1, 1), (3, 1, 37), (3, 13, 7)])
def test_images_smaller_than_the_psf(shape: tuple[int, int, int]):
    image = torch.rand(shape, generator=torch.Generator().manual_seed(2))
    restored = wiener(image, gaussian(2.0), 0.01)
    assert restored.shape == image.shape and torch.isfinite(restored).all()


def test_an_unknown_depth_is_handled_better_than_by_its_mean_psf_alone():
    """The filter for a stack of PSFs minimises the mean square error over them (orthogonality principle)."""
    image = photograph()
    stack = torch.stack([gaussian(0.4), gaussian(3.0)])
    noise = 0.01
    generator = torch.Generator().manual_seed(3)
    photos = [blurred(image, k) + noise * torch.randn(image.shape, generator=generator) for k in stack]
    error = [[(wiener(p, h, noise) - image).square().mean() for p in photos] for h in (stack, stack.mean(0))]
    assert sum(error[0]) < sum(error[1])


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="do not fit"):
        wiener(torch.zeros(3, 8, 8), torch.zeros(1, 5, 5), 0.01)
    with pytest.raises(InputError, match="noise"):
        wiener(torch.zeros(3, 8, 8), torch.zeros(3, 5, 5), float("nan"))


@pytest.mark.parametrize("name", ["paper-clear", "paper-learned", "zernike-wiener"])
def test_a_photo_of_the_world_is_not_taken_for_mirrored_at_its_border(
    name: str, monkeypatch: pytest.MonkeyPatch
):
    """Light comes in from beyond the frame; the truth is the larger picture, blurred and cut. So for filters
    of PSFs that are given, and for those of a checkpoint."""
    checkpoint = None
    if name.startswith("paper"):
        loaded = load_camera(name)
        camera = Camera.from_recipe(loaded.recipe, loaded.base)
    else:
        checkpoint = load_checkpoint(name)
        camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
    lines = torch.tensor([482e-9, 543e-9, 611e-9], dtype=torch.float64)
    depth = torch.tensor([0.6])
    psf = channel_psfs(camera, lines, depth)[0].float()
    frame = (..., slice(96, 224), slice(96, 224))
    border = torch.ones(128, 128, dtype=torch.bool)
    border[8:-8, 8:-8] = False
    noise = torch.randn(3, 128, 128, generator=torch.Generator().manual_seed(1))
    errors = {"ours": 0.0, "mirrored": 0.0}
    for picture, left in ((data.astronaut(), 60), (data.astronaut(), 180), (data.coffee(), 150)):
        world = torch.from_numpy(picture[:320, left : left + 320] / 255.0).permute(2, 0, 1).float()
        photo = blurred(world, psf[:, 1:, 1:])[frame] + camera.read_noise * noise
        for way in errors:
            with monkeypatch.context() as patched:
                if way == "mirrored":
                    patched.setattr(importlib.import_module("edofsim.restore.wiener"), "BEYOND_PX", 0)
                restored, _ = restore(photo, camera, lines, depth, checkpoint=checkpoint)
            assert restored.shape == photo.shape
            errors[way] += float((restored - world[frame])[:, border].square().mean())
    assert errors["ours"] < 0.8 * errors["mirrored"]


def test_of_one_depth_everywhere_the_filter_by_depth_is_that_of_its_psf():
    image = photograph(96)
    psfs = torch.stack([gaussian(0.7), gaussian(1.5), gaussian(3.0)])
    nodes = torch.tensor([0.0, 0.5, 2.0])
    photo = blurred(image, psfs[1])
    depth = torch.full((96, 96), 0.5)
    found = wiener_by_depth(photo, psfs, nodes, depth, 0.005)
    torch.testing.assert_close(found, wiener(photo, psfs[1], 0.005), atol=1e-5, rtol=0)


def test_between_two_nodes_both_filters_count_by_how_near_they_are():
    """And beyond the last node that one alone. PSFs that only move the photo, each another way, pass all
    frequencies alike: the noise is compared with the same signal in both."""
    photo = photograph(64)
    psfs, nodes = torch.zeros(2, 3, 9, 9), torch.tensor([0.5, 1.5])
    psfs[0, :, 5, 4] = psfs[1, :, 4, 7] = 1
    depth = torch.linspace(0.0, 2.0, 64).expand(64, 64)
    share = ((depth - 0.5) / 1.0).clamp(0, 1)
    first, last = (wiener(photo, psf, 0.01) for psf in psfs)
    found = wiener_by_depth(photo, psfs, nodes, depth, 0.01)
    torch.testing.assert_close(found, first.lerp(last, share), atol=1e-5, rtol=0)


def test_known_depths_restore_more_than_unknown_ones():
    """A picture whose left is blurred otherwise than its right: each part by its own filter."""
    image, noise = photograph(), 0.005
    psfs, nodes = torch.stack([gaussian(0.8), gaussian(3.0)]), torch.tensor([0.0, 2.0])
    depth = torch.zeros(128, 128)
    depth[:, 64:] = 2.0
    photo = torch.where(depth == 0, blurred(image, psfs[0]), blurred(image, psfs[1]))
    photo = photo + noise * torch.randn(photo.shape, generator=torch.Generator().manual_seed(2))
    known = psnr(wiener_by_depth(photo, psfs, nodes, depth, noise), image)
    assert known > psnr(wiener(photo, psfs, noise), image) + 0.5
    turned = psnr(wiener_by_depth(photo, psfs, nodes, 2.0 - depth, noise), image)
    assert turned < known - 3


def test_shares_are_how_often_a_depth_is_there():
    photo = photograph(64)
    one, other = gaussian(1.0), gaussian(3.0)
    shares = torch.tensor([0.75, 0.25])
    expected = wiener(photo, torch.stack([one, one, one, other]), 0.01)
    torch.testing.assert_close(wiener(photo, torch.stack([one, other]), 0.01, shares=shares), expected)


@pytest.mark.parametrize(
    "nodes, depth",
    [([0.0], torch.zeros(8, 8)), ([1.0, 0.0], torch.zeros(8, 8)), ([0.0, 1.0], torch.zeros(8, 9))],
)
def test_depths_that_do_not_fit_are_refused(nodes: list[float], depth: torch.Tensor):
    with pytest.raises(InputError, match="by depth"):
        wiener_by_depth(torch.zeros(3, 8, 8), torch.zeros(2, 3, 5, 5), torch.tensor(nodes), depth, 0.01)
