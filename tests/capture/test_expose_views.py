"""What is done to views before they are photographed: checks, crops, resampling, depth nodes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from edofsim.capture import Fidelity, capture, light
from edofsim.capture.checks import check_pixel_angle, check_view, check_window
from edofsim.capture.crop import crop, with_margin
from edofsim.capture.noise import photo_noise
from edofsim.capture.photograph import depths_of
from edofsim.capture.prepare import DEFOCUS_STEP, depth_nodes
from edofsim.capture.resample import resampled
from edofsim.errors import InputError
from edofsim.optics import Camera, PsfField
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.masks.cubic import CubicMask
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings
from edofsim.render.view import View


def plain(bench, rows=20, columns=24, margin=4):
    return bench.flat_view(bench.texture(2, rows, columns), 0.5, margin)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("inverse_depth", float("nan"), "depth is NaN"),
        ("inverse_depth", -0.1, "negative"),
        ("inverse_depth", float("inf"), "zero"),
        ("radiance", float("nan"), "radiance is NaN"),
        ("coverage", 1.5, "coverage"),
    ],
)
def test_bad_values_are_refused_and_their_pixels_named(bench, field, value, says):
    view = plain(bench)
    bad = getattr(view, field).clone()
    bad[..., 24 * 6 + 9] = value  # row 6 and column 9 of the padded frame: (2, 5) in the frame
    with pytest.raises(InputError) as caught:
        check_view(replace(view, **{field: bad}))
    assert says in str(caught.value)
    assert "(2, 5)" in str(caught.value)


def test_all_that_is_wrong_is_said_at_once(bench):
    view = plain(bench)
    with pytest.raises(InputError) as caught:
        check_view(replace(view, inverse_depth=-view.inverse_depth, radiance=view.radiance * float("nan")))
    assert len(caught.value.problems) == 2
    assert "and 475 more" in caught.value.problems[0]


def test_fragments_beyond_the_frame_or_out_of_order_are_refused(bench):
    view = plain(bench)
    for wrong, says in ((view.pixel + 1, "1 to 480.*0 to 479"), (view.pixel - 1, "-1 to 478")):
        with pytest.raises(InputError, match=says):
            check_view(replace(view, pixel=wrong))
    with pytest.raises(InputError, match="sorted"):
        check_view(replace(view, pixel=view.pixel.flip(0)))


def test_a_sound_view_passes(bench):
    view = plain(bench)
    check_view(view)
    check_pixel_angle(view, view.pixel_angle * 1.0005)
    check_window(view, 20)


def test_other_pixel_angle_is_refused_with_both(bench):
    with pytest.raises(InputError, match=r"0\.16 mrad.*0\.2 mrad"):
        check_pixel_angle(plain(bench), 2e-4)


def test_blur_wider_than_the_image_is_refused(bench):
    with pytest.raises(InputError, match="21 pixels is wider than the image of 24 x 20"):
        check_window(plain(bench), 21)


def test_crop_shows_the_same_pixels(bench):
    sheets = [
        (torch.rand(20, 24).double().round(), torch.full((20, 24), 2.0).double(), bench.texture(2, 20, 24)),
        (torch.ones(20, 24).double(), torch.full((20, 24), 0.5).double(), bench.texture(2, 20, 24, 1)),
    ]
    view = bench.stacked_view(sheets, 4)
    part = crop(view, 3, 5, 6, 7, 2)
    assert (part.height, part.width, part.margin) == (6, 7, 2)
    whole = view.crop_margin(view.all_in_focus())
    assert torch.equal(part.crop_margin(part.all_in_focus()), whole[:, 3:9, 5:12])
    assert torch.equal(part.all_in_focus(), whole[:, 1:11, 3:14])
    assert int(part.hidden.sum()) == int(sheets[0][0][5:15, 7:18].sum())


def test_margin_is_widened_by_repeating_the_border(bench):
    view = plain(bench)
    wide = with_margin(view, 7)
    expected = torch.nn.functional.pad(view.all_in_focus()[None], (3, 3, 3, 3), mode="replicate")[0]
    assert torch.equal(wide.all_in_focus(), expected)
    assert with_margin(view, 3) is view


@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.25, 2.0, 2.6])
def test_resampling_keeps_constants_energy_and_places(bench, ratio):
    """Radiance is per solid angle: a constant stays one; light times pixel area is kept; a spot stays put."""
    view = bench.flat_view(torch.ones(2, 40, 44, dtype=torch.float64), 0.5, 4)
    other = resampled(view, view.pixel_angle / ratio)
    assert abs(other.height - 32 * ratio) <= 0.5
    assert abs(other.width - 36 * ratio) <= 0.5
    assert torch.allclose(other.all_in_focus(), torch.ones(2, *other.padded_shape, dtype=torch.float64))
    image = torch.zeros(1, 40, 44, dtype=torch.float64)
    image[0, 12, 30] = 1
    spot = resampled(bench.flat_view(image, 0.5, 4), 1.6e-4 / ratio).all_in_focus()[0]
    assert abs(spot.sum().item() / ratio**2 - 1) < 1e-9
    rows, columns = (torch.arange(n, dtype=torch.float64) + 0.5 - n / 2 for n in spot.shape)
    # a square on a grid that it does not fit into is known to a quarter of a pixel
    assert abs((spot.sum(1) @ rows).item() / spot.sum().item() - (12.5 - 20) * ratio) <= 0.25
    assert abs((spot.sum(0) @ columns).item() / spot.sum().item() - (30.5 - 22) * ratio) <= 0.25


def test_resampled_fragments_stay_sorted(bench):
    sheets = [
        (torch.rand(20, 24).double().round(), torch.full((20, 24), 2.0).double(), bench.texture(2, 20, 24)),
        (torch.ones(20, 24).double(), torch.full((20, 24), 0.5).double(), bench.texture(2, 20, 24, 1)),
    ]
    view = resampled(bench.stacked_view(sheets, 4), 1.6e-4 / 0.7)
    assert (view.pixel.diff() >= 0).all()
    same = view.pixel.diff() == 0
    assert (view.inverse_depth.diff()[same] <= 0).all()
    visible = torch.zeros(view.padded_shape[0] * view.padded_shape[1], dtype=torch.float64)
    visible.index_add_(0, view.pixel[~view.hidden], view.coverage[~view.hidden])
    assert torch.allclose(visible, torch.ones_like(visible))


def test_hidden_surfaces_that_come_together_cover_a_pixel_once(bench):
    """Behind a card lie two sheets, 0.01 dioptres apart: one hidden surface with the mean of their light."""

    def even(value: float) -> torch.Tensor:
        return torch.full((16, 24), value, dtype=torch.float64)

    sheets = [
        (even(1), even(depth), even(light)[None]) for depth, light in ((2, 0.9), (0.5, 0.2), (0.49, 0.6))
    ]
    view = resampled(bench.stacked_view(sheets, 4), 1.6e-4 / 2)
    assert view.hidden.any() and float(view.coverage.max()) <= 1
    inside = view.hidden & (view.coverage == 1)
    assert inside.any()
    torch.testing.assert_close(view.radiance[0, inside], torch.full_like(view.radiance[0, inside], 0.4))


def test_resampling_to_pixels_of_two_gathers_what_is_one_surface(bench):
    """Four pixels of a slanted sheet, 0.5 to 0.57 dioptres, are one fragment with their mean; a card in front
    of two of them stays apart, and what is hidden stays hidden."""
    slant = torch.linspace(0.5, 0.57, 24, dtype=torch.float64).expand(16, 24)
    card = torch.zeros(16, 24, dtype=torch.float64)
    card[:, 9:15] = 1
    light = [bench.texture(2, 16, 24, seed) for seed in (0, 1)]
    sheets = [(card, torch.full_like(slant, 2.0), light[0]), (torch.ones_like(slant), slant, light[1])]
    view = bench.stacked_view(sheets, 4)
    twice = resampled(view, 2 * view.pixel_angle)

    def halved(image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.avg_pool2d(image[None], 2)[0]

    torch.testing.assert_close(twice.all_in_focus(), halved(view.all_in_focus()))
    # 8 x 12 pixels; 3 columns of card alone or in part; the sheet is seen in all but the 2 within the card
    near = twice.inverse_depth > 1
    assert int(near.sum()) == 8 * 4 and int((~near & ~twice.hidden).sum()) == 8 * 10
    assert int(twice.hidden.sum()) == 8 * 4
    seen = ~near & ~twice.hidden & (twice.pixel < 12) & (twice.pixel < 4)
    torch.testing.assert_close(
        twice.inverse_depth[seen].double(), halved(slant[None])[0, 0, :4], atol=1e-6, rtol=0
    )


def test_depth_nodes():
    """Exactly the scene's depths where they are few; else steps that the defocus asks for, ends included."""
    few = torch.tensor([0.5, 2.0, 0.5, 0.0], dtype=torch.float32)
    assert depth_nodes(few, 3, 40.0).tolist() == [0.0, 0.5, 2.0]
    many = torch.linspace(0, 2, 5000, dtype=torch.float64)
    assert torch.allclose(depth_nodes(many, 5, 40.0), torch.linspace(0, 2, 5, dtype=torch.float64))
    automatic = depth_nodes(many, "auto", 40.0)
    assert (automatic[0], automatic[-1]) == (0, 2)
    assert 0.9 * DEFOCUS_STEP < 40.0 * float(automatic.diff().max()) <= DEFOCUS_STEP
    assert depth_nodes(many, 1, 40.0).tolist() == [1.0]


@pytest.mark.parametrize("layers", [0, -3, 2.5, "many"])
def test_bad_layers_are_refused(layers):
    with pytest.raises(InputError, match="at least 1"):
        depth_nodes(torch.tensor([0.5, 1.0]), layers, 40.0)


def test_psfs_computed_as_they_are_needed_are_those_held(bench, monkeypatch):
    nodes = torch.linspace(0, 2, 7, dtype=torch.float64)
    held = bench.kernels(nodes, 3, 9)
    calls = []

    def compute(depths):
        calls.append(depths.numel())
        return bench.gaussian_psfs(depths, 3, 9)

    monkeypatch.setattr("edofsim.optics.psf_field.AHEAD", 3)
    streamed = PsfField(compute, nodes, held.wavelengths, 9)
    for k in range(7):
        assert torch.equal(streamed.layer(k), held.layer(k))
    assert calls == [3, 3, 1]
    assert torch.equal(streamed.truncated, held.truncated)
    assert torch.equal(streamed.values, held.values)


def deep_view(camera: Camera, margin: int = 24, side: int = 40) -> View:
    """Noise on a slope, and in front of it a bar that leans and hides some of it."""
    rows = side + 2 * margin
    draw = torch.Generator().manual_seed(3)
    slope = torch.linspace(0.0, 1.4, rows).expand(rows, rows).reshape(-1)
    bar = torch.zeros(rows, rows, dtype=torch.bool)
    bar[30:60, 40:46] = True
    behind = torch.nonzero(bar.flatten()).squeeze(1)
    near = torch.where(bar.flatten(), 1.7 + slope / 4, slope)
    pixel = torch.cat([torch.arange(rows * rows), behind])
    order = torch.argsort(pixel, stable=True)
    return View(
        height=side,
        width=side,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=torch.cat([near, slope[behind]])[order],
        radiance=torch.rand(1, len(pixel), generator=draw)[:, order],
        hidden=(torch.arange(len(pixel)) >= rows * rows)[order],
        wavelengths=torch.tensor([482e-9], dtype=torch.float64),
        pixel_angle=camera.pixel_angle,
    )


def deep_camera() -> Camera:
    lens, mask = PlanoConvexLens(aperture_radius_mm=1.5), CubicMask(alpha_rad=20.0)
    return Camera.from_recipe(CameraRecipe(name="deep", lens=lens, mask=mask, psf=PsfSettings(window_px=48)))


@pytest.mark.parametrize("occlusion", ["none", "hidden"])
def test_photo_of_band_limited_depths_is_that_of_very_many(occlusion):
    """Slabs blurred at few nodes of their own, negative shares and all, against four times as many depth
    nodes as 70 dB asks for where light is shared by the two next to it: noise on every surface."""
    camera = deep_camera()
    view = deep_view(camera)
    full = Fidelity(occlusion=occlusion)
    nodes, between = depths_of([view], camera, full)
    per_dioptre = math.pi / 482e-9 * camera.aperture_radius**2
    many = 4 * len(depth_nodes(view.inverse_depth, "auto", per_dioptre, 70.0))
    assert between is not None
    assert len(nodes) < many / 8
    few, exact = (
        capture(view, camera, how, exposure=1.0) for how in (full, Fidelity(occlusion=occlusion, layers=many))
    )
    assert (few.clean - exact.clean).square().mean() < 10 ** (-70 / 10)
    assert torch.allclose(few.truncated, exact.truncated, atol=2e-5)


def test_blur_of_a_part_of_the_frame_is_that_of_all_of_it(monkeypatch):
    """What is cut out around a slab and pasted back, against transforms of the whole frame."""
    camera = deep_camera()
    view = deep_view(camera)
    parts = []
    pasted = light.Box.pasted
    monkeypatch.setattr(light.Box, "pasted", lambda box, *how: parts.append(box) or pasted(box, *how))
    for how in (Fidelity(layers=7), Fidelity()):
        monkeypatch.setattr(light, "CROP_BELOW", 1.0)
        cut = capture(view, camera, how, exposure=1.0, dtype=torch.float64).clean
        assert parts
        monkeypatch.setattr(light, "CROP_BELOW", 0.0)
        parts.clear()
        whole = capture(view, camera, how, exposure=1.0, dtype=torch.float64).clean
        assert not parts
        assert (cut - whole).abs().max() < 1e-9


def test_noise_is_photographed_as_light_is(bench):
    """Photos of both halves differ by twice what `photo_noise` finds, where nothing hides anything."""
    camera = Camera.from_recipe(CameraRecipe(name="paper"))
    light = bench.texture(5, 48, 56)
    view = bench.flat_view(light, 0.9, 8, camera.pixel_angle)
    noise = 0.05 * light * torch.randn(light.shape, generator=torch.Generator().manual_seed(2))
    view = replace(view, noise=0.05, half_difference=noise.flatten(1))
    fidelity = Fidelity(window_px=33, read_noise=False)
    photo = capture(view, camera, fidelity)
    found = photo_noise(view, camera, fidelity, photo)
    ends = [capture(view.with_light(view.radiance + s * view.half_difference), camera, fidelity,
                    exposure=photo.exposure) for s in (1, -1)]  # fmt: skip
    assert found.state == "taken out"
    for name, mine in (("clean", found.image), ("ideal", found.ideal)):
        expected = (getattr(ends[0], name) - getattr(ends[1], name)) / 2
        assert float((mine - expected).square().mean().sqrt() / expected.square().mean().sqrt()) < 1e-3
    assert photo_noise(replace(view, half_difference=None), camera, fidelity, photo).state == "included"
    assert photo_noise(bench.flat_view(light, 0.9, 8), camera, fidelity, photo).state == "none"


def test_noise_does_not_move_the_exposure(bench):
    """Noise of 10 % raises the percentile of single pixels by several times what it does to the meter's."""
    camera = Camera.from_recipe(CameraRecipe(name="paper"))
    smooth = torch.linspace(0.2, 1, 160).expand(5, 160, 160)
    noisy = smooth * (1 + 0.1 * torch.randn((1, 160, 160), generator=torch.Generator().manual_seed(3)))
    views = [bench.flat_view(light, 0.9, 16, camera.pixel_angle) for light in (smooth, noisy)]
    exact, single = (capture(view, camera, Fidelity(window_px=33)).exposure for view in views)
    metered = [capture(replace(view, noise=0.1), camera, Fidelity(window_px=33)).exposure for view in views]
    assert abs(metered[1] / metered[0] - 1) < 0.03 < 0.06 < 1 - single / exact
