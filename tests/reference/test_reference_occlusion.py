"""The experiment on occlusion, small: compositors against clipped pupils at the edge of a screen."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from edofsim.capture.prepare import blur_per_dioptre
from edofsim.core.progress import silent
from edofsim.errors import InputError
from edofsim.experiments import kept, occlusion, occlusion_cameras, occlusion_ways
from edofsim.experiments.occlusion_cameras import Edge
from edofsim.optics import Camera, focus_distance
from edofsim.recipe import load_camera, load_scene
from edofsim.reference import clipped_pupils
from edofsim.reference.pinhole import Crop
from edofsim.stability.white_wall import WAYS

ANGLE = 1.626e-4
FOCI = ("front", "between", "behind")


def scores_of(judged: occlusion_ways.Judged) -> dict[str, float]:
    return {way: occlusion.psnr(photo, judged.truth) for way, photo in judged.photos.items()}


def test_focus_lies_in_front_between_and_behind():
    places = occlusion_cameras.focus_distances(Edge(Crop(0, 0, 4, 4), 2.0, 1.0))
    assert 1 / places["front"] > 2.0 > 1 / places["between"] > 1.0 > 1 / places["behind"]


@pytest.mark.parametrize("mask", occlusion_cameras.MASKS)
def test_cameras_see_the_view_s_pixels_and_are_sharp_where_asked(mask):
    for distance in (0.6, 2.0):
        camera = occlusion_cameras.camera_with(mask, distance, ANGLE)
        assert camera.pixel_angle == pytest.approx(ANGLE, rel=1e-9)
        assert float(focus_distance(camera, 587.6e-9)) == pytest.approx(distance, rel=1e-6)


@pytest.mark.parametrize("name", ["lens-50mm-f2", "phone-5mm-f2", "paper-levin", "paper-learned"])
def test_any_camera_is_moved_to_the_edge_with_its_mask(name: str):
    loaded = load_camera(name)
    takers = occlusion_cameras.test_cameras(loaded)
    own = Camera.from_recipe(loaded.recipe, loaded.base)
    assert takers.names == (name,)
    framed = takers.framed(load_scene("bench").recipe)
    assert framed.frame.pixel_angle == pytest.approx(own.pixel_angle)
    for place in (name, occlusion.THIN_LENS):
        camera = takers.at(place, 0.9, own.pixel_angle)
        assert camera.pixel_angle == pytest.approx(own.pixel_angle)
        assert camera.sensor_distance == pytest.approx(
            Camera.from_recipe(camera.recipe, camera.base).sensor_distance
        )
        assert 1 / camera.recipe.focus.distance_m == pytest.approx(1 / 0.9)
        bare = place == occlusion.THIN_LENS
        assert camera.recipe.mask == (own.without_mask() if bare else own).recipe.mask
        assert camera.lens.aberrates == (own.lens.aberrates and not bare)
    # edges count whose blurs are as wide as the paper's
    paper, wide = (each.gaps(own.pixel_angle) for each in (occlusion_cameras.test_cameras(None), takers))
    by_paper = blur_per_dioptre(occlusion_cameras.camera_with("clear", 1.5, ANGLE)) * paper[1]
    assert blur_per_dioptre(own) * wide[1] == pytest.approx(by_paper, rel=0.02)


def test_the_crop_lies_at_the_hard_edges(screens):
    """The near screen ends in the middle of the frame, at column 96: the first crop that holds it all."""
    _, view = screens.two(ANGLE, 192, 8)
    edge = occlusion_cameras.busiest_edge(view)
    assert edge.where == Crop(0, 32, occlusion_cameras.SIZE, occlusion_cameras.SIZE)
    assert (edge.near, edge.far) == pytest.approx((2.5, 1.25))
    flat = replace(view, inverse_depth=torch.ones_like(view.inverse_depth))
    with pytest.raises(InputError, match="no depth edge"):
        occlusion_cameras.busiest_edge(flat)


def test_ways_to_composite_against_clipped_pupils(screens):
    """At the edge of a screen: hidden surfaces bring the photo nearer to the truth than any way without them;
    far from the edge, where nothing is hidden, all agree with it."""
    window = 32
    model, view = screens.two(ANGLE, 32, window // 2)
    edge = Edge(Crop(10, 8, 8, 16), 2.5, 1.25)
    behind = occlusion_cameras.focus_distances(edge)["behind"]
    taken = occlusion_cameras.camera_with("clear", behind, ANGLE, window, aperture_mm=1.2)
    truth = clipped_pupils(view, model, [taken], edge.where, rays=32)[0]
    scores = scores_of(occlusion_ways.composites(view, edge.where, taken, truth))
    assert scores["hidden"] > max(scores["none"], scores["over"], scores["normalised"]) + 2
    assert scores["hidden"] > 30
    beside = Crop(10, 28, 4, 4)
    taken = occlusion_cameras.camera_with("clear", behind, ANGLE, window, aperture_mm=0.3)
    truth = clipped_pupils(view, model, [taken], beside, rays=32)[0]
    judged = occlusion_ways.composites(view, beside, taken, truth)
    for photo in judged.photos.values():
        assert torch.allclose(photo.double(), judged.truth, atol=0.02)


def test_ways_to_composite_against_rays_through_a_thin_lens(screens):
    """The other reference, from the scene itself, says the same of the edge of a screen; diffraction, which
    rays lack, blurs the stripes of this narrow aperture besides."""
    window = 32
    model, view = screens.two(ANGLE, 32, window // 2)
    where = Crop(10, 8, 8, 16)
    behind = occlusion_cameras.focus_distances(Edge(where, 2.5, 1.25))["behind"]
    taken = occlusion_cameras.camera_with(occlusion.THIN_LENS, behind, ANGLE, window, aperture_mm=1.2)
    truth = torch.stack(occlusion.by_rays(model, view, 0, where, taken, 1)).mean(0)
    scores = scores_of(occlusion_ways.composites(view, where, taken, truth))
    assert scores["hidden"] > max(scores["none"], scores["over"], scores["normalised"]) + 2
    assert scores["hidden"] > 25


@pytest.mark.parametrize("focus", FOCI)
def test_parts_of_the_pupil_against_rays_through_the_whole_aperture(screens, focus):
    """The paper's aperture blurs both surfaces of the edge at once: averages over the pupil are then far off,
    and sharing it out among parts takes most of that away."""
    model, view = screens.two(ANGLE, 32, occlusion.WINDOW // 2)
    where = Crop(10, 8, 8, 16)
    distance = occlusion_cameras.focus_distances(Edge(where, 2.5, 1.25))[focus]
    taken = occlusion_cameras.camera_with(occlusion.THIN_LENS, distance, ANGLE)
    truth = torch.stack(occlusion.by_rays(model, view, 0, where, taken, 1)).mean(0)
    scores = scores_of(occlusion_ways.composites(view, where, taken, truth))
    assert scores["sub_apertures"] > 36
    assert scores["sub_apertures"] > max(scores[way] for way in occlusion_ways.OCCLUSIONS) + 5


def test_layers_that_hide_each_other_are_judged_by_their_best_number(screens):
    """`over` gets the number of layers that is best for it: it is nowhere better with another one."""
    window = 32
    model, view = screens.two(ANGLE, 32, window // 2)
    where = Crop(10, 8, 8, 16)
    distance = occlusion_cameras.focus_distances(Edge(where, 2.5, 1.25))["between"]
    taken = occlusion_cameras.camera_with(occlusion.THIN_LENS, distance, ANGLE, window, aperture_mm=1.2)
    truth = torch.stack(occlusion.by_rays(model, view, 0, where, taken, 1)).mean(0)
    judged = occlusion_ways.composites(view, where, taken, truth)
    assert set(judged.layers) == {"over", "normalised"}
    found = judged.figures("case")
    for count in occlusion_ways.LAYERS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(occlusion_ways, "LAYERS", (count,))
            one = occlusion_ways.composites(view, where, taken, truth).figures("case")
        for way in occlusion.SNAPPED:
            assert one[f"psnr_db.case.{way}"] <= found[f"psnr_db.case.{way}"] + 1e-9
            if one[f"layers.case.{way}"] == judged.layers[way]:
                assert one[f"psnr_db.case.{way}"] == pytest.approx(found[f"psnr_db.case.{way}"])


def test_noise_of_the_mean_of_two_images():
    """Two images with noise of 0.02 each: their mean has 0.02 / sqrt(2), 37 dB."""
    draw = torch.Generator().manual_seed(0)
    one, other = (0.5 + 0.02 * torch.randn(3, 200, 200, generator=draw) for _ in range(2))
    assert occlusion.noise_db(one, other) == pytest.approx(-20 * math.log10(0.02 / math.sqrt(2)), abs=0.1)


@pytest.mark.parametrize("change", ["code", "view", "camera", "own"])
def test_a_finished_scene_is_measured_anew_once_it_is_another(tmp_path, monkeypatch, change: str):
    """Another line of code, another view, or another camera; and not otherwise."""
    calls = []

    def of_scene(source, takers, folder, *_):
        calls.append(source.recipe.name)
        name = source.recipe.name
        (folder / f"occlusion-{name}.png").write_bytes(b"picture")
        case = f"{name}.clear.front"
        scores = {f"psnr_db.{case}.{way}": 30.0 for way in occlusion.WAYS}
        return scores | {f"layers.{case}.{way}": 4.0 for way in occlusion.SNAPPED}

    monkeypatch.setattr(occlusion, "of_scene", of_scene)
    monkeypatch.setattr(occlusion, "by_every_way", lambda camera: {("known", way): 0.0 for way in WAYS})
    for _ in range(2):
        occlusion.run(tmp_path, silent, ["bench"])
    assert calls == ["bench"]
    if change == "code":
        monkeypatch.setattr(kept, "code_of", lambda folder: "another line")
    elif change == "view":
        monkeypatch.setattr(occlusion, "SAMPLES", 2 * occlusion.SAMPLES)
    elif change == "camera":
        inner = occlusion_cameras.camera_with
        monkeypatch.setattr(occlusion_cameras, "camera_with", lambda *given: inner(*given, aperture_mm=2.0))
    occlusion.run(tmp_path, silent, ["bench"], camera="paper-rings" if change == "own" else None)
    assert calls == ["bench", "bench"]


def test_a_camera_of_ones_own_is_told_how_white_a_white_wall_is(tmp_path, monkeypatch):
    monkeypatch.setattr(occlusion, "of_scene", lambda *given: {})
    monkeypatch.setattr(occlusion, "WHITE_CAMERAS", {})
    phone = load_camera("phone-5mm-f2")
    own = tmp_path / "own.toml"
    own.write_text(phone.text.replace('"phone-5mm-f2"', '"own"'))
    found = occlusion.run(tmp_path, silent, [], camera=str(own))
    figures = {name: value for name, value in found.figures.items() if name.startswith("white_percent.")}
    assert set(figures) == {f"white_percent.own.{b}.{way}" for b in ("known", "guessed") for way in WAYS}
    for behind in ("known", "guessed"):
        assert figures[f"white_percent.own.{behind}.hidden"] < 1 < figures[f"white_percent.own.{behind}.none"]
    table = found.shown[1]
    assert [row[:2] for row in table.rows] == [("own", "known"), ("own", "guessed")]


@pytest.mark.slow
def test_hidden_surfaces_win_on_two_surfaces_of_a_shipped_scene(tmp_path):
    """The bus before the car: nearer to clipped pupils and to rays than every way that knows the visible
    alone, for every mask and focus, and best where the car is nearly in focus, where it would be exact."""
    figures = occlusion.run(tmp_path, silent, ["bench"]).figures
    _, rows = occlusion.table(figures)
    assert len(rows) == 12
    hidden = {}
    for _, mask, focus, none, over, normalised, with_hidden, with_parts, *_ in rows:
        assert with_hidden > max(none, over, normalised) + 1
        assert with_parts > with_hidden - 0.5
        hidden[mask, focus] = with_hidden
    for mask in ("clear", "smooth"):
        assert hidden[mask, "behind"] > 37
        assert hidden[mask, "behind"] > hidden[mask, "between"]
    for focus in FOCI:  # clipped pupils lack what the view lacks, and the truth has noise
        assert 35 < figures[f"view_db.bench.thin-lens.{focus}"] < figures[f"noise_db.bench.thin-lens.{focus}"]
    assert (tmp_path / "occlusion.csv").is_file()
    assert (tmp_path / "occlusion-bench.png").is_file()
