"""Deep scenes: the paper's protocol as written, edges where blur crosses them, work that goes on."""

from __future__ import annotations

import csv
import functools
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from skimage import data as pictures

from edofsim import console
from edofsim.capture import Fidelity, Photo, capture, ideal_image
from edofsim.capture.depth_edges import near_edges
from edofsim.cli import app
from edofsim.core.progress import silent
from edofsim.experiments import bench_scene, protocols, scene3d
from edofsim.experiments.protocols import (
    LENS_ALONE,
    OURS,
    WAYS,
    System,
    capture_restored,
    flattened,
    quantised,
    saturating,
    systems_of,
    unscattered_light,
    views_of,
    with_glare,
)
from edofsim.experiments.scene_scores import SceneScores
from edofsim.experiments.sources import system_of
from edofsim.optics import Camera, psf_bank
from edofsim.plan import full_fidelity
from edofsim.recipe import CameraRecipe, SceneRecipe, load_camera, load_scene
from edofsim.recipe.camera import PsfSettings
from edofsim.recipe.fabrication import Fabrication
from edofsim.recipe.load import Loaded
from edofsim.render.view import View
from edofsim.restore.light import without_glare
from edofsim.restore.scores import score_parts

CAMERA = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=24)))
ROWS, COLUMNS, MARGIN = 24, 32, 12
NEAR, FAR = 1.0, 0.5  # inverse depths in 1/m
PAPER_WAY = WAYS[0]

SCENE = """\
name = "NAME"
camera = "camera.toml"

[bands]
start_nm = 430
stop_nm = 700
count = 7

[frame]
width_px = 40
height_px = 32
margin_px = 12

[source]
kind = "rgbd"
image = "IMAGE"

[source.depth]
path = "depth.npy"
"""


@pytest.fixture
def view() -> View:
    """A near surface at the left, a far one at the right; in a column between, both share each pixel."""
    rows, columns = ROWS + 2 * MARGIN, COLUMNS + 2 * MARGIN
    draw = torch.Generator().manual_seed(3)
    bands = torch.linspace(430e-9, 700e-9, 7, dtype=torch.float64)
    column = torch.arange(rows * columns) % columns
    edge = columns // 2
    share = torch.where(column < edge, 1.0, torch.where(column == edge, 0.7, 0.0))
    pixel = torch.arange(rows * columns).repeat_interleave(2)
    coverage = torch.stack([share, 1 - share], 1).flatten()
    depth = torch.tensor([NEAR, FAR]).repeat(rows * columns)
    some = coverage > 0
    light = torch.rand(7, rows * columns, generator=draw).repeat_interleave(2, 1) * coverage
    return View(
        height=ROWS,
        width=COLUMNS,
        margin=MARGIN,
        pixel=pixel[some],
        coverage=coverage[some],
        inverse_depth=depth[some],
        radiance=light[:, some],
        hidden=torch.zeros(int(some.sum()), dtype=torch.bool),
        wavelengths=bands,
        pixel_angle=CAMERA.pixel_angle,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Recipes of two pictures with depth, one of a picture cut short, and a camera of small windows."""
    ramp = np.where(np.arange(64) < 30, 0.7, 1.6) + np.linspace(0, 0.1, 56)[:, None]
    np.save(tmp_path / "depth.npy", ramp)
    for name, image in (("cat", pictures.chelsea()), ("cup", pictures.coffee())):
        Image.fromarray(image[100:156, 120:184]).save(tmp_path / f"{name}.png")
        (tmp_path / f"{name}.toml").write_text(SCENE.replace("NAME", name).replace("IMAGE", f"{name}.png"))
    whole = (tmp_path / "cat.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 3])
    (tmp_path / "cut.toml").write_text(SCENE.replace("NAME", "cut").replace("IMAGE", "cut.png"))
    text = load_camera("paper-clear").text.replace("window_px = 128", "window_px = 24")
    (tmp_path / "camera.toml").write_text(text)
    return tmp_path


def test_the_papers_photo_is_its_equation(view: View):
    """Written out once more: for each depth the picture where it is at that depth, convolved, and summed."""
    flat = views_of(view, CAMERA)["paper"]
    taken = capture_restored(flat, PAPER_WAY, System("lens_alone", CAMERA))
    colours = torch.tensor([611e-9, 543e-9, 482e-9], dtype=torch.float64)
    rows, columns = flat.padded_shape
    picture = flat.radiance.flip(0).reshape(3, rows, columns)  # bands ascend, colours do not
    depth = flat.inverse_depth.reshape(rows, columns)
    bank = psf_bank(CAMERA, colours, [FAR, NEAR], window_px=24).values
    photo = torch.zeros_like(picture)
    for psf, inverse in zip(bank, (FAR, NEAR), strict=True):
        # the centre of a PSF is its pixel 24 // 2: 12 pixels reach it from one side, 11 from the other
        part = torch.nn.functional.pad(picture * (depth == inverse), (11, 12, 11, 12))
        photo += torch.nn.functional.conv2d(part[None], psf.flip(-2, -1)[:, None], groups=3)[0]
        beyond = 1 - psf.sum((1, 2), keepdim=True)
        photo += beyond * (picture * (depth == inverse)).mean((1, 2), keepdim=True)
    assert torch.allclose(view.crop_margin(photo), taken.photo.clean, atol=2e-3)
    assert torch.equal(taken.truth, view.crop_margin(picture))


def test_a_flat_picture_has_the_depth_that_covers_most_and_8_bits(view: View):
    flat = flattened(view, CAMERA, encoded=True)
    depth = flat.inverse_depth.reshape(flat.padded_shape)
    edge = flat.padded_shape[1] // 2
    assert (depth[:, : edge + 1] == NEAR).all() and (depth[:, edge + 1 :] == FAR).all()
    levels = flat.radiance.double() * 255
    assert torch.allclose(levels, levels.round(), atol=1e-4)
    linear = flattened(view, CAMERA, encoded=False)
    wanted = ideal_image(view, CAMERA).clamp(0, 1)
    assert torch.allclose(linear.radiance.flip(0).reshape(wanted.shape), wanted, atol=1e-6)
    # sRGB lifts the middle: IEC 61966-2-1 gives 0.7354 for 0.5
    half = (linear.radiance - 0.5).abs() < 0.002
    assert half.any() and torch.allclose(flat.radiance[half], torch.tensor(0.7354), atol=5e-3)


def test_depths_are_whole_millimetres_and_infinity_stays():
    found = quantised(torch.tensor([2.0, 1 / 1.2346, 1 / 0.5004, 0.0]))
    assert torch.allclose(found[:3].reciprocal() * 1e3, torch.tensor([500.0, 1235.0, 500.0]).double())
    assert found[3] == 0


def test_what_height_errors_leave_is_what_a_made_mask_leaves():
    """The closed form against the PSF of one mask that is made: 3 um, 30 nm; its haze is wider still."""
    mask = {"kind": "height-map"}
    recipe = CameraRecipe(name="flat", mask=mask, psf=PsfSettings(window_px=24))
    made = recipe.model_copy(update={"fabrication": Fabrication(preset="paper-test")})
    flat = torch.zeros(239, 239)
    at = torch.tensor([482e-9, 611e-9], dtype=torch.float64)
    designed, real = (
        psf_bank(Camera.from_recipe(each).with_height(flat), at, [0.6], window_px=24).values[0]
        for each in (recipe, made)
    )
    kept = unscattered_light(Camera.from_recipe(recipe), at)
    assert torch.allclose(real.sum((1, 2)).double() / designed.sum((1, 2)), kept, atol=4e-3)
    assert (real - designed * kept[:, None, None]).abs().max() < 0.02 * designed.max()
    assert (unscattered_light(CAMERA, at) == 1).all() and (
        unscattered_light(Camera.from_recipe(made), at) == 1
    ).all()


def test_scattered_light_is_a_veil_that_a_filter_takes_off(view: View):
    """No light is made or lost, contrast falls, and the photo without the glare is as before."""
    part = torch.linspace(0.8, 0.95, view.bands, dtype=torch.float64)
    hazy = with_glare(view, part)
    before, after = (ideal_image(each, CAMERA, 1.0) for each in (view, hazy))
    assert torch.allclose(before.mean((1, 2)), after.mean((1, 2)), rtol=1e-5)
    even = with_glare(view, torch.full((view.bands,), 0.9))
    glare = torch.full((3,), 0.1)
    # the mean of the world is known but for a guess of what lies beyond the frame
    level = without_glare(ideal_image(even, CAMERA, 1.0), glare) - before
    assert level.std((1, 2)).max() < 1e-5
    assert level.abs().max() < 0.02
    assert not torch.allclose(ideal_image(even, CAMERA, 1.0), before, atol=1e-2)


def test_pixels_within_the_blur_radius_of_an_edge(view: View):
    """Thin lens: the blur of a point at 1/z through an aperture 2r, focused at 1/f, is 2 r z_i |1/z - 1/f|
    wide; 1 m is farther from a focus of 1.5 m than 2 m is."""
    found = near_edges(view, CAMERA)
    pixels = 2.5e-3 * CAMERA.sensor_distance * (NEAR - 1 / 1.5) / 6e-6
    reach = math.ceil(pixels)
    assert reach == 6
    edge = COLUMNS // 2
    inside = torch.zeros(COLUMNS, dtype=torch.bool)
    inside[edge - 1 - reach : edge + 1 + reach + 1] = True
    assert torch.equal(found, inside.expand(ROWS, -1))


def test_one_surface_has_no_edges(view: View):
    slanted = torch.linspace(0.9, 1.1, view.pixel.numel())
    whole = View(**{**vars(view), "inverse_depth": slanted})
    alone = View(**{**vars(whole), "coverage": torch.ones(view.pixel.numel())})
    assert not near_edges(alone, CAMERA).any()


def test_every_way_and_system_is_scored(view: View, network: Path, folder: Path):
    systems = systems_of(load_camera(str(folder / "camera.toml")), [str(network)])
    measured, kept, edges = scene3d.measure("two", view, systems)
    scored = {(row.way, row.system, row.image) for row in measured.rows}
    images = [("lens_alone", "photo"), *(("trained", image) for image in ("photo", "restored", "wiener"))]
    assert scored == {(way.name, *image) for way in WAYS for image in images}
    for way in WAYS:
        whole = measured.score(way.name, "lens_alone", "photo")
        parts = [
            measured.score(way.name, "lens_alone", "photo", r) for r in ("near edges", "away from edges")
        ]
        assert sum(part.pixels for part in parts) == whole.pixels == ROWS * COLUMNS
        # errors of parts add up to that of the whole
        error = sum(part.pixels * 10 ** (-part.psnr_db / 10) for part in parts) / whole.pixels
        assert whole.psnr_db == pytest.approx(-10 * math.log10(error), abs=1e-6)
    assert set(kept) == {(way, name) for way in ("paper", OURS) for name in ("lens_alone", "trained")}
    assert int(edges.sum()) == measured.score(OURS, "lens_alone", "photo", "near edges").pixels
    off = [
        (taken.images["photo"].clamp(0, 1).mean((-1, -2)) / taken.truth.mean((-1, -2)) - 1).abs().max()
        for taken in (kept[OURS, "lens_alone"], kept[OURS, "trained"])
    ]
    assert measured.score(OURS, "lens_alone", "photo").light_error == pytest.approx(float(off[0]), rel=1e-4)
    found = scene3d.figures(SceneScores((measured,)), ["trained"])
    assert found[f"light_error.two.{OURS}.trained.photo"] == pytest.approx(float(off[1]), rel=1e-4)
    restored, alone = (measured.score(OURS, *place).psnr_db for place in (images[2], images[0]))
    assert measured.gain(OURS, "trained") == pytest.approx(restored - alone)


def test_systems_with_one_mask_share_its_photo(
    view: View, network: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """Scores are as if each had taken its own, a mask that differs by roundings counts as the same, and no
    other does."""
    alone, trained = systems_of(load_camera(str(folder / "camera.toml")), [str(network)])
    height = trained.camera.height_map
    assert height is not None

    def with_height(name: str, other: torch.Tensor) -> System:
        return replace(trained, name=name, camera=trained.camera.with_height(other))

    height_map = 1e-6 * torch.rand(
        height.shape, generator=torch.Generator().manual_seed(1), dtype=height.dtype
    )
    twin, other = with_height("twin", height + 1e-13), with_height("other", height_map)
    taken = []

    def counted(*given: object, **more: object) -> Photo:
        taken.append(given[1])
        return capture(*given, **more)

    monkeypatch.setattr(protocols, "capture", counted)
    monkeypatch.setattr(scene3d, "converged_db", lambda *about: math.inf)
    ways = WAYS[:2]
    together, _, _ = scene3d.measure("two", view, [alone, trained, twin, other], ways=ways)
    assert len(taken) == 3 * len(ways)
    for system in (twin, other):
        apart, _, _ = scene3d.measure("two", view, [alone, system], ways=ways)
        of_system = [row for row in together.rows if row.system in (alone.name, system.name)]
        for row, own in zip(of_system, apart.rows, strict=True):
            assert (row.way, row.image, row.region) == (own.way, own.image, own.region)
            assert row.psnr_db == pytest.approx(own.psnr_db, abs=1e-4), row
    of_photos = [together.score(ways[1].name, name, "photo").psnr_db for name in ("trained", "twin", "other")]
    assert of_photos[0] == of_photos[1] and abs(of_photos[0] - of_photos[2]) > 0.01


def test_ours_is_the_photo_through_parts_of_the_pupil(view: View, monkeypatch: pytest.MonkeyPatch):
    """Against each part composited in all bands by itself, which costs one photo a part; the near half now
    hides light that lies behind, and all is grey."""
    near = torch.nonzero(view.inverse_depth == NEAR).squeeze(1)
    alone = near[view.coverage[near] == 1]
    behind = torch.cat([torch.arange(view.pixel.numel()), alone])
    hidden = torch.arange(len(behind)) >= view.pixel.numel()
    order = torch.argsort(view.pixel[behind] * 2 + hidden, stable=True)
    depth = torch.where(hidden, FAR, view.inverse_depth[behind])
    light = torch.where(hidden, 1 - view.radiance[:, behind], view.radiance[:, behind])
    layered = replace(
        view,
        pixel=view.pixel[behind][order],
        coverage=view.coverage[behind][order],
        inverse_depth=depth[order],
        radiance=light.mean(0).expand(7, -1)[:, order].contiguous(),
        hidden=hidden[order],
    )
    by_name = {way.name: way for way in WAYS}
    ours, whole = (
        capture_restored(layered, by_name[name], System("lens_alone", CAMERA)) for name in (OURS, "hidden")
    )
    across = min(by_name[OURS].sub_apertures, full_fidelity(CAMERA, layered).sub_apertures)
    monkeypatch.setattr("edofsim.capture.imaging.of_sub_apertures", lambda fidelity, *_: fidelity)
    slow, one = (
        capture(layered, CAMERA, Fidelity(sub_apertures=count, layers=41), exposure=ours.photo.exposure).clean
        for count in (across, 1)
    )
    change = slow - one
    assert across > 2 and change.abs().max() > 2e-3
    found = ours.photo.clean - whole.photo.clean
    assert (found - change).square().mean().sqrt() < 0.5 * change.square().mean().sqrt()
    # noise is drawn once, of the photo as it is now
    assert torch.allclose(ours.photo.image - whole.photo.image, found, atol=1e-6)


def test_the_sensor_saturates_and_the_truth_alike(view: View, network: Path, folder: Path):
    """A lamp of a hundred times full scale: photos and truth hold full scale and no more, though the camera
    says nothing of saturation, and by the paper's protocol, too."""
    camera = load_camera(str(folder / "camera.toml"))
    assert not camera.recipe.sensor.saturation
    lit = view.radiance.clone()
    row, column = ROWS // 2 + MARGIN, COLUMNS // 2 + MARGIN
    lit[:, view.pixel == row * (COLUMNS + 2 * MARGIN) + column] = 100
    for system in systems_of(camera, [str(network)]):
        for way in (WAYS[0], WAYS[2]):
            shown = views_of(replace(view, radiance=lit), system.camera)[way.name]
            taken = capture_restored(shown, way, system)
            assert taken.truth.max() == 1
            assert taken.photo.image.min() >= 0 and taken.photo.image.max() <= 1
            if not way.flat:  # whose values are an 8-bit picture's
                assert taken.photo.clean.max() > 2 and taken.photo.image.max() == 1


def test_an_interrupted_evaluation_goes_on(folder: Path, network: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(scene3d, "converged_db", lambda *about: 60.0)
    scenes = [load_scene(folder / f"{name}.toml") for name in ("cat", "cup")]
    done: list[str] = []
    whole = scene3d.measure

    def measure(name: str, *rest: object, **more: object):
        if name == "cup" and "cup" not in done:
            done.append("cup")
            raise KeyboardInterrupt
        done.append(name)
        return whole(name, *rest, ways=WAYS[:2], **more)

    monkeypatch.setattr(scene3d, "measure", measure)
    with pytest.raises(KeyboardInterrupt):
        scene3d.measured_scenes(folder, scenes, networks=[system_of(str(network))], progress=silent)
    outcome = scene3d.measured_scenes(folder, scenes, networks=[system_of(str(network))], progress=silent)
    assert done == ["cat", "cup", "cup"]
    again = scene3d.measured_scenes(folder, scenes, networks=[system_of(str(network))], progress=silent)
    assert done == ["cat", "cup", "cup"] and again == outcome
    # another seed is another measurement
    scene3d.measured_scenes(folder, scenes[:1], networks=[system_of(str(network))], progress=silent, seed=1)
    assert done[-1] == "cat"


@pytest.fixture
def few_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes are measured in the ways that pages show, and one more."""
    ways = [way for way in WAYS if way.name in ("paper", "normalised", OURS)]
    monkeypatch.setattr(scene3d, "measure", functools.partial(scene3d.measure, ways=ways))


@pytest.mark.usefixtures("plots_left_out", "few_ways")
def test_the_command_names_what_is_broken_and_finishes_the_others(
    folder: Path, network: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(scene3d, "converged_db", lambda *about: 60.0)
    out = folder / "out"
    names = ["cat", "cut", "missing", "cup"]
    arguments = ["evaluate", "scene3d", *(str(folder / f"{name}.toml") for name in names)]
    arguments += ["--network", str(network), "--out", str(out), "--quiet"]
    status = console.exit_status(lambda: app(arguments, standalone_mode=False))
    printed = capfd.readouterr()
    assert status == 2 and "cut.png" in printed.err and "missing.toml" in printed.err
    assert "worst of trained" in printed.out
    record = json.loads((out / "scene3d.json").read_text())
    figures = record["figures"]
    assert figures["scenes"] == 2 and figures["scenes.failed"] == 2
    rows = list(csv.DictReader((out / "scene3d.csv").open()))
    mean = np.mean(
        [
            float(row["psnr_db"])
            for row in rows
            if (row["way"], row["image"], row["region"]) == ("normalised", "restored", "whole")
        ]
    )
    assert figures["psnr_db.mean.normalised.trained"] == pytest.approx(mean, abs=1e-3)
    lows = {scene: figures[f"psnr_db.{scene}.{OURS}.trained"] for scene in ("cat", "cup")}
    assert record["worst"] == {"trained": min(lows, key=lambda scene: lows[scene])}
    page = (out / "scene3d.html").read_text()
    assert "cut.png" in page and 'href="scenes/cat-trained.html"' in page
    assert 'href="../scene3d.html"' in (out / "scenes/cup-trained.html").read_text()


def test_members_of_a_family_stand_in_its_place(
    network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    asked: list[str] = []

    def measured(_: Path, scenes: Sequence[Loaded[SceneRecipe]], **__: object) -> SceneScores:
        asked.extend(each.recipe.name for each in scenes)
        raise LookupError("asked")

    monkeypatch.setattr(scene3d, "measured_scenes", measured)
    command = ["evaluate", "scene3d", "clutter", "--members", "3", "--seed", "7", "--network", str(network)]
    with pytest.raises(LookupError, match="asked"):
        app([*command, "--out", str(tmp_path)], standalone_mode=False)
    assert asked == ["clutter-7", "clutter-8", "clutter-9"]
    command[2] = "wall"
    assert console.exit_status(lambda: app([*command, "--out", str(tmp_path)], standalone_mode=False)) == 2
    assert "wall: the recipe has no [family]" in capfd.readouterr().err


def test_nothing_to_photograph_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    status = console.exit_status(lambda: app(["evaluate", "scene3d", "dek"], standalone_mode=False))
    said = capfd.readouterr().err
    assert status == 2 and "did you mean 'desk'" in said


def test_objects_of_the_bench_are_where_the_view_shows_them():
    """Outlines are projected by the pinhole: x / z = (column + 1/2 - W/2) pixel_angle. The bus stands left of
    the middle, 0.5 m away, the car right of it, 1.3 m away, each nearly as wide as it is long."""
    bench = load_scene("bench")
    frame = bench.recipe.frame
    for inverse, seen, other in ((1 / 0.512, "bus", "car"), (1 / 1.31, "car", "bus")):
        plain = View.flat(
            torch.zeros(1, frame.height_px, frame.width_px),
            inverse,
            wavelengths=[550e-9],
            pixel_angle=frame.pixel_angle_mrad * 1e-3,
        )
        parts = bench_scene.object_pixels(bench, plain)
        assert not parts[other].any()
        rows, columns = torch.nonzero(parts[seen], as_tuple=True)
        thing = next(each for each in bench.recipe.objects if each.name == seen)
        middle = frame.width_px / 2 * (1 + thing.x_frame)
        assert float(columns.float().mean()) == pytest.approx(middle, abs=30)
        # a thing turned by a third of a right angle is between its width and its length wide
        length = thing.length_mm * 1e-3 * inverse / plain.pixel_angle
        assert 0.7 * length < columns.max() - columns.min() < 1.1 * length
        assert rows.min() > 0


@pytest.mark.parametrize("quick", [True, False])
def test_scenes_are_scored_with_many_samples_and_small_ones_have_fewer_pixels(quick: bool):
    """Scores are without the grain of the truth; fewer samples would leave them uncertain."""
    for name in ("desk", "night"):
        recipe = load_scene(name).recipe
        scored = scene3d.scored_version(recipe, quick=quick)
        whole = (recipe.frame.width_px, recipe.frame.height_px)
        assert (scored.frame.width_px, scored.frame.height_px) == ((160, 128) if quick else whole)
        assert scored.render.samples >= max(64, recipe.render.samples)


@pytest.mark.usefixtures("plots_left_out")
def test_the_bench_has_a_page_with_both_objects(
    folder: Path, network: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    def tiny(recipe: SceneRecipe, *, quick: bool) -> SceneRecipe:
        assert quick
        frame = recipe.frame.model_copy(update={"width_px": 64, "height_px": 48, "margin_px": 12})
        changes = {"frame": frame, "bands": recipe.bands.model_copy(update={"count": 3})}
        return recipe.model_copy(
            update={**changes, "render": recipe.render.model_copy(update={"samples": 4})}
        )

    monkeypatch.setattr(bench_scene.scene3d, "scored_version", tiny)
    out = folder / "out"
    arguments = ["evaluate", "bench-scene", "--quick", "--quiet", "--cache", folder / "cache", "--out", out]
    arguments += ["--camera", folder / "camera.toml", "--network", network]
    app([str(each) for each in arguments], standalone_mode=False)
    figures = json.loads((out / "bench-scene.json").read_text())["figures"]
    for part in ("", ".bus", ".car"):
        assert 5 < figures[f"psnr_db.{OURS}.lens_alone{part}"] < 60
        assert 5 < figures[f"psnr_db.paper.trained{part}"] < 60
    # the lens is focused near the car, and the bus is far out of focus
    assert figures[f"psnr_db.{OURS}.lens_alone.car"] > figures[f"psnr_db.{OURS}.lens_alone.bus"]
    page = (out / "bench-scene.html").read_text()
    assert re.search(r"Bus: about 0\.5\d", page) and re.search(r"Car: about 1\.3", page)
    assert "Restored, trained" in capfd.readouterr().out


@pytest.mark.parametrize(
    "way", [way for way in WAYS if way.name in ("linear", "none", OURS)], ids=lambda w: w.name
)
def test_every_way_knows_the_noise_of_its_truth(view, way):
    """Half of what the truths of the halves differ by, at one exposure; what the lens alone photographs has
    less of it than the truth, and scores have a standard error."""
    recipe = CAMERA.recipe.model_copy(
        update={"sensor": CAMERA.recipe.sensor.model_copy(update={"exposure": 0.9})}
    )
    system = System(LENS_ALONE, replace(CAMERA, recipe=saturating(recipe)).without_mask())
    noise = (
        0.02 * view.radiance * torch.randn(view.radiance.shape, generator=torch.Generator().manual_seed(1))
    )
    seen = replace(view, noise=0.02, half_difference=noise)
    taken = capture_restored(views_of(seen, system.camera)[way.name], way, system)
    ends = [
        capture_restored(
            views_of(view.with_light(view.radiance + s * noise), system.camera)[way.name], way, system
        ).photo
        for s in (1, -1)
    ]
    half = (ends[0].ideal - ends[1].ideal) / 2
    assert torch.allclose(taken.noise.ideal, half, atol=1e-6)
    found = score_parts(*taken.compared("photo")[:2], [None], taken.compared("photo")[2])[0]
    assert float(taken.left["photo"].std()) < float(half.std()) and found.psnr_db_se > 0
