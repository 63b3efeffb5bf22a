"""Light is kept: what changes slowly comes back as it was, whatever its brightness and colour."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from edofsim.capture.planes import capture_planes
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.restore import restore
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.light import BLUR_PX, MOST, REACH, SMOOTH_PX, keep_light, with_other_glare, without_glare
from edofsim.restore.network import apply_network
from edofsim.restore.restorer import Restorer

LEVELS = (0.02, 0.05, 0.2, 0.8)
HUES = ((1, 0.4, 0.4), (1, 1, 0.4), (0.4, 1, 0.4), (0.4, 1, 1), (0.4, 0.4, 1), (1, 0.4, 1))
SIDE, SMALL = 192, 96
NOISE = 0.005


def _noise(*shape: int) -> Tensor:
    return NOISE * torch.randn(shape, generator=torch.Generator().manual_seed(1))


def _flat(colour: Tensor, side: int = SIDE) -> Tensor:
    return colour[:, None, None].expand(3, side, side)


def _camera() -> Camera:
    checkpoint = load_checkpoint("paper-dcnn")
    return camera_with_mask(trained_camera(checkpoint), checkpoint)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ["paper-dcnn", "depth-dcnn", "paper-bank"])
def test_flat_colours_come_back_as_they_were(name: str, level: float) -> None:
    """PSFs sum to one with the glare beyond their windows, so that the photo of a flat colour is that colour
    at every distance: 2 % of each channel, in six hues, of which each level has every other one."""
    network = load_checkpoint(name).network
    for hue in HUES[LEVELS.index(level) % 2 :: 2]:
        colour = level * torch.tensor(hue)
        noisy = _flat(colour, SMALL) + _noise(3, SMALL, SMALL)
        restored = apply_network(network, noisy, glare=torch.full((3,), 0.06))
        torch.testing.assert_close(restored.mean((-1, -2)), colour, rtol=0.02, atol=0)


def test_a_wiener_filter_keeps_flat_colours() -> None:
    camera, depths = _camera(), torch.tensor([0.0, 1.0, 2.0])
    for level in LEVELS:
        colour = level * torch.tensor(HUES[0])
        photo = _flat(colour) + _noise(3, SIDE, SIDE)
        for glare in (None, torch.full((3,), 0.06)):
            restored, _ = restore(photo, camera, PAPER_COLOURS, depths, glare=glare)
            torch.testing.assert_close(restored.mean((-1, -2)), colour, rtol=0.02, atol=0)


def test_a_photo_is_restored_with_the_veil_that_its_camera_leaves() -> None:
    """Of a mask whose making scatters a third of the light the contrast comes back whole: a slow wave, whose
    photo has two thirds of it."""
    checkpoint = load_checkpoint("paper-dcnn")
    wave = 0.4 + 0.1 * torch.cos(torch.arange(-128, 128) * torch.pi / 128)
    sharp = wave.expand(3, 256, 256)
    photo = 2 / 3 * sharp + 1 / 3 * wave[0]  # the world goes on as its border does, nearly
    glare = torch.full((3,), 1 / 3)
    depth = torch.tensor([1.0])
    restored, _ = restore(photo, _camera(), PAPER_COLOURS, depth, checkpoint=checkpoint, glare=glare)

    def contrast(image: Tensor) -> float:
        return float(image[..., 118:138].mean() - image[..., 32:42].mean())

    assert abs(contrast(restored[:, 64:-64]) / contrast(sharp) - 1) < 0.1


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.5, float("inf")])
def test_a_flat_colour_looks_the_same_at_every_distance(distance: float) -> None:
    """What the case above takes for granted, by the PSFs of the shipped mask: what leaves their window comes
    back as veiling glare of the same colour."""
    psf = psf_bank(_camera(), PAPER_COLOURS, [1 / distance]).values
    colour = torch.tensor([0.8, 0.05, 0.3])
    photo = capture_planes(_flat(colour)[None], psf)[0]
    torch.testing.assert_close(photo, colour[:, None, None].expand(photo.shape), rtol=1e-4, atol=0)


@pytest.mark.parametrize("name", ["paper-dcnn", "depth-dcnn", "paper-bank"])
def test_a_dark_photo_is_not_darker_after_restoration(name: str) -> None:
    """A slope of light from 0.01 to 0.2, in another direction in each channel: any place's mean stays."""
    ramp = torch.linspace(0.01, 0.2, SIDE)
    across, down = ramp.expand(SIDE, -1), ramp[:, None].expand(-1, SIDE)
    sharp = torch.stack([across, across.flip(1), down])
    restored = apply_network(load_checkpoint(name).network, sharp + _noise(3, SIDE, SIDE))
    cells = torch.nn.functional.avg_pool2d(restored[:, 32:-32, 32:-32], 32)
    expected = torch.nn.functional.avg_pool2d(sharp[:, 32:-32, 32:-32], 32)
    assert (cells - expected).abs().max() < 3e-3


def test_a_veil_is_taken_off_and_the_mean_is_kept() -> None:
    generator = torch.Generator().manual_seed(2)
    sharp = torch.rand(3, 40, 56, generator=generator)
    glare = torch.tensor([0.0, 0.1, 0.3])
    part = glare[:, None, None]
    # the world goes on as its border does, which gives the glare its mean
    world = torch.nn.functional.pad(sharp[None], (64,) * 4, mode="replicate")[0]
    photo = (1 - part) * sharp + part * world.mean((-1, -2), keepdim=True)
    torch.testing.assert_close(without_glare(photo, glare), sharp, rtol=0, atol=1e-5)
    other = torch.tensor([0.2, 0.0, 0.1])
    part = other[:, None, None]
    hazy = (1 - part) * sharp + part * world.mean((-1, -2), keepdim=True)
    torch.testing.assert_close(with_other_glare(photo, glare, other), hazy, rtol=0, atol=1e-5)


class _Watching(Restorer):
    """Returns photos as they are, and remembers what it saw."""

    def forward(self, photo: Tensor) -> Tensor:
        self.seen = photo[0].clone()
        return photo


def test_a_network_sees_the_veil_of_its_training() -> None:
    """Whatever veil the photo has."""
    network = _Watching()
    network.glare = (0.1, 0.2, 0.3)
    sharp = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(6)) * 0.5 + 0.2
    world = torch.nn.functional.pad(sharp[None], (64,) * 4, mode="replicate")[0].mean((-1, -2))
    for part in ((0.0, 0.0, 0.0), (0.05, 0.3, 0.1)):
        had, wanted = (torch.tensor(each)[:, None, None] for each in (part, network.glare))
        photo = (1 - had) * sharp + had * world[:, None, None]
        apply_network(network, photo, glare=torch.tensor(part) if any(part) else None)
        expected = (1 - wanted) * sharp + wanted * world[:, None, None]
        torch.testing.assert_close(network.seen, expected, rtol=0, atol=1e-5)


def test_the_veil_of_a_training_follows_from_its_errors_of_fabrication() -> None:
    """Of networks that were told the PSFs of such masks; exp(-s^2) of the light keeps its way, s the error of
    the phase."""
    for name in ("depth-dcnn", "paper-bank"):
        checkpoint = load_checkpoint(name)
        height_map = Camera.from_recipe(trained_camera(checkpoint)).mask_material
        error = checkpoint.card["recipe"]["doe"]["height_noise_nm"] * 1e-9
        phase = 2 * math.pi * error * (height_map.index(PAPER_COLOURS) - 1) / PAPER_COLOURS
        assert checkpoint.network.glare == pytest.approx((1 - (-phase.square()).exp()).tolist())
    assert [load_checkpoint(name).network.glare for name in ("paper-dcnn", "universal")] == [None, None]


def test_a_level_that_is_wrong_is_mended_and_detail_is_left() -> None:
    generator = torch.Generator().manual_seed(3)
    detail = 0.1 * torch.randn(3, 160, 160, generator=generator).sign()
    photo = torch.full((3, 160, 160), 0.4)
    wrong = photo + detail - torch.tensor([0.02, 0.0, -0.03])[:, None, None]
    kept = keep_light(photo, wrong)
    torch.testing.assert_close(kept.mean((-1, -2)), photo.mean((-1, -2)), rtol=0, atol=1e-3)
    difference = kept - wrong
    assert difference.diff(dim=-1).abs().max() < 2e-3  # smooth
    # of the detail itself, a Gaussian of some 32 pixels leaves next to nothing
    assert (difference - difference.mean((-1, -2), keepdim=True)).abs().max() < 0.01


def test_nothing_changes_beyond_the_reach() -> None:
    generator = torch.Generator().manual_seed(4)
    size = 2 * REACH + 96
    photo = 0.5 + 0.1 * torch.rand(3, 16, size, generator=generator)
    restored = photo + 0.05 * torch.rand(photo.shape, generator=generator)
    other = photo.clone()
    other[:, :, :24] = 30.0
    same = (..., slice(24 + REACH, None))
    torch.testing.assert_close(keep_light(other, restored)[same], keep_light(photo, restored)[same])


@pytest.mark.parametrize("brightness", [3.0, 60.0, 1e6])
def test_a_lamp_bleeds_no_halo(brightness: float) -> None:
    """A restoration that is right: the lamp's light is together again, and full scale holds little of it. The
    photo holds all of it, spread; what is dark around the lamp has to stay dark."""
    sharp = torch.full((3, 128, 128), 0.05)
    sharp[:, 62:66, 62:66] = brightness
    spread = torch.nn.functional.avg_pool2d(sharp, 17, 1, 8, count_include_pad=False)
    kept = keep_light(spread, sharp.clamp_max(1.2))
    outside = torch.ones(128, 128, dtype=torch.bool)
    outside[54:74, 54:74] = False
    assert (kept[:, outside] - 0.05).abs().max() < 5e-3
    assert kept.shape == sharp.shape and torch.isfinite(kept).all()


def test_what_clamping_adds_is_taken_off_again() -> None:
    """Noise about black: its negative half is cut, the mean stays at what the photo says."""
    dark = torch.full((3, 160, 160), 0.002)
    noisy = dark + 0.01 * torch.randn(dark.shape, generator=torch.Generator().manual_seed(5))
    kept = keep_light(dark, noisy)
    assert kept.min() >= 0
    assert kept.mean() - 0.002 < 0.5 * (noisy.clamp_min(0).mean() - 0.002)


@pytest.mark.parametrize("shape", [(1, 1), (1, 37), (3, 2), (9, 65)])
def test_any_size(shape: tuple[int, int]) -> None:
    photo = torch.rand(3, *shape, generator=torch.Generator().manual_seed(6))
    torch.testing.assert_close(keep_light(photo, photo), photo, rtol=0, atol=0.5 * MOST)
    assert SMOOTH_PX > BLUR_PX
    batch = torch.stack([photo, photo.flip(-1)])
    torch.testing.assert_close(keep_light(batch, batch)[0], keep_light(photo, photo))
