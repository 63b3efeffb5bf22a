"""What another package adds by an entry point works from a recipe as if it were ours: `tests/example_package`
adds one of each kind."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

from edofsim import plugins
from edofsim.capture import Fidelity, capture
from edofsim.capture.fidelity import simpler_camera
from edofsim.capture.sensor import noise_deviation, record, sensor_effects
from edofsim.cli import invoke
from edofsim.errors import InputError
from edofsim.learn.trainer import train
from edofsim.optics import Camera, psf_bank
from edofsim.plan import EFFECTS, parse_target, plan_photo
from edofsim.plugins import SensorEffect, Signal
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.kinds import MASKS, OBJECTS
from edofsim.recipe.load import load_camera, load_scene, load_train
from edofsim.render import render
from edofsim.render.keys import view_key
from edofsim.render.view import View
from edofsim.restore import restore
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.network import apply_network
from edofsim.restore.wiener import wiener
from edofsim.scene import build_scene, solids

GREEN = 543e-9


def camera_of(tmp_path: Path, text: str) -> Camera:
    path = tmp_path / "camera.toml"
    path.write_text(f'name = "example"\n{text}\n[psf]\nwindow_px = 32\n')
    loaded = load_camera(path)
    return Camera.from_recipe(loaded.recipe, loaded.base)


def test_a_mask(installed: Path, tmp_path: Path):
    """u^4 + v^4 is rho^4 (3 + cos 4 angle) / 4: of Noll's polynomials (table I of his paper), rho^4 is a
    mixture of 1, 4 and 11, and rho^4 cos 4 angle a part of 14."""
    camera = camera_of(tmp_path, '[mask]\nkind = "quartic"\nalpha_rad = 8.0')
    # Z4 = sqrt(3) (2 rho^2 - 1), Z11 = sqrt(5) (6 rho^4 - 6 rho^2 + 1), Z14 = sqrt(10) rho^4 cos 4 angle
    terms = [(4, 3 / 3**0.5), (11, 1 / 5**0.5), (14, 2 / 10**0.5)]
    known = {"kind": "zernike", "terms": [{"noll": noll, "rms_rad": rms} for noll, rms in terms]}
    other = Camera.from_recipe(CameraRecipe(name="known", mask=known, psf={"window_px": 32}))
    ours, theirs = (psf_bank(c, [GREEN], [0.4], dtype=torch.float64).values for c in (camera, other))
    assert float((ours - theirs).norm() / theirs.norm()) < 1e-6


DARK = '{ kind = "dark-current", electrons = 900, full_well_electrons = 10000 }'
GREY = torch.full((3, 48, 48), 0.5)


def grey_view(camera: Camera) -> View:
    bands = [450e-9, 550e-9, 650e-9]
    return View.flat(GREY, 0.7, margin=16, pixel_angle=camera.pixel_angle, wavelengths=bands)


def test_an_effect_of_plans_with_a_level_in_between(installed: Path, tmp_path: Path):
    """In full, the dark current's mean alone, and without it: what each leaves out is that of n electrons of
    N, of their noise, and of their mean, too. A file names what was left out, and cannot bring it back."""
    camera = camera_of(tmp_path, f"[sensor]\nread_noise = 0.0\nexposure = 1.0\neffects = [{DARK}]")
    view, target = grey_view(camera), parse_target("60dB", None)
    kept, left = (plan_photo(view, camera, {"without": names}, target) for names in ([], ["dark current"]))
    (row,) = [each for each in kept.decisions if each.effect == "dark current"]
    assert row.called_for and row.error == pytest.approx((0.09 * (1 + 1 / 900) ** 0.5,) * 3, rel=1e-6)
    full, between, none = (
        capture(view, camera, fidelity)
        for fidelity in (kept.fidelity, Fidelity().changed(EFFECTS["dark current"].levels(None)[1].change),
                         left.fidelity.changed({"layers": 1}))
    )  # fmt: skip
    assert torch.equal(none.image, none.clean)
    torch.testing.assert_close(between.image, between.clean + 0.09)
    noise = full.image - full.clean - 0.09
    assert float(noise.square().mean()) == pytest.approx(9e-6, rel=5 * (2 / noise.numel()) ** 0.5)
    with pytest.raises(InputError, match="simplifications of other packages.*--without EFFECT"):
        Fidelity.load(left.fidelity.save(tmp_path / "fidelity.json"))


class DarkLevel(SensorEffect):
    """Adds a level, relative to full scale."""

    kind: Literal["dark-level"] = "dark-level"
    level: float

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        return Signal(signal.image + self.level, signal.seen)


@pytest.mark.usefixtures("registered_for_a_test")
def test_a_sensor_effect_is_left_out_by_its_kind(tmp_path: Path):
    """It needs no effect of plans of its own: the plan has one, whose error is what it adds; a file keeps
    what is left out. What the recipe lists is in the image and not in the noise-free photo."""
    plugins.register(DarkLevel)
    text = '[sensor]\nread_noise = 0.0\nexposure = 1.0\neffects = [{ kind = "dark-level", level = 0.02 }]'
    camera = camera_of(tmp_path, text)
    view, target = grey_view(camera), parse_target("60dB", None)
    photo = capture(view, camera)
    torch.testing.assert_close(photo.image, photo.clean + 0.02)
    kept, left = (plan_photo(view, camera, {"without": names}, target) for names in ([], ["dark-level"]))
    (row,) = [each for each in kept.decisions if each.effect == "dark-level"]
    assert row.called_for and row.error == pytest.approx((0.02,) * 3, rel=1e-4)
    assert [effect.kind for effect in sensor_effects(camera, kept.fidelity)] == ["dark-level"]
    assert sensor_effects(camera, left.fidelity) == ()
    again = Fidelity.load(left.fidelity.save(tmp_path / "fidelity.json"))
    assert again == left.fidelity and sensor_effects(camera, again) == ()
    with pytest.raises(InputError, match="dark-levels"):
        plan_photo(view, camera, {"without": ["dark-levels"]}, target)


def test_a_sensor_effect_before_the_converter_counts_in_all_noise(installed: Path, tmp_path: Path):
    """What is added before the converter is in whole steps of it behind; and plans, Wiener deconvolution and
    networks reckon with its variance, n / N^2 for n of N electrons."""
    camera = camera_of(tmp_path, f"[sensor]\nread_noise = 0.004\nbits = 5\neffects = [{DARK}]")
    assert [effect.kind for effect in sensor_effects(camera)] == [
        "read-noise",
        "dark-current",
        "quantisation",
    ]
    image = record(torch.full((3, 40, 40), 0.4), sensor_effects(camera), 1)
    torch.testing.assert_close(31 * image, (31 * image).round(), rtol=0, atol=1e-4)
    assert float(image.mean()) == pytest.approx(0.49, abs=0.01)
    variance = 0.004**2 + 900 / 10000**2 + 1 / 31**2 / 12
    assert noise_deviation(camera) == pytest.approx(variance**0.5, rel=1e-9)
    assert sensor_effects(camera, Fidelity(quantisation=False))[-1].kind != "quantisation"
    photo, psfs = torch.rand(3, 40, 40, generator=torch.Generator().manual_seed(1)), torch.zeros(1, 3, 9, 9)
    psfs[..., 3:6, 3:6] = 1 / 9
    nodes = torch.tensor([0.5])
    restored, by = restore(photo, camera, torch.tensor([450e-9, 550e-9, 650e-9]), nodes, psfs=psfs)
    torch.testing.assert_close(restored, wiener(photo, psfs[0], variance**0.5))


def test_a_module_is_tried_without_installing_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "mine.py").write_text(
        "from typing import Literal\nfrom edofsim.plugins import SmoothMask\n\n\n"
        "class Mine(SmoothMask):\n    kind: Literal['mine'] = 'mine'\n\n"
        "    def wavefront(self, u, v):\n        return 5 * u**3\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv("EDOFSIM_PLUGINS", "mine")
    MASKS.look_again()
    try:
        assert camera_of(tmp_path, '[mask]\nkind = "mine"').mask.kind == "mine"
        (tmp_path / "hers.py").write_text("from mine import Mine as Other")
        monkeypatch.setenv("EDOFSIM_PLUGINS", "hers")
        MASKS.look_again()
        assert MASKS.place("mine") == "mine:Mine" and len(MASKS.code_of("mine")) == 64
        monkeypatch.setenv("EDOFSIM_PLUGINS", "no_such_module")
        MASKS.look_again()
        with pytest.raises(InputError, match="EDOFSIM_PLUGINS=no_such_module: cannot be imported"):
            camera_of(tmp_path, '[mask]\nkind = "mine"')
    finally:
        monkeypatch.undo()
        MASKS.look_again()


def test_all_that_plugins_build_on_is_there():
    assert "SensorEffect" in dir(plugins) and all(getattr(plugins, name) for name in dir(plugins))
    with pytest.raises(AttributeError, match="no 'Nothing'; there is AnySurface"):
        _ = plugins.Nothing


def test_a_lens(installed: Path, tmp_path: Path):
    """A tenth of a wave of rho^4, whose variance over the pupil is 4/45 of its square, takes
    1 - exp(-(2 pi)^2 variance) of the light at the middle of a PSF (Marechal), and all of it comes back when
    a photo is simulated without spherical aberration."""
    text = '[lens]\nkind = "seidel"\nfocal_length_mm = 20\nf_number = 8\nwavelength_nm = 543\nwaves = {}\n'
    sensor = "[sensor]\npixel_um = 0.5\n"
    plain, bent = (camera_of(tmp_path, text.format(waves) + sensor) for waves in (0.0, 0.1))
    simpler = simpler_camera(bent, Fidelity(spherical_aberration=False))
    peaks = [float(psf_bank(each, [GREEN], [1 / 1.5]).values.max()) for each in (plain, bent, simpler)]
    assert peaks[1] / peaks[0] == pytest.approx(math.exp(-((2 * math.pi * 0.1) ** 2) * 4 / 45), abs=2e-3)
    assert peaks[2] == pytest.approx(peaks[0], rel=1e-5)


SCENE = """\
name = "example"
lights = [{ kind = "environment" }]

[[objects]]
kind = "pyramid"
width_mm = 30
height_mm = 60
depth_m = 0.8
"""


def test_a_builder(installed: Path, tmp_path: Path):
    """A pyramid holds a third of its base times its height; its code is part of the key of its view."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    loaded = load_scene(path)
    (pyramid,) = build_scene(loaded.recipe, loaded.base).objects
    assert solids.signed_volume(pyramid.mesh) == pytest.approx(0.03**2 * 0.06 / 3, rel=1e-5)
    assert pyramid.mesh.vertices[:, 2].mean() == pytest.approx(0.8)
    key = view_key(loaded.recipe, loaded.base)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(OBJECTS), "code_of", lambda self, name: "other code")
        assert view_key(loaded.recipe, loaded.base) != key


def test_a_reader_of_scenes(installed: Path, tmp_path: Path):
    """A light field of a plane whose texture moves by 3 pixels from camera to camera: the plane's depth is
    the baseline over 3 pixels' tangent."""
    texture = np.random.default_rng(0).random((20, 40))
    pictures = np.stack([np.roll(texture, -3 * k, 1) for k in (-1, 0, 1)])
    np.savez(tmp_path / "field.npz", pictures=pictures, baseline_mm=2.0)
    (tmp_path / "scene.toml").write_text(
        """\
        name = "example"
        frame = { width_px = 16, height_px = 12, margin_px = 2, pixel_angle_mrad = 0.5 }
        bands = { count = 3 }
        source = { kind = "light-field", path = "field.npz" }
        """
    )
    loaded = load_scene(tmp_path / "scene.toml")
    view = render(loaded.recipe, loaded.base, cache=tmp_path / "cache")
    assert 1 / view.mean_inverse_depth().mean() == pytest.approx(2e-3 / (3 * 0.5e-3))
    np.testing.assert_allclose(view.all_in_focus()[1, 2:-2, 2:-2], texture[4:16, 12:28], rtol=1e-6)
    with pytest.raises(InputError, match="light field 'none.npz'"):
        gone = loaded.recipe.source.model_copy(update={"path": "none.npz"})
        render(loaded.recipe.model_copy(update={"source": gone}), loaded.base)


TRAINING = """\
name = "example"
camera = "paper-clear"

[network]
kind = "unsharp-mask"
settings = { width = 7 }

[psf]
window_px = 32

[data]
patch_px = 32
validation_patches = 2
sources = [{ kind = "noise" }]

[optimiser]
steps = 2
batch = 2
learning_rate = 0.01
"""


def test_a_network_and_a_reader_of_training_data(installed: Path, tmp_path: Path):
    """Two steps of Adam move its one weight by the learning rate each at most; it was told a PSF before them,
    and its checkpoint restores a photo, in tiles as whole."""
    path = tmp_path / "train.toml"
    path.write_text(TRAINING)
    trained = train(load_train(path), tmp_path / "out")
    network = load_checkpoint(trained.checkpoint).network
    assert load_checkpoint(trained.checkpoint).card["data"]["sources"] == [{"kind": "noise"}]
    moved = float(network.strength.detach()) - 0.5
    assert network.kind == "unsharp-mask" and 0 < abs(moved) <= 0.021
    assert torch.allclose(network.psf.sum((-1, -2)), torch.ones(3, 1)) and network.psf.shape[-1] == 7
    photo = torch.rand(3, 40, 50, generator=torch.Generator().manual_seed(1))
    whole, tiles = (apply_network(network, photo, tile=tile) for tile in (512, 16))
    assert torch.allclose(whole, tiles, atol=1e-6)
    path.write_text(TRAINING.replace("unsharp-mask", "unsharp-musk"))
    with pytest.raises(InputError, match="line 5.*'unsharp-musk'; did you mean 'unsharp-mask'"):
        load_train(path)


def test_its_mistakes_are_told_like_ours(installed: Path, tmp_path: Path):
    with pytest.raises(InputError) as refused:
        camera_of(tmp_path, '[mask]\nkind = "quartic"\nalfa_rad = 8.0')
    (only,) = refused.value.problems
    assert "line 4" in only and "did you mean 'alpha_rad'" in only


def test_the_command_line_finds_what_is_installed(
    site: Path,
    installed: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
):
    """The list of experiments by a process of its own, the other commands in this one."""
    recipe = 'name = "example"\n[mask]\nkind = "quartic"\n[psf]\nwindow_px = 16\n'
    (tmp_path / "camera.toml").write_text(recipe)
    monkeypatch.chdir(tmp_path)
    path = os.pathsep.join([str(site), str(installed), *sys.path])
    run = [sys.executable, "-c", "from edofsim.cli import invoke; invoke(['evaluate', '--help'])"]
    done = subprocess.run(run, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "width  " in done.stdout

    def said(*words: str) -> str:
        invoke([*words])
        return capfd.readouterr().out

    assert "QuarticMask" in said("schema", "camera")
    listed = said("list", "plugins")
    assert "mask quartic" in listed and "edofsim_example.plan_effect:EFFECT" in listed
    assert "experiment width" in listed and "cubic" not in listed
    assert "width  " in said("evaluate", "--help")
    assert "--depth" in said("evaluate", "width", "--help")
    said("psf", "camera.toml", "--out", "out")
    assert (tmp_path / "out" / "psf.csv").exists()
    said("evaluate", "width", "--camera", "camera.toml", "--depth", "0.5", "--out", "width")
    assert (tmp_path / "width" / "width.html").exists()
    assert json.loads((tmp_path / "width" / "width.json").read_text())["figures"]["width_um"] > 6


def test_an_unknown_kind_is_told_the_nearest_and_all(installed: Path, tmp_path: Path):
    with pytest.raises(InputError, match="unknown kind 'quartik'; did you mean 'quartic'"):
        camera_of(tmp_path, '[mask]\nkind = "quartik"')


def test_ours_keep_their_names_and_others_are_told_apart_by_their_code(installed: Path):
    assert MASKS["cubic"].__module__ == "edofsim.optics.masks.cubic" and MASKS.code_of("cubic") == ""
    assert len(MASKS.code_of("quartic")) == 64
    with pytest.raises(InputError, match="unknown mask 'quartik'; did you mean 'quartic'"):
        MASKS["quartik"]


def test_a_package_that_cannot_be_imported_is_named_where_it_is_used_and_only_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    told = tmp_path / "site" / "broken-1.0.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    points = "[edofsim.masks]\nbroken = no_such_module:Mask\nnumber = math:pi\n"
    (told / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    MASKS.look_again()
    try:
        assert camera_of(tmp_path, '[mask]\nkind = "cubic"').mask.kind == "cubic"
        with pytest.raises(InputError, match="'broken' of another package cannot be loaded"):
            camera_of(tmp_path, '[mask]\nkind = "broken"')
        with pytest.raises(InputError, match="'number' of another package is no Mask: math:pi is 3.14"):
            camera_of(tmp_path, '[mask]\nkind = "number"')
    finally:
        monkeypatch.undo()
        MASKS.look_again()
