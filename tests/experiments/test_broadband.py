"""Broadband photos of spectral cubes, and what wavelength does to point spread functions."""

from __future__ import annotations

import csv
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from edofsim.core.progress import silent
from edofsim.errors import InputError
from edofsim.experiments import broadband, chromatic
from edofsim.experiments.cubes import Reading, read_cubes, read_one
from edofsim.experiments.experiment import Findings
from edofsim.experiments.systems import EvaluatedSystem
from edofsim.optics import Camera, response, response_curves
from edofsim.recipe.camera import CameraRecipe
from edofsim.report import page_html

NM = broadband.sensor_bands_nm()


def test_bands_that_a_cube_lacks_are_left_out(cave: Path) -> None:
    """CAVE ends at 700 nm, the sensor at 720; what is left keeps its values, nothing is made up."""
    cube = read_one(cave, NM, Reading())
    assert (cube.wavelengths * 1e9).round().tolist() == list(range(420, 701, 10))
    middle = read_one(cave, NM, Reading(bands=(430, 690), crop=(4, 0, 0, 0)))
    assert (middle.wavelengths * 1e9).round().tolist() == list(range(430, 691, 10))
    assert middle.radiance.shape == (27, cube.radiance.shape[1], cube.radiance.shape[2] - 4)
    assert torch.equal(middle.radiance, cube.radiance[1:28, :, 4:])
    # levels of the file are full scale times 0.2 + 0.6 band / 30: band 3 is 430 nm, band 29 is 690 nm
    ratio = float(middle.radiance[-1].sum() / middle.radiance[0].sum())
    assert ratio == pytest.approx((0.2 + 0.6 * 29 / 30) / (0.2 + 0.6 * 3 / 30), rel=1e-3)


def test_the_share_left_out_is_that_of_the_response(cave: Path) -> None:
    curves = response_curves(Camera.from_recipe(CameraRecipe(name="c")))
    at, values = (np.asarray(part) for part in curves)
    inside = (at > 429e-9) & (at < 691e-9)
    expected = 1 - values[:, inside].sum(1) / values.sum(1)
    found = broadband._left_out(read_one(cave, NM, Reading(bands=(430, 690))).wavelengths)
    assert found == pytest.approx(expected.tolist(), abs=1e-12)


def test_sharp_optics_give_the_response_weighted_cube(cave: Path) -> None:
    cube = read_one(cave, NM, Reading())
    point = torch.zeros(len(cube.radiance), 9, 9)
    point[:, 4, 4] = 1
    weights = response(Camera.from_recipe(CameraRecipe(name="c")), cube.wavelengths).float()
    photo, errors = broadband.capture_cube(cube.radiance, point, weights)
    assert torch.allclose(photo, torch.einsum("cb,byx->cyx", weights, cube.radiance), atol=1e-6)
    assert max(errors) < 1e-6


@pytest.mark.usefixtures("coarse", "plots_left_out")
def test_the_experiment_goes_on_and_names_a_broken_cube(
    cave: Path, tmp_path: Path, network: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = cave.parent / "other_ms"
    shutil.copytree(cave, broken)
    (broken / "toy_ms_07.png").write_bytes(b"no picture")

    def run() -> Findings:
        reading = {"bands": "430,690", "crop": "4,0,0,0"}
        return broadband.run(tmp_path, silent, [cave.parent], systems=[str(network)], **reading)

    done = run()
    assert len(done.problems) == 1 and "other_ms" in done.problems[0] and "toy_ms_07.png" in done.problems[0]
    page = page_html(done.page)
    assert "other_ms" in page and "37.09" in page
    rows = list(csv.DictReader(done.outputs["table"].open()))
    assert [row["depth"] for row in rows] == ["0.5m", "1m", "infinity"]
    for row in rows:  # all channels together: the mean of the channels' square errors
        mean = np.mean([10 ** (-float(row[f"photo_db_{c}"]) / 10) for c in ("red", "green", "blue")])
        assert float(row["photo_db_all"]) == pytest.approx(-10 * math.log10(mean), abs=1e-3)
        if row["depth"] == "1m":  # at the others the blur brings in more than a frame so small holds
            assert float(row["filter_db"]) > float(row["photo_db_all"])  # it knows what to undo
    first = done.outputs["table"].read_bytes()
    monkeypatch.setattr(broadband, "_captured", None)  # nothing of it is computed again
    monkeypatch.setattr(broadband, "chromatic", None)
    again = run()
    assert again.outputs["table"].read_bytes() == first
    assert page_html(again.page) == page


def test_cubes_that_cannot_be_used_are_refused(cave: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_cubes(tmp_path / "none", NM, Reading())
    with pytest.raises(InputError, match="none that the sensor sees"):
        read_cubes(cave, NM, Reading(start_nm=900, step_nm=10))
    (cave / "toy_ms_31.png").unlink()
    with pytest.raises(InputError, match="give --start-nm and --step-nm"):
        read_cubes(cave, NM, Reading())
    with pytest.raises(InputError, match="--bands 430: give 2 numbers"):
        broadband.run(tmp_path, silent, [cave], bands="430")


@pytest.mark.usefixtures("coarse")
def test_optics_of_a_lens_alone(echo: Callable[..., EvaluatedSystem]) -> None:
    """Round, on the axis, sharp farther away for red than for blue, and the same as with a clear mask."""
    found = chromatic.chromatic(echo())
    assert float(found.centroid_um.abs().max()) < 0.01
    assert float(found.asymmetry.max()) < 1e-4
    assert torch.equal(found.transfer, found.lens_transfer)
    assert found.focus.tolist() == sorted(found.focus.tolist(), reverse=True)  # inverse distance
    best = found.inverse_depths[found.lens_transfer.argmax(0)]
    assert best.tolist() == sorted(best.tolist(), reverse=True) and float(best[0]) > float(best[-1])


@pytest.mark.usefixtures("coarse")
def test_a_cubic_mask_levels_depth_and_is_one_sided(echo: Callable[..., EvaluatedSystem]) -> None:
    found = chromatic.chromatic(echo("cubic"))
    spread = [float(values.max() / values.min()) for values in (found.transfer, found.lens_transfer)]
    assert spread[0] < spread[1] / 1.5
    assert float(found.asymmetry.min()) > 0.1


def test_a_sensor_that_sees_three_lines_loses_nothing_to_its_bands(
    echo: Callable[..., EvaluatedSystem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a response of one band for each colour, those of the training, all bands restore as three
    wavelengths do; with the real one the light of a cubic mask smears, most at both ends of the range."""
    monkeypatch.setattr(chromatic, "MAP_DEPTHS", 2)
    monkeypatch.setattr(chromatic, "BANDS_M", chromatic.PAPER_COLOURS.flip(0))
    monkeypatch.setattr(chromatic, "response", lambda camera, wavelengths: torch.eye(3).flip(0))
    three, bands = chromatic.chromatic(echo("cubic")).linear_db.T
    assert bands.tolist() == pytest.approx(three.tolist(), abs=1e-9)
    monkeypatch.undo()
    monkeypatch.setattr(chromatic, "MAP_DEPTHS", 2)
    three, bands = chromatic.chromatic(echo("cubic")).linear_db.T
    lost = (three - bands).tolist()
    assert min(lost) > 0 and min(lost[0], lost[2]) > 0.5


def test_measures_of_a_point_spread_function() -> None:
    psf = torch.zeros(8, 8, dtype=torch.float64)
    psf[4, 6] = 1  # the centre pixel is 4, 4: two to the right
    assert chromatic.centroid(psf).tolist() == [2, 0]
    assert chromatic.asymmetry(psf).tolist() == [1, 0]
    assert float(chromatic.rms_transfer(psf)) == 1  # a point passes every frequency on
    flat = torch.full((8, 8), 1 / 64, dtype=torch.float64)
    assert float(chromatic.rms_transfer(flat)) == pytest.approx(1 / 8)  # only frequency 0 of 64


def test_what_a_cube_does_not_tell_is_asked_for_by_option(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"cube": np.ones((64, 64, 4)), "other": np.ones((64, 64, 4))})
    wanted = np.array([500.0, 520.0])
    with pytest.raises(InputError, match="say which with --key cube"):
        read_cubes(tmp_path / "a.mat", wanted, Reading())
    with pytest.raises(InputError, match="give --start-nm and --step-nm"):
        read_cubes(tmp_path / "a.mat", wanted, Reading(key="cube"))
