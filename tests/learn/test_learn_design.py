"""Masks designed alone: the closed forms against dense linear algebra, random masks and a trained network."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from pydantic import ValidationError
from torch import Tensor

from edofsim.capture.planes import surroundings
from edofsim.errors import InputError
from edofsim.learn.design import design
from edofsim.learn.doe import FreeHeight, MaskMaps
from edofsim.learn.sources import central_patches, packaged_images
from edofsim.learn.system import Planes
from edofsim.learn.training_camera import TrainingCamera
from edofsim.optics import Camera, mean_psfs, response
from edofsim.recipe.load import load_camera
from edofsim.recipe.train import DoeTable
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.linear import colour_error, local_error, local_filters, wiener_error
from edofsim.restore.network import apply_network
from edofsim.restore.photograph_statistics import (
    COARSEST_PX,
    COLOUR_CORRELATION,
    FALL,
    POWER,
    colour_weights,
)

NOISE = 0.02
WINDOW, SIZE = 6, 12


SEEN = ((0.8, 0.3, -0.1), (0.1, 0.85, 0.05), (0.0, 0.2, 0.8))  # of each colour in each channel


def _psfs(depths: int, mixed: bool = False) -> Tensor:
    """[depth, channel, y, x], or by colour."""
    shape = (depths, 3, 3) if mixed else (depths, 3)
    random = torch.rand(*shape, WINDOW, WINDOW, generator=torch.Generator().manual_seed(4)).double() ** 3
    psf = 0.9 * random / random.sum((-1, -2), keepdim=True)
    return psf * torch.tensor(SEEN).double()[..., None, None] if mixed else psf


def _scene() -> Tensor:
    """Covariance of a periodic scene, [3 * pixels, 3 * pixels], term by term."""
    frequency = torch.fft.fftfreq(SIZE, dtype=torch.float64)
    power = POWER * (frequency[:, None] ** 2 + frequency[None, :] ** 2 + COARSEST_PX**-2) ** (-FALL / 2)
    place = torch.cartesian_prod(torch.arange(SIZE), torch.arange(SIZE)).double()
    waves = torch.exp(2j * math.pi / SIZE * (place @ place.T))
    alone = (waves @ torch.diag(power.reshape(-1)).to(waves) @ waves.conj().T).real / SIZE**2
    return torch.kron(torch.tensor(COLOUR_CORRELATION, dtype=torch.float64), alone)


def _blur(psf: Tensor) -> Tensor:
    """The blur of one depth as a matrix, [3 * pixels, 3 * pixels]: a sum over places, no transform. Light
    that the PSF does not hold goes to all places."""
    matrix = torch.zeros(3, SIZE, SIZE, 3, SIZE, SIZE, dtype=torch.float64)
    psf = psf if psf.ndim == 4 else torch.diag_embed(psf.movedim(0, -1)).movedim((-2, -1), (0, 1))
    for channel, colour in itertools.product(range(3), range(3)):
        seen = psf[channel, colour]
        matrix[channel, :, :, colour] = (float(channel == colour) - seen.sum()) / SIZE**2
        for y in range(SIZE):
            for x in range(SIZE):
                for v in range(WINDOW):
                    for u in range(WINDOW):
                        row, column = (y + v - WINDOW // 2) % SIZE, (x + u - WINDOW // 2) % SIZE
                        matrix[channel, row, column, colour, y, x] += seen[v, u]
    return matrix.reshape(3 * SIZE**2, 3 * SIZE**2)


@pytest.fixture(scope="module", params=[False, True], ids=["channels", "colours"])
def mixed(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture(scope="module")
def blurs(mixed: bool) -> list[Tensor]:
    """Those of `_psfs(4, mixed)`."""
    return [_blur(one) for one in _psfs(4, mixed)]


@pytest.fixture(scope="module")
def scene() -> Tensor:
    return _scene()


@pytest.mark.parametrize("groups", [1, 2])
def test_local_error_is_that_of_dense_least_squares(
    groups: int, mixed: bool, blurs: list[Tensor], scene: Tensor
) -> None:
    psf = _psfs(4, mixed)
    support, middle = 3, SIZE // 2
    pixels = [
        channel * SIZE**2 + (middle + v) * SIZE + middle + u
        for channel in range(3)
        for v in (-1, 0, 1)
        for u in (-1, 0, 1)
    ]
    sharp = [channel * SIZE**2 + middle * SIZE + middle for channel in range(3)]
    covariances, crosses = [], []
    for blur in blurs:
        covariance = blur @ scene @ blur.T + NOISE**2 * torch.eye(3 * SIZE**2, dtype=torch.float64)
        covariances.append(covariance[pixels][:, pixels])
        crosses.append((scene @ blur.T)[sharp][:, pixels])
    errors, filters = [], []
    for index in range(4):
        group = slice(index // (4 // groups) * (4 // groups), (index // (4 // groups) + 1) * (4 // groups))
        mean, cross = torch.stack(covariances[group]).mean(0), torch.stack(crosses[group]).mean(0)
        best = torch.linalg.solve(mean, cross.T).T
        left = scene[sharp][:, sharp] - 2 * best @ crosses[index].T + best @ covariances[index] @ best.T
        errors.append(left.diag())
        filters.append(best)
    torch.testing.assert_close(
        local_error(psf, NOISE, support, groups), torch.stack(errors), rtol=1e-6, atol=0
    )
    made = local_filters(psf, support, groups, NOISE)
    step = 4 // groups
    torch.testing.assert_close(
        made.reshape(groups, 3, -1), torch.stack(filters[::step]), rtol=2e-2, atol=2e-3
    )  # on a longer period


def test_wiener_error_is_that_of_a_dense_filter_for_one_depth() -> None:
    psf, scene = _psfs(1), _scene()
    blur = _blur(psf[0])
    for channel in range(3):
        part = slice(channel * SIZE**2, (channel + 1) * SIZE**2)
        one, matrix = scene[part, part], blur[part, part]
        covariance = matrix @ one @ matrix.T + NOISE**2 * torch.eye(SIZE**2, dtype=torch.float64)
        left = one - one @ matrix.T @ torch.linalg.solve(covariance, matrix @ one)
        expected = left.diag().mean()
        assert float(wiener_error(psf, NOISE)[0, channel]) == pytest.approx(float(expected), rel=1e-6)


@pytest.mark.parametrize("groups", [1, 2, 4])
def test_colour_error_is_that_of_dense_filters_of_all_pixels_and_colours(
    groups: int, mixed: bool, blurs: list[Tensor], scene: Tensor
) -> None:
    narrow = _psfs(4, mixed)
    psf = torch.zeros(*narrow.shape[:-2], SIZE, SIZE, dtype=torch.float64)
    corner = SIZE // 2 - WINDOW // 2
    psf[..., corner : corner + WINDOW, corner : corner + WINDOW] = narrow
    noise = NOISE**2 * torch.eye(3 * SIZE**2, dtype=torch.float64)
    level = torch.full((SIZE**2, SIZE**2), 1 / SIZE**2, dtype=torch.float64)
    without_mean = torch.eye(3 * SIZE**2, dtype=torch.float64) - torch.block_diag(level, level, level)
    each = 4 // groups
    expected = []
    for index, blur in enumerate(blurs):
        group = blurs[index // each * each : (index // each + 1) * each]
        covariance = torch.stack([one @ scene @ one.T + noise for one in group]).mean(0)
        cross = torch.stack([scene @ one.T for one in group]).mean(0)
        best = torch.linalg.solve(covariance, cross.T).T
        own = blur @ scene @ blur.T + noise
        left = scene - best @ blur @ scene - (best @ blur @ scene).T + best @ own @ best.T
        error = (without_mean @ left @ without_mean).diag()
        expected.append(error.reshape(3, -1).mean(1))
    torch.testing.assert_close(colour_error(psf, NOISE, groups), torch.stack(expected), rtol=1e-6, atol=0)


def test_colour_error_is_below_that_of_filters_of_few_pixels() -> None:
    psf = _psfs(4)
    assert float(colour_error(psf, NOISE).mean()) < float(local_error(psf, NOISE, 5).mean())


def test_a_filter_for_fewer_depths_and_more_pixels_leaves_less() -> None:
    psf = _psfs(8)
    by_groups = [float(local_error(psf, NOISE, 5, groups).mean()) for groups in (1, 2, 4, 8)]
    by_support = [float(local_error(psf, NOISE, support).mean()) for support in (1, 3, 5, 7)]
    assert by_groups == sorted(by_groups, reverse=True)
    assert by_support == sorted(by_support, reverse=True)


def test_mean_psfs_are_the_mean_over_masks_that_err() -> None:
    optics = _optics("paper-clear", 32)
    height = torch.full((239, 239), 0.6e-6)
    depths = torch.tensor([0.7], dtype=torch.float64)
    generator = torch.Generator().manual_seed(1)
    drawn = [
        optics.with_mask(MaskMaps(height + 60e-9 * torch.randn(height.shape, generator=generator))).psfs(
            depths
        )
        for _ in range(100)
    ]
    mean = torch.stack(drawn).mean(0)
    found = optics.with_mask(MaskMaps(height)).psfs(depths, height_noise=60e-9)
    peak = found.amax((-1, -2))
    torch.testing.assert_close(mean.amax((-1, -2)), peak, rtol=0.01, atol=0)
    torch.testing.assert_close(
        mean[..., :8, :].sum((-1, -2)), found[..., :8, :].sum((-1, -2)), rtol=0.05, atol=0
    )


def test_design_lowers_the_error_and_repeats_itself() -> None:
    optics = _optics("paper-clear", 32)
    maps = []
    for _ in range(2):
        mask = FreeHeight(torch.full((239, 239), 0.6e-6), 1.2e-6, 1.3e-7)
        depths = torch.linspace(0, 2, 5, dtype=torch.float64)
        with torch.no_grad():
            before = (
                local_error(optics.with_mask(MaskMaps(mask())).psfs(depths, height_noise=40e-9))
                .mean(1)
                .log()
                .mean()
            )
        settings = {"height_noise": 40e-9, "truncated_energy": 0.5, "seed": 3}
        design(mask, optics, 12, (0.0, 2.0), error=_for_one_filter, **settings)
        with torch.no_grad():
            after = (
                local_error(optics.with_mask(MaskMaps(mask())).psfs(depths, height_noise=40e-9))
                .mean(1)
                .log()
                .mean()
            )
        assert float(after) < float(before) - 0.1
        maps.append(mask().detach())
    assert torch.equal(*maps)


def test_a_mask_is_designed_for_filters_of_each_distance() -> None:
    """Judged apart from the steps, at other depths."""
    optics = _optics("paper-clear", 48)
    mask = FreeHeight(torch.full((239, 239), 0.6e-6), 1.2e-6, 1.3e-7)
    depths = torch.linspace(0, 2, 8, dtype=torch.float64)

    def judged() -> float:
        with torch.no_grad():
            psf = optics.with_mask(MaskMaps(mask())).psfs(depths, height_noise=40e-9)
            return float(colour_error(psf, groups=4).mean(1).log().mean())

    before = judged()
    design(
        mask,
        optics,
        12,
        (0.0, 2.0),
        error=lambda psf, filters: colour_error(psf, groups=filters),
        groups=4,
        height_noise=40e-9,
        truncated_energy=0.5,
        seed=3,
    )
    assert judged() < before - 0.1


def test_a_mask_gains_most_where_most_is_lacking() -> None:
    """In light of all wavelengths, from a mask that has a shape: two wishes, and the mean."""
    optics = _optics("paper-clear", 32)
    place = torch.linspace(-1, 1, 239)
    start = (0.6 + 0.4 * (place**3 + place[:, None] ** 3) / 2) * 1e-6
    ends = torch.tensor([0.0, 2.0], dtype=torch.float64)
    found = []
    for wanted in ((), ((0.0, 40.0), (0.6, 10.0), (2.0, 10.0)), ((0.0, 10.0), (1.4, 10.0), (2.0, 40.0))):
        mask = FreeHeight(start, 1.2e-6, 1.3e-7)
        settings = {"height_noise": 40e-9, "truncated_energy": 0.5, "seed": 3}
        design(
            mask, optics, 8, (0.0, 2.0), error=_for_one_filter, broadband=True, wanted_db=wanted, **settings
        )
        with torch.no_grad():
            psf = optics.with_mask(MaskMaps(mask())).psfs(ends, True, 40e-9)
        found.append(-10 * local_error(psf, groups=2).mean(1).log10())
        assert float((mask() - start).detach().std()) < 60e-9  # it went on from the start
    mean, far, near = found
    assert float(far[0]) > float(mean[0]) + 0.1 and float(near[1]) > float(mean[1]) + 0.1, found


def test_wishes_must_ascend() -> None:
    with pytest.raises(ValidationError, match="must ascend"):
        DoeTable(design_wanted_db=((1.0, 28.0), (0.5, 27.0)))


def test_a_few_shifted_wavelengths_stand_for_the_whole_response() -> None:
    optics = _optics("paper-clear", 48)
    depths = torch.tensor([0.0, 0.7, 1.6], dtype=torch.float64)
    height = torch.full((239, 239), 0.6e-6)
    shifted = [optics.with_mask(MaskMaps(height)).psfs(depths, True, 30e-9, (n + 0.5) / 8) for n in range(8)]
    bands = torch.linspace(420e-9, 720e-9, 61, dtype=torch.float64)
    fine = replace(optics, camera=optics._sampled(bands, depths))
    weights = response(fine.camera, bands).float()
    many = torch.stack(
        [
            mean_psfs(fine.camera.with_height(height), one[None], depths, 30e-9, window_px=48)[:, 0]
            for one in bands
        ]
    )
    expected = torch.einsum("cb,bdyx->dcyx", weights, many)
    found = torch.stack(shifted).mean(0)
    assert float((found.sum(2) - expected).norm() / expected.norm()) < 0.02
    by_colour = torch.einsum("cb,bdyx->dcyx", colour_weights(bands, weights), many).unflatten(1, (3, 3))
    assert float((found - by_colour).norm() / by_colour.norm()) < 0.05


def test_a_sensor_of_three_lines_has_no_other_light() -> None:
    optics = _optics("paper-clear", 48, response="lines")
    with pytest.raises(InputError, match=r"sensor\.response"):
        optics.with_mask(MaskMaps(torch.zeros(239, 239))).psfs(torch.tensor([1.0]), True)


@pytest.mark.parametrize("name", ["clear-dcnn", "rings-dcnn", "cubic-dcnn", "paper-dcnn"])
def test_the_closed_form_predicts_a_trained_network(name: str) -> None:
    """A trained D-CNN restores what a linear filter of its kind could, and about a constant more. Over depth
    both rise and fall together; by the learned mask they hardly do, so that only the constant is asked, and
    by the cubic mask less than by others: the closed form of rings or of no mask has 0.8 with it."""
    checkpoint = load_checkpoint(name)
    camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
    optics = TrainingCamera(camera, 96, torch.device("cpu"))
    depths = torch.linspace(0, 2, 9, dtype=torch.float64)
    psf = optics.psfs(depths)
    predicted = -10 * local_error(psf).mean(1).log10()
    sharp = central_patches(packaged_images(128), 3, 128, surroundings(96))[0]
    generator, found = torch.Generator().manual_seed(0), []
    for index in range(len(depths)):
        planes = Planes(sharp, depths[index].expand(3), psf[index].expand(3, -1, -1, -1))
        captured = planes.photograph(optics)
        photo = captured.clean + 0.005 * torch.randn(captured.clean.shape, generator=generator)
        restored = torch.stack([apply_network(checkpoint.network, one) for one in photo])
        error = (restored - captured.ideal).square().mean((1, 2, 3))
        found.append(float((-10 * error.log10()).mean()))
    reached = torch.tensor(found, dtype=torch.float64)
    more = reached - predicted.double()
    if name == "paper-dcnn":
        assert float(more.min()) > 0 and float((more - more.mean()).abs().max()) < 1.25
    else:
        together = float(torch.corrcoef(torch.stack([predicted.double(), reached]))[0, 1])
        assert together > (0.9 if name == "cubic-dcnn" else 0.95)


def _for_one_filter(psf: Tensor, filters: int) -> Tensor:
    assert filters == 1
    return local_error(psf)


def _optics(camera: str, window: int, **sensor: str) -> TrainingCamera:
    recipe = load_camera(camera).recipe
    recipe = recipe.model_copy(update={"sensor": recipe.sensor.model_copy(update=sensor)})
    mask = {"kind": "height-map", "pitch_um": 21.0}
    psf = {"window_px": window, "pupil_sampling_um": 21.0}
    made = type(recipe).model_validate(
        recipe.model_dump(mode="json", by_alias=True) | {"mask": mask, "psf": psf}
    )
    return TrainingCamera(Camera.from_recipe(made, Path()), window, torch.device("cpu"))
