"""`edofsim look`: a scene without a camera, and what was assumed to read it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import edofsim as package
from edofsim import console
from edofsim.cli import invoke
from edofsim.recipe import load_scene
from edofsim.render.seen import by_itself

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def edofsim(capfd: pytest.CaptureFixture[str]) -> Run:
    """Run a command in this process: (exit status, all that it said)."""

    def run(*arguments: str | Path) -> tuple[int, str]:
        status = console.exit_status(lambda: invoke([str(a) for a in arguments]))
        return status, "".join(capfd.readouterr())

    return run


def photograph(folder: Path) -> Path:
    """A picture that lies on its side, its depths in millimetres, and the recipe that `new` makes of them."""
    colours = np.zeros((8, 12, 3), np.uint8)
    colours[:, :6, 0] = 255
    colours[:, 6:, 2] = 255
    about = Image.Exif()
    about[274] = 6
    Image.fromarray(np.rot90(colours)).save(folder / "a.png", exif=about)
    depth = np.full((8, 12), 800, np.uint16)
    depth[:, 6:] = 2500
    Image.fromarray(depth).save(folder / "z.png")
    return folder / "mine.toml"


def test_a_picture_is_seen_with_its_depths_and_what_was_assumed(edofsim: Run, tmp_path: Path):
    recipe = photograph(tmp_path)
    given = ("--image", tmp_path / "a.png", "--depth", tmp_path / "z.png")
    status, said = edofsim("new", "scene", recipe, *given)
    assert status == 0 and "0.8 to 2.5 m" in said and "0.001 m each" in said
    status, said = edofsim("look", recipe, "--out", tmp_path / "out", "--json", tmp_path / "a.json")
    assert status == 0, said
    for phrase in ("turned upright", "sRGB", "0.001 m each", "0.8 to 2.5 m", "degrees across"):
        assert phrase in said
    seen = np.asarray(Image.open(tmp_path / "out" / "picture.png").convert("RGB")).astype(int)
    assert seen.shape == (8, 12, 3)
    assert (seen[:, :6, 0] > seen[:, :6, 2] + 100).all() and (seen[:, 6:, 2] > seen[:, 6:, 0] + 100).all()
    figures = json.loads((tmp_path / "a.json").read_text())["figures"]
    assert figures["depth_m.nearest"] == pytest.approx(0.8, rel=1e-5)
    assert figures["depth_m.farthest"] == pytest.approx(2.5, rel=1e-5)
    view = package.look(recipe)
    assert (view.height, view.width) == (8, 12)
    assert any("turned upright" in line for line in view.metadata["assumed"])


@pytest.mark.parametrize(("axis", "side"), [("x", 40), ("y", 30), ("diagonal", 50), ("smaller", 30)])
def test_a_mitsuba_scene_has_the_angle_of_its_own_sensor(tmp_path: Path, axis: str, side: int):
    """An axis of 50 degrees spans the frame's 40, 30 or 50 pixels: 2 tan(25 degrees) over them."""
    (tmp_path / "a.xml").write_text(
        f'<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="50"/>'
        f'<string name="fov_axis" value="{axis}"/></sensor><shape type="sphere"/></scene>'
    )
    (tmp_path / "a.toml").write_text(
        'name = "a"\n[frame]\nwidth_px = 40\nheight_px = 30\n[source]\nkind = "mitsuba"\npath = "a.xml"\n'
    )
    loaded = load_scene(tmp_path / "a.toml")
    recipe, whose = by_itself(loaded.recipe, loaded.base)
    assert recipe is not None and "sensor" in whose
    assert recipe.frame.pixel_angle == pytest.approx(2 * math.tan(math.radians(25)) / side, rel=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--holds", "relative_inverse_depth"), "--near and --far"),
        (("--holds", "disparity"), "--focal-px and --baseline-mm"),
        (("--key", "Z"), "leave out key"),
        (("--unit", "-1"), "--unit"),
        (("--near", "1"), "near"),
    ],
)
def test_what_a_depth_map_needs_is_named_by_its_option(
    edofsim: Run, tmp_path: Path, options: tuple[str, ...], words: str
):
    recipe = photograph(tmp_path)
    given = ("--image", tmp_path / "a.png", "--depth", tmp_path / "z.png")
    status, said = edofsim("new", "scene", recipe, *given, *options)
    assert status == 2 and words in said and not recipe.exists()


def test_a_relative_map_a_smaller_map_and_a_disparity_are_made_as_asked(edofsim: Run, tmp_path: Path):
    """1/z is straight in what a network gives: 1/0.8 at the largest number, 1/4 at the smallest."""
    Image.new("RGB", (12, 8)).save(tmp_path / "a.png")
    network = np.linspace(0, 1000, 24).reshape(4, 6)
    np.save(tmp_path / "z.npy", network)
    given = ("--image", tmp_path / "a.png", "--depth", tmp_path / "z.npy", "--resize")
    relative = ("--holds", "relative_inverse_depth", "--near", "0.8", "--far", "4")
    assert edofsim("new", "scene", tmp_path / "rel", *given, *relative)[0] == 0
    view = package.look(tmp_path / "rel.toml")
    want = np.kron(1 / 4 + network / 1000 * (1 / 0.8 - 1 / 4), np.ones((2, 2)))
    np.testing.assert_allclose(view.mean_inverse_depth().numpy(), want, rtol=1e-5)
    pair = ("--holds", "disparity", "--focal-px", "500", "--baseline-mm", "200", "--offset", "10")
    assert edofsim("new", "scene", tmp_path / "pair", *given, *pair)[0] == 0
    view = package.look(tmp_path / "pair.toml")
    want = np.kron((network + 10) / (0.2 * 500), np.ones((2, 2)))
    got = view.mean_inverse_depth().numpy()
    np.testing.assert_allclose(got[:, 2:], want[:, 2:], rtol=1e-5)  # a disparity of 0 is a hole


@pytest.mark.parametrize("name", ["", ".", "..", ".toml"])
def test_odd_names_are_refused(edofsim: Run, tmp_path: Path, name: str):
    status, said = edofsim("new", "scene", name)
    assert status == 2 and "cannot name a recipe" in said


def test_quotes_in_names_of_files_are_written_so_that_they_can_be_read(edofsim: Run, tmp_path: Path):
    photograph(tmp_path)
    (tmp_path / "a.png").rename(tmp_path / 'a "b" \\c.png')
    given = ("--image", tmp_path / 'a "b" \\c.png', "--depth", tmp_path / "z.png")
    assert edofsim("new", "scene", tmp_path / "q", *given)[0] == 0
    assert load_scene(tmp_path / "q.toml").recipe.source.image == 'a "b" \\c.png'


@pytest.mark.parametrize("name", ["lens.zmx", "lens.json", "lens.seq"])
@pytest.mark.parametrize("content", [b"MODE SEQ\n", "MODE SEQ\n".encode("utf-16"), b"{}"])
def test_lens_files_of_other_programs_are_met_by_name(
    edofsim: Run, tmp_path: Path, name: str, content: bytes
):
    (tmp_path / name).write_bytes(content)
    status, said = edofsim("psf", tmp_path / name)
    assert status == 2 and "no recipe of edofsim" in said and "TOML" not in said
