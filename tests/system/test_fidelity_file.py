"""What a run or a plan wrote is simulated again, on any machine; what does not fit is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

import edofsim as package
from edofsim.capture import capture, full_fidelity, read_image
from edofsim.capture.checks import check_fits
from edofsim.capture.presets import PRESETS, preset
from edofsim.core.images import openexr
from edofsim.errors import InputError
from edofsim.recipe import load_scene

from .test_run import SCENE

KEPT = Path(__file__).with_name("replayed.json")
"""As another machine wrote it."""
WRITTEN_OUT = package.Fidelity(
    band_groups=1,
    group_wavelengths=2,
    layers=3,
    occlusion="hidden",
    sub_apertures=3,
    sub_aperture_pixel=2,
    window_px=24,
    oversampling=2,
    spherical_aberration=False,
    quantisation=False,
)

Command = Callable[..., tuple[int, str]]


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """A ball in front of a wall."""
    ball = 'objects = [{ kind = "wall", depth_m = 2.0 }, { kind = "sphere", depth_m = 0.8, radius_mm = 20 }]'
    frame = 'camera = "small.toml"\nframe = { width_px = 40, height_px = 32, margin_px = 24 }'
    lines = {"objects": ball, "frame": frame}
    path = tmp_path / "card.toml"
    path.write_text("\n".join(lines.get(line.partition(" ")[0], line) for line in SCENE.splitlines()))
    (tmp_path / "small.toml").write_text('name = "small"\n[psf]\nwindow_px = 48\n')
    return path


def photo_of(folder: Path) -> torch.Tensor:
    return read_image(folder / "photo.exr")


def test_a_kept_json_is_the_fidelity_that_it_says(card: Path):
    """Field by field, and to the same photo as the record written out by hand."""
    read = package.Fidelity.load(KEPT)
    assert read == WRITTEN_OUT
    camera = package.camera(window=48)
    view = package.view(card, camera)
    photos = [capture(view, camera, each).image for each in (read, WRITTEN_OUT, full_fidelity(camera, view))]
    assert float((photos[0] - photos[1]).abs().max()) < 1e-6
    assert float((photos[0] - photos[2]).abs().max()) > 1e-4


@pytest.mark.usefixtures("plots_left_out")
def test_what_a_run_wrote_gives_its_photo_again(edofsim: Command, card: Path, tmp_path: Path):
    first, again, toml = tmp_path / "first", tmp_path / "again", tmp_path / "toml"
    status, said = edofsim(
        *("run", card, "--layers", "3", "--without", "bands", "--network", "wiener"),
        *("--out", first, "--json", tmp_path / "run.json"),
    )
    assert status == 0, said
    written = json.loads((tmp_path / "run.json").read_text())
    assert written["fidelity"]["layers"] == 3 and written["figures"]["plan.psnr_db"] < 80
    header = json.loads(openexr().File(str(first / "photo.exr")).header()["how"])
    assert header["fidelity"] == written["fidelity"]
    assert header["predicted"]["psnr_db"] == pytest.approx(written["figures"]["plan.psnr_db"], abs=0.01)
    left = header["predicted"]["left_out_db"]
    assert left["bands"] == pytest.approx(written["figures"]["psnr_db.without_bands"], abs=0.01)
    status, said = edofsim(
        "run", card, "--fidelity", tmp_path / "run.json", "--network", "wiener", "--out", again
    )
    assert status == 0, said
    assert float((photo_of(first) - photo_of(again)).abs().max()) < 1e-6
    assert "run.json says, without a plan" in (again / "report.html").read_text()
    fields = {name: value for name, value in written["fidelity"].items() if value is not None}
    del fields["simplifications"]
    lines = (f"{name} = {json.dumps(value)}" for name, value in fields.items())
    (tmp_path / "own.toml").write_text("[fidelity]\n" + "\n".join(lines))
    status, said = edofsim("expose", card, "--fidelity", tmp_path / "own.toml", "--out", toml)
    assert status == 0, said
    assert float((photo_of(first) - photo_of(toml)).abs().max()) < 1e-6


def test_what_expose_and_plan_write_is_a_fidelity(edofsim: Command, card: Path, tmp_path: Path):
    for command in ("expose", "plan"):
        out = ("--out", tmp_path / command) if command == "expose" else ()
        status, said = edofsim(command, card, *out, "--json", tmp_path / f"{command}.json")
        assert status == 0, said
    found = [package.Fidelity.load(tmp_path / f"{name}.json") for name in ("expose", "plan")]
    assert found[0].occlusion == found[1].occlusion


def test_a_fidelity_survives_a_file(tmp_path: Path):
    saved = WRITTEN_OUT.changed({"bounces": 3, "layers": None}).save(tmp_path / "own.json")
    assert package.Fidelity.load(saved) == WRITTEN_OUT.changed({"bounces": 3, "layers": None})


def test_fields_that_there_were_are_read(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    path = tmp_path / "before.json"
    path.write_text('{"fidelity": {"method": "layered", "sub_apertures_in_full": false, "layers": 5}}')
    assert package.Fidelity.load(path) == package.Fidelity(layers=5) and not caplog.messages
    path.write_text('{"settings": {"method": "constant"}}')
    assert package.Fidelity.load(path) == package.Fidelity(layers=1)
    assert "layers = 1 now" in caplog.text


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"fidelity": {"layrs": 3}}', "layrs"),
        ('{"fidelity": {"layers": "3"}}', "layers"),
        ('{"fidelity": {"layers": 0}}', "0 depth layers"),
        ('{"command": "psf", "figures": {}}', "holds no fidelity"),
        ('{"fidelities": {"a": {}, "b": {}}}', "several scenes"),
        ('{"simplifications": ["flat lens"]}', "--without"),
        ('{"fidelity": {"method": "brute"}}', "method brute was removed"),
        ('{"sub_apertures_in_full": true}', "sub_apertures_in_full was removed"),
        ("[1, 2]", "no fields"),
        ("nonsense", "neither JSON nor TOML"),
    ],
)
def test_what_is_no_fidelity_is_refused(tmp_path: Path, content: str, said: str):
    path = tmp_path / "bad.json"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        package.Fidelity.load(path)


def test_what_does_not_fit_is_refused(card: Path):
    camera, recipe = package.camera(window=48), load_scene(card).recipe
    check_fits(WRITTEN_OUT, camera, recipe)
    for change, said in (
        ({"window_px": 64}, "window_px = 64"),
        ({"samples": 100}, "samples = 100"),
        ({"occlusion": "none"}, "sub_apertures = 3"),
    ):
        with pytest.raises(InputError, match=said):
            check_fits(WRITTEN_OUT.changed(change), camera, recipe)


@pytest.mark.parametrize("option", [("--accuracy", "40dB"), ("--layers", "3"), ("--without", "bands")])
def test_a_fidelity_stands_alone(edofsim: Command, card: Path, tmp_path: Path, option: tuple[str, str]):
    status, said = edofsim("run", card, "--fidelity", KEPT, *option, "--out", tmp_path)
    assert status == 2 and option[0] in said and len(said.strip().splitlines()) == 1


def test_presets_are_a_moment_and_everything(edofsim: Command, card: Path, tmp_path: Path):
    camera = package.camera(window=48)
    view = package.view(card, camera)
    assert preset("reference", camera, view) == full_fidelity(camera, view)
    assert preset("preview", camera, view).layers == 9 and set(PRESETS) == {"preview", "reference"}
    status, said = edofsim("expose", card, "--fidelity", "preview", "--out", tmp_path / "quick")
    assert status == 0, said
    status, said = edofsim("expose", card, "--fidelity", "perfect", "--out", tmp_path / "none")
    assert status == 2 and "presets are reference, preview" in said
