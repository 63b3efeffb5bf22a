"""Photographs as planes: the paper's model, what an interruption leaves, and what cannot be used."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from edofsim.core.progress import silent
from edofsim.errors import InputError
from edofsim.experiments import fabrication, noise, planes, robustness, table
from edofsim.experiments.paper_figures import FABRICATION, NOISE
from edofsim.experiments.photographs import chart, photographs
from edofsim.experiments.planes import Condition, measure, random_depths
from edofsim.experiments.systems import READ_NOISE, Contestant, contestant, paper_test
from edofsim.optics import PAPER_COLOURS, psf_bank
from edofsim.report import page_html
from edofsim.restore.checkpoint import comparison_checkpoints, shipped_checkpoints

pytestmark = pytest.mark.usefixtures("coarse")
Echo = Callable[..., Contestant]


def at(depth_m: float | None, noise: float = READ_NOISE) -> Condition:
    return Condition(f"{depth_m}", None if depth_m is None else 1 / depth_m, noise, paper_test(0))


def test_the_photo_is_the_papers_model(folder: Path, tmp_path: Path, echo: Echo) -> None:
    """Written out once more: convolution of the mirrored picture, glare of the light that the window
    does not hold, noise of 0.005."""
    system = echo()
    pictures = photographs(folder).pictures
    row = measure(system, pictures[:1], [at(0.5)], tmp_path, seed=0)[0]
    assert row.restored_db == row.photo_db
    camera = planes.made(system.camera, paper_test(0))
    psf = psf_bank(camera, PAPER_COLOURS, [2.0]).values[0]
    sharp, reach = pictures[0].values, 24
    mirrored = torch.from_numpy(np.pad(sharp.numpy(), ((0, 0), (reach, reach), (reach, reach)), "symmetric"))
    blurred = torch.nn.functional.conv2d(mirrored[None], psf.flip(-2, -1)[:, None], groups=3)[0]
    start = reach - (24 - 1 - 24 // 2)
    blurred = blurred[:, start : start + sharp.shape[1], start : start + sharp.shape[2]]
    # of the mirrored picture, as far as the window reaches
    around = mirrored[:, start : start + sharp.shape[1] + 23, start : start + sharp.shape[2] + 23]
    blurred += ((1 - psf.sum((1, 2))) * around.mean((1, 2)))[:, None, None]
    expected = -10 * math.log10(float((blurred - sharp).square().mean()) + 0.005**2)
    assert row.photo_db == pytest.approx(expected, abs=0.02)


def test_defocus_blurs(folder: Path, tmp_path: Path, echo: Echo) -> None:
    """A clear aperture focused at 1.5 m blurs more the nearer the plane."""
    rows = measure(echo(), photographs(folder).pictures, [at(0.5), at(0.8), at(1.0)], tmp_path, seed=0)
    means = list(planes.averages(rows).values())[::2]
    assert means[0] < means[1] < means[2]


def test_read_noise_adds_its_variance(folder: Path, tmp_path: Path, echo: Echo, only: Callable) -> None:
    """Mean square errors of the photos at two noises differ by the difference of their variances."""
    only(echo())
    figures = noise.run(tmp_path, silent, folder).figures
    rows = list(csv.DictReader((tmp_path / "noise.csv").open()))
    errors = {
        float(row["sigma_s"]): 10 ** (-float(row["photo_db"]) / 10)
        for row in rows
        if row["picture"] == "a.png"
    }
    assert list(errors) == list(NOISE)
    added = errors[0.02] - errors[0.005]
    assert added == pytest.approx(0.02**2 - 0.005**2, rel=0.02)
    assert figures["loss_db.echo"] > 0
    assert len(rows) == 3 * 4 and {row["sigma_s"] for row in rows} == {"0.005", "0.009", "0.015", "0.02"}


def test_height_errors_scatter_light(folder: Path, tmp_path: Path, echo: Echo, only: Callable) -> None:
    """The rougher the mask, the hazier the photo; the device is hazy, too."""
    only(echo("cubic"))
    figures = fabrication.run(tmp_path, silent, folder, limit=1).figures
    photos = [figures[f"psnr_db.echo.photo.{sigma:g}nm"] for sigma in FABRICATION]
    assert photos == sorted(photos, reverse=True)
    assert photos[0] - photos[-1] > 0.2
    assert figures["psnr_db.echo.photo.device"] < photos[0]
    assert robustness.green_focus(echo()) == pytest.approx(1.294, abs=0.001)  # the paper rounds to 1.30 m


def test_an_interrupted_evaluation_goes_on(folder: Path, tmp_path: Path, echo: Echo, only: Callable) -> None:
    calls: list[int] = []

    def restore(photo: torch.Tensor, glare: torch.Tensor) -> torch.Tensor:
        calls.append(1)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return photo

    only(echo(restore=restore))
    with pytest.raises(KeyboardInterrupt):
        noise.run(tmp_path / "cut", silent, folder)
    with (tmp_path / "cut/finished.jsonl").open("a") as file:
        file.write('{"key": "half a li')  # as a kill in the middle of a write leaves it
    resumed = noise.run(tmp_path / "cut", silent, folder)
    assert len(calls) == 6 + 12 - 5  # five were finished, the sixth was not
    again = noise.run(tmp_path / "cut", silent, folder)
    assert len(calls) == 13 and again.figures == resumed.figures
    only(echo())
    assert noise.run(tmp_path / "whole", silent, folder).figures == resumed.figures


def test_other_inputs_are_measured_anew(folder: Path, tmp_path: Path, echo: Echo) -> None:
    """A finding is kept for exactly the picture, the system, the condition and the seed it was made with."""
    pictures = photographs(folder).pictures[:1]
    first = measure(echo(), pictures, [at(1.0)], tmp_path, seed=0)[0]
    assert measure(echo(), pictures, [at(1.0, 0.05)], tmp_path, seed=0)[0].photo_db < first.photo_db
    assert measure(echo("cubic"), pictures, [at(1.0)], tmp_path, seed=0)[0].photo_db != first.photo_db
    assert measure(echo(), pictures, [at(1.0)], tmp_path, seed=0)[0] == first


def test_a_broken_picture_is_named_and_the_others_are_finished(
    folder: Path, tmp_path: Path, network: Path
) -> None:
    depths = random_depths(photographs(folder).pictures, seed=3)
    whole = (folder / "b.png").read_bytes()
    (folder / "b.png").write_bytes(whole[: len(whole) // 3])
    found = noise.run(tmp_path, silent, folder, [str(network)], seed=3)
    assert len(found.problems) == 1 and "b.png: cannot be read" in found.problems[0]
    assert "Left out, since they cannot be used: b.png." in page_html(found.page)
    rows = list(csv.DictReader(found.outputs["table"].open()))
    assert {row["picture"] for row in rows} == {"a.png", "c.png"}
    # the pictures that are left stand where they would stand beside it
    left = random_depths(photographs(folder).pictures, seed=3)
    assert left == [depths[0], depths[2]]


def test_the_table_is_written_and_repeats(folder: Path, tmp_path: Path, network: Path) -> None:
    for name in ("out", "again"):
        (tmp_path / name).mkdir()
    options = {"systems": [str(network), "paper-cubic"], "limit": 2}
    result = table.run(tmp_path / "out", silent, folder, **options)
    assert result.figures == table.run(tmp_path / "again", silent, folder, **options).figures
    rows = list(csv.DictReader((tmp_path / "out/table.csv").open()))
    assert len(rows) == 2 * (2 * 4 + 3)  # each system: two pictures at four depths, the chart at three
    ours = [row for row in rows if (row["system"], row["depth"]) == ("trained", "1m")]
    mean = np.mean([float(row["restored_db"]) for row in ours if row["picture"] != "USAF-1951"])
    assert result.figures["psnr_db.trained.1m"] == pytest.approx(mean, abs=1e-3)
    # all systems see a picture at the same random depth
    depths = {(row["picture"], row["inverse_depth_per_m"]) for row in rows if row["depth"] == "random"}
    assert len(depths) == 2
    # cubic blur is removed by its filter
    cubic = "psnr_db.paper-cubic+wiener"
    assert result.figures[f"{cubic}.1m"] > result.figures[f"{cubic}.photo.1m"] + 1


def test_the_tables_page_shows_the_paper_beside_ours(folder: Path, tmp_path: Path, network: Path) -> None:
    page = page_html(table.run(tmp_path, silent, folder, [str(network)], show=["c.png"], limit=3).page)
    for expected in ("26.26", "27.31", "28.31", "USAF-1951", "c.png", "0.8 m, sensor", "0.8 m, output"):
        assert expected in page
    assert '<img src="http' not in page


def test_what_cannot_be_judged_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        table.run(tmp_path, silent, tmp_path / "none", systems=["paper-clear"])
    with pytest.raises(InputError, match="no such checkpoint"):
        contestant("nobody")
    with pytest.raises(InputError, match="no such picture; there are a.png, b.png, c.png"):
        noise.run(tmp_path, silent, folder, show=["d.png"])
    with pytest.raises(InputError, match="two systems are called 'paper-clear"):
        noise.run(tmp_path, silent, folder, systems=["paper-clear", "paper-clear"])
    for path in folder.iterdir():
        path.write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"a\.png: cannot be read"):
        photographs(folder)


def test_the_drawn_chart_is_black_on_white() -> None:
    drawn = chart(None).pixels
    assert drawn.shape[0] == 3 and drawn.shape[2] == 160
    assert drawn[:, 0, 0].tolist() == [255] * 3 and int(drawn.min()) == 0


def test_the_table_compares_all_that_ship(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By default: networks, systems trained for comparison, and the two apertures without training."""
    asked: list[str] = []

    def nothing(system: Contestant, *rest: object, **options: object) -> list[planes.Row]:
        asked.append(system.name)
        return []

    monkeypatch.setattr(table, "measure", nothing)
    monkeypatch.setattr(table, "page", lambda result: None)
    table.run(tmp_path, silent, folder)
    found = {*shipped_checkpoints(), *comparison_checkpoints(), "paper-clear+wiener", "paper-cubic+wiener"}
    assert set(asked) == found and len(found) > 6
