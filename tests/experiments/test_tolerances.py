"""`edofsim evaluate tolerances`: quantiles, what matters, going on, shares, and what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import torch

from edofsim import console
from edofsim.cli import invoke
from edofsim.experiments import tolerances
from edofsim.experiments.tolerances_page import figures_of, worst_of

CAMERA = """
name = "small"
[lens]
kind = "prescription"
f_number = 6
[[lens.surfaces]]
stop = true
[[lens.surfaces]]
radius_mm = 22.9
thickness_mm = 3
glass = "N-BK7"
[[lens.surfaces]]
[focus]
distance_m = 2
plane = "best"
[sensor]
pixel_um = 6
[psf]
window_px = 24
[tolerances]
decentre_um = 200
tilt_arcmin = 20
"""


def edofsim(*arguments: str | Path) -> int:
    return console.exit_status(lambda: invoke([str(each) for each in arguments]))


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(CAMERA)
    return path


@pytest.mark.usefixtures("plots_left_out")
def test_cameras_are_made_gone_on_with_and_shared(camera: Path, tmp_path: Path, monkeypatch):
    """Two shares, then the whole: nothing is done twice, and every draw is in the table."""
    monkeypatch.setattr(tolerances, "A_PART", 5)
    out = tmp_path / "out"
    command = [
        "evaluate",
        "tolerances",
        camera,
        "--draws",
        "10",
        "--network",
        "wiener",
        "--out",
        out,
        "--quiet",
        "--fields",
        "2.5",
    ]
    assert edofsim(*command, "--shard", "1/2") == 0
    assert edofsim(*command, "--shard", "2/2") == 0
    lines = (out / "finished.jsonl").read_text().splitlines()
    assert edofsim(*command) == 0
    new = (out / "finished.jsonl").read_text().splitlines()[len(lines) :]
    assert len(lines) == 11 and len(new) == tolerances.WORST  # the worst of all are known at the end
    found = json.loads((out / "tolerances.json").read_text())["figures"]
    assert found["draws"] == 10
    rows = list(csv.DictReader((out / "tolerances.csv").open()))
    assert [row["draw"] for row in rows] == [str(number) for number in range(10)]
    start, end = "psnr_db.photo.", ".p50"
    angles = [name[len(start) : -len(end)] for name in found if name.startswith(start) and name.endswith(end)]
    assert angles == ["2.5deg"]
    for angle in angles:
        photo = torch.tensor([float(row[f"psnr_db.photo.{angle}"]) for row in rows], dtype=torch.float64)
        assert found[f"psnr_db.photo.{angle}.p10"] == pytest.approx(float(photo.quantile(0.1)), abs=1e-4)
        assert found[f"psnr_db.photo.{angle}.p10"] < found[f"psnr_db.photo.{angle}.p50"]
        assert found[f"psnr_db.restored.{angle}.designed"] > found[f"psnr_db.photo.{angle}.designed"]
    shares = [value for name, value in found.items() if name.startswith("share_percent")]
    assert sum(shares) == pytest.approx(100)
    assert found["share_percent.tilt.1-2"] > found["share_percent.index.1"]
    assert 0 < found["exact.missed_waves"] < 0.1 * found["exact.change_waves"]
    assert found["exact.photo_db"] < 0.1
    assert (out / "tolerances.html").is_file()


@pytest.mark.parametrize(
    "more, said",
    [
        (["--fields", "95"], "give degrees from 0 to 90"),
        (["--frequency", "-3"], "give cycles/mm above 0"),
        (["--distance", "0"], "give metres above 0"),
        (["--draws", "2"], "--draws"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(camera, tmp_path, capsys, more, said):
    assert (
        edofsim("evaluate", "tolerances", camera, "--out", tmp_path / "out", "--network", "wiener", *more)
        == 2
    )
    assert said in capsys.readouterr().err


def test_tolerances_of_a_recipe_are_checked(camera, tmp_path, capsys):
    camera.write_text(CAMERA.replace("decentre_um = 200", "decentre_um = -1"))
    assert edofsim("evaluate", "tolerances", camera, "--out", tmp_path / "out") == 2
    assert "tolerances.decentre_um" in capsys.readouterr().err
    assert edofsim("evaluate", "tolerances", "lens-25mm-f5", "--fields", "3", "--out", tmp_path / "out") == 2
    assert "the same over the field" in capsys.readouterr().err


def test_the_worst_are_those_with_the_worst_photos():
    found = {
        k: {"psnr_db.photo.0deg": 30.0 - k, "psnr_db.restored.0deg": 20.0 + k, "seconds.x": 1.0}
        for k in range(4)
    }
    assert worst_of(found, 2) == [3, 2]
    figures = figures_of(found[0], found, {}, {"a": 3.0, "b": 4.0})
    assert figures["share_percent.b"] == pytest.approx(64)
    assert figures["seconds.x"] == 4.0
    assert figures["psnr_db.photo.0deg.p50"] == pytest.approx(28.5)
    assert figures["psnr_db.photo.0deg.designed"] == 30.0
