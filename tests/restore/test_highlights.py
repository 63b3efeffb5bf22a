"""Highlights beyond full scale are taken off, and what a photo holds without them stays."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from torch import Tensor

from edofsim.capture.planes import capture_planes
from edofsim.core.images import srgb_decode
from edofsim.experiments.photographs import photographs
from edofsim.optics import PAPER_COLOURS, Camera, channel_psfs
from edofsim.restore import restore, said_of
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.highlights import FULL, covered, without_highlights
from edofsim.restore.places import Method
from edofsim.restore.scores import psnr

SIDE, NOISE = 160, 0.005
COLOUR = (30.0, 20.0, 6.0)
WIDTHS = tuple(np.linspace(2.0, 15.0, 27))
"""Radius of the blur of the distances, pixels: geometric, no optics of ours."""


def _disc(width: float, window: int = 65) -> Tensor:
    place = torch.arange(window) - window // 2
    found = (width + 0.5 - place[:, None].double().hypot(place.double())).clamp(0, 1)
    return found / found.sum()


def _psf(width: float) -> Tensor:
    """As a coded pupil has it: a ring, and a disc of a third of its radius within."""
    ring = math.pi * width**2 * _disc(width) - math.pi * (0.7 * width) ** 2 * _disc(0.7 * width)
    return (0.6 * ring.clamp_min(0) / ring.clamp_min(0).sum() + 0.4 * _disc(width / 3)).expand(3, -1, -1)


PSFS = torch.stack([_psf(width) for width in WIDTHS])


def _at(row: float, column: float) -> Tensor:
    return PSFS


def _scene(
    radius: float, colour: tuple[float, ...], at: tuple[float, float] = (80.3, 77.6), squeezed: float = 1.0
) -> Tensor:
    """A lamp before a smooth pattern, [3, y, x]; each pixel is a mean of 8 x 8 points. squeezed: its rows."""
    fine = (torch.arange(8 * SIDE) + 0.5) / 8 - 0.5
    row, column = (fine - at[0])[:, None] * squeezed, fine - at[1]
    inside = ((row**2 + column**2) < radius**2).double()
    cover = inside.unflatten(0, (SIDE, 8)).unflatten(2, (SIDE, 8)).mean((1, 3))
    y, x = torch.meshgrid(torch.arange(SIDE), torch.arange(SIDE), indexing="ij")
    pattern = 0.2 + 0.1 * torch.sin(x / 13) * torch.cos(y / 17)
    return pattern * (1 - cover) + cover * torch.tensor(colour)[:, None, None]


def _blurred(scene: Tensor, width: float) -> Tensor:
    """By convolution of scipy's, the border continued."""
    padded = np.pad(scene.numpy(), ((0, 0), (32, 32), (32, 32)), mode="edge")
    found = [fftconvolve(channel, _psf(width)[0].numpy(), mode="valid") for channel in padded]
    return torch.from_numpy(np.stack(found)).float()


def _photo(scene: Tensor, width: float, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    clean = _blurred(scene, width)
    return clean + NOISE * torch.randn(clean.shape, generator=generator)


@pytest.mark.parametrize("saturates", [True, False])
@pytest.mark.parametrize(("radius", "width"), [(1.5, 8.2), (3.0, 7.3), (4.0, 11.7), (6.0, 13.1)])
def test_what_is_left_is_the_photo_of_a_scene_within_full_scale(
    radius: float, width: float, saturates: bool
) -> None:
    scene = _scene(radius, COLOUR)
    photo = _photo(scene, width)
    photo = photo.clamp(0, 1) if saturates else photo
    found, count = without_highlights(photo, _at, NOISE)
    wanted = _blurred(scene.clamp_max(1), width)
    assert count == 1
    assert psnr(found, wanted) > 38  # the noise alone is 46 dB off
    assert psnr(photo.clamp(0, 1), wanted) < 28


@pytest.mark.parametrize(("at", "expected"), [((3.0, 80.0), 1), ((80.0, 157.0), 1), ((2.0, 2.0), 0)])
def test_a_lamp_at_the_border_is_taken_off_and_one_in_a_corner_left(
    at: tuple[float, float], expected: int
) -> None:
    """Of its halo a half or a quarter is in the frame."""
    scene = _scene(3.0, COLOUR, at)
    photo = _photo(scene, 7.3).clamp(0, 1)
    found, count = without_highlights(photo, _at, NOISE)
    wanted = _blurred(scene.clamp_max(1), 7.3)
    assert count == expected
    assert psnr(found, wanted) >= psnr(photo, wanted) + 12 * expected


def test_an_ellipse_is_found_and_two_lamps_are_two() -> None:
    scene = _scene(3.0, COLOUR, (50.0, 60.0), squeezed=0.4).maximum(_scene(3.0, COLOUR, (120.0, 110.0)))
    found, count = without_highlights(_photo(scene, 7.3).clamp(0, 1), _at, NOISE)
    assert count == 2
    assert psnr(found, _blurred(scene.clamp_max(1), 7.3)) > 36


@pytest.mark.parametrize(
    ("radius", "colour"),
    [(6.0, (1.0, 1.0, 1.0)), (12.0, (1.2, 1.2, 1.2)), (20.0, (1.0, 0.9, 0.7)), (1.0, (0.9, 0.9, 0.9))],
)
def test_what_is_white_and_no_brighter_stays(radius: float, colour: tuple[float, ...]) -> None:
    """The same object comes back: nothing of it was computed anew."""
    photo = _photo(_scene(radius, colour), 2.5).clamp(0, 1)
    found, count = without_highlights(photo, _at, NOISE)
    assert found is photo
    assert count == 0


def test_what_cannot_be_told_from_a_white_disc_stays() -> None:
    """Through a clear round lens a lamp out of focus and a white disc in focus may look the same: of two
    discs it makes no difference which is the lamp and which the blur."""
    discs = torch.stack([_disc(width).expand(3, -1, -1) for width in WIDTHS])
    for scene, radius in ((_scene(12.0, (1.0, 1.0, 1.0)), 2.0), (_scene(9.0, (1.2, 1.1, 1.0)), 3.0)):
        padded = np.pad(scene.numpy(), ((0, 0), (32, 32), (32, 32)), mode="edge")
        blurred = [fftconvolve(each, _disc(radius).numpy(), mode="valid") for each in padded]
        noise = NOISE * torch.randn(scene.shape, generator=torch.Generator().manual_seed(0))
        photo = (torch.from_numpy(np.stack(blurred)).float() + noise.float()).clamp(0, 1)
        assert without_highlights(photo, lambda row, column: discs, NOISE)[0] is photo


def test_a_soft_gloss_stays() -> None:
    """A highlight that fades away has no edge that tells how bright it is."""
    row = torch.arange(SIDE)[:, None] - 80.0
    gloss = 3.5 * torch.exp(-(row**2 + (torch.arange(SIDE) - 77.0) ** 2) / (2 * 10.0**2))
    scene = torch.full((3, SIDE, SIDE), 0.25, dtype=torch.float64) + gloss
    photo = _photo(scene, 7.3).clamp(0, 1)
    assert without_highlights(photo, _at, NOISE)[0] is photo


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0, 40.0])
def test_flat_photos_stay(level: float) -> None:
    photo = torch.full((3, 40, 40), level)
    assert without_highlights(photo, _at, NOISE)[0] is photo


def test_a_photo_without_full_pixels_asks_for_no_psf() -> None:
    def none(row: float, column: float) -> Tensor:
        raise AssertionError("not needed")

    photo = torch.rand(3, 64, 64) * (FULL - 0.01)
    assert without_highlights(photo, none, NOISE)[0] is photo


def test_brightness_of_any_size_stays_finite() -> None:
    """The largest numbers, too small a photo, a single distance, and a noise of zero."""
    scene = _scene(3.0, (1e6, 2e6, 3e6))
    found, _ = without_highlights(_photo(scene, 7.3), _at, 0.0)
    assert bool(torch.isfinite(found).all())
    small = _photo(_scene(3.0, COLOUR), 2.0).clamp(0, 1)[:, 74:86, 70:84]
    found, _ = without_highlights(small, lambda row, column: PSFS[3:4], NOISE)
    assert bool(torch.isfinite(found).all())


def test_the_same_on_any_number_of_threads() -> None:
    photo = _photo(_scene(3.0, COLOUR), 7.3).clamp(0, 1)
    before = torch.get_num_threads()
    images = []
    try:
        for threads in (1, 2, 3):
            torch.set_num_threads(threads)
            images.append(without_highlights(photo, _at, NOISE)[0])
    finally:
        torch.set_num_threads(before)
    assert not torch.equal(images[0], photo)
    assert torch.equal(images[0], images[1])
    assert torch.equal(images[0], images[2])


def test_gradients_pass() -> None:
    photo = _photo(_scene(3.0, COLOUR), 7.3).clamp(0, 1).requires_grad_()
    found, count = without_highlights(photo, _at, NOISE)
    assert count == 1
    found.sum().backward()
    assert photo.grad is not None
    assert torch.equal(photo.grad, torch.ones_like(photo))


@pytest.mark.parametrize("stretch", [(0.0, 0.0), (0.8, 0.0), (0.3, -0.9), (-1.0, 0.6)])
def test_ellipses_cover_their_area_however_they_are_stretched(stretch: tuple[float, float]) -> None:
    shape = torch.tensor([[60.2, 61.7, math.log(9.0), *stretch, 0.0, -1.0]], dtype=torch.float64)
    cover = covered(shape, 128, 128)[0]
    assert float(cover.sum()) == pytest.approx(math.pi * 81, rel=0.01)
    row = torch.arange(128, dtype=torch.float64)
    assert float((cover.sum(1) @ row) / cover.sum()) == pytest.approx(60.2, abs=0.03)


@pytest.fixture(scope="module")
def taken() -> tuple[Camera, Callable[[float], Tensor], Tensor]:
    """A camera, photos of a lamp at a distance in 1/m by it, and their truth."""
    checkpoint = load_checkpoint("paper-dcnn")
    camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
    scene = _scene(4.0, COLOUR)

    def photo(inverse: float) -> Tensor:
        psf = channel_psfs(camera, PAPER_COLOURS, torch.tensor([inverse], dtype=torch.float64))[0]
        padded = np.pad(scene.numpy(), ((0, 0), (48, 47), (48, 47)), mode="edge")
        found = [fftconvolve(c, p.numpy(), mode="valid") for c, p in zip(padded, psf, strict=True)]
        generator = torch.Generator().manual_seed(0)
        clean = torch.from_numpy(np.stack(found)).float()
        return (clean + NOISE * torch.randn(clean.shape, generator=generator)).clamp(0, 1)

    return camera, photo, scene.clamp_max(1).float()


@pytest.mark.parametrize("name", [None, "paper-dcnn", "paper-bank"])
@pytest.mark.parametrize("inverse", [0.4, 1.6])
def test_every_restoration_gains(
    taken: tuple[Camera, Callable[[float], Tensor], Tensor], name: str | None, inverse: float
) -> None:
    camera, photo, truth = taken
    checkpoint = None if name is None else load_checkpoint(name)
    ends = torch.tensor([0.0, 2.0])
    found = {}
    for highlights in (False, True):
        how = {"checkpoint": checkpoint, "highlights": highlights}
        image, method = restore(photo(inverse), camera, PAPER_COLOURS, ends, **how)
        found[highlights] = psnr(image[:, 24:-24, 24:-24].clamp(0, 1), truth[:, 24:-24, 24:-24])
        assert method.highlights == int(highlights)
    assert found[True] > found[False] + 4


def test_a_report_names_what_was_taken_off() -> None:
    assert str(Method("paper-bank")) == "paper-bank"
    assert str(Method("paper-bank", highlights=1)) == "paper-bank, 1 highlight beyond full scale taken off"
    assert str(Method("Wiener", "x", 8, 2)).endswith("8 px apart, 2 highlights beyond full scale taken off")


def test_a_person_is_told_what_was_taken_off() -> None:
    assert said_of(None, Method("Wiener")) is None
    assert (said_of(None, Method("Wiener", highlights=1)) or "").startswith("1 highlight was brighter")
    said = said_of(load_checkpoint("universal"), Method("universal", highlights=3)) or ""
    assert said.startswith("3 highlights were brighter")
    assert "No network was trained" in said


@pytest.mark.parametrize(("picture", "inverse"), [("astronaut", 1.7), ("chelsea", 0.3)])
def test_bright_photographs_without_lamps_stay(
    taken: tuple[Camera, Callable[[float], Tensor], Tensor], picture: str, inverse: float
) -> None:
    """A suit and fur, overexposed to two and three times full scale."""
    camera = taken[0]
    depths = torch.tensor([*torch.linspace(0, 2.05, 21), inverse], dtype=torch.float64)
    psfs = channel_psfs(camera, PAPER_COLOURS, depths)
    values = next(each for each in photographs(None).pictures if each.name == picture).values
    light = srgb_decode(values) * (2 if picture == "astronaut" else 3)
    rows, columns = (size // 2 for size in light.shape[-2:])
    part = light[:, rows - 130 : rows + 130, columns - 130 : columns + 130]
    clean = capture_planes(part[None], psfs[-1:])[0]
    generator = torch.Generator().manual_seed(0)
    photo = (clean + NOISE * torch.randn(clean.shape, generator=generator)).clamp(0, 1)
    assert without_highlights(photo, lambda row, column: psfs[:-1], NOISE)[0] is photo
