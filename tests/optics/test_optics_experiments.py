"""The experiments of the optics and what they write."""

from __future__ import annotations

import csv
import math

import pytest
import torch

from edofsim.core.images import read_exr
from edofsim.core.progress import silent
from edofsim.experiments import bandwidth, field_figure, mtf, psf_figure
from edofsim.optics import Camera, psf_bank
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.recipe.load import load_camera


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


def test_a_lens_over_its_field_as_pictures_and_tables(tmp_path, monkeypatch):
    """Figures are those of the tables, and what is at the axis has no sides."""
    monkeypatch.setattr(field_figure, "CURVE", 3)
    monkeypatch.setattr(field_figure, "DEPTHS", 3)
    recipe = load_camera("aspheres-5mm-f3").recipe
    camera = Camera.from_recipe(recipe.model_copy(update={"psf": PsfSettings(window_px=32)}))
    what = {"fields_deg": (0.0, 8.0), "wavelengths_nm": (611.0, 543.0, 482.0), "depths_m": (0.5, 1.0)}
    figures, outputs = field_figure.run(camera, tmp_path, **what)
    assert set(outputs.values()) == set(tmp_path.iterdir())
    assert all(path.stat().st_size > 10_000 for path in outputs.values() if path.suffix == ".png")
    tables = {}
    for path in tmp_path.glob("*.csv"):
        with path.open() as file:
            tables[path.stem] = list(csv.DictReader(file))
    rows = {float(row["field_deg"]): row for row in tables["field"]}
    for degrees in (0.0, 8.0):
        name, row = f"{degrees:g}deg", rows[degrees]
        assert figures[f"distortion_percent.{name}"] == pytest.approx(
            float(row["distortion_percent"]), abs=1e-4
        )
        for side in ("tangential", "sagittal"):
            assert figures[f"focus_um.{side}.{name}"] == pytest.approx(
                float(row[f"focus_{side}_um"]), abs=1e-2
            )
        colour = float(row["lateral_colour_611nm_um"]) - float(row["lateral_colour_482nm_um"])
        assert figures[f"lateral_colour_um.{name}"] == pytest.approx(colour, abs=1e-4)
        at_focus = [row for row in tables["mtf_depth"] if float(row["inverse_depth_per_m"]) == 1.0]
        both = next(row for row in at_focus if float(row["field_deg"]) == degrees)
        for side in ("tangential", "sagittal"):
            assert figures[f"mtf.{side}.{name}"] == pytest.approx(float(both[side]), abs=1e-3)
    assert figures["illumination_percent.0deg"] == 100 > figures["illumination_percent.8deg"] > 90
    assert figures["mtf.tangential.0deg"] == pytest.approx(figures["mtf.sagittal.0deg"], abs=1e-3)
    assert figures["mtf.sagittal.8deg"] > 2 * figures["mtf.tangential.8deg"]
    spot = next(r for r in tables["spots"] if (r["field_deg"], r["depth_m"], r["nm"]) == ("8", "1", "543"))
    assert figures["spot_um.8deg"] == pytest.approx(float(spot["rms_um"]), rel=1e-4)
    stored = read_exr(tmp_path / "psf_field.exr", "PSFs")
    assert len(stored) == 2 * 2 * 3
    bank = psf_bank(camera.at_field((0.0, math.tan(math.radians(8.0)))), [482e-9], [2.0])
    assert float(abs(torch.from_numpy(stored["8deg.0.5m.482nm"]) - bank.values[0, 0]).max()) < 1e-6


def test_places_of_the_field_that_are_looked_at_reach_the_corner_of_a_frame():
    camera = Camera.from_recipe(load_camera("doublet-25mm-f6").recipe)
    corner = math.degrees(math.atan(320 * camera.pixel_angle))
    assert field_figure.usual_fields(camera) == pytest.approx((0, corner / 2, 0.7 * corner, corner), rel=0.01)


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
