"""Shipped scenes, small: what they do not call for is not called."""

from __future__ import annotations

import functools
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from edofsim.capture import blurring, capture, full_fidelity, layers
from edofsim.capture.photo import Photo
from edofsim.cli.shared import plan_lines
from edofsim.core.stopwatch import Stopwatch
from edofsim.experiments.predictions import camera_of, small_version
from edofsim.optics import Camera, field
from edofsim.pipeline import planned_view
from edofsim.plan import Fidelity, Plan, look, parse_target, plan_figures, plan_photo, plan_scene, remember
from edofsim.plan.coarse import Coarse
from edofsim.plan.spectra import Spectra
from edofsim.recipe import CameraRecipe, load_scene
from edofsim.recipe.camera import PsfSettings, Sensor
from edofsim.render import render
from edofsim.render.view import View
from edofsim.restore.scores import psnr
from edofsim.scene.family import member

CAMERA = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=32)))


def small(name: str):
    """A shipped scene: the middle of its frame, two samples a pixel."""
    loaded = load_scene(name)
    recipe = loaded.recipe
    frame = recipe.frame.model_copy(update={"width_px": 40, "height_px": 32, "margin_px": 16})
    few = recipe.render.model_copy(update={"samples": 2})
    return replace(loaded, recipe=recipe.model_copy(update={"frame": frame, "render": few}))


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("views")


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter:
    """How often what takes time was called: depth layers of rendering, refraction band by band, PSFs,
    convolutions, coverages."""
    from edofsim.render import paths, rendering

    counts: Counter = Counter()

    def spy(place: object, name: str, amount: Callable[..., dict[str, int]]) -> None:
        whole = getattr(place, name)

        @functools.wraps(whole)
        def counted(*args, **how):
            found = whole(*args, **how)
            counts.update(amount(found, *args, **how))
            return found

        monkeypatch.setattr(place, name, counted)

    def psfs(found, camera, wavelengths, depths, **how):
        return {"psfs": 0 if how.get("window_px") == 1 else len(wavelengths) * len(depths)}

    spy(rendering, "survey_layers", lambda found, *_: {"views": 1, "hidden layers": len(found[0]) - 1})
    spy(paths, "refracted", lambda *_: {"bands apart": 1})
    spy(field, "psf_bank", psfs)
    spy(layers, "add_convolved", lambda found, total, light, *_: {"convolutions": len(light)})
    spy(blurring.Blurring, "coverage", lambda *_: {"coverages": 1})
    return counts


def run(name: str, cache: Path, calls: Counter) -> tuple[Plan, Photo]:
    """Plan, render and photograph; the calls of planning are not counted."""
    loaded = small(name)
    looked = look(loaded.recipe, loaded.base, CAMERA, cache=cache)
    plan = plan_scene(looked, CAMERA)
    calls.clear()
    view = render(loaded.recipe, loaded.base, cache=cache)
    return plan, capture(view, CAMERA, plan.fidelity)


def called_for(plan: Plan) -> set[str]:
    return {decision.effect for decision in plan.decisions if decision.called_for}


@pytest.mark.parametrize("name", ["wall", "clouds"])
def test_one_depth_has_no_layers_no_occlusion_nothing_hidden_and_no_band_apart(name, tmp_path, calls):
    plan, photo = run(name, tmp_path, calls)
    never = {
        "depth layers",
        "occlusion",
        "hidden surfaces",
        "sub-apertures",
        "dispersion of scene glass",
    }
    assert not called_for(plan) & {*never, "interreflection"}
    assert calls["views"] <= 1 and calls["hidden layers"] == 0 and calls["bands apart"] == 0
    assert photo.how.layers == 1 and calls["coverages"] == 0
    assert calls["convolutions"] == photo.how.bands < 31
    assert calls["psfs"] < 31


def test_glass_alone_takes_bands_apart(cache, calls):
    """The route band by band is there for the still life's dispersive glass, and gone with it."""
    loaded = small("stilllife")
    render(loaded.recipe, loaded.base, cache=cache)
    assert calls["views"] == 1 and calls["bands apart"] > 0
    calls.clear()
    surfaces = {"dispersion": False}
    plain = tuple(
        thing.model_copy(
            update={
                field: value.model_copy(update=surfaces)
                for field, value in thing
                if getattr(value, "kind", "") == "glass"
            }
        )
        for thing in loaded.recipe.objects
    )
    render(loaded.recipe.model_copy(update={"objects": plain}), loaded.base, cache=cache)
    assert calls["views"] == 1 and calls["bands apart"] == 0


def test_the_still_life_says_which_glass_asks_for_it(cache):
    loaded = small("stilllife")
    looked = look(loaded.recipe, loaded.base, CAMERA, cache=cache)
    (hero,) = [d for d in plan_scene(looked, CAMERA).decisions if d.effect == "dispersion of scene glass"]
    assert "crystal ball" in hero.why and "cloth" not in hero.why


@pytest.fixture(scope="module")
def desk(cache: Path) -> View:
    loaded = small("desk")
    return render(loaded.recipe, loaded.base, cache=cache)


def bands_of(view: View, camera: Camera, calls: Counter) -> tuple[int, int]:
    """Images blurred for each depth, and PSFs computed, for a target that all share."""
    plan = plan_photo(view, camera, target=parse_target("50dB", None))
    calls.clear()
    # what parts of the pupil change has bands and layers of its own
    photo = capture(view, camera, plan.fidelity.changed({"sub_apertures": 1}))
    return photo.how.bands, calls["psfs"] // photo.how.layers


def test_a_grey_scene_under_flat_light_takes_fewer_bands_than_the_desk(desk, calls):
    grey = replace(desk, radiance=desk.radiance.mean(0).expand(desk.bands, -1).contiguous())
    coloured, psfs = bands_of(desk, CAMERA, calls)
    few, fewer = bands_of(grey, CAMERA, calls)
    assert few < coloured and few * fewer < coloured * psfs


def test_a_narrow_sensor_takes_few_bands(desk, calls, tmp_path):
    """Every channel sees the same 20 nm: two or three of 31 bands."""
    curve = {400: 0, 535: 0, 540: 1, 560: 1, 565: 0, 740: 0}
    lines = ["wavelength_nm,r,g,b", *(f"{nm},{value},{value},{value}" for nm, value in curve.items())]
    (tmp_path / "narrow.csv").write_text("\n".join(lines))
    recipe = CAMERA.recipe.model_copy(update={"sensor": Sensor(response="narrow.csv")})
    camera = Camera.from_recipe(recipe, tmp_path)
    _, psfs = bands_of(desk, camera, calls)
    assert psfs <= 3
    _, usual = bands_of(desk, CAMERA, calls)
    assert psfs < usual


def test_the_plan_of_a_picture_names_what_it_lacks(cache: Path):
    """The motorcycle's depth map has holes, and no picture holds the light from behind its edges."""
    loaded = small("motorcycle")
    plan = plan_photo(render(loaded.recipe, loaded.base, cache=cache), CAMERA)
    why = {decision.effect: decision.why for decision in plan.decisions}
    assert "holes of the depth map were filled" in why["depth layers"]
    assert "no light from behind its edges" in why["hidden surfaces"]


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """How often a plan looks at the light of a view: at its spectra, at coarse photos."""
    found: list[str] = []
    for place, name in ((Spectra, "light"), (Coarse, "photo")):
        whole = getattr(place, name)

        def looked(self, *args, whole=whole, name=name, **how):
            found.append(name)
            return whole(self, *args, **how)

        monkeypatch.setattr(place, name, looked)
    return found


def test_nothing_is_asked_where_nothing_is_to_gain(cache: Path, looks: list[str]):
    """The photo of a wall takes a moment in full: a plan that looked at it would take longer. A plan of every
    effect does look."""
    loaded = small("wall")
    watch = Stopwatch()
    view, plan, _ = planned_view(loaded, CAMERA, watch, cache=cache)
    assert not looks and plan.error_db == float("inf")
    assert set(watch.seconds) - {"guess"} == {"render", "plan"}
    assert plan.fidelity.band_groups == 0 and plan.fidelity.spherical_aberration
    (bands,) = [d for d in plan.decisions if d.effect == "bands"]
    assert bands.error is None and "save next to no time" in bands.why
    assert plan_photo(view, CAMERA).error_db < float("inf") and looks


def test_a_time_is_planned_on_a_preview_and_rendering_is_cut_to_it(tmp_path: Path, looks: list[str]):
    """Where a time is asked for, and only there, the view is rendered with less than the recipe says."""
    loaded = small("hallway")
    watch = Stopwatch()
    _, plan, _ = planned_view(loaded, CAMERA, watch, cache=tmp_path, target=parse_target(None, "1e-3s"))
    assert "preview" in watch.seconds and "cannot be had" in plan.note
    assert "within 0.001 s, of which" in plan.target  # what was asked for, and what is gone of it
    again = Stopwatch()
    planned_view(loaded, CAMERA, again, cache=tmp_path)
    assert set(again.seconds) == {"render", "plan"}


def test_everything_in_full_is_asked_nothing(cache: Path, looks: list[str]):
    loaded = small("desk")
    _, plan, _ = planned_view(loaded, CAMERA, Stopwatch(), cache=cache, target=parse_target("full", None))
    assert not looks and plan.fidelity.sub_apertures > 1 and plan.fidelity.band_groups == 0


def test_what_planning_took_is_told_as_a_share_of_what_it_saves():
    plan = Plan((), Fidelity(), seconds={"blur": 2.0}, full_seconds=12.0)
    assert plan_lines(plan, 0.5)[-1] == "planned in 0.5 s, 5.0% of the 10 s that it saves"
    assert plan_figures(plan, 0.5)["plan.share_of_saved"] == 0.05
    nothing = Plan((), Fidelity(), seconds={"blur": 2.0}, full_seconds=2.0)
    assert plan_lines(nothing, 0.5)[-1] == "planned in 0.5 s"
    assert "plan.share_of_saved" not in plan_figures(nothing, 0.5)


@pytest.mark.slow
def test_gathered_bands_are_seen_to_err_where_surfaces_hide_others(
    cache: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """Blocks behind blocks, through a clear mask: spectra alone foretell 13 dB less error than there is, and
    a plan by them misses its target by 7 dB."""
    loaded = load_scene("scenes/families/blocks.toml")
    recipe = small_version(member(loaded.recipe, 904), (256, 192, 32))
    view, camera = render(recipe, loaded.base, cache=cache), camera_of("clear")

    def missed_db() -> float:
        monkeypatch.setattr(remember, "_folder", lambda: tmp_path / str(time.monotonic()))
        plan = plan_photo(view, camera, every_effect=False)
        photos = [capture(view, camera, each).clean for each in (plan.fidelity, full_fidelity(camera, view))]
        return (plan.asked_db or 0.0) - psnr(*photos)

    assert missed_db() < 0
    monkeypatch.setattr(Coarse, "by_gathering", lambda self, full: 0.0)
    assert missed_db() > 3
