"""The experiments of the optics and what they write."""

from __future__ import annotations

import csv
import math

import pytest
import torch

from edofsim.core.progress import silent
from edofsim.experiments import bandwidth, mtf, psf_figure
from edofsim.optics import Camera, psf_bank
from edofsim.recipe.camera import CameraRecipe


def small(mask: str = "cubic") -> Camera:
    settings = {"window_px": 32}
    return Camera.from_recipe(CameraRecipe(name="small", mask={"kind": mask}, psf=settings))


def test_chirp_bandwidth_follows_the_papers_curve(tmp_path):
    figures = bandwidth.run(tmp_path, silent).figures
    assert figures["ratio_difference_percent.psi_5_up"] < 5
    assert figures["psi_max"] == pytest.approx(44.4, abs=0.05)
    assert figures["sampling_bound_um"] == pytest.approx(22, abs=0.5)
    with (tmp_path / "bandwidth.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 100
    assert (tmp_path / "bandwidth.png").stat().st_size > 10_000


def test_bandwidth_of_a_wide_chirp_approaches_its_slope():
    # edges matter less and less against w_z = 2 Psi / r
    ratios = [bandwidth.bandwidth_ratio(psi) for psi in (10.0, 30.0, 90.0)]
    assert ratios[0] > ratios[1] > ratios[2] > 1


def test_transfer_functions_of_masks(tmp_path):
    figures = mtf.run(tmp_path, silent, "paper-cubic").figures
    # the clear aperture loses all contrast with defocus, the cubic mask hardly changes
    assert figures["mean_mtf.clear.psi_40"] < 0.1 * figures["mean_mtf.clear.psi_0"]
    assert figures["mean_mtf.cubic.psi_40"] > 0.7 * figures["mean_mtf.cubic.psi_0"]
    assert figures["least_mtf.clear"] < 0.01 < 0.1 < figures["least_mtf.cubic"]
    assert all(0 <= value <= 1 for value in figures.values())
    with (tmp_path / "mtf.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 18 * 121 and all(0 <= float(row["mtf"]) <= 1.0001 for row in rows)
    assert (tmp_path / "mtf.png").stat().st_size > 10_000


def test_psfs_as_picture_and_exr(tmp_path):
    import OpenEXR

    camera = small()
    figures, outputs = psf_figure.run(camera, tmp_path, wavelengths_nm=(543.0,), depths_m=(0.5, math.inf))
    assert set(outputs.values()) == set(tmp_path.iterdir())
    names = [
        f"{what}.{depth}.543nm" for what in ("truncated_percent", "strehl") for depth in ("0.5m", "infinity")
    ]
    assert set(figures) == {*names, "focus_m.paraxial", "focus_m.best", "transmission_percent"}
    bank = psf_bank(camera, [543e-9], [2.0, 0.0])
    with OpenEXR.File(str(tmp_path / "psf.exr"), separate_channels=True) as file:
        stored = torch.from_numpy(file.channels()["0.5m.543nm"].pixels.copy())
        assert CameraRecipe.model_validate_json(file.header()["camera"]) == camera.recipe
    assert torch.equal(stored, bank.values[0, 0])
    with OpenEXR.File(str(tmp_path / "mtf.exr"), separate_channels=True) as file:
        middle = float(file.channels()["infinity.543nm"].pixels[16, 16])
    assert middle == pytest.approx(float(bank.values[1, 0].sum()), rel=1e-5)
    assert (tmp_path / "psf.png").stat().st_size > 10_000


@pytest.mark.slow
def test_every_mask_has_a_picture(tmp_path):
    assert psf_figure.gallery(tmp_path).stat().st_size > 100_000


@pytest.mark.slow
def test_throughput_against_prysm():
    from benchmarks.optics import against_prysm

    figures = against_prysm()
    assert figures["difference.prysm"] < 1e-9
    assert figures["throughput_ratio.prysm_float64"] >= 5


@pytest.mark.slow
def test_memory_of_a_bank_stays_within_what_is_stated():
    from benchmarks.optics import bank_memory

    figures = bank_memory()
    threads = torch.get_num_threads()
    assert (
        figures["bank.growth_mib"]
        < 2 * figures["bank.size_mib"] + 4 * threads * figures["bank.work_limit_mib"]
    )
