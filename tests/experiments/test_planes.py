"""Photographs as planes: the paper's model, what an interruption leaves, and what cannot be used."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from edofsim.capture import capture
from edofsim.core.progress import silent
from edofsim.errors import InputError
from edofsim.experiments import fabrication, noise, planes, robustness, table
from edofsim.experiments.known_depth import at_known_depth
from edofsim.experiments.paper_figures import FABRICATION, NOISE
from edofsim.experiments.photographs import chart, photographs
from edofsim.experiments.planes import Condition, measure, random_depths
from edofsim.experiments.systems import READ_NOISE, EvaluatedSystem, evaluated_system, paper_test
from edofsim.experiments.training import Training, training_of
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.optics.field import relative_light
from edofsim.recipe import CameraRecipe
from edofsim.report import page_html
from edofsim.restore.checkpoint import comparison_checkpoints, shipped_checkpoints
from edofsim.restore.linear import colour_error
from edofsim.restore.photograph_statistics import COLOUR_CORRELATION, power_spectrum

sys.path.insert(0, str(Path(__file__).parents[1] / "example_package"))
from edofsim_example.off_axis_lens import OffAxisLens

pytestmark = pytest.mark.usefixtures("coarse")
Echo = Callable[..., EvaluatedSystem]


def at(depth_m: float | None, noise: float = READ_NOISE) -> Condition:
    return Condition(f"{depth_m}", None if depth_m is None else 1 / depth_m, noise, paper_test(0))


def test_the_photo_is_the_papers_model(folder: Path, tmp_path: Path, echo: Echo) -> None:
    """Written out once more: convolution of the mirrored picture, glare of the light that the window
    does not hold, noise of 0.005."""
    system = echo()
    pictures = photographs(folder).pictures
    row = measure(system, pictures[:1], [at(0.5)], tmp_path, seed=0)[0]
    assert (row.restored_db, row.whole_restored_db) == (row.photo_db, row.whole_photo_db)
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
    wrong = (blurred - sharp).square()
    for error, found in ((wrong, row.whole_photo_db), (wrong[:, 12:-12, 12:-12], row.photo_db)):
        assert found == pytest.approx(-10 * math.log10(float(error.mean()) + 0.005**2), abs=0.02)


def test_a_frame_is_a_middle_and_nobody_is_told_what_lies_beyond(
    folder: Path, tmp_path: Path, echo: Echo
) -> None:
    """A system is given the photo of the middle, whose light comes from the larger picture, exactly; and, by
    the paper's protocol, that of the whole picture: the same photo, cut. Its scores are of each alone."""
    given: list[torch.Tensor] = []

    def restore(photo: torch.Tensor, glare: torch.Tensor) -> torch.Tensor:
        given.append(photo)
        return torch.zeros_like(photo)

    picture = photographs(folder).pictures[0]
    system = echo(restore=restore)
    row = measure(system, [picture], [at(0.5, noise=0.0)], tmp_path, seed=0)[0]
    middle, whole = given
    assert torch.equal(middle, whole[:, 12:-12, 12:-12])
    psf = psf_bank(planes.made(system.camera, paper_test(0)), PAPER_COLOURS, [2.0]).values[0]
    # no picture beyond the frame is invented: only pixels of the picture itself, and its mean as glare
    blurred = torch.nn.functional.conv2d(picture.values[None], psf.flip(-2, -1)[:, None], groups=3)[0]
    veil = middle - blurred[:, 1:, 1:]  # a window of 24 pixels reaches 12 to one side and 11 to the other
    assert float((veil - veil.mean((1, 2), keepdim=True)).abs().max()) < 1e-5
    for db, truth in (
        (row.restored_db, picture.values[:, 12:-12, 12:-12]),
        (row.whole_restored_db, picture.values),
    ):
        assert db == pytest.approx(-10 * math.log10(float(truth.square().mean())), abs=1e-3)


def _varying(system: EvaluatedSystem) -> EvaluatedSystem:
    """With a lens that has coma and loses light towards the corners of a small picture."""
    lens = {"kind": "ideal", "focal_length_mm": 25, "f_number": 5}
    focus, psf = {"distance_m": 1.0, "wavelength_nm": 550}, {"window_px": 12}
    recipe = CameraRecipe.model_validate({"name": "c", "lens": lens, "focus": focus, "psf": psf})
    varying = OffAxisLens(**{**lens, "kind": "off-axis"}, coma=60.0, shadow=8.0)
    return replace(system, camera=replace(Camera.from_recipe(recipe), lens=varying))


def test_a_plane_through_a_lens_that_varies_is_the_sum_over_its_places(
    echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pixels of the photo, each the sum over sources around it by the PSFs of their own places; as much of it
    as makes a white picture even."""
    monkeypatch.setattr("edofsim.capture.field.step_for", lambda *of: 16)
    photographed = sys.modules[capture.__module__]
    glare_of = photographed.glare_of
    monkeypatch.setattr(photographed, "glare_of", lambda *of: tuple(0 * each for each in glare_of(*of)))
    camera, depth, half = _varying(echo()).camera, 1.1, 6
    picture = torch.rand(3, 12, 16, generator=torch.Generator().manual_seed(1))
    picture = picture.repeat_interleave(3, 1).repeat_interleave(3, 2)
    clean, truncated = planes.over_field(picture, depth, camera)
    assert clean.shape == picture.shape and truncated.shape == (3,)
    rows, columns = picture.shape[1:]
    world = torch.from_numpy(np.pad(picture.numpy(), ((0, 0), (half, half), (half, half)), "symmetric"))
    apart: list[torch.Tensor] = []
    for y, x in ((3, 4), (30, 44)):
        total, white, own = torch.zeros(3, 3, dtype=torch.float64)
        for row in range(12):
            for column in range(12):
                down, right = y - (row - half), x - (column - half)  # the source of this pixel of the PSF
                field = ((right + 0.5 - columns / 2), (rows / 2 - down - 0.5))
                there = camera.at_field((field[0] * camera.pixel_angle, field[1] * camera.pixel_angle))
                psfs = psf_bank(there, PAPER_COLOURS, [depth]).values[0].double() * relative_light(there)
                white += psfs[:, row, column]
                total += psfs[:, row, column] * world[:, down + half, right + half]
                own = psfs.sum((-2, -1)) if (down, right) == (y, x) else own
        apart.append(clean[:, y, x].double() - total / white * own)
    assert float(torch.stack(apart).abs().max()) < 4e-3
    by_axis = planes.through(picture, psf_bank(camera, PAPER_COLOURS, [depth]).values[0])
    assert float((clean - by_axis).abs().max()) > 0.05


def test_pictures_through_a_lens_that_varies_are_restored_and_scored(
    folder: Path, tmp_path: Path, echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("edofsim.capture.field.step_for", lambda *of: 64)
    system = _varying(echo())
    pictures = photographs(folder).pictures[:1]
    row = measure(system, pictures, [at(0.9)], tmp_path, seed=0)[0]
    assert row.restored_db == row.photo_db > 5
    with pytest.raises(InputError, match="given the depth has one PSF"):
        measure(system, pictures, [at(0.9)], tmp_path / "known", seed=0, known_depth=True)


def test_defocus_blurs(folder: Path, tmp_path: Path, echo: Echo) -> None:
    """A clear aperture focused at 1.5 m blurs more the nearer the plane."""
    rows = measure(echo(), photographs(folder).pictures, [at(0.5), at(0.8), at(1.0)], tmp_path, seed=0)
    means = planes.averages(rows)
    for kind in ("", "whole."):
        at_depths = [means[f"psnr_db.echo.{kind}{depth}"] for depth in ("0.5", "0.8", "1.0")]
        assert at_depths == sorted(at_depths)


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
        if len(calls) == 12:
            raise KeyboardInterrupt
        return photo

    only(echo(restore=restore))
    with pytest.raises(KeyboardInterrupt):
        noise.run(tmp_path / "cut", silent, folder)
    with (tmp_path / "cut/finished.jsonl").open("a") as file:
        file.write('{"key": "half a li')  # as a kill in the middle of a write leaves it
    resumed = noise.run(tmp_path / "cut", silent, folder)
    assert len(calls) == 12 + 2 * (12 - 5)  # two frames each; five were finished, the sixth was not
    again = noise.run(tmp_path / "cut", silent, folder)
    assert len(calls) == 26 and again.figures == resumed.figures
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
    result = table.run(tmp_path / "out", silent, folder, systems=[str(network), "paper-cubic"], limit=2)
    alone = table.run(tmp_path / "again", silent, folder, systems=[str(network)], limit=2)
    of_trained = {name for name in result.figures if ".trained." in name}
    assert {name: alone.figures[name] for name in of_trained} == {n: result.figures[n] for n in of_trained}
    assert len(of_trained) > 10
    rows = list(csv.DictReader((tmp_path / "out/table.csv").open()))
    assert len(rows) == 2 * (2 * 4 + 3)  # each system: two pictures at four depths, the chart at three
    ours = [row for row in rows if (row["system"], row["depth"]) == ("trained", "1m")]
    mean = np.mean([float(row["restored_db"]) for row in ours if row["picture"] != "USAF-1951"])
    assert result.figures["psnr_db.trained.1m"] == pytest.approx(mean, abs=1e-3)
    whole = np.mean([float(row["whole_restored_db"]) for row in ours if row["picture"] != "USAF-1951"])
    assert result.figures["psnr_db.trained.whole.1m"] == pytest.approx(whole, abs=1e-3)
    chart_row = next(row for row in ours if row["picture"] == "USAF-1951")
    for name, column in (("chart", "restored_db"), ("whole.chart", "whole_restored_db")):
        assert result.figures[f"psnr_db.trained.{name}.1m"] == pytest.approx(
            float(chart_row[column]), abs=1e-3
        )
    # all systems see a picture at the same random depth
    depths = {(row["picture"], row["inverse_depth_per_m"]) for row in rows if row["depth"] == "random"}
    assert len(depths) == 2
    # cubic blur is removed by its filter
    cubic = "psnr_db.paper-cubic+wiener"
    assert result.figures[f"{cubic}.1m"] > result.figures[f"{cubic}.photo.1m"] + 1


def test_the_paper_and_the_trainings_stand_beside_ours(folder: Path, tmp_path: Path, network: Path) -> None:
    """Printed: both protocols; the paper's rows for its averages, its chart and its two pictures of Kodak's,
    of which the mean of 30.98 and 31.33 dB at half a metre is 31.155; own steps apart from another's."""
    systems = [str(network), "clear-dcnn"]
    found = table.run(tmp_path, silent, folder, systems=systems, limit=1)
    for printed in found.shown[:2]:
        rows = {str(row[0]).split("\n")[0]: row for row in printed.rows if "BSDS" not in str(row[0])}
        assert list(rows)[:2] == ["trained", "clear-dcnn"]
        paper = rows["the paper: Proposed"]
        assert paper[4:] == pytest.approx((26.26, 31.155, 30.74, 29.925, 28.31, 31.44, 30.00))
        assert rows["clear-dcnn"][1] == "5839\nafter 11070 of another" and rows["clear-dcnn"][2] is None
    bsds = [row for row in found.shown[0].rows if "Proposed" in str(row[0]) and "BSDS" in str(row[0])]
    assert bsds[0][4] == 27.31 and set(bsds[0][5:]) == {None}
    assert found.figures["steps.clear-dcnn"] == 2400 + 3439


def test_a_filter_that_is_told_the_depth_shows_what_a_photo_holds(
    folder: Path, tmp_path: Path, network: Path
) -> None:
    """Against the least mean square error in closed form: a scene drawn from the statistics of photographs,
    blurred by PSFs of its own for each colour, with noise."""
    size, noise = 192, 0.006
    draw = torch.Generator().manual_seed(5)
    like = torch.tensor(COLOUR_CORRELATION, dtype=torch.float64)
    white = torch.randn(3, size, size, generator=draw, dtype=torch.float64)
    power = power_spectrum(size, like)
    power[0, 0] = 0
    mixed = torch.einsum("cd,dyx->cyx", torch.linalg.cholesky(like), white)
    scene = 0.5 + 0.2 * torch.fft.irfft2(torch.fft.rfft2(mixed) * power.sqrt(), s=(size, size))
    place = torch.arange(17, dtype=torch.float64) - 8
    widths = torch.tensor([2.5, 1.5, 0.8], dtype=torch.float64)[:, None, None]
    psf = (-(place[:, None] ** 2 + place**2) / (2 * widths**2)).exp()
    psf = psf / psf.sum((1, 2), keepdim=True)
    photo = torch.nn.functional.conv2d(scene[None], psf[:, None], groups=3)[0]
    photo = photo + 0.2 * noise * torch.randn(photo.shape, generator=draw, dtype=torch.float64)
    truth = scene[:, 8:-8, 8:-8]
    # a fifth of light and noise alike, so that nothing is clamped: the filter is the same
    inside = (..., slice(16, -16), slice(16, -16))
    found = planes.channels(at_known_depth(photo, psf, noise)[inside], truth[inside])
    expected = -10 * (0.04 * colour_error(psf[None], noise)[0]).log10()
    assert found == pytest.approx(expected.tolist(), abs=1.0)
    # the table has it of the chart alone, each colour for itself
    figures = table.run(tmp_path, silent, folder, [str(network)], limit=1).figures
    linear = "psnr_db.trained.known-depth.chart.0.5m"
    error = np.mean([10 ** (-figures[f"{linear}.{c}"] / 10) for c in planes.CHANNELS])
    assert figures[linear] == pytest.approx(-10 * math.log10(error), abs=1e-6)


def test_hours_are_told_where_all_cards_tell_them() -> None:
    first = {"name": "a", "step": 100, "hours": 0.5}
    last = {"name": "a", "step": 50, "hours": 1.5}
    other = {"name": "b", "step": 7}
    assert training_of({**last, "history": [other, first]}) == Training(150, 7, 2.0)
    assert training_of({**last, "history": [{"name": "a", "step": 1}]}) == Training(51, 0, None)


def test_the_tables_page_shows_the_paper_beside_ours(folder: Path, tmp_path: Path, network: Path) -> None:
    page = page_html(table.run(tmp_path, silent, folder, [str(network)], show=["c.png"], limit=3).page)
    for expected in ("26.26", "27.31", "28.31", "USAF-1951", "c.png", "0.8 m, sensor", "0.8 m, output"):
        assert expected in page
    assert '<img src="http' not in page


def test_what_cannot_be_judged_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        table.run(tmp_path, silent, tmp_path / "none", systems=["paper-clear"])
    with pytest.raises(InputError, match="no such checkpoint"):
        evaluated_system("nobody")
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

    def nothing(system: EvaluatedSystem, *rest: object, **options: object) -> list[planes.PictureScore]:
        asked.append(system.name)
        return []

    monkeypatch.setattr(table, "measure", nothing)
    monkeypatch.setattr(table, "page", lambda result: None)
    monkeypatch.setattr(table, "methods", lambda result, protocol: None)
    table.run(tmp_path, silent, folder)
    found = {*shipped_checkpoints(), *comparison_checkpoints(), "paper-clear+wiener", "paper-cubic+wiener"}
    assert set(asked) == found and len(found) > 6
