"""The public API: what `import edofsim` gives, that it takes no time, and that it agrees with the rooms."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import edofsim
from edofsim.recipe import load_scene
from edofsim.render.readers import picture_view

PAPER = {"window": 32, "read_noise": 0.0}


@pytest.fixture(scope="module")
def picture() -> tuple[np.ndarray, np.ndarray]:
    """An sRGB picture [24, 32, 3], uint8, and depths from 0.6 m to the background at infinity."""
    values = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    depth = np.full((24, 32), np.inf)
    depth[6:18, 8:24] = np.linspace(0.6, 2.0, 16)
    return values, depth


def test_importing_it_loads_nothing_slow_and_every_public_name_is_there():
    code = "import sys, edofsim; assert not {'torch', 'numpy', 'mitsuba'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
    for name in edofsim.__all__:
        assert edofsim.__getattr__(name) is getattr(edofsim, name)


def test_rooms_do_not_take_the_place_of_public_names():
    """A subpackage that is imported becomes an attribute of the package, and would hide a function."""
    rooms = {path.stem for path in Path(edofsim.__file__).parent.iterdir()}
    assert not rooms & set(edofsim.__all__)


def test_a_name_that_is_not_public_is_refused_with_those_that_are():
    with pytest.raises(AttributeError, match="photograph"):
        edofsim.nothing  # noqa: B018


def test_a_picture_with_depths_is_the_view_that_a_recipe_reads_of_its_files(picture, tmp_path: Path):
    from skimage.io import imsave

    rgb, depth = picture
    depth = depth.copy()
    depth[0, 0] = 0.0  # a hole
    imsave(tmp_path / "a.png", rgb, check_contrast=False)
    np.save(tmp_path / "z.npy", depth)
    recipe = tmp_path / "scene.toml"
    recipe.write_text(
        'name = "scene"\n[frame]\nwidth_px = 32\nheight_px = 24\nmargin_px = 5\n'
        '[source]\nkind = "rgbd"\nimage = "a.png"\n[source.depth]\npath = "z.npy"\n'
    )
    loaded = load_scene(recipe)
    read = picture_view(loaded.recipe, loaded.base)
    made = edofsim.View.from_image(rgb, depth, margin=5)
    assert (made.width, made.height, made.margin) == (32, 24, 5)
    assert torch.equal(made.radiance, read.radiance)
    assert torch.equal(made.inverse_depth, read.inverse_depth)
    assert made.pixel_angle == read.pixel_angle
    files = edofsim.View.from_image(tmp_path / "a.png", str(tmp_path / "z.npy"), margin=5)
    assert torch.equal(files.radiance, made.radiance) and torch.equal(files.inverse_depth, made.inverse_depth)


def test_a_depth_file_of_whole_numbers_is_in_millimetres(picture, tmp_path):
    """As `edofsim new scene` takes it, and as depth cameras write it."""
    from skimage.io import imsave

    rgb, _ = picture
    imsave(tmp_path / "z.png", np.full((24, 32), 800, np.uint16), check_contrast=False)
    view = edofsim.View.from_image(rgb, tmp_path / "z.png")
    assert float(view.inverse_depth.min()) == pytest.approx(1 / 0.8) == float(view.inverse_depth.max())


def test_a_white_picture_is_shown_white_and_grey_at_its_value(picture):
    """D65 light on white is what sRGB calls white; the mean of Mallett and Yuksel's basis keeps greys."""
    grey = np.full((8, 8, 3), 186, np.uint8)
    shown = edofsim.View.from_image(grey, 1.0, margin=2).picture()
    assert torch.allclose(shown, shown.mean().expand_as(shown), rtol=1e-4)
    red, green, blue = edofsim.View.from_image(np.eye(3)[None], 1.0, margin=0).picture()[:, 0].T
    assert red.argmax() == 0 and green.argmax() == 1 and blue.argmax() == 2


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (np.ones((3, 4)), "shape"),
        (np.zeros((24, 32)), "no depth"),
        (-1.0, "no depth"),
        (np.full((24, 32), 800), "unit is not known"),
    ],
)
def test_depths_that_are_none_are_refused(picture, depth, said: str):
    with pytest.raises(edofsim.InputError, match=said):
        edofsim.View.from_image(picture[0], depth)


def test_what_is_no_picture_says_what_to_give(picture, tmp_path):
    linear = np.moveaxis(picture[0] / 255, -1, 0)  # as `read_image` gives it
    with pytest.raises(edofsim.InputError, match="give the file"):
        edofsim.View.from_image(linear, 1.0)
    with pytest.raises(edofsim.InputError, match="nowhere.png"):
        edofsim.View.from_image(tmp_path / "nowhere.png", 1.0)


def test_a_camera_by_numbers_has_them():
    """f = 50 mm at f/4 has an aperture 12.5 mm across; focused at 2 m, the sensor lies at 1 / (1/f - 1/2)."""
    camera = edofsim.camera(focal_length=0.05, f_number=4, focus=2.0, pixel=5e-6, read_noise=0.01)
    assert camera.aperture_radius == pytest.approx(0.00625)
    assert camera.sensor_distance == pytest.approx(1 / (1 / 0.05 - 1 / 2.0))
    assert camera.pixel_angle == pytest.approx(5e-6 / camera.sensor_distance)
    assert camera.read_noise == 0.01


def test_numbers_change_a_named_camera_and_leave_the_rest():
    shipped, changed = edofsim.camera("paper-device"), edofsim.camera("paper-device", read_noise=0.02)
    assert changed.recipe.mask == shipped.recipe.mask
    assert changed.recipe.fabrication == shipped.recipe.fabrication
    assert changed.read_noise == 0.02 and changed.sensor_distance == shipped.sensor_distance


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"focal_length": 0.05}, "belong together"),
        ({"pixel": -1e-6}, "sensor.pixel_um"),
        ({"focus": 0.01}, "inside the focal length"),
        ({"height": np.zeros((3, 4))}, "square"),
        ({"pitch": 21e-6}, "give height"),
        ({"height": np.zeros((4, 4)), "network": "paper-dcnn"}, "one of them"),
    ],
)
def test_numbers_that_make_no_camera_are_refused(numbers: dict, said: str):
    with pytest.raises(edofsim.InputError, match=said):
        edofsim.camera(**numbers)


def test_a_height_map_of_numpy_is_the_mask():
    """A prism, thicker to the right as the sensor sees it, bends light there by (n - 1) times its slope.

    The point's image moves right by that times the sensor's distance, and so left in the upright picture."""
    pitch, slope, green = 21e-6, 2e-3, 543e-9
    across = (np.arange(239) - 119) * pitch
    height = np.broadcast_to(slope * across, (239, 239))
    flat = edofsim.camera(height=np.zeros((239, 239)), pitch=pitch, window=64)
    prism = edofsim.camera(height=height, pitch=pitch, window=64)
    index = float(prism.mask_material.index(green))

    def centre(camera: edofsim.Camera) -> float:
        psf = edofsim.psfs(camera, [1.5], [green]).values[0, 0].double()
        return float((psf.sum(0) * torch.arange(64)).sum() / psf.sum())

    moved = centre(prism) - centre(flat)
    assert moved == pytest.approx(-(index - 1) * slope * prism.sensor_distance / prism.pixel, rel=0.1)


def test_psfs_are_the_bank_of_inverse_depths():
    from edofsim.optics import psf_bank

    camera = edofsim.camera(**PAPER)
    ours = edofsim.psfs(camera, [0.5, float("inf")], [543e-9], window=16)
    assert torch.equal(ours.values, psf_bank(camera, [543e-9], [2.0, 0.0], window_px=16).values)
    with pytest.raises(edofsim.InputError, match="above 0"):
        edofsim.psfs(camera, [0.0], [543e-9])


def test_a_photo_is_what_capture_makes_of_its_fidelity_and_gradients_reach_the_height(picture):
    from edofsim.capture import capture

    height = torch.zeros(32, 32, requires_grad=True)
    camera = edofsim.camera(height=height, **PAPER)
    view = edofsim.View.from_image(*picture, margin=16, wavelengths=np.array([482e-9, 543e-9, 611e-9]))
    fidelity = edofsim.Fidelity(layers=3, occlusion="none")
    photo = edofsim.photograph(view, camera, fidelity)
    assert torch.equal(photo.clean, capture(view, camera, fidelity).clean)
    (grad,) = torch.autograd.grad(photo.clean.square().sum(), height)
    assert torch.isfinite(grad).all() and grad.abs().max() > 0


def test_a_view_of_other_pixels_is_refused_before_anything_is_planned(picture):
    view = edofsim.View.from_image(*picture, pixel_angle=1e-3)
    with pytest.raises(edofsim.InputError, match="mrad"):
        edofsim.photograph(view, edofsim.camera(**PAPER))


def test_pixels_beyond_the_frame_are_refused_before_anything_is_planned(picture):
    camera = edofsim.camera("paper-clear")
    view = edofsim.View.from_image(*picture, pixel_angle=camera.pixel_angle)
    beyond = dataclasses.replace(view, pixel=view.pixel + 10**9)
    with pytest.raises(edofsim.InputError, match="the view.s pixels go from"):
        edofsim.photograph(beyond, camera)


def test_a_plan_beside_an_accuracy_is_refused(picture):
    view = edofsim.View.from_image(*picture)
    with pytest.raises(edofsim.InputError, match="give a plan, or"):
        edofsim.photograph(view, edofsim.camera(**PAPER), edofsim.Fidelity(), accuracy="45dB")


@pytest.mark.usefixtures("conditioned_once", "filters_left_out")
def test_a_camera_with_a_mask_of_its_own_is_restored_by_the_network_for_any_not_by_another_masks():
    photo = torch.rand(3, 32, 32, generator=torch.Generator().manual_seed(0))
    named = edofsim.camera("paper-learned", window=32)
    own = named.with_height(torch.zeros(239, 239))
    how = {"wavelengths": [482e-9, 543e-9, 611e-9], "depths": (1.4, 1.7)}
    any_camera, wiener, anothers = (
        edofsim.restored(photo, own, network=network, **how)
        for network in ("universal", "wiener", "paper-dcnn")
    )
    found = edofsim.restored(photo, own, **how)
    assert torch.equal(found, any_camera)
    assert not torch.equal(found, wiener) and not torch.equal(found, anothers)
    by_own, linear = (edofsim.restored(photo, named, network=network, **how) for network in (None, "wiener"))
    assert not torch.equal(by_own, linear)
    with pytest.raises(edofsim.InputError, match="nearest"):
        edofsim.restored(photo, named, depths=(2.0, 1.0))


def test_everything_shows_itself_in_a_notebook_and_images_are_saved(picture, tmp_path: Path):
    from edofsim.capture import write_photo
    from edofsim.plan import Plan

    camera = edofsim.camera(**PAPER)
    view = edofsim.View.from_image(*picture, margin=16)
    photo = edofsim.photograph(view, camera, edofsim.Fidelity(layers=2, band_groups=1, group_wavelengths=1))
    for thing in (view, photo):
        assert thing._repr_png_().startswith(b"\x89PNG") and "<img" in thing._repr_html_()
        assert thing.show() is not None
    assert "paper-clear" in camera._repr_html_() and "0.6 to infinity" not in camera._repr_html_()
    assert "0.6 to infinity m" in view._repr_html_()
    assert "<table>" in Plan((), edofsim.Fidelity(), note="a < b")._repr_html_()
    assert "a &lt; b" in Plan((), edofsim.Fidelity(), note="a < b")._repr_html_()
    assert photo.save(tmp_path / "a.png").stat().st_size
    back = edofsim.read_image(photo.save(tmp_path / "a.exr"))
    assert torch.equal(back, photo.image)
    assert (tmp_path / "a.exr").read_bytes() == write_photo(tmp_path / "b.exr", photo).read_bytes()
    with pytest.raises(edofsim.InputError, match="exr"):
        photo.save(tmp_path / "a.gif")
    with pytest.raises(edofsim.InputError, match="shape"):
        edofsim.show(torch.zeros(2, 4, 4))
