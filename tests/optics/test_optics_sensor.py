"""Spectral response and noise of the sensor."""

from __future__ import annotations

import pytest
import torch

from edofsim.errors import InputError
from edofsim.optics import Camera, response
from edofsim.recipe.camera import CameraRecipe

BANDS = torch.linspace(420e-9, 720e-9, 31, dtype=torch.float64)


def camera(name: str, base=None) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="sensor", sensor={"response": name}), base)


@pytest.mark.parametrize("name", ["paper", "nikon-5100", "sigma-sdmerill"])
def test_rows_sum_to_one_and_peak_in_their_colour(name):
    bands = BANDS[:27]  # to 680 nm, where Sigma's data end
    weights = response(camera(name), bands)
    assert weights.shape == (3, 27) and weights.dtype == torch.float64
    assert torch.allclose(weights.sum(1), torch.ones(3, dtype=torch.float64))
    red, green, blue = (float(bands[row.argmax()]) for row in weights)
    assert 430e-9 < blue < 500e-9 < green < red < 660e-9


def test_the_papers_response_is_its_table():
    weights = response(camera("paper"), BANDS)
    # read off the figure: red peaks at 610 nm with 0.0991, green at 540 with 0.0963, blue at 480 with 0.0950
    assert float(weights[0, 19]) == pytest.approx(0.0991, abs=1e-3)
    assert float(weights[1, 12]) == pytest.approx(0.0963, abs=1e-3)
    assert float(weights[2, 6]) == pytest.approx(0.0950, abs=1e-3)


def test_wavelengths_between_the_table_are_interpolated():
    fine = torch.linspace(420e-9, 720e-9, 61, dtype=torch.float64)
    coarse, dense = response(camera("paper"), BANDS), response(camera("paper"), fine)
    ratio = coarse / dense[:, ::2].clamp_min(1e-12)
    assert torch.allclose(ratio[0], ratio[0, 0].expand(31))


def test_wavelengths_outside_are_refused():
    with pytest.raises(InputError, match="does not have 400 nm"):
        response(camera("paper"), torch.tensor([400e-9, 500e-9]))
    with pytest.raises(InputError, match="does not have 690 nm"):
        response(camera("sigma-sdmerill"), BANDS)
    with pytest.raises(InputError, match="blue dark"):
        response(camera("paper"), torch.tensor([700e-9, 720e-9]))


def test_lines_give_each_channel_its_own_band():
    weights = response(camera("lines"), torch.tensor([482e-9, 611e-9, 543e-9]))
    assert torch.equal(weights, torch.tensor([[0, 1, 0], [0, 0, 1], [1, 0, 0]]).double())
    with pytest.raises(InputError, match="three bands"):
        response(camera("lines"), BANDS)


def test_own_tables(tmp_path):
    (tmp_path / "mine.csv").write_text("wavelength_nm,r,g,b\n400,0,0,1\n550,0,1,0\n700,1,0,0\n")
    weights = response(camera("mine.csv", tmp_path), torch.tensor([400e-9, 475e-9, 550e-9, 700e-9]).double())
    assert torch.allclose(weights[2], torch.tensor([2 / 3, 1 / 3, 0, 0]).double(), atol=1e-6)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("nm,r,g,b\n400,0,0,1\n", "wavelength_nm"),
        ("wavelength_nm,r,g,b\n400,0,x,1\n500,1,1,1\n", "numbers"),
        ("wavelength_nm,r,g,b\n500,0,0,1\n400,1,1,1\n", "rising"),
        ("wavelength_nm,r,g,b\n400,0,0,-1\n500,1,1,1\n", "0 or above"),
        ("", "two rows"),
    ],
)
def test_bad_tables_are_refused(tmp_path, text, word):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=word):
        response(camera("bad.csv", tmp_path), BANDS)


def test_an_unknown_response_names_the_nearest():
    with pytest.raises(InputError, match="nikon-5100"):
        response(camera("nikon-5200"), BANDS)
