"""What is a system of a comparison: cameras, networks, Wiener deconvolution and functions, any lens."""

from __future__ import annotations

import json
import math
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from edofsim import console
from edofsim.cli import app
from edofsim.errors import InputError
from edofsim.experiments import protocols
from edofsim.experiments.mtf import camera_curves, depths_of, frequencies_of
from edofsim.experiments.protocols import LENS_ALONE, WAYS, System, capture_restored, converged_db
from edofsim.experiments.restorations import ByWiener, ByWienerOfDepth
from edofsim.experiments.sources import system_of
from edofsim.optics import Camera
from edofsim.recipe import CameraRecipe, load_camera
from edofsim.render.view import View
from edofsim.restore.functions import PhotoInfo, load_function
from edofsim.restore.scores import psnr

NONE = next(way for way in WAYS if way.name == "none")


def lens(
    focal_mm: float, f_number: float, pixel_um: float, window: int = 96, name: str = "own"
) -> CameraRecipe:
    return CameraRecipe.model_validate(
        {
            "name": name,
            "lens": {"kind": "ideal", "focal_length_mm": focal_mm, "f_number": f_number},
            "focus": {"distance_m": 1.0},
            "sensor": {"pixel_um": pixel_um, "read_noise": 0.0},
            "psf": {"window_px": window},
        }
    )


FAST = lens(35, 4, 3.45)
PAPER = load_camera("paper-clear").recipe
CAMERAS = {
    "35 mm f/4": FAST,
    "phone": lens(5, 2, 1.4),
    "the paper's": PAPER.model_copy(update={"psf": FAST.psf}),
}
"""Cameras whose photos take seconds."""


def ramp(camera: Camera, far: float, near: float, size: int = 112) -> View:
    """Coarse and fine texture that recedes evenly in inverse depth, three bands, another depth each pixel."""
    draw = torch.Generator().manual_seed(0)
    light = sum(
        torch.nn.functional.interpolate(torch.rand(1, 3, n, n, generator=draw), size=(size, size))[0]
        for n in (7, 14, 28, 56, 112)
    )
    depth = torch.linspace(far, near, size**2).reshape(size, size)
    bands = [611e-9, 543e-9, 482e-9]
    return View.flat(light, depth, wavelengths=bands, pixel_angle=camera.pixel_angle)


def page(camera: Camera) -> View:
    """The same texture in focus, and a row far in front of it and one far behind: layers are far apart."""
    view = ramp(camera, 0.125, 2.5)
    depth = view.inverse_depth.reshape(112, 112).clone()
    depth[1:-1] = torch.linspace(0.99, 1.01, 110 * 112).reshape(110, 112)
    return replace(view, inverse_depth=depth.flatten())


def scores(view: View, camera: Camera, layers: int | None) -> tuple[int, list[float]]:
    """Layers of a photo; PSNR in dB of it, and of what Wiener deconvolution makes of it."""
    taken = capture_restored(view, replace(NONE, layers=layers), System("wiener", camera, ByWiener()))
    images = (taken.images[name].clamp(0, 1) for name in ("photo", "restored"))
    return taken.photo.how.layers, [psnr(image, taken.truth) for image in images]


def shift(view: View, camera: Camera, layers: int | None) -> float:
    """By how much scores move with twice the layers, in dB at most; None for as many as the camera asks."""
    count, once = scores(view, camera, layers)
    _, twice = scores(view, camera, 2 * (layers or count))
    return max(abs(a - b) for a, b in zip(once, twice, strict=True))


def of_lines(recipe: CameraRecipe) -> Camera:
    lines = recipe.sensor.model_copy(update={"response": "lines"})
    return Camera.from_recipe(recipe.model_copy(update={"sensor": lines}))


@pytest.mark.parametrize("name", CAMERAS)
def test_twice_the_layers_change_no_score(name: str) -> None:
    """By the camera's own layers; with 25 of them, as before, a fast lens is farther from convergence."""
    camera = of_lines(CAMERAS[name])
    view = ramp(camera, 0.6, 1.4)
    assert shift(view, camera, None) < 0.1
    far = converged_db(view, NONE, System(LENS_ALONE, camera))
    assert far > 50
    if CAMERAS[name] is FAST:
        assert converged_db(view, replace(NONE, layers=25), System(LENS_ALONE, camera)) < far - 5


@pytest.mark.slow
def test_nor_do_they_where_25_layers_would_miss_what_is_in_focus() -> None:
    camera = of_lines(FAST)
    view = page(camera)
    assert shift(view, camera, None) < 0.1 < shift(view, camera, 25)


def test_layers_for_60_db_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Restoring amplifies what they leave out: 0.17 dB of a phone's photo."""
    monkeypatch.setattr(protocols, "LAYERS_DB", 60.0)
    camera = of_lines(CAMERAS["phone"])
    assert shift(ramp(camera, 0.6, 1.4), camera, None) > 0.1


def test_a_function_is_checked_and_named_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "import numpy as np\n"
        "def good(photo, psfs, info):\n    photo.mul_(2)\n    return photo.numpy()\n"
        "def shape(photo, psfs, info):\n    return photo[0]\n"
        "def nan(photo, psfs, info):\n    return photo * float('nan')\n"
        "def nothing(photo, psfs, info):\n    pass\n"
        "def fails(photo, psfs, info):\n    raise KeyError('x')\n"
        "def ends(photo, psfs, info):\n    raise SystemExit\n"
    )
    photo = torch.full((3, 4, 5), 0.4)
    camera = Camera.from_recipe(FAST)
    info = PhotoInfo(camera, torch.ones(1), torch.zeros(1), 0.0, torch.zeros(3), torch.zeros(4, 5))

    def called(name: str) -> torch.Tensor:
        return load_function(f"{tmp_path / 'own.py'}:{name}")(photo, torch.ones(1, 3, 2, 2), info)

    assert torch.allclose(called("good"), torch.full((3, 4, 5), 0.8)) and float(photo[0, 0, 0]) == np.float32(
        0.4
    )
    said = {
        "shape": r"shape \[4, 5\]",
        "nan": "NaN",
        "nothing": "NoneType",
        "fails": "KeyError",
        "ends": "SystemExit",
    }
    for name, text in said.items():
        with pytest.raises(InputError, match=text) as error:
            called(name)
        assert len(error.value.problems) == 1 and "\n" not in error.value.problems[0]
    with pytest.raises(InputError, match="no function 'none'"):
        called("none")
    one = load_function(f"{tmp_path / 'own.py'}:good").digest
    (tmp_path / "own.py").write_text((tmp_path / "own.py").read_text() + "\n# changed\n")
    assert load_function(f"{tmp_path / 'own.py'}:good").digest != one


def test_what_a_system_is(tmp_path: Path) -> None:
    names = {
        text: system_of(text).name for text in ("paper-clear", "paper-dcnn", "wiener", "paper-dcnn+wiener")
    }
    assert list(names.values()) == ["paper-clear+wiener", "paper-dcnn", "wiener", "paper-dcnn+wiener"]
    assert system_of("paper-learned").name == "paper-learned+paper-bank"
    assert system_of("paper-rings+wiener-depth").restoration.name == "wiener-depth"
    with pytest.raises(InputError, match="no such file"):
        system_of(str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="a function as"):
        system_of("nobody")


def test_transfer_of_an_own_camera_goes_to_its_nyquist_frequency_and_is_in_focus_once() -> None:
    camera = Camera.from_recipe(lens(35, 8, 2.0))
    per_mm, depths = frequencies_of(camera), depths_of(camera)
    assert float(per_mm[-1]) == 250 and depths == (0.5, 1.0, math.inf)
    near, sharp, far = camera_curves(camera, per_mm[:60], depths)[:3]
    # Goodman, sec. 6.4: an ideal lens in focus at a frequency v passes 2/pi (acos s - s sqrt(1 - s^2))
    s = 59e3 * 611e-9 * camera.sensor_distance / (2 * camera.aperture_radius)
    assert float(sharp.values[59]) == pytest.approx(
        2 / math.pi * (math.acos(s) - s * math.sqrt(1 - s * s)), abs=2e-3
    )
    assert max(near.values[59], far.values[59]) < 0.3


@pytest.mark.usefixtures("plots_left_out")
def test_deep_scenes_by_lenses_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    """Two lenses in one command, a function that fails, and all that is printed by one of them."""
    monkeypatch.setattr("edofsim.experiments.scene3d.scored_version", _tiny)
    body = 'name = "NAME"\n[lens]\nkind = "ideal"\nfocal_length_mm = FOCAL\nf_number = 5.6\n'
    body += "[psf]\nwindow_px = 32\n"
    for name, focal in (("one", 20), ("two", 25)):
        (tmp_path / f"{name}.toml").write_text(body.replace("NAME", name).replace("FOCAL", str(focal)))
    (tmp_path / "own.py").write_text("def bad(photo, psfs, info):\n    return 1\n")
    command = ["evaluate", "scene3d", "motorcycle", "--camera", str(tmp_path / "one.toml"), "--quiet"]
    command += ["--system", "wiener", "--system", f"{tmp_path / 'two.toml'}+wiener-depth"]
    bad = ["--system", f"{tmp_path / 'own.py'}:bad"]
    out = tmp_path / "out"
    assert console.exit_status(lambda: app([*command, *bad, "--out", str(out)], standalone_mode=False)) == 2
    assert "own.py:bad: returned int" in capfd.readouterr().err
    figures = json.loads((out / "scene3d.json").read_text())["figures"]
    base = "motorcycle.sub_apertures"
    own = {
        name: figures[f"psnr_db.{base}.two+wiener-depth{name}"]
        for name in ("", ".photo", ".wiener", ".lens_alone")
    }
    over = [
        figures[f"gain_db.{base}.two+wiener-depth.over_{name}"] for name in ("photo", "wiener", "lens_alone")
    ]
    assert over == pytest.approx([own[""] - own[name] for name in (".photo", ".wiener", ".lens_alone")])
    assert own[".lens_alone"] != figures[f"psnr_db.{base}.lens_alone"]
    assert figures[f"converged_db.{base}.wiener.photo"] > 40
    only = [*command[:6], *bad, "--out", str(tmp_path / "none")]
    assert console.exit_status(lambda: app(only, standalone_mode=False)) == 2
    assert capfd.readouterr().err.count("returned int") == 1 and not (tmp_path / "none/scene3d.json").exists()


def _tiny(recipe, *, quick: bool = False):
    frame = recipe.frame.model_copy(update={"width_px": 32, "height_px": 24})
    bands = recipe.bands.model_copy(update={"count": 3})
    return recipe.model_copy(update={"frame": frame, "bands": bands})


def test_wiener_that_knows_distances_refuses_a_lens_that_varies() -> None:
    """It has the PSFs of the axis alone."""
    camera = Camera.from_recipe(load_camera("doublet-25mm-f6").recipe)
    photo, known = torch.zeros(3, 8, 8), types.SimpleNamespace(camera=camera)
    with pytest.raises(InputError, match="doublet-25mm-f6 change over the frame: take `wiener`"):
        ByWienerOfDepth()(photo, known)
