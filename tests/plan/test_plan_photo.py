"""The plan asks for what a view and a camera call for, and for nothing else."""

from __future__ import annotations

import functools
import importlib
import math
import runpy
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture import Fidelity, capture
from edofsim.capture.fidelity import describe
from edofsim.core.once import Once
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.plan import (
    EFFECTS,
    RESTORED,
    Effect,
    Level,
    Target,
    all_effects,
    as_accurate,
    decibels,
    overall,
    parse_target,
    plan_photo,
    planner_of,
    remember,
    thumbnail,
)
from edofsim.plan.costs import WORTH_S
from edofsim.plan.effects import sub_apertures, window
from edofsim.plan.estimate import estimate
from edofsim.plan.facts import facts_of, rms
from edofsim.plan.photo import allowed_error
from edofsim.plan.spectra import Spectra
from edofsim.plan.target import sensor_noise
from edofsim.plan.work import work_of
from edofsim.recipe import CameraRecipe, load_camera, load_scene
from edofsim.recipe.camera import PsfSettings, Sensor
from edofsim.render.view import View

PSF = PsfSettings(window_px=32)
LENS = PlanoConvexLens(aperture_radius_mm=1.0)
CAMERA = Camera.from_recipe(CameraRecipe(name="test", lens=LENS, psf=PSF, sensor=Sensor(read_noise=0.005)))
BANDS = torch.linspace(420e-9, 720e-9, 7, dtype=torch.float64)


def scene(inverse_depth: torch.Tensor, spectra: torch.Tensor | None = None, hidden: bool = False) -> View:
    """Random radiance at given depths [y, x]; spectra: [band, y, x] in its place; hidden: light at infinity
    behind the nearer half."""
    rows, columns = inverse_depth.shape
    draw = torch.Generator().manual_seed(3)
    if spectra is None:
        spectra = torch.rand(len(BANDS), rows, columns, generator=draw)
    behind = torch.nonzero(inverse_depth.flatten() > inverse_depth.mean()).squeeze(1) if hidden else None
    pixel = torch.arange(rows * columns)
    depth, light = inverse_depth.flatten(), spectra.reshape(len(BANDS), -1)
    is_hidden = torch.zeros(len(pixel), dtype=torch.bool)
    if behind is not None:
        pixel = torch.cat([pixel, behind])
        depth = torch.cat([depth, torch.zeros(len(behind))])
        light = torch.cat([light, torch.rand(len(BANDS), len(behind), generator=draw)], 1)
        is_hidden = torch.cat([is_hidden, torch.ones(len(behind), dtype=torch.bool)])
    order = torch.argsort(pixel * 2 + is_hidden)
    return View(
        height=rows - 32,
        width=columns - 32,
        margin=16,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=depth[order],
        radiance=light[:, order],
        hidden=is_hidden[order],
        wavelengths=BANDS,
        pixel_angle=CAMERA.pixel_angle,
    )


FLAT = torch.full((72, 80), 0.7)
STEP = torch.where(torch.arange(80) < 40, 2.0, 0.0).expand(72, 80)
SLANTED = torch.linspace(0.0, 2.0, 80).expand(72, 80)


@functools.cache
def planner_with_map():
    """A rough relief in place of the mask of a camera whose own recipe has none; with its view."""
    draw = torch.Generator().manual_seed(1)
    height_map = 0.3e-6 * torch.rand(96, 96, generator=draw, dtype=torch.float64)
    view = scene(SLANTED)
    return planner_of(view, CAMERA.with_height(height_map)), view, height_map


@functools.cache
def planner(kind: str):
    """Estimates are made once for all tests of a scene."""
    depth = {"flat": FLAT, "slanted": SLANTED, "step": STEP}[kind]
    return planner_of(scene(depth, hidden=kind == "step"), CAMERA)


def row(plan, effect: str):
    (found,) = [d for d in plan.decisions if d.effect == effect]
    return found


def measured(view: View, camera: Camera, change: dict, full=None) -> float:
    """Root mean square difference of the photo with a change from the photo in full."""
    full = full or planner_of(view, camera, effects=()).facts.full
    difference = capture(view, camera, full.changed(change)).clean - capture(view, camera, full).clean
    return float(difference.square().mean().sqrt())


def test_one_depth_calls_for_one_layer_and_no_occlusion():
    plan = planner("flat").plan()
    called_for = {d.effect for d in plan.decisions if d.called_for}
    assert not called_for & {"depth layers", "occlusion", "hidden surfaces"}
    assert plan.fidelity.occlusion == "none" and "0.7" not in row(plan, "depth layers").chosen
    assert capture(scene(FLAT), CAMERA, plan.fidelity).how.layers == 1


def test_a_slanted_surface_has_layers_and_no_edges_and_a_step_has():
    slanted = planner("slanted").plan()
    assert row(slanted, "depth layers").called_for
    step = planner("step").plan()
    assert row(step, "occlusion").called_for and row(step, "hidden surfaces").error is not None
    guessed = row(plan_photo(scene(STEP), CAMERA), "hidden surfaces")  # nothing is known there
    assert guessed.error is not None and "guessed" in guessed.chosen and "not known" in guessed.why


@pytest.mark.parametrize("kind", ["slanted", "step"])
@pytest.mark.parametrize("asked", [20, 35, 50])
def test_levels_that_cannot_be_taken_are_not_looked_at(kind: str, asked: int):
    """And the choice among those that are left is that among all."""
    whole, target = planner(kind), Target("db", asked)
    most = allowed_error(target, whole.facts)
    found = estimate(replace(whole.facts, allowed=most), all_effects())
    assert replace(whole, estimates=found).plan(target).fidelity == whole.plan(target).fidelity
    known = whole.estimates.by_name
    for row in found.rows:
        assert row.levels[0] == known[row.effect.name].levels[0]  # what leaving it out costs is always told
        assert row.levels[-1] == known[row.effect.name].levels[-1]
        errors = [overall(level) for level in row.errors]
        if not row.effect.one_pass and errors[0] > most:
            halves = math.ceil(math.log2(len(known[row.effect.name].levels)))
            assert sum(error > most for error in errors) <= 1 + halves
    levels = [sum(len(row.levels) for row in rows) for rows in (found.rows, whole.estimates.rows)]
    assert levels[0] < levels[1]


def test_bands_that_say_the_same_are_gathered():
    """A grey scene under one light has the same spectrum everywhere: each channel's mean PSF is then exact,
    which is not so where every pixel has a spectrum of its own."""
    grey = torch.rand(1, 72, 80, generator=torch.Generator().manual_seed(0)).expand(len(BANDS), 72, 80)
    target = parse_target("60dB", None)
    many = capture(scene(FLAT), CAMERA, planner("flat").plan(target).fidelity)
    plan = plan_photo(scene(FLAT, grey.contiguous()), CAMERA, target=target)
    few = capture(scene(FLAT, grey.contiguous()), CAMERA, plan.fidelity)
    assert few.how.bands < many.how.bands


def test_a_sensor_of_three_lines_has_no_bands_to_gather():
    camera = Camera.from_recipe(CameraRecipe(name="lines", psf=PSF, sensor=Sensor(response="lines")))
    view = scene(FLAT)
    view = replace(view, radiance=view.radiance[:3], wavelengths=view.wavelengths[[1, 3, 5]])
    found = row(plan_photo(view, camera), "bands")
    assert not found.called_for and found.error is None


@pytest.mark.parametrize("effect", ["bands", "spherical aberration", "dispersion of the lens", "PSF window"])
def test_an_estimate_is_what_the_whole_photo_shows(effect: str):
    """Within 3 dB; depths and the rest of the simulation differ."""
    view, known = scene(SLANTED), planner("slanted")
    found = known.estimates.by_name[effect]
    truth = measured(view, CAMERA, dict(found.levels[0].change), known.facts.full)
    assert decibels(overall(found.errors[0])) == pytest.approx(decibels(truth), abs=3)


@pytest.mark.parametrize("asked", [30, 40, 50])
def test_what_is_promised_is_met(asked: int):
    view, known = scene(SLANTED), planner("slanted")
    plan = known.plan(parse_target(f"{asked}dB", None))
    full = capture(view, CAMERA, known.facts.full).clean
    error = capture(view, CAMERA, plan.fidelity).clean - full
    assert decibels(float(error.square().mean().sqrt())) >= asked - 1
    assert plan.error_db >= asked


@pytest.mark.parametrize("effect", ["dispersion of the DOE", "pupil sampling"])
def test_a_height_map_in_the_mask_s_place_has_the_effects_of_one(effect: str):
    """Against the whole photo: a map beside a recipe without a mask disperses, and scatters light."""
    found, view, height_map = planner_with_map()
    estimate = found.estimates.by_name[effect]
    how = functools.partial(capture, view, CAMERA.with_height(height_map))
    full = found.facts.full
    difference = how(full.changed(estimate.levels[0].change)).clean - how(full).clean
    ratio = overall(estimate.errors[0]) / float(difference.square().mean().sqrt())
    assert estimate.absent == "" and 1 / 1.4 < ratio < 1.4  # 3 dB


@pytest.mark.parametrize("asked", [40, 50, 60])
def test_what_is_promised_with_a_height_map_is_met(asked: int):
    found, view, height_map = planner_with_map()
    how = functools.partial(capture, view, CAMERA.with_height(height_map))
    plan = found.plan(parse_target(f"{asked}dB", None))
    difference = how(plan.fidelity).clean - how(found.facts.full).clean
    assert -20 * difference.square().mean().sqrt().log10() > asked - 1


def test_more_accuracy_never_takes_less_time():
    known = planner("slanted")
    times = [sum(known.plan(parse_target(f"{db}dB", None)).seconds.values()) for db in (25, 40, 55)]
    assert times == sorted(times)
    assert times[-1] <= sum(known.plan(parse_target("full", None)).seconds.values())


def test_a_time_that_cannot_be_had_gives_the_fastest_and_says_so():
    known = planner("slanted")
    plan = known.plan(parse_target(None, "1e-6s"))
    fast = known.plan(parse_target("10dB", None))
    assert "cannot be had" in plan.note
    assert sum(plan.seconds.values()) <= 1.05 * sum(fast.seconds.values())
    late = known.plan(Target("time", seconds=20.0, spent=19.999999))
    assert "20 s, of which 20 s are spent" in late.target and "20 s are spent" in late.note
    assert late.fidelity == plan.fidelity
    enough = known.plan(parse_target(None, "1h"))
    assert not enough.note and enough.error_db == float("inf")


def test_an_accuracy_beyond_the_rendering_is_answered_with_why():
    noisy = replace(scene(FLAT), noise=0.05, metadata={"samples": 16})
    plan = plan_photo(noisy, CAMERA, target=parse_target("70dB", None))
    assert "its own noise" in plan.note and "times as many samples" in plan.note
    assert not plan_photo(noisy, CAMERA, target=parse_target("30dB", None)).note


def test_an_accuracy_that_the_user_stands_in_the_way_of_is_answered_with_why():
    plan = plan_photo(
        scene(SLANTED), CAMERA, {"without": ["spherical aberration"]}, parse_target("70dB", None)
    )
    assert "70.0 dB cannot be had with spherical aberration" in plan.note and plan.error_db < 70
    everything = planner("slanted").facts.full.changed({"spherical_aberration": False})
    assert measured(scene(SLANTED), CAMERA, vars(plan.fidelity)) == pytest.approx(
        measured(scene(SLANTED), CAMERA, vars(everything)), rel=1e-3
    )
    assert not plan_photo(scene(SLANTED), CAMERA, target=parse_target("45dB", None)).note


def test_saturation_and_mosaic_are_told_in_their_own_size():
    """What a bright exposure clips and what a mosaic keeps out, against the whole photo's own pixels."""
    sensor = Sensor(read_noise=0.005, exposure=3.0, saturation=True, bayer="RGGB")
    camera = Camera.from_recipe(CAMERA.recipe.model_copy(update={"sensor": sensor}))
    plan = plan_photo(scene(SLANTED), camera)
    photo = capture(scene(SLANTED), camera, planner("slanted").facts.full).clean
    clipped = (photo - photo.clamp(0, 1)).square().mean().sqrt()
    kept_out = photo.square().mean((1, 2)) * torch.tensor([0.75, 0.5, 0.75])
    assert decibels(overall(row(plan, "saturation").error)) == pytest.approx(decibels(float(clipped)), abs=3)
    expected = decibels(float(kept_out.mean().sqrt()))
    assert decibels(overall(row(plan, "Bayer mosaic").error)) == pytest.approx(expected, abs=1)
    assert plan.fidelity.saturation and plan.fidelity.mosaic
    plain = plan_photo(scene(SLANTED), camera, {"without": ["Bayer mosaic", "saturation"]}).fidelity
    image = capture(scene(SLANTED), camera, plain).image
    assert float(image.max()) > 1 and float((image == 0).float().mean()) < 0.01
    assert row(plan_photo(scene(SLANTED), CAMERA), "Bayer mosaic").error is None


def test_what_the_user_insists_on_is_done_and_marked():
    overrule = {"layers": 3, "occlusion": None, "without": ["spherical aberration"]}
    plan = plan_photo(scene(SLANTED), CAMERA, overrule)
    assert plan.fidelity.layers == 3 and not plan.fidelity.spherical_aberration
    assert {d.effect for d in plan.decisions if d.overruled} == {"depth layers", "spherical aberration"}
    with pytest.raises(InputError, match="effect 'spherical aberation' is not known"):
        plan_photo(scene(SLANTED), CAMERA, {"with_": ["spherical aberation"]})


def test_noise_that_the_recipe_asks_for_is_told_in_its_own_size():
    found = row(planner("flat").plan(), "read noise")
    assert overall(found.error) == pytest.approx(0.005) and found.chosen == "Gaussian"
    silent = Camera.from_recipe(CameraRecipe(name="silent", psf=PSF, sensor=Sensor(read_noise=0)))
    assert row(plan_photo(scene(FLAT), silent), "read noise").error is None


def test_the_default_asks_for_less_than_half_of_the_noise():
    plan = planner("flat").plan()
    assert plan.asked_db == pytest.approx(decibels(0.0025))


def test_an_effect_is_a_file_and_a_line():
    """As in CONTRIBUTING.md: the estimate of an effect of one's own is what the photo shows without it."""
    mine = Effect(
        name="half the window",
        levels=lambda facts: [Level("half", {"window_px": 16}), Level("whole", {})],
        why=lambda facts: "blur has tails",
    )
    known = planner_of(scene(FLAT), CAMERA, effects=(EFFECTS["bands"], mine))
    found = row(known.plan(parse_target("full", None)), "half the window")
    truth = measured(scene(FLAT), CAMERA, {"window_px": 16})
    assert decibels(overall(found.error)) == pytest.approx(decibels(truth), abs=3)


def test_effects_are_all_listed_and_named_once():
    import edofsim.plan.effects as package

    files = {path.stem for path in Path(package.__file__).parent.glob("*.py")} - {"__init__"}
    modules = [vars(importlib.import_module(f"{package.__name__}.{file}")) for file in files]
    made = [each.name for module in modules for each in module.values() if isinstance(each, Effect)]
    assert sorted(made) == sorted(EFFECTS)
    assert [effect.name for effect in all_effects()] == list(EFFECTS)


def test_every_knob_of_a_fidelity_belongs_to_an_effect_that_sets_it():
    """The record of what is simulated, the effects of a plan and the page that lists them do not drift
    apart."""
    apart = ("simplifications", "without_sensor")  # other packages set them
    knobs = {knob.name: knob for knob in describe() if knob.name not in apart}
    assert {knob.effect for knob in knobs.values()} == set(EFFECTS)
    assert all(knob.meaning for knob in knobs.values())
    found: dict[str, set[str]] = {}
    known = [planner(name) for name in ("slanted", "step")]
    for each in known:
        for looked in each.estimates.rows:
            for level in looked.levels:
                found.setdefault(looked.effect.name, set()).update(level.change)
    for name, changed in found.items():  # or to the effect that it is a part of, or that is a part of it
        near = {name, EFFECTS[name].within, *(n for n, effect in EFFECTS.items() if effect.within == name)}
        assert {knobs[field].effect for field in changed} <= near
    docs = Path(__file__).parents[2] / "docs"
    page = runpy.run_path(str(docs / "effects_page.py"))["effects_page"]
    assert (docs / "effects.md").read_text() == page()


@pytest.mark.parametrize("text", ["0dB", "-3dB", "good", "dB", "score:", "score:0dB", "score:-1dB"])
def test_wrong_targets_are_refused(text: str):
    with pytest.raises(InputError, match="--accuracy"):
        parse_target(text, None)


def test_scores_that_could_be_asked_for_are_understood(caplog: pytest.LogCaptureFixture):
    assert parse_target("score:0.1dB", None) == parse_target("restored", None) == RESTORED
    assert "`restored` now" in caplog.text and len(caplog.messages) == 1


def test_what_is_restored_takes_a_photo_that_is_nearer():
    """By as much, whatever the sensor's noise, and by other levels than the default."""
    known = planner("step")
    usual, nearer = known.plan(), known.plan(RESTORED)
    assert usual.asked_db is not None and nearer.asked_db == pytest.approx(
        usual.asked_db + RESTORED.nearer_db
    )
    assert usual.fidelity != nearer.fidelity and usual.error_db < nearer.asked_db <= nearer.error_db
    assert parse_target(None, None) == Target() and parse_target(None, None, RESTORED) == RESTORED
    assert as_accurate(nearer, RESTORED) == Target()  # nothing is restored from the photo compared with
    assert as_accurate(nearer, Target("time", seconds=1.0)) == Target("db", db=nearer.error_db)


@pytest.mark.parametrize(("louder_db", "nearer_db"), [(5, 12.0), (11, 13 - 20 * math.log10(2)), (30, 0.0)])
def test_what_noise_of_the_rendering_hides_need_not_be_restored(louder_db: float, nearer_db: float):
    """A photo of a rendering that is noisier than the sensor need be no more than 24 dB nearer than that, and
    as accurate as by default at least."""
    facts = planner("step").facts
    whole = replace(facts, view=replace(facts.view, noise=1.0))
    noise = sensor_noise(facts) / overall(whole.monte_carlo_noise) * 10 ** (louder_db / 20)
    noisy = replace(facts, view=replace(facts.view, noise=noise))
    usual = Target().asked_db(facts)
    assert Target().asked_db(noisy) == usual and RESTORED.asked_db(facts) == pytest.approx(usual + 12)
    assert RESTORED.asked_db(noisy) == pytest.approx(usual + nearer_db, abs=1e-6)
    said = f"{nearer_db:.3g} dB nearer for what is restored"
    assert (said in RESTORED.sentence(noisy)) == (nearer_db > 0)


def test_a_target_is_an_accuracy_or_a_time():
    assert parse_target("45dB", None).db == 45 and parse_target(None, "2min").seconds == 120
    with pytest.raises(InputError, match="one of them"):
        parse_target("full", "3s")
    with pytest.raises(InputError, match="--time"):
        parse_target(None, "soon")


def test_a_thumbnail_shows_the_same_field_with_fewer_pixels():
    recipe = load_scene("desk").recipe
    small = thumbnail(recipe)
    assert max(small.frame.width_px, small.frame.height_px) <= 64
    field = recipe.frame.width_px * recipe.frame.pixel_angle_mrad
    assert small.frame.width_px * small.frame.pixel_angle_mrad == pytest.approx(field, rel=0.05)
    assert small.objects == recipe.objects and small.render.samples <= 16


def test_a_plan_is_remembered_and_damage_is_not_believed(monkeypatch: pytest.MonkeyPatch, tmp_path):
    monkeypatch.setattr(remember, "_folder", lambda: tmp_path)
    looks = []
    whole = Spectra.by_bands
    monkeypatch.setattr(Spectra, "by_bands", lambda self, *how: looks.append(how) or whole(self, *how))
    first = plan_photo(scene(FLAT), CAMERA)
    count = len(looks)
    again = plan_photo(scene(FLAT), CAMERA)
    assert count > 0 and len(looks) == count and again.fidelity == first.fidelity
    assert again.error_db == pytest.approx(first.error_db)
    (file,) = tmp_path.glob("*.json")
    file.write_text("{")
    assert plan_photo(scene(FLAT), CAMERA).fidelity == first.fidelity and len(looks) == 2 * count


def counted(monkeypatch: pytest.MonkeyPatch, view: View, plan) -> dict[str, int]:
    """Calls that a photo makes: PSFs computed, convolutions, coverages blurred."""
    from edofsim.capture import blurring, layers
    from edofsim.optics import field

    calls = {"psfs": 0, "convolutions": 0, "coverages": 0}

    def bank(camera, wavelengths, depths, **how):
        if how.get("window_px") != 1:
            calls["psfs"] += len(wavelengths) * len(depths)
        return psf_bank(camera, wavelengths, depths, **how)

    def convolved(total, light, *rest):
        calls["convolutions"] += len(light)
        return add_convolved(total, light, *rest)

    def blocked(way):
        def one(self, *rest):
            calls["coverages"] += 1
            return way(self, *rest)

        return one

    psf_bank, add_convolved = field.psf_bank, layers.add_convolved
    monkeypatch.setattr(field, "psf_bank", bank)
    monkeypatch.setattr(layers, "add_convolved", convolved)
    for name in ("coverage", "slab"):
        monkeypatch.setattr(blurring.Blurring, name, blocked(getattr(blurring.Blurring, name)))
    capture(view, CAMERA, plan.fidelity)
    return calls


def test_one_depth_takes_one_convolution_a_group_and_no_coverage(monkeypatch: pytest.MonkeyPatch):
    plan = planner("flat").plan()
    calls = counted(monkeypatch, scene(FLAT), plan)
    groups = 3 * plan.fidelity.band_groups or len(BANDS)
    assert calls["coverages"] == 0 and calls["convolutions"] == groups


def test_the_plan_takes_fewer_calls_than_the_full_simulation(monkeypatch: pytest.MonkeyPatch):
    known = planner("step")
    view = scene(STEP, hidden=True)
    planned = counted(monkeypatch, view, known.plan(parse_target("30dB", None)))
    monkeypatch.undo()
    full = counted(monkeypatch, view, known.plan(parse_target("full", None)))
    assert planned["psfs"] < full["psfs"] and planned["convolutions"] < full["convolutions"]
    assert full["coverages"] > 0


def test_parts_of_the_pupil_are_an_effect_of_edges_whose_behind_is_known_or_guessed():
    assert "edges" in row(planner("slanted").plan(), "sub-apertures").why
    assert row(plan_photo(scene(STEP), CAMERA), "sub-apertures").error is not None  # past guesses, too
    known = planner("step")
    found = known.estimates.by_name["sub-apertures"]
    one, *_, full = (overall(errors) for errors in found.errors)
    assert one > full == 0
    truth = measured(scene(STEP, hidden=True), CAMERA, dict(found.levels[0].change), known.facts.full)
    assert decibels(one) == pytest.approx(decibels(truth), abs=3)
    # so are coarse pixels, whose share follows from how fine the change is
    assert len(found.levels) == 4
    for level, errors in list(zip(found.levels, found.errors, strict=True))[1:-1]:
        truth = measured(scene(STEP, hidden=True), CAMERA, dict(level.change), known.facts.full)
        assert decibels(overall(errors)) == pytest.approx(decibels(truth), abs=4)
    # what leaves out occlusion or hidden surfaces leaves out parts with them
    for name in ("occlusion", "hidden surfaces"):
        whole = known.estimates.by_name[name]
        truth = measured(scene(STEP, hidden=True), CAMERA, dict(whole.levels[0].change), known.facts.full)
        assert decibels(overall(whole.errors[0])) == pytest.approx(decibels(truth), abs=2)
    without = known.plan(None, {"occlusion": 0})
    assert "does not matter" in row(without, "sub-apertures").why
    for plan, parts in (
        (known.plan(parse_target("20dB", None)), 1),
        (without, 1),
        (known.plan(parse_target("full", None)), known.facts.full.sub_apertures),
    ):
        assert capture(scene(STEP, hidden=True), CAMERA, plan.fidelity).how.sub_apertures == parts


def test_what_few_parts_leave_out_is_seen_through_all_of_them(monkeypatch: pytest.MonkeyPatch):
    """A coarse photo through all parts tells; where 3 x 3 err too much in any case it is not taken."""
    camera = Camera.from_recipe(load_camera("paper-cubic").recipe)
    facts = facts_of(scene(STEP, hidden=True), camera)
    full, shape = facts.full.sub_apertures, (3, facts.coarse.view.height * facts.coarse.view.width)
    by_few, by_all, left_out = torch.full(shape, 0.5), torch.ones(shape), torch.full(shape, 0.4)
    changes = {(1, 3): by_few, (1, full): by_all, (3, full): left_out}
    asked: list[int] = []

    def changed(facts: object, few: list[dict[str, int]], sub_apertures: int) -> list[torch.Tensor]:
        asked.append(sub_apertures)
        return [changes[each["sub_apertures"], sub_apertures] for each in few]

    monkeypatch.setattr(sub_apertures, "photo_changes", changed)
    levels = sub_apertures.levels(facts)
    few = next(level for level in levels if level.change["sub_apertures"] == 3)
    whole, some = map(rms, sub_apertures.differences(facts, [levels[0], few]))
    assert asked == [3, full] and whole == pytest.approx(rms(by_all / sub_apertures.SEEN))
    assert 0.4 * overall(whole) <= overall(some) < 0.7 * overall(whole)
    sub_apertures.differences(replace(facts, allowed=0.01 * overall(rms(by_few))), [levels[0], few])
    assert asked == [3, full, 3]


@pytest.mark.parametrize("times", [1, 4, 5, 12])
def test_small_windows_are_judged_by_the_larger_of_spectra_and_coarse_photos(
    monkeypatch: pytest.MonkeyPatch, times: int
):
    """From a quarter of the recipe's window on, or four large pixels: behind edges spectra alone are
    optimistic."""
    camera = Camera.from_recipe(CAMERA.recipe.model_copy(update={"psf": PsfSettings(window_px=128)}))
    facts = replace(facts_of(scene(STEP, hidden=True), camera), allowed=1.0)
    facts.__dict__["coarse"] = replace(facts.coarse, times=times)
    few, full = window.levels(facts)[:-1], 128
    little, much = torch.full((3, 4), 1e-3), torch.full((3, 4), 1e-2)
    monkeypatch.setattr(window, "of_psfs", lambda facts, levels: [little for _ in levels])
    monkeypatch.setattr(window, "photo_changes", lambda facts, changes: [much for _ in changes])
    found = dict(
        zip((level.change["window_px"] for level in few), window.differences(facts, few), strict=True)
    )
    assert {16, 32, 48} < found.keys()
    for side, change in found.items():
        assert torch.equal(change, much if side >= min(full / 4, 4 * times) else little)


def test_parts_change_little_by_the_bands_and_layers_that_they_are_told_apart_in(
    monkeypatch: pytest.MonkeyPatch,
):
    """What parts change is simulated in one group of bands a channel and few layers: against all bands and
    layers, each part composited by itself, where every pixel has a spectrum of its own."""
    view, full = scene(STEP, hidden=True), planner("step").facts.full
    one, some = (capture(view, CAMERA, full.changed({"sub_apertures": n})).clean for n in (1, 3))
    finely = Camera.from_recipe(
        CAMERA.recipe.model_copy(
            update={"psf": CAMERA.recipe.psf.model_copy(update={"oversampling": full.oversampling})}
        )
    )
    factor = capture(view, CAMERA, full).exposure
    monkeypatch.setattr("edofsim.capture.imaging.of_sub_apertures", lambda fidelity, *_: fidelity)
    finest = [Fidelity(sub_apertures=n, layers=41) for n in (1, 3)]
    slow = [factor * capture(view, finely, each, exposure=1.0).clean for each in finest]
    change = slow[1] - slow[0]
    assert change.abs().max() > 1e-3
    assert (some - one - change).square().mean().sqrt() < 0.25 * change.square().mean().sqrt()


def test_parts_of_the_pupil_are_taken_on_request():
    """Through parts the photo changes where both sides of an edge are blurred; its light stays nearly all."""
    view = scene(STEP, hidden=True)
    plan = plan_photo(view, CAMERA, {"sub_apertures": 2})
    four = capture(view, CAMERA, plan.fidelity)
    one = capture(view, CAMERA, replace(plan.fidelity, sub_apertures=1))
    assert plan.fidelity.occlusion == "hidden" and four.how.sub_apertures == 2
    assert not torch.equal(one.clean, four.clean)
    assert (one.clean - four.clean).abs().mean() < 0.05 * one.clean.mean()
    with pytest.raises(InputError, match="hidden"):
        plan_photo(view, CAMERA, {"occlusion": "over", "sub_apertures": 2})


OTHER = {
    "band_groups": 2,
    "group_wavelengths": 1,
    "sub_apertures": 5,
    "sub_aperture_pixel": 3,
    "layers_db": 40.0,
    "occlusion": "over",
    "layers": 7,
    "window_px": 16,
    "oversampling": 3,
    "pupil_sampling_um": 9.0,
    "margin_px": 8,
    "samples": 16,
    "field_step_px": 40,
    "bounces": 2,
    "simplifications": (),
    "without_sensor": ("dark-current",),
}


def test_what_was_counted_before_changes_no_count():
    """Work that simulations share is counted once: every field of a fidelity by itself, and with
    sub-apertures, after all others, is as if nothing had been counted yet."""
    shape = facts_of(scene(STEP, hidden=True), CAMERA).shape
    assert shape.slabs is not None
    tried = []
    for start in (Fidelity(), Fidelity(sub_apertures=3), Fidelity(sub_apertures=4, sub_aperture_pixel=2)):
        for knob in describe():
            now = getattr(start, knob.name)
            other = (
                OTHER[knob.name] if knob.name in OTHER else (not now if isinstance(now, bool) else now + 1)
            )
            tried.append(start.changed({knob.name: other}))
    counts = []
    for fidelity in tried:
        layers = fidelity.layers or 12
        known = work_of(shape, CAMERA, fidelity, layers, 6, 9)
        alone = work_of(replace(shape, counted=Once()), CAMERA, fidelity, layers, 6, 9)
        assert known == alone, fidelity
        counts.append(known.amounts)
    for stage in ("psf", "blur", "sub_apertures"):
        assert len({tuple(sorted(each[stage].items())) for each in counts}) > 2


def test_where_a_photo_takes_a_moment_in_full_no_effect_is_looked_at(monkeypatch: pytest.MonkeyPatch):
    """Not even at how much time each could save; and all is simulated as for `--accuracy full`."""
    view = scene(FLAT)
    full = plan_photo(view, CAMERA, target=parse_target("full", None), every_effect=False)
    assert 0 < sum(full.seconds.values()) < WORTH_S

    def looked(*_: object) -> None:
        raise AssertionError("an effect was looked at")

    monkeypatch.setattr("edofsim.plan.costs.levels_of", looked)
    assert plan_photo(view, CAMERA, every_effect=False).fidelity == full.fidelity
