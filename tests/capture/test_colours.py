"""Pictures in the colours that the eye sees: the colour checker of `desk`, judged by CIE Delta E 2000.

The truth uses no code of the package: patches, observer and Delta E are colour-science's.
"""

from __future__ import annotations

from pathlib import Path

import colour
import numpy as np
import pytest
import torch
from colour import SDS_COLOURCHECKERS

import edofsim
from edofsim.capture import Fidelity, capture, ideal_image
from edofsim.capture.files import read_colour_matrix
from edofsim.capture.photograph import colours_of
from edofsim.core.images import developed
from edofsim.optics import response
from edofsim.recipe import load_scene
from edofsim.render import render
from edofsim.scene import build_scene
from edofsim.scene.spectra import color_checker

pytestmark = pytest.mark.filterwarnings("ignore::colour.utilities.ColourRuntimeWarning")
D65 = np.array([0.3127, 0.3290])
SHAPE = colour.SpectralShape(380, 780, 5)
SMALLER = 2
"""Pixels of the desk per pixel of the test."""


def lab(linear: np.ndarray) -> np.ndarray:
    """Linear sRGB [..., 3] in CIE Lab under D65."""
    return colour.XYZ_to_Lab(colour.sRGB_to_XYZ(linear, apply_cctf_decoding=False), D65)


def patches_by_the_eye(light: colour.SpectralDistribution) -> np.ndarray:
    """CIE Lab [24, 3] of the measured patches in a light, to an eye that is adapted to it (Bradford)."""
    eye = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(SHAPE)
    light = light.copy().align(SHAPE)
    white = colour.sd_to_XYZ(colour.sd_ones(SHAPE), eye, light)
    found = []
    for patch in SDS_COLOURCHECKERS["ColorChecker N Ohta"].values():
        xyz = colour.sd_to_XYZ(patch.copy().align(SHAPE), eye, light)
        seen = colour.chromatic_adaptation(xyz, white, colour.xy_to_XYZ(D65) * 100, transform="Bradford")
        found.append(colour.XYZ_to_Lab(seen / 100, D65))
    return np.array(found)


def errors(linear: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Delta E 2000 [24] of patches in linear sRGB [24, 3], exposed so that their mean lightness is right."""
    low, high = 0.2, 5.0
    for _ in range(40):
        gain = (low * high) ** 0.5
        low, high = (gain, high) if lab(linear * gain)[:, 0].mean() < truth[:, 0].mean() else (low, gain)
    return colour.delta_E(lab(linear * gain), truth, method="CIE 2000")


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, torch.Tensor]:
    """Means of the 24 patches in the ideal image of the small desk, [24, 3], and its colours."""
    loaded = load_scene("desk")
    camera = edofsim.camera("paper-clear")
    recipe = loaded.recipe.seen_at(camera.pixel_angle * SMALLER)
    frame = recipe.frame
    size = {"width_px": frame.width_px // SMALLER, "height_px": frame.height_px // SMALLER, "margin_px": 0}
    recipe = recipe.model_copy(
        update={
            "frame": frame.model_copy(update=size),
            "render": recipe.render.model_copy(update={"samples": 16, "hidden": False}),
        }
    )
    view = render(recipe, loaded.base, cache=tmp_path_factory.mktemp("cache"))
    image = view.crop_margin(ideal_image(view, camera))
    colours = colours_of([view], response(camera, view.wavelengths))
    assert colours is not None
    names = list(color_checker(view.wavelengths.numpy()))
    meshes = {each.name: each.mesh for each in build_scene(recipe, loaded.base).objects}
    means = []
    for name in names:
        corners = next(
            mesh for key, mesh in meshes.items() if key == f"color checker/{name}"
        ).vertices.astype(float)
        middle = corners.mean(0)
        spot = middle + 0.5 * (corners - middle)  # half of the patch: its border mixes with the card
        x = spot[:, 0] / spot[:, 2] / view.pixel_angle + view.width / 2
        y = view.height / 2 - spot[:, 1] / spot[:, 2] / view.pixel_angle
        part = image[:, round(y.min()) : round(y.max()), round(x.min()) : round(x.max())]
        assert part[0].numel() >= 9
        means.append(part.flatten(1).mean(1))
    return torch.stack(means).T.double().numpy(), colours


def lamp() -> colour.SpectralDistribution:
    return colour.SDS_ILLUMINANTS["LED-B3"]


def test_the_colour_checker_of_the_desk_has_its_colours(desk):
    sensor, colours = desk
    truth = patches_by_the_eye(lamp())
    shown = developed(torch.from_numpy(sensor)[:, :, None], colours)[..., 0].numpy().T
    assert errors(shown, truth).mean() < 4
    assert errors(sensor.T, truth).mean() > 6  # so that without the matrix the line above fails


def test_white_is_balanced_in_any_light():
    picture = np.full((8, 8, 3), 200, np.uint8)
    for light in ("D65", "A", "LED-B3"):
        view = edofsim.View.from_image(picture, 1.5, illuminant=light)
        camera = edofsim.camera("paper-clear")
        photo = capture(view, camera, Fidelity(layers=1, sub_apertures=1))
        shown = developed(photo.ideal, photo.colours).mean((1, 2))
        assert torch.allclose(shown, shown.mean().expand(3), rtol=2e-3), (light, shown)


def test_a_picture_keeps_its_colours():
    """The patches as a picture in daylight: their sRGB values come back, within what the sensor can tell."""
    nm = np.arange(420, 721, 10) * 1e-9
    truth = patches_by_the_eye(colour.SDS_ILLUMINANTS["D65"])
    linear = colour.XYZ_to_sRGB(colour.Lab_to_XYZ(truth, D65), apply_cctf_encoding=False).clip(0, 1)
    view = edofsim.View.from_image(colour.cctf_encoding(linear)[None], 2.0, wavelengths=nm)
    photo = capture(view, edofsim.camera("paper-clear"), Fidelity(layers=1, sub_apertures=1))
    shown = developed(photo.ideal, photo.colours)[:, 0].T.double().numpy()
    assert errors(shown, truth).mean() < 4
    assert errors(photo.ideal[:, 0].T.double().numpy(), truth).mean() > 6


def test_files_say_how_their_colours_were_made(tmp_path: Path):
    generator = np.random.default_rng(3)
    picture = (60 + 120 * generator.random((12, 16, 3))).astype(np.uint8)
    view = edofsim.View.from_image(picture, 1.5)
    photo = capture(view, edofsim.camera("paper-clear"), Fidelity(layers=1, sub_apertures=1))
    assert photo.colours is not None
    for name in ("photo.png", "photo.exr"):
        stated = read_colour_matrix(photo.save(tmp_path / name))
        assert stated is not None and torch.allclose(stated, photo.colours)
    back = edofsim.read_image(tmp_path / "photo.png")
    inside = (developed(photo.image, photo.colours) > 0).all(0) & (
        developed(photo.image, photo.colours) < 1
    ).all(0)
    assert inside.float().mean() > 0.3
    assert (back - photo.image)[:, inside].abs().max() < 0.01
    raw = edofsim.read_image(edofsim.save_image(tmp_path / "raw.png", photo.image))
    assert (raw - photo.image.clamp(0, 1)).abs().max() < 0.01
