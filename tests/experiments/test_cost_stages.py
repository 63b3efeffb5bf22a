"""What rendering and restoring cost: measured once, and drawn with the front and the choice."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
import torch

from edofsim.experiments import cost, cost_stages
from edofsim.experiments.cost_page import cost_page, stage_plot
from edofsim.experiments.cost_stages import Point, front
from edofsim.plan import Fidelity, rates, remember
from edofsim.recipe import Loaded, load_camera, load_scene
from edofsim.recipe.camera import PsfSettings
from edofsim.render.settings import samples_of_a_pass
from edofsim.render.view import View

BANDS = 7
RATES = {
    "prepare": {"calls": 1e-3, "moves": 3e-8, "elements": 1e-8},
    "psf": {"calls": 9e-5, "elements": 2e-8, "products": 3e-10},
    "blur": {"calls": 1e-4, "transforms": 3e-10, "elements": 3e-9, "moves": 4e-8},
    "sub_apertures": {"calls": 2e-3, "products": 4e-10, "elements": 4e-9},
    "sensor": {"elements": 2e-8},
    "pace": {"calls": 1e-3, "products": 3e-3, "transforms": 1e-3, "elements": 1e-3, "moves": 1e-3},
}


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> View:
    """Random colours in one plane, and rates that need no measuring."""
    monkeypatch.setitem(rates._known, rates._name(), RATES)
    monkeypatch.setattr(remember, "_folder", lambda: tmp_path / "plans")
    side = 40 + 2 * 16
    draw = torch.Generator().manual_seed(1)
    coarse = torch.rand(BANDS, 9, 9, generator=draw)
    radiance = torch.nn.functional.interpolate(coarse[None], (side, side), mode="bilinear")[0]
    return View.flat(
        radiance,
        1.25,
        wavelengths=torch.linspace(420e-9, 720e-9, BANDS),
        pixel_angle=6e-6 / 36.8975e-3,
        margin=16,
    )


def ship(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """As if these were all networks with a mask: each takes seconds."""
    monkeypatch.setattr(cost_stages, "shipped_checkpoints", lambda: names)


def camera(name: str) -> Loaded:
    loaded = load_camera(name)
    recipe = loaded.recipe.model_copy(update={"psf": PsfSettings(window_px=32)})
    return Loaded(recipe, loaded.path, loaded.text)


@pytest.mark.usefixtures("conditioned_once", "filters_left_out")
def test_restoring_is_measured_once_and_the_default_is_marked(
    view: View, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    ship(monkeypatch, "paper-dcnn")
    taken = []
    whole = cost_stages.restore
    monkeypatch.setattr(cost_stages, "restore", lambda *a, **k: taken.append(a) or whole(*a, **k))
    points = cost_stages.restore_points(view, camera("paper-clear"), tmp_path, repeats=2)
    assert len(taken) == 2 * len(points) and len({point.name for point in points}) == len(points)
    assert [point.name for point in points if point.chosen] == ["universal"]
    names = ["Wiener", "paper-dcnn", "Wiener, mask of paper-dcnn", "universal"]
    assert [point.name for point in points] == names
    assert all(point.seconds > 0 and math.isfinite(point.value) for point in points)
    again = cost_stages.restore_points(view, camera("paper-clear"), tmp_path, repeats=2)
    assert again == points and len(taken) == 2 * len(points)


@pytest.mark.usefixtures("conditioned_once", "filters_left_out")
def test_a_camera_with_a_network_of_its_own_is_restored_by_it(
    view: View, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    ship(monkeypatch, "paper-bank", "paper-dcnn")
    points = cost_stages.restore_points(view, camera("paper-learned"), tmp_path, repeats=1)
    (chosen,) = [point for point in points if point.chosen]
    assert "Wiener" not in chosen.name and any("Wiener" in point.name for point in points)


def test_rendering_with_more_samples_is_told_with_its_noise(monkeypatch: pytest.MonkeyPatch, view: View):
    """Without the renderer: noise falls with the root of the samples, seconds rise with them."""
    from dataclasses import replace

    def rendered(recipe, base, **how):
        return replace(view, noise=recipe.render.samples**-0.5)

    monkeypatch.setattr(cost_stages, "render", rendered)
    monkeypatch.setattr(cost_stages, "_render_seconds", lambda recipe, *_: float(recipe.render.samples))
    scene = load_scene("wall")
    points = cost_stages.render_points(scene.recipe, scene.base)
    assert [point.seconds for point in points] == [4, 8, 16, 32, 64]
    assert front(points) == points and [point.chosen for point in points] == [False] * 4 + [True]
    photo = load_scene("motorcycle")
    assert cost_stages.render_points(photo.recipe, photo.base) == []


def test_loading_and_compiling_are_no_part_of_the_seconds_of_rendering(monkeypatch: pytest.MonkeyPatch):
    """40 samples are passes of 16, 16 and 8, of which the last takes half as long as the others."""
    scene = load_scene("wall")
    settings = scene.recipe.render.model_copy(update={"samples": 40})
    recipe = scene.recipe.model_copy(update={"render": settings})
    assert samples_of_a_pass(40) == 16
    run = {"seconds": {"load": 9.0, "survey": 9.0, "paths": 19.0}, "last_pass_seconds": {"all": 1.0}}
    monkeypatch.setattr(cost_stages, "run_of", lambda *_: run)
    assert cost_stages._render_seconds(recipe, scene.base, None) == pytest.approx(5.0)


def test_all_stages_are_drawn_and_written(tmp_path: Path):
    points = [
        Point("render", "4 samples", 0.5, 1.0),
        Point("render", "8 samples", 0.35, 2.0, True),
        Point("restore", "Wiener", 24.0, 0.5),
        Point("restore", "slow", 23.0, 0.8),
        Point("restore", "good", 28.0, 1.0, True, 0.02),
    ]
    assert [point.name for point in front(points[2:])] == ["Wiener", "good"]
    found = cost_stages.figures(points)
    assert found["render_noise.render.8_samples"] == 0.35 and found["psnr_db.restore.good"] == 28.0
    assert found["psnr_db_se.restore.good"] == 0.02 and "psnr_db_se.render.8_samples" not in found
    lines = list(csv.DictReader(cost_stages.write_table(tmp_path / "stages.csv", points).open()))
    assert [line["chosen"] for line in lines] == ["0", "1", "0", "0", "1"]
    assert [line["psnr_db_se"] for line in lines][1::3] == ["", "0.02"]
    rows = [
        cost.Measured(cost.Case("30 dB", "target", Fidelity(), 30.0, 31.0, 0.1), 32.0, 0.1),
        cost.Measured(cost.Case("chosen", "chosen", Fidelity(), 50.0, 51.0, 0.2), 52.0, 0.2),
        cost.Measured(cost.Case("full", "full", Fidelity()), math.inf, 3.0),
    ]
    page = cost_page(tmp_path / "cost.html", "test", rows, points, {"times_faster.chosen": 15.0})
    text = page.read_text(encoding="utf-8")
    assert all(word in text for word in ("Rendering", "Restoration", "good", "15.0"))
    assert stage_plot(points[:2]).save(tmp_path / "render.png").stat().st_size > 5_000
    assert stage_plot(points[2:]).save(tmp_path / "restore.png").stat().st_size > 5_000
