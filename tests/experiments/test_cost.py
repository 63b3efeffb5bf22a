"""What accuracy costs is measured once, gone on from, and drawn."""

from __future__ import annotations

import csv
import math
import statistics
from dataclasses import replace

import pytest
import torch

from edofsim.capture import capture
from edofsim.errors import InputError
from edofsim.experiments import cost, predictions
from edofsim.experiments.cost_page import cost_plot, shift_table
from edofsim.experiments.cost_scores import GAIN, Judge
from edofsim.optics import Camera
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.masks.cubic import CubicMask
from edofsim.plan import Fidelity, planner_of, rates, remember, through_mask_like
from edofsim.recipe import CameraRecipe, load_scene
from edofsim.recipe.camera import PsfSettings
from edofsim.render.view import View
from edofsim.restore.scores import psnr, within_scale

CAMERA = Camera.from_recipe(
    CameraRecipe(name="test", lens=PlanoConvexLens(aperture_radius_mm=1.0), psf=PsfSettings(window_px=32))
)
NARROW = PlanoConvexLens(aperture_radius_mm=0.5)
SIMPLER = Camera.from_recipe(CAMERA.recipe.model_copy(update={"lens": NARROW}))
SIDE, MARGIN = 40, 16
RATES = {
    "prepare": {"calls": 1e-3, "moves": 3e-8, "elements": 1e-8},
    "psf": {"calls": 9e-5, "elements": 2e-8, "products": 3e-10},
    "blur": {"calls": 1e-4, "transforms": 3e-10, "elements": 3e-9, "moves": 4e-8},
    "sub_apertures": {"calls": 2e-3, "products": 4e-10, "elements": 4e-9},
    "sensor": {"elements": 2e-8},
    "pace": {"calls": 1e-3, "products": 3e-3, "transforms": 1e-3, "elements": 1e-3, "moves": 1e-3},
}


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch, tmp_path) -> View:
    """A slanted surface of random colours, and rates that need no measuring."""
    monkeypatch.setitem(rates._known, rates._name(), RATES)
    monkeypatch.setattr(remember, "_folder", lambda: tmp_path / "plans")
    side = SIDE + 2 * MARGIN
    draw = torch.Generator().manual_seed(1)
    return View.flat(
        torch.rand(5, side, side, generator=draw),
        torch.linspace(0, 2, side).expand(side, side),
        wavelengths=torch.linspace(420e-9, 720e-9, 5),
        pixel_angle=CAMERA.pixel_angle,
        margin=MARGIN,
    )


def test_cost_is_measured_gone_on_from_and_drawn(view: View, monkeypatch: pytest.MonkeyPatch, tmp_path):
    cases = cost.cases_of(planner_of(view, CAMERA), targets=(30, 50))
    taken = []
    whole = cost.capture
    monkeypatch.setattr(cost, "capture", lambda *a, **k: taken.append(a) or whole(*a, **k))
    rows = cost.measure(view, CAMERA, cases, tmp_path, repeats=2)
    by_name = {row.case.name: row for row in rows}
    assert by_name["full"].measured_db == math.inf and by_name["full"].repeats == 1
    assert by_name["50 dB"].measured_db >= 49 and by_name["30 dB"].measured_db >= 29
    assert (
        by_name["spherical aberration"].case.kind == "without"
        and by_name["spherical aberration"].measured_db < 60
    )
    count = len(taken)
    assert count == 2 * (len(cases) - 1) + 1

    # the last measurement was being written when the process died
    file = tmp_path / "measurements.jsonl"
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:20])
    again = cost.measure(view, CAMERA, cases, tmp_path, repeats=2)
    assert len(taken) == count + 1
    assert [row.measured_db for row in again] == [row.measured_db for row in rows]

    table = list(csv.DictReader(cost.write_table(tmp_path / "cost.csv", rows).open()))
    assert [line["case"] for line in table] == [case.name for case in cases]
    assert cost_plot(rows, "test").save(tmp_path / "cost.png").stat().st_size > 10_000


def test_names_in_the_chart_cover_no_other_name_and_no_marker():
    """Where points crowd; right of each point, as the first choice is, they would."""
    names = ["dispersion of the lens", "spherical aberration", "hidden surfaces", "occlusion"]
    left_out = [
        cost.Measured(cost.Case(name, "without", Fidelity()), 42.0 + 0.2 * i, 2.0 + 0.05 * i)
        for i, name in enumerate(names)
    ]
    targets = [cost.Measured(cost.Case(f"{db} dB", "target", Fidelity()), db, db / 20) for db in (30, 50, 60)]
    figure = cost_plot([*targets, *left_out], "test", 7.6).paint()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts}
    assert sorted(boxes) == sorted(names)
    points = axes.transData.transform([(row.seconds, row.measured_db) for row in (*targets, *left_out)])
    for name, box in boxes.items():
        others = [other for known, other in boxes.items() if known != name]
        assert box.count_overlaps(others) == 0 and box.count_contains(points) == 0, name


def test_effects_that_edges_do_not_need_are_measured_without_parts_of_the_pupil(view: View, tmp_path):
    """Against the full simulation without them too: a difference of parts would drown other effects."""
    side = SIDE + 2 * MARGIN
    front = torch.arange(side * side) % side < side // 2
    behind = torch.nonzero(front).squeeze(1)
    pixel = torch.cat([view.pixel, behind])
    order = torch.argsort(pixel * 2 + (torch.arange(len(pixel)) >= side * side))
    depth = torch.cat([2.0 * front, torch.zeros(len(behind))])[order]
    light = torch.cat([view.radiance, view.radiance[:, behind].flip(1)], 1)[:, order]
    step = replace(
        view,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=depth,
        radiance=light,
        hidden=order >= side * side,
    )
    cases = {case.name: case for case in cost.cases_of(planner_of(step, CAMERA), targets=())}
    assert cases["full"].fidelity.sub_apertures > 1 == cases["spherical aberration"].fidelity.sub_apertures
    assert cases["spherical aberration"].one_part and not cases["sub-apertures"].one_part
    rows = {
        row.case.name: row for row in cost.measure(step, CAMERA, list(cases.values()), tmp_path, repeats=1)
    }
    for name in ("spherical aberration", "sub-apertures", "hidden surfaces"):
        assert rows[name].measured_db == pytest.approx(rows[name].case.predicted_db, abs=3), name
    assert rows["full"].stages["sub_apertures"] > 0 == rows["spherical aberration"].stages["sub_apertures"]


def test_another_view_is_not_mixed_with_what_was_measured(view: View, tmp_path):
    cases = [
        cost.Case("few", "target", Fidelity(layers=2, occlusion="none"), 30.0),
        cost.Case("full", "full", Fidelity(layers=4, occlusion="none")),
    ]
    first = cost.measure(view, CAMERA, cases, tmp_path, repeats=1)
    other = view.to(dtype=torch.float32)
    brighter = View(**{**vars(other), "radiance": other.radiance.flip(1)})
    second = cost.measure(brighter, CAMERA, cases, tmp_path, repeats=1)
    assert first[0].measured_db != second[0].measured_db


def test_what_becomes_of_scores_is_told_beside_their_noise(view: View, tmp_path):
    """Against photos that are taken anew with each seed, and a restoration that only darkens."""
    few, full = Fidelity(layers=2, occlusion="none"), Fidelity(layers=4, occlusion="none")
    cases = [cost.Case("few", "target", few, 30.0), cost.Case("full", "full", full)]
    judge = Judge({"darker": lambda image, truncated: 0.9 * image}, seeds=3, alone=SIMPLER)
    row = cost.measure(view, CAMERA, cases, tmp_path, repeats=1, judge=judge)[0]

    def score(camera: Camera, fidelity: Fidelity, seed: int, darker: float) -> float:
        exposure = capture(view, CAMERA, full).exposure
        photo = capture(view, camera, fidelity, seed=seed, exposure=exposure)
        return psnr(within_scale(darker * photo.image), within_scale(photo.ideal))

    by_seed = [[score(CAMERA, how, seed, 0.9) for seed in range(3)] for how in (few, full)]
    shift = sum(by_seed[0]) / 3 - sum(by_seed[1]) / 3
    assert row.shifts["darker"].mean == pytest.approx(shift, abs=1e-4) and abs(shift) > 1e-3
    assert row.shifts["darker"].noise == pytest.approx(statistics.stdev(by_seed[1]), rel=1e-3)
    alone = [sum(score(SIMPLER, how, seed, 1.0) for seed in range(3)) / 3 for how in (few, full)]
    assert row.shifts[GAIN].mean == pytest.approx(shift - (alone[0] - alone[1]), abs=1e-4)
    cells = shift_table([row]).rows[0]
    assert cells[0] == "for few" and cells[1] == row.shifts["darker"].mean
    assert cost.figures([row])["shift_db.target.few.darker"] == row.shifts["darker"].mean


def test_the_lens_alone_is_compared_with_by_plans_of_its_own(view: View, tmp_path):
    """Through a mask that evens the blur few layers do; through the bare lens they would miss the target."""
    cubic = CAMERA.recipe.model_copy(update={"mask": CubicMask(alpha_rad=60.0)})
    masked, alone = Camera.from_recipe(cubic), CAMERA
    planner = planner_of(view, masked)
    rival = planner_of(view, alone, facts=through_mask_like(planner.facts, alone))
    cases = {(case.kind, case.name): case for case in cost.cases_of(planner, (45,), rival)}
    target, full = cases["target", "45 dB"], cases["full", "full"]
    assert full.alone == rival.facts.full
    truth = capture(view, alone, full.alone, exposure=1.0).clean
    own, others = (
        psnr(capture(view, alone, how, exposure=1.0).clean, truth) for how in (target.alone, target.fidelity)
    )
    assert own >= 45 > others
    judge = Judge({"nothing": lambda image, truncated: image}, alone=alone)
    row = cost.measure(view, masked, [target, full], tmp_path, repeats=1, judge=judge)[0]
    as_masked = [replace(case, alone=None) for case in (target, full)]
    other = cost.measure(view, masked, as_masked, tmp_path, repeats=1, judge=judge)[0]
    assert row.shifts["nothing"] == other.shifts["nothing"] and row.shifts[GAIN] != other.shifts[GAIN]


def test_a_mask_that_is_not_known_is_refused(tmp_path):
    with pytest.raises(InputError, match="--mask waffle: give one of clear"):
        predictions.run(tmp_path, lambda *_: None, ["wall"], masks=["waffle"])


def test_the_front_holds_what_nothing_beats():
    def row(seconds: float, db: float) -> cost.Measured:
        return cost.Measured(cost.Case("", "target", Fidelity()), db, seconds)

    front = cost.pareto([row(3, 50), row(1, 30), row(2, 25), row(2, 40), row(4, 45)])
    assert [(each.seconds, each.measured_db) for each in front] == [(1, 30), (2, 40), (3, 50)]


def test_shares_are_counted_over_effects_that_matter():
    def row(kind: str, measured: float, predicted: float, asked: float = math.inf) -> cost.Measured:
        return cost.Measured(cost.Case("", kind, Fidelity(), asked, predicted, 1.0), measured, 2.0)

    rows = (
        row("without", 40, 42),
        row("without", 40, 45),
        row("without", 70, 50),
        row("target", 39.5, 41, 40),
    )
    found = predictions.figures([predictions.Outcome("a", "b", rows)])
    assert found["pairs"] == 2 and found["share.error_within_3_db"] == 0.5
    assert found["worst_optimism_db"] == 5 and found["share.targets_met"] == 1
    assert found["share.time_within_1.5"] == 0


@pytest.mark.slow
def test_predictions_hold_on_a_small_scene(tmp_path):
    """The middle of a photograph with measured depth, through the cubic mask: nothing needs rendering."""
    found = predictions.figures(
        predictions.measure(tmp_path, lambda *_: None, [load_scene("motorcycle")], ["cubic"], quick=True)
    )
    assert found["pairs"] >= 5
    assert found["share.error_within_3_db"] >= 0.9
    assert found["worst_optimism_db"] <= 6
    assert found["share.targets_met"] == 1


def test_the_pace_of_the_machine_is_kept_beside_each_time(view: View, tmp_path):
    cases = [
        cost.Case("few", "target", Fidelity(layers=2, occlusion="none"), 30.0),
        cost.Case("full", "full", Fidelity(layers=4, occlusion="none")),
    ]
    ticks = iter(range(10_000))
    paces = iter([1.0, 3.0, 5.0, 7.0])
    how = {"repeats": 1, "clock": lambda: float(next(ticks)), "pace": lambda: next(paces)}
    rows = cost.measure(view, CAMERA, cases, tmp_path, **how)
    assert {row.case.name: row.pace for row in rows} == {"full": 2.0, "few": 6.0}
    assert all(row.seconds == sum(row.stages.values()) + 2 for row in rows)  # two more looks at the clock


def test_effects_of_rendering_are_measured_on_another_rendering(view: View, monkeypatch, tmp_path):
    """Direct light alone is a tenth darker here, so the photo is: linear optics."""
    from dataclasses import replace

    from edofsim.recipe import load_scene

    rendered = []

    def darker(recipe, base, **how):
        rendered.append(recipe.render.max_depth)
        return replace(view, radiance=0.9 * view.radiance)

    monkeypatch.setattr(predictions, "render", darker)
    monkeypatch.setattr(predictions, "seen_in_thumbnails", lambda *_, **__: ({2: (0.1, 0.1, 0.1)}, ()))
    desk = load_scene("desk")
    (row,) = predictions._rendering(desk.recipe, desk.base, view, CAMERA, tmp_path, {})
    fidelity = planner_of(view, CAMERA).plan().fidelity
    clean = capture(view, CAMERA, fidelity).clean
    assert row.case.name == "interreflection" and rendered == [2]
    assert row.case.predicted_db == pytest.approx(20)
    assert row.measured_db == pytest.approx(-10 * math.log10(float((0.1 * clean).square().mean())), abs=0.1)
    again = predictions._rendering(desk.recipe, desk.base, view, CAMERA, tmp_path, {})
    assert again == [row] and rendered == [2]
