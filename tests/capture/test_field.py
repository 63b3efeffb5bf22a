"""Photos through a lens that varies over the field, against sums over sources and closed forms."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hard_cases.lens_field import with_nearer
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture import field as captured
from edofsim.capture.crop import crop
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.capture.resample import resampled
from edofsim.errors import InputError
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.optics import field as optics_field
from edofsim.optics import terms as optics_terms
from edofsim.optics.field import Frame, places, psfs_on_sensor, relative_light, step_for
from edofsim.plan import decibels, overall, parse_target, plan_photo
from edofsim.plan.facts import Facts
from edofsim.recipe import CameraRecipe
from edofsim.recipe.load import load_camera
from edofsim.render.view import View
from edofsim.restore import restore
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.scores import psnr

sys.path.insert(0, str(Path(__file__).parents[1] / "example_package"))
from edofsim_example.off_axis_lens import OffAxisLens

WINDOW = 12
DEPTH = 1 / 1.1
GREEN = 550e-9
WAIST = 0.5


def camera(coma: float = 12.0, shadow: float = 3.0, mask: str = "clear", pixel_um: float = 6) -> Camera:
    lens = {"kind": "ideal", "focal_length_mm": 25, "f_number": 5}
    recipe = {
        "name": "off-axis",
        "lens": lens,
        "mask": {"kind": "gaussian", "waist": WAIST} if mask == "gaussian" else {"kind": mask},
        "focus": {"distance_m": 1.0, "wavelength_nm": 550},
        "sensor": {"pixel_um": pixel_um, "response": "lines", "exposure": 1.0, "read_noise": 0.0},
        "psf": {"window_px": WINDOW},
    }
    plain = Camera.from_recipe(CameraRecipe.model_validate(recipe))
    return replace(plain, lens=OffAxisLens(**{**lens, "kind": "off-axis"}, coma=coma, shadow=shadow))


def view_of(light: Tensor, seen_by: Camera, margin: int, axis: tuple[float, float] | None) -> View:
    how = {"wavelengths": PAPER_COLOURS, "pixel_angle": seen_by.pixel_angle, "margin": margin}
    return replace(View.flat(light, DEPTH, **how, metadata={"hidden": "none"}), axis=axis)


def random_light(height: int, width: int, seed: int = 0) -> Tensor:
    """Blocks of 3 x 3 pixels."""
    noise = torch.rand(3, -(-height // 3), -(-width // 3), generator=torch.Generator().manual_seed(seed))
    return noise.repeat_interleave(3, 1).repeat_interleave(3, 2)[:, :height, :width]


def by_sources(view: View, seen_by: Camera, y: int, x: int) -> Tensor:
    """The light of a pixel: the sum over all sources near by, each by the PSF of its own place; as much of it
    as makes a white scene even."""
    rows, columns = view.padded_shape
    light, half = view.radiance.double().reshape(3, rows, columns), WINDOW // 2
    axis = view.axis_px
    total, white, own = torch.zeros(3, 3, dtype=torch.float64)
    for dy in range(-half, half + 1):
        for dx in range(-half, half + 1):
            row, column = half - dy, half - dx  # of the PSF, by which the source reaches this pixel
            if 0 <= row < WINDOW and 0 <= column < WINDOW:
                right, up = (x + dx + 0.5 - axis[1]), (axis[0] - y - dy - 0.5)
                there = seen_by.at_field((right * view.pixel_angle, up * view.pixel_angle))
                psfs = psf_bank(there, PAPER_COLOURS, [DEPTH]).values[0].double() * relative_light(there)
                white += psfs[:, row, column]
                total += psfs[:, row, column] * light[:, y + dy + view.margin, x + dx + view.margin]
                own = psfs.sum((-2, -1)) if dy == dx == 0 else own
    return total / white * own


def db(error: Tensor) -> float:
    return float(-10 * torch.log10(error.square().mean()))


@pytest.fixture(scope="module")
def corner() -> tuple[View, Camera]:
    """A frame beside the axis, below it and to its right: nothing in it is symmetric."""
    seen_by = camera()
    return view_of(random_light(30 + 2 * 8, 40 + 2 * 8), seen_by, 8, (-170.0, -260.0)), seen_by


PLACES = [(4, 6), (25, 33)]


@pytest.fixture
def no_glare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Veiling glare is made of all light that a view knows of."""
    module = sys.modules[capture.__module__]
    with_glare = module.glare_of
    monkeypatch.setattr(module, "glare_of", lambda *of: tuple(0 * each for each in with_glare(*of)))


@pytest.fixture(scope="module")
def truth(corner: tuple[View, Camera]) -> Tensor:
    """[place, channel], source by source."""
    return torch.stack([by_sources(*corner, y, x) for y, x in PLACES])


def psnr_of_places(corner: tuple[View, Camera], truth: Tensor, in_terms: bool = False) -> float:
    photo = capture(*corner, Fidelity(field_step_px=16, field_terms=in_terms))
    return db(torch.stack([photo.clean[:, y, x] for y, x in PLACES]).double() - truth)


@pytest.mark.usefixtures("no_glare")
@pytest.mark.parametrize("in_terms", [False, True])
def test_a_photo_is_the_sum_over_its_sources(corner: tuple[View, Camera], truth: Tensor, in_terms: bool):
    assert psnr_of_places(corner, truth, in_terms) > 75


def _right_is_left(frame: Frame, y: float, x: float) -> tuple[float, float]:
    return (frame.axis[1] - x) * frame.pixel_angle, (frame.axis[0] - y) * frame.pixel_angle


def _right_is_up(frame: Frame, y: float, x: float) -> tuple[float, float]:
    return (frame.axis[0] - y) * frame.pixel_angle, (x - frame.axis[1]) * frame.pixel_angle


BROKEN = {
    "mirrored field": (Frame, "field", _right_is_left),
    "transposed field": (Frame, "field", _right_is_up),
    "axis forgotten": (View, "axis_px", property(lambda view: (view.height / 2, view.width / 2))),
    "weights after the blur": (optics_field, "psfs_on_sensor", lambda camera, step, psfs: psfs(camera)),
    "light of vignetting twice": (captured, "relative_light", lambda here: relative_light(here) ** 2),
    "light of terms twice": (optics_terms, "relative_light", lambda here: relative_light(here) ** 2),
    "light of terms left out": (optics_terms, "relative_light", lambda here: 1.0),
}


@pytest.mark.usefixtures("no_glare")
@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_a_photo_with_a_fault_is_another(
    corner: tuple[View, Camera], truth: Tensor, broken: tuple, monkeypatch: pytest.MonkeyPatch
):
    """Each fault on purpose, by the measure of the test above."""
    monkeypatch.setattr(*broken)
    for way in ("find", "keep"):
        monkeypatch.setattr(optics_terms.KEPT, way, lambda *of: None)
    psnr = psnr_of_places(corner, truth, broken[0] is optics_terms)
    print(f"{psnr:.1f} dB")
    assert psnr < 71


@pytest.mark.usefixtures("no_glare")
@pytest.mark.parametrize(("in_terms", "most"), [(False, 1e-6), (True, 2e-3)])
def test_a_part_of_a_photo_is_the_photo_of_the_part(corner: tuple[View, Camera], in_terms: bool, most: float):
    """The same places have shares in both; kernels are found for each by itself, to the error allowed."""
    view, seen_by = corner
    how = {"exposure": 1.0, "nodes": torch.tensor([DEPTH], dtype=torch.float64)}
    fidelity = Fidelity(field_step_px=16, field_terms=in_terms)
    whole = capture(view, seen_by, fidelity, **how).clean
    part = capture(crop(view, 9, 11, 12, 17, 8), seen_by, fidelity, **how).clean
    assert float((whole[:, 9:21, 11:28] - part).abs().max()) < most
    lost = capture(replace(crop(view, 9, 11, 12, 17, 8), axis=None), seen_by, fidelity, **how).clean
    assert float((whole[:, 9:21, 11:28] - lost).abs().max()) > 5 * most  # had it forgotten its axis


def test_white_is_as_bright_as_the_light_that_gets_through():
    seen_by = camera(coma=0.0)
    view = view_of(torch.ones(3, 40 + 24, 60 + 24), seen_by, 12, (-150.0, 300.0))
    photo = capture(view, seen_by, Fidelity(field_step_px=16)).clean[1]
    for y, x in ((0, 0), (13, 40), (39, 59)):
        light = relative_light(
            seen_by.at_field(Frame(40, 60, view.axis_px, view.pixel_angle).field(y + 0.5, x + 0.5))
        )
        assert float(photo[y, x]) == pytest.approx(light, abs=1e-3)
    assert 0.3 < float(photo.min()) < float(photo.max()) < 0.97


def test_a_white_disc_before_a_white_slope_is_as_bright_as_its_place(tmp_path: Path):
    """Also where PSFs move light by distances that change with the place: light is crowded there, and so is
    what covers other light."""
    recipe = load_camera("aspheres-5mm-f3").recipe
    psf = recipe.psf.model_copy(update={"window_px": 24})
    seen_by = Camera.from_recipe(recipe.model_copy(update={"psf": psf}))
    y, x = torch.meshgrid(torch.arange(72), torch.arange(72), indexing="ij")
    focus = 1 / seen_by.recipe.focus.distance_m
    how = {"wavelengths": [500e-9, 600e-9], "pixel_angle": seen_by.pixel_angle, "margin": 24}
    view = View.flat(torch.ones(2, 72, 72), focus + 1e-3 * x, **how, metadata={"hidden": "known"})
    view = with_nearer(replace(view, axis=(-150.0, -150.0)), (y - 36) ** 2 + (x - 36) ** 2 < 60, focus + 0.4)
    photo = capture(view, seen_by, Fidelity(layers_db=60.0, field_step_px=32), exposure=1.0, cache=tmp_path)
    frame = Frame(24, 24, view.axis_px, view.pixel_angle)
    for row, column in ((0, 0), (12, 12), (23, 23)):
        light = relative_light(seen_by.seen_at(frame.field(row + 0.5, column + 0.5)))
        assert float(photo.clean[1, row, column]) == pytest.approx(light, abs=4e-3)


def test_plans_of_a_plane_out_of_focus_hold_what_is_wide_off_the_axis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Far from the axis a phone's PSFs reach farther than on it, where a window of 16 pixels holds them.
    Places are close enough together where they are 32 pixels apart: that is not looked for."""
    joined = {step: float(step == 0 or step > 32) for step in (0, *optics_field.STEPS)}
    monkeypatch.setattr(Facts, "joined", joined)
    monkeypatch.setattr(Facts, "_without_field", (1.0, 1.0, 1.0))
    seen_by = Camera.from_recipe(load_camera("aspheres-5mm-f3").recipe)
    blocks = torch.rand(1, 20, 20, generator=torch.Generator().manual_seed(1))
    light = blocks.repeat_interleave(4, 1).repeat_interleave(4, 2)
    depth = 1 / seen_by.recipe.focus.distance_m + 14 / blur_per_dioptre(seen_by)
    how = {"pixel_angle": seen_by.pixel_angle, "margin": 32, "metadata": {"hidden": "none"}}
    view = View.flat(light, depth, wavelengths=[550e-9], **how)
    view = replace(view, axis=(-208.0, -208.0))
    fidelity = plan_photo(view, seen_by, None, parse_target("45dB", None), every_effect=False).fidelity
    every_place = Fidelity(field_step_px=16, field_terms=False, layers_db=70.0)
    found, true = (
        capture(view, seen_by, each, exposure=1.0, cache=tmp_path).clean for each in (fidelity, every_place)
    )
    print(fidelity.window_px, psnr(found, true))
    assert psnr(found, true) > 44


def test_the_light_of_two_discs():
    """What two discs of one radius share, in closed form: a lens."""
    seen_by = camera(shadow=4.0)
    d = 4.0 * 0.15 / 2  # half the distance of their middles
    share = 2 / math.pi * (math.acos(d) - d * math.sqrt(1 - d * d))
    light = relative_light(seen_by.at_field((0.15, 0.0)))
    assert light == pytest.approx(share, abs=0.02)  # the rim is a cell wider than the pupil
    assert relative_light(seen_by.at_field((0.0, -0.15))) == pytest.approx(light, abs=1e-6)


def test_coma_moves_light_as_its_slope_says():
    """The middle of a PSF moves by the mean slope of the phase, weighted with the light: that of
    |rho|^2 (rho f) is 2 f times the mean of |rho|^2. The light is a Gaussian, whose edge
    scatters next to nothing, and pixels are small."""
    seen_by = camera(coma=6.0, shadow=0.0, mask="gaussian", pixel_um=1.5)
    rim = 2 / WAIST**2
    mean = 1 / rim - math.exp(-rim) / (1 - math.exp(-rim))
    for field in ((0.1, 0.0), (0.0, 0.1), (-0.08, 0.06)):
        bank = psf_bank(seen_by.at_field(field), [GREEN], [1.0], window_px=64, dtype=torch.float64)
        psf = bank.values[0, 0]
        at = torch.arange(64, dtype=torch.float64) - 32
        right, up = (psf.sum(0) @ at) / psf.sum(), -(psf.sum(1) @ at) / psf.sum()
        moved = -2 * mean * seen_by.sensor_distance * 6.0 * 550e-9 / seen_by.aperture_radius / seen_by.pixel
        assert float(right) == pytest.approx(moved * field[0], abs=0.005)
        assert float(up) == pytest.approx(moved * field[1], abs=0.005)


def test_places_share_out_every_frame():
    for axis in ((12.0, 16.0), (-100.5, 7.25), (400.0, -3.0)):
        frame, total = Frame(24, 32, axis, 1e-3), torch.zeros(24, 32, dtype=torch.float64)
        for place in places(frame, 7):
            total[place.rows, place.columns] += place.share
        assert float((total - 1).abs().max()) < 1e-12


def test_steps_are_as_small_as_is_asked_for(corner: tuple[View, Camera]):
    view, seen_by = corner
    frame = Frame(view.height, view.width, view.axis_px, view.pixel_angle)
    wanted = (35, 45, 60)
    steps = [step_for(seen_by, frame, view.wavelengths, (DEPTH, DEPTH), asked) for asked in wanted]
    assert steps == sorted(steps, reverse=True) and steps[0] > steps[-1]
    finest = capture(view, seen_by, Fidelity(field_step_px=8)).clean
    for step, asked in zip(steps, wanted, strict=True):
        photo = capture(view, seen_by, Fidelity(field_step_px=step)).clean
        print(asked, step, db(photo - finest))
        assert step == 8 or db(photo - finest) > asked - 1
    still = replace(seen_by, lens=seen_by.lens.model_copy(update={"coma": 0.0, "shadow": 0.0}))
    assert step_for(still, frame, view.wavelengths, (DEPTH, DEPTH), 60) == 1024


def test_views_keep_their_axis(tmp_path: Path, corner: tuple[View, Camera]):
    view, _ = corner
    assert crop(view, 9, 11, 12, 17, 3).axis == (-179.0, -271.0)
    assert crop(view, 0, 0, 30, 40, 3).axis == view.axis
    finer = resampled(replace(view, axis=(5.0, 30.0)), view.pixel_angle / 2)
    assert finer.axis == (10.0, 60.0)
    with pytest.raises(InputError, match="axis"):
        replace(view, axis=(math.nan, 0.0))


def test_a_batch_looks_one_way(corner: tuple[View, Camera]):
    view, seen_by = corner
    with pytest.raises(InputError, match="one by one"):
        capture([view, replace(view, axis=(0.0, 0.0))], seen_by, Fidelity(field_step_px=64))


def test_plans_have_as_many_places_as_the_target_asks_for(corner: tuple[View, Camera]):
    view, seen_by = corner
    plans = [plan_photo(view, seen_by, None, parse_target(asked, None)) for asked in ("40dB", "60dB", "full")]
    steps = [plan.fidelity.field_step_px for plan in plans]
    assert steps[0] >= steps[1] > 0 and steps[2] is None  # in a small frame all take as long
    photo, finest = (capture(view, seen_by, each).clean for each in (plans[0].fidelity, plans[2].fidelity))
    assert db(photo - finest) > 40
    left_out = next(each for each in plans[2].decisions if each.effect == "field dependence")
    by_axis = capture(view, seen_by, plans[2].fidelity.changed({"field_step_px": 0})).clean
    assert decibels(overall(left_out.error)) == pytest.approx(db(by_axis - finest), abs=3)
    seconds = [sum(plan.seconds.values()) for plan in plans]
    assert seconds == sorted(seconds)


def test_a_long_lens_with_a_small_sensor_pays_for_one_place(monkeypatch: pytest.MonkeyPatch):
    """And a short one of the same surfaces does not. What the axis alone errs by is looked at; places are
    taken to err by the square of their distance."""
    joined = {0: 1.0, **{step: (step / 1024) ** 2 for step in optics_field.STEPS}}
    monkeypatch.setattr(Facts, "joined", joined)
    recipe = load_camera("double-gauss-50mm-f4").recipe
    steps = []
    for focal, pixel_um in ((100.0, 3.0), (6.0, 40.0)):
        lens = {**recipe.lens.model_dump(exclude_unset=True), "focal_length_mm": focal, "f_number": 8.0}
        sensor = recipe.sensor.model_copy(update={"pixel_um": pixel_um, "read_noise": 0.01})
        keys = {"lens": lens, "sensor": sensor.model_dump(), "psf": {"window_px": 16}}
        seen_by = Camera.from_recipe(CameraRecipe.model_validate(recipe.model_dump() | keys))
        view = view_of(random_light(40 + 16, 40 + 16), seen_by, 8, None)
        plan = plan_photo(replace(view, inverse_depth=view.inverse_depth * 0 + 0.5), seen_by)
        said = next(each for each in plan.decisions if each.effect == "field dependence")
        steps.append((plan.fidelity.field_step_px, said.chosen, said.called_for))
    assert steps[0] == (0, "that of the axis", False)
    assert steps[1][0] != 0 and steps[1][2]


def test_each_place_is_restored_by_its_own_psfs():
    """Better than by those of the axis."""
    seen_by = camera(coma=30.0, shadow=0.0)
    view = view_of(random_light(48 + 24, 64 + 24), seen_by, 12, (-150.0, -240.0))
    photo = capture(view, seen_by, Fidelity(field_step_px=16))
    frame = Frame(view.height, view.width, view.axis_px, view.pixel_angle)
    ends = torch.tensor([DEPTH], dtype=torch.float64)
    sharp, how = restore(photo.image, seen_by, view.wavelengths, ends, frame=frame)
    assert how.step_px > 0 and str(how) == f"Wiener, place by place, {how.step_px} px apart"
    plain = replace(seen_by, lens=seen_by.lens.model_copy(update={"coma": 0.0}))
    by_axis, _ = restore(photo.image, plain, view.wavelengths, ends)
    scores = [psnr(each.clamp(0, 1), photo.ideal) for each in (sharp, by_axis)]
    print(scores)
    assert scores[0] > scores[1] + 3


def hard_tiles(count: int, axis: float, step: int) -> list[tuple[float, slice, Tensor]]:
    """In place of hats: each pixel from the nearest place alone."""
    found = []
    for middle, part, share in optics_field_hats(count, axis, step):
        near = (torch.arange(part.start, part.stop) + 0.5 - middle).abs() < step / 2
        found.append((middle, part, near.to(share)))
    return found


optics_field_hats = optics_field._hats


def across_alone(hats: Callable[..., list], axis: float) -> Callable[..., list]:
    """`hats` along the side with that axis, and one place for all of the other."""

    def found(count: int, at: float, step: int) -> list[tuple[float, slice, Tensor]]:
        return hats(count, at, step) if at == axis else [(count / 2, slice(0, count), torch.ones(count))]

    return found


def seam(image: Tensor, step: int, axis: float) -> float:
    """How much an image [channel, y, x] bends where the nearest place changes, over how much elsewhere."""
    bends = image.double().diff(2, dim=-1).square().mean((0, 1)).sqrt()
    away = (torch.arange(1, image.shape[-1] - 1) + 0.5 - axis) / step - 0.5
    border = (away - away.round()).abs() * step <= 1
    inner = slice(8, -8)  # of what lies beyond the frame nothing is known
    return float(bends[inner][border[inner]].max() / bends[inner][~border[inner]].max())


@pytest.mark.parametrize("network", [None, pytest.param("universal", marks=pytest.mark.slow)])
def test_restored_photos_have_no_seams(network: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a smooth scene, by Wiener deconvolution and the network for any camera; hard tiles have them. One
    place stands for all of the frame's rows: the network takes two seconds for each."""
    seen_by, axis = camera(coma=30.0, shadow=3.0).with_read_noise(0.01), (-150.0, -256.0)
    y, x = torch.meshgrid(torch.arange(16.0 + 24), torch.arange(64.0 + 24), indexing="ij")
    smooth = 0.5 + 0.2 * torch.sin(x / 17) + 0.2 * torch.cos(y / 13 + x / 29)
    view = view_of(smooth.expand(3, -1, -1).clone(), seen_by, 12, axis)
    photo = capture(view, seen_by, Fidelity(field_step_px=16))
    frame = Frame(view.height, view.width, view.axis_px, view.pixel_angle)
    ends = torch.tensor([DEPTH], dtype=torch.float64)
    checkpoint = None if network is None else load_checkpoint(network)

    def found() -> float:
        sharp, how = restore(photo.clean, seen_by, view.wavelengths, ends, frame=frame, checkpoint=checkpoint)
        assert view.width == how.step_px  # two places are side by side, and the border is in the middle
        return seam(sharp, how.step_px, axis[1])

    found_by = []
    for hats in (optics_field_hats, hard_tiles):
        monkeypatch.setattr(optics_field, "_hats", across_alone(hats, axis[1]))
        found_by.append(found())
    with_hats, hard = found_by
    print(with_hats, hard)
    assert with_hats < 1  # no more than elsewhere
    assert hard > 1.2


def test_places_next_to_each_other_are_the_same_ones():
    """PSFs as they land need those of the places around: each is computed once."""
    seen_by = Camera.from_recipe(load_camera("aspheres-5mm-f3").recipe)
    frame, step = Frame.about(60, 90, seen_by), 32
    own, around = set(), set()
    tangent = step * frame.pixel_angle

    def kept(camera: Camera) -> torch.Tensor:
        around.add(camera.field)
        return torch.zeros(3, 3)

    for place in places(frame, step):
        here = seen_by.seen_at(place.field)
        own.add(here.field)
        psfs_on_sensor(here, tangent, kept)
    assert len(own) == 3 * 5 and own < around and len(around) == 3 * 5 + 2 * (3 + 5)
