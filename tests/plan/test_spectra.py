"""What plans look at: spectra of tiles, and coarse pixels."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
import torch

from edofsim.capture import Fidelity, capture, photograph
from edofsim.capture.band_groups import every_band
from edofsim.capture.checks import check_view
from edofsim.capture.guessed import with_guessed
from edofsim.capture.photograph import sub_aperture_change
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.core.once import Once
from edofsim.optics import Camera, psf_bank
from edofsim.plan import decibels, facts_of, tiles
from edofsim.plan.coarse import coarse_of, coarser
from edofsim.plan.effect import Level
from edofsim.plan.effects import all_effects, depth_layers, window
from edofsim.plan.estimate import _products, estimate
from edofsim.plan.facts import photo_changes
from edofsim.plan.fragments import Fragments
from edofsim.plan.otfs import otfs_of, reach_of
from edofsim.plan.passing import Passing
from edofsim.plan.spectra import Spectra
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings
from edofsim.render.view import View

LAMPS = 1.4826
"""Inverse depth of lamps, 1/m: of the range next to a node of 9 and of 13 layers, and between two of 29."""
CAMERA = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=48)))


def images(spectra: Spectra, vector: torch.Tensor) -> torch.Tensor:
    """A change given as a vector, under the window, 0 outside of the frame: [tile, channel, y, x]."""
    return vector.unflatten(1, spectra.tiles.inside.shape).transpose(0, 1) / spectra.tiles.scale[:, None]


def two_depths(height: int = 384, width: int = 576, bands: int = 12) -> View:
    """Random light, the left half farther than the right; nothing is hidden."""
    margin = 24
    rows, columns = height + 2 * margin, width + 2 * margin
    depth = torch.full((rows, columns), 0.3)
    depth[:, columns // 2 :] = 2.0
    return View.flat(
        torch.rand(bands, rows, columns, generator=torch.Generator().manual_seed(0)),
        depth,
        wavelengths=torch.linspace(420e-9, 720e-9, bands),
        pixel_angle=CAMERA.pixel_angle,
        margin=margin,
        metadata={"hidden": "none"},
    )


def test_tiles_of_other_depths_share_the_groups_of_bands():
    """Each more group of bands is nearer to every band on its own, though the tiles that stand for the frame
    lie at other distances; each band on its own errs by nothing."""
    facts = facts_of(two_depths(), CAMERA)
    depth = facts.view.inverse_depth[facts.spectra.seen.which]
    assert len(facts.spectra.tiles.shares) > 4 and depth.min() < 1 < depth.max()
    errors = [
        float(
            facts.spectra.by_bands(facts.full.changed({"band_groups": groups, "group_wavelengths": 0}))
            .square()
            .sum()
        )
        for groups in (1, 2, 4, 8, 12)
    ]
    assert all(more < 0.8 * fewer for fewer, more in zip(errors, errors[1:], strict=False))
    assert errors[-1] < 1e-9


def test_many_psfs_are_computed_in_the_window_that_holds_each_of_them():
    """Of half, three quarters and all of the camera's the first that holds 95 % of what the camera's does at
    every depth, by sums over whole PSFs; their OTFs are those of the same PSFs cut."""
    gathering, found = every_band(torch.tensor([500e-9, 600e-9]).double(), torch.eye(2)), set()
    for depths in ([0.5, 0.6], [0.2, 0.5], [0.0, 2.0], [0.0, 2.6]):
        nodes = torch.tensor(depths, dtype=torch.float64)
        otfs = partial(otfs_of, Once(), CAMERA, 64)
        side = reach_of(otfs, facts_of(two_depths(), CAMERA).full, gathering, nodes, 48)
        psfs = psf_bank(CAMERA, gathering.wavelengths, nodes, window_px=48).values

        def held(cut: int, psfs: torch.Tensor = psfs) -> float:
            some = slice(24 - cut // 2, 24 + cut // 2)
            return float((psfs[..., some, some].sum((-1, -2)) / psfs.sum((-1, -2))).min())

        assert side == next(cut for cut in (24, 36, 48) if held(cut) >= 0.95)
        full = facts_of(two_depths(), CAMERA).full
        one = otfs(full, gathering, nodes, within=side)
        other = otfs(full.changed({"window_px": side}), gathering, nodes)
        assert (one - other).abs().max() < 1e-3
        found.add(side)
    assert found == {24, 36, 48}


def test_each_tile_is_dimmed_by_what_is_in_front_of_it():
    """Where a share of all light of a tile passes, changes there are that share of what they were."""
    passed = []
    for dimmed in (False, True):
        spectra = facts_of(two_depths(), CAMERA).spectra
        shares = (
            torch.linspace(0.2, 0.9, len(spectra.tiles.shares))
            if dimmed
            else torch.ones(len(spectra.tiles.shares))
        )
        shares = shares[None, :, None, None].expand(2, -1, spectra.tiles.side, spectra.tiles.side)
        spectra.__dict__["_passing"] = Passing(torch.tensor([1.0], dtype=torch.float64), shares)
        one = spectra.full.changed({"band_groups": 1, "group_wavelengths": 0})
        passed.append((images(spectra, spectra.by_bands(one)), shares[0, :, None]))
    (whole, _), (found, shares) = passed
    assert whole.flatten(1).norm(dim=1).min() > 0
    torch.testing.assert_close(found, whole * shares, rtol=1e-4, atol=1e-9)


def test_products_of_errors_are_those_of_their_images(monkeypatch: pytest.MonkeyPatch):
    """However few entries of the images are summed at a time."""
    monkeypatch.setattr("edofsim.plan.estimate.CHUNK", 10_000)
    kept, products = [], _products
    monkeypatch.setattr(
        "edofsim.plan.estimate._products", lambda images: kept.extend(images) or products(images)
    )
    found = estimate(facts_of(two_depths(), CAMERA), all_effects())
    assert len(kept) > 5
    for one, row in zip(kept, found.products, strict=True):
        for other, product in zip(kept, row.tolist(), strict=True):
            wanted = 0.0
            if one.shape == other.shape:
                wanted = float((one.double() * other.double()).sum()) / len(one)
            size = float(one.norm() * other.norm())
            assert product == pytest.approx(wanted, abs=1e-5 * size)


def test_tiles_stand_for_the_frame():
    """What a narrower window changes: seen in some tiles, and in the photo of the whole frame."""
    view = two_depths()
    facts = facts_of(view, CAMERA)
    full = facts.full.changed({"occlusion": "none"})
    narrow = {"window_px": 16}
    seen = facts.spectra.by_psfs(facts.spectra.full.changed(narrow), facts.spectra.full)
    photo = capture(view, CAMERA, full)
    change = capture(view, CAMERA, full.changed(narrow), exposure=photo.exposure).clean - photo.clean
    found, truth = (float(square.sqrt()) for square in (seen.square().sum(1).mean(), change.square().mean()))
    assert found == pytest.approx(truth, rel=0.4)  # 3 dB


def bars(rows: int = 144, columns: int = 176, bands: int = 4) -> View:
    """Dark bars in front of a bright surface, which goes on behind them."""
    x, y = torch.arange(columns), torch.arange(rows)[:, None]
    near = ((x // 20) % 3 == 0).expand(rows, columns)
    bright = 0.6 + 0.3 * (torch.sin(2 * torch.pi * x / 90) * torch.cos(2 * torch.pi * y / 70))
    dark = 0.3 + 0.1 * torch.rand(rows * columns, generator=torch.Generator().manual_seed(0))
    return in_front(near, dark, bright, bands)


def in_front(near: torch.Tensor, light: torch.Tensor, behind: torch.Tensor, bands: int = 4) -> View:
    """A surface where `near` [y, x], in front of one that goes on behind it, with the light of each."""
    light, behind, nearer = light.flatten(), behind.flatten(), near.flatten()
    every, margin = torch.arange(near.numel()), 24
    pixel = torch.cat([every, every[nearer]])
    hidden = torch.arange(len(pixel)) >= len(every)
    depth = torch.where(torch.cat([nearer, nearer[nearer]]) & ~hidden, 2.0, 0.3)
    shine = torch.cat([torch.where(nearer, light, behind), behind[nearer]])
    order = torch.argsort(pixel * 2 + hidden)
    return View(
        height=near.shape[0] - 2 * margin,
        width=near.shape[1] - 2 * margin,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(order)),
        inverse_depth=depth[order],
        radiance=shine[order].repeat(bands, 1),
        hidden=hidden[order],
        wavelengths=torch.linspace(450e-9, 650e-9, bands, dtype=torch.float64),
        pixel_angle=CAMERA.pixel_angle,
    )


def test_surfaces_hide_what_is_behind_however_narrow_the_window():
    """A fence out of focus whose left half is dark, as all behind it is there: a window of 16 pixels errs by
    what it does in a photo; by half of this, if light that it loses let as much through from behind."""
    recipe = CameraRecipe(name="test", psf=PsfSettings(window_px=128), mask={"kind": "cubic"})
    x = torch.arange(192)
    light = torch.where(x < 96, 0.1, 0.9).expand(192, 192)
    view = in_front(((x // 8) % 6 != 0).expand(192, 192), light, light)
    facts = facts_of(view, Camera.from_recipe(recipe))
    narrow = window.levels(facts)[0]
    full = facts.full.changed({"sub_apertures": 1})
    photo, other = (
        capture(view, facts.camera, each, exposure=facts.exposure).clean
        for each in (full, full.changed(narrow.change))
    )
    truth = float((other - photo).square().mean().sqrt())
    (seen,) = window.differences(facts, [narrow])
    assert narrow.change == {"window_px": 16}
    assert float(seen.square().sum(1).mean().sqrt()) == pytest.approx(truth, rel=0.1)


@pytest.mark.parametrize("change", [{"lens_dispersion": False}, {"spherical_aberration": False}])
def test_at_silhouettes_spectra_see_what_changes_in_photos_with_occlusion(change: dict):
    """The difference of two photos, and the one by spectra, tile by tile: as long as light behind goes on and
    is dimmed they are alike; without that a silhouette is seen against nothing."""
    facts = facts_of(bars(), CAMERA)
    spectra, full = facts.spectra, facts.full.changed({"sub_apertures": 1})
    photo = capture(facts.view, CAMERA, full)
    other = capture(facts.view, CAMERA, full.changed(change), exposure=photo.exposure)
    difference = torch.nn.functional.pad(other.clean - photo.clean, (spectra.tiles.side,) * 4)
    truth = torch.stack(
        [
            difference[:, spectra.tiles.side + top :, spectra.tiles.side + left :][
                :, : spectra.tiles.side, : spectra.tiles.side
            ]
            for top, left in spectra.tiles.corners
        ]
    )

    def alike(seen: Spectra) -> float:
        found = images(seen, seen.by_psfs(seen.full.changed(change), seen.full)).flatten()
        return float(
            torch.nn.functional.cosine_similarity(found, (truth * seen.tiles.taper[:, None]).flatten(), 0)
        )

    nothing = Fragments(*(torch.zeros(0, dtype=torch.int64),) * 2, torch.zeros(0, dtype=torch.float64))
    bare = replace(spectra, behind=nothing, before=nothing, _known=Once())
    assert alike(spectra) > 0.7 > 0.5 > alike(bare)


def test_of_tiles_that_reach_over_the_border_the_part_in_the_frame_counts():
    spectra = facts_of(two_depths(96, 120, 2), CAMERA).spectra
    tops = [top for top, _ in spectra.tiles.corners]
    assert min(tops) < 0 and max(tops) + spectra.tiles.side > 96  # the tiles reach over it
    around = torch.stack(
        [
            torch.tensor(
                [
                    [
                        1.0 if 0 <= y < 96 and 0 <= x < 120 else 100.0
                        for x in range(left, left + spectra.tiles.side)
                    ]
                    for y in range(top, top + spectra.tiles.side)
                ]
            )
            for top, left in spectra.tiles.corners
        ]
    )[:, None]
    assert float(spectra.tiles.vector(around * spectra.tiles.taper[:, None]).square().sum()) == pytest.approx(
        1, rel=1e-5
    )


def test_a_lamp_counts_in_full_wherever_it_lies():
    """Each lamp alone: what a narrower window changes is seen right in tiles, next to their borders too."""
    view = two_depths(96, 200, 3)
    view = replace(view, inverse_depth=torch.ones_like(view.inverse_depth))
    for number, x in enumerate(range(30, 170, 10)):
        light = torch.full((3, 96 + 48, 200 + 48), 0.01)
        light[:, 24 + 30 + 5 * x % 36, 24 + x] = 100
        facts = facts_of(replace(view, radiance=light.flatten(1)), CAMERA)
        spectra, narrow = facts.spectra, facts.full.changed({"window_px": 24})
        assert len(spectra.tiles.shares) > 4
        if number == 0:  # so it is for all of them
            photo = capture(facts.view, CAMERA, facts.full)
            other = capture(facts.view, CAMERA, narrow, exposure=photo.exposure)
            truth = decibels(float((other.clean - photo.clean).square().mean().sqrt()))
        change = spectra.by_psfs(narrow, facts.full)
        assert decibels(float(change.square().sum(1).mean().sqrt())) == pytest.approx(truth, abs=1)


@pytest.mark.parametrize("times", [1, 2, 3])
def test_coarse_pixels_hold_the_mean_of_the_light_at_its_depths(times: int):
    view = two_depths(48, 72, 2)
    found = coarser(view, times)
    assert found.padded_shape == (96 // times, 120 // times) and found.margin == 24 // times
    assert found.pixel_angle == pytest.approx(times * view.pixel_angle)
    image = torch.zeros(2, 96 // times * (120 // times)).index_add(1, found.pixel, found.radiance)
    fine = view.radiance.reshape(2, 1, 96, 120)
    means = torch.nn.functional.avg_pool2d(fine, times).flatten(1)
    assert torch.allclose(image, means, atol=1e-6)
    assert torch.allclose(torch.bincount(found.pixel, found.coverage), torch.ones(image.shape[1]))
    assert set(found.inverse_depth.unique().tolist()) == set(view.inverse_depth.unique().tolist())


def test_hidden_surfaces_of_one_depth_cover_a_coarse_pixel_at_most_once():
    """Two lie behind one that is seen, the one behind the other, closer than depths are told apart."""
    pixels = torch.arange(16)
    depths = torch.tensor([2.0, 0.5, 0.5 - 1e-4]).repeat(16)  # seen, hidden, hidden behind that
    light = torch.tensor([1.0, 3.0, 5.0]).repeat(16)
    view = View(
        height=4,
        width=4,
        margin=0,
        pixel=pixels.repeat_interleave(3),
        coverage=torch.ones(48),
        inverse_depth=depths,
        radiance=light[None],
        hidden=depths < 1,
        wavelengths=torch.tensor([550e-9], dtype=torch.float64),
        pixel_angle=1e-3,
    )
    found = coarser(view, 2)
    check_view(found)
    assert found.coverage.tolist() == pytest.approx([1, 1] * 4)
    assert found.radiance[0].tolist() == pytest.approx([1, 4] * 4)
    assert found.hidden.tolist() == [False, True] * 4


def test_a_large_view_is_photographed_in_few_pixels_and_a_small_one_as_it_is():
    large, small = two_depths(), two_depths(48, 72, 2)
    coarse = coarse_of(large, CAMERA, 1.0)
    assert coarse.times > 2 and coarse.view.padded_shape[0] < large.padded_shape[0] / 2
    assert coarse.camera.pixel == pytest.approx(coarse.times * CAMERA.pixel)
    assert coarse_of(small, CAMERA, 1.0).view is small


def test_steps_of_less_blur_than_a_coarse_pixel_hide_in_it_as_in_the_view():
    """Stairs whose blurs differ by one and a half of the view's pixels, of which four lie in a coarse one:
    what sub-apertures change is as large as in a photo of the whole view, within 3 dB."""
    flat = two_depths(180, 270, bands=2)
    step = 1.5 / blur_per_dioptre(CAMERA)
    stairs = torch.div(torch.arange(flat.padded_shape[1]), 60, rounding_mode="floor").remainder(5)
    depth = (0.3 + step * stairs).expand(flat.padded_shape)
    view = with_guessed(replace(flat, inverse_depth=depth.flatten(), metadata={}), CAMERA)
    coarse = coarse_of(view, CAMERA, 1.0)
    assert coarse.times == 2 and view.hidden.any()
    parted = Fidelity(band_groups=1, group_wavelengths=1, layers=4, sub_apertures=3)
    fine = sub_aperture_change(view, CAMERA, parted, exposure=1.0)
    seen = coarse.photo(parted) - coarse.photo(parted.changed({"sub_apertures": 1}))
    fine = torch.nn.functional.avg_pool2d(fine, coarse.times)
    assert 0.5 < float(seen.square().mean() / fine.square().mean()) < 2


def test_coarse_photos_are_clean_photos_without_colours(monkeypatch: pytest.MonkeyPatch):
    """A plan asks for no tables of colours, which take seconds to load, and no noise."""
    view, plain = two_depths(48, 72, 2), Fidelity(layers=2, band_groups=1, group_wavelengths=1)
    photo = capture(view, CAMERA, plain, exposure=2.0).clean
    for name in ("colours_of", "record"):
        monkeypatch.delattr(photograph, name)
    coarse = coarse_of(view, CAMERA, 2.0)
    assert torch.equal(coarse.photo(plain), photo)
    parted = plain.changed({"sub_apertures": 2})
    change = sub_aperture_change(view, CAMERA, parted.changed({"field_step_px": 0}), exposure=2.0)
    assert torch.equal(coarse.photo(parted), photo + change)


def test_a_grey_photo_is_that_of_the_only_band_and_of_light_like_that_of_all_channels():
    """With one band it is a channel of the photo in colours, sub-apertures and all; through a sensor whose
    bands are fixed, too. Of many bands that are alike its light is the mean of the channels'."""
    parted = Fidelity(layers=2, band_groups=0, sub_apertures=2)
    one = coarse_of(with_guessed(two_depths(48, 72, 1), CAMERA), CAMERA, 2.0)
    (grey,) = one.grey.photo(parted)
    assert torch.allclose(one.photo(parted), grey.expand(3, -1, -1), atol=1e-6)
    lines = CAMERA.recipe.sensor.model_copy(update={"response": "lines"})
    of_lines = Camera.from_recipe(CAMERA.recipe.model_copy(update={"sensor": lines}))
    for camera, bands in ((CAMERA, 12), (of_lines, 3)):
        many = coarse_of(two_depths(48, 72, bands), camera, 2.0)
        whole = Fidelity(layers=2, occlusion="none")
        grey, colours = many.grey.photo(whole), many.photo(whole)
        assert grey.shape == (1, 48, 72) and float(grey.mean()) == pytest.approx(
            float(colours.mean()), rel=2e-3
        )


def test_each_channel_has_a_share_of_a_grey_change_like_that_of_its_light():
    view = two_depths(48, 72, 4)
    red = view.with_light(view.radiance * torch.tensor([0.1, 0.2, 0.5, 1.0])[:, None], view.wavelengths)
    facts = facts_of(red, CAMERA)
    (change,) = photo_changes(facts, [{"window_px": 8}])
    level = facts.levels_of_light.float()
    assert level[0] > 2 * level[2] and change.abs().max() > 1e-5
    assert torch.allclose(change[0], change[2] * level[0] / level[2])


def test_psfs_of_large_pixels_hold_as_much_light():
    """A recipe that fixes the samples of a pixel asks for as many of each small one in a large one."""
    camera = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=48, oversampling=2)))
    coarse = coarse_of(two_depths(), camera, 1.0)
    assert coarse.times == 3
    fine, large = (
        psf_bank(each, [450e-9, 600e-9], [0.3, 2.0]).values.sum((-2, -1)) for each in (camera, coarse.camera)
    )
    assert torch.allclose(fine, large, atol=2e-3)


def test_lamps_between_many_layers_err_by_where_they_lie_between_them():
    """On a slope. All lamps are next to a node of the fewer layers that errors of more are predicted from."""
    rows, columns, margin = 192, 240, 24
    view = two_depths(rows, columns, 4)
    depth = torch.linspace(0, 2, columns + 2 * margin).repeat(rows + 2 * margin, 1)
    light = 0.1 * view.radiance.unflatten(1, depth.shape)
    for down in range(0, rows, 24):
        for across in range(0, columns, 24):
            there = slice(margin + down, margin + down + 3), slice(margin + across, margin + across + 3)
            light[:, *there], depth[there] = 10.0, LAMPS
    shape = {"wavelengths": view.wavelengths, "pixel_angle": CAMERA.pixel_angle, "margin": margin}
    facts = facts_of(View.flat(light, depth, **shape, metadata={"hidden": "none"}), CAMERA)
    assert facts.spectra.fine_nodes == 25
    (found,) = depth_layers.differences(facts, [Level("", {"layers": 29})])
    whole = facts.full.changed({"sub_apertures": 1})
    truth, photo = (
        capture(facts.view, CAMERA, whole.changed(layers), exposure=facts.exposure).clean
        for layers in ({}, {"layers": 29})
    )
    predicted, measured = (
        10 * float(each.log10()) for each in (found.square().sum(1).mean(), (photo - truth).square().mean())
    )
    print(predicted, measured)
    assert abs(predicted - measured) < 4


def test_samples_within_pixels_are_seen_in_every_band():
    """By a cubic mask one sample a pixel errs in each band in another way, and less in their mean than eleven
    of them would say: a grey texture out of focus, against photos."""
    recipe = CameraRecipe(name="test", psf=PsfSettings(window_px=64), mask={"kind": "cubic"})
    camera, side, margin = Camera.from_recipe(recipe), 64, 32
    grey = torch.rand(1, side + 2 * margin, side + 2 * margin, generator=torch.Generator().manual_seed(0))
    view = View.flat(
        grey.expand(31, -1, -1).contiguous(),
        torch.full(grey.shape[1:], 0.6),
        wavelengths=torch.linspace(420e-9, 720e-9, 31),
        pixel_angle=camera.pixel_angle,
        margin=margin,
        metadata={"hidden": "none"},
    )
    facts = facts_of(view, camera)
    one = facts.full.changed({"oversampling": 1})
    whole, simpler = (capture(view, camera, each.of_photo()).clean for each in (facts.full, one))
    predicted = float(facts.spectra.by_psfs(one, facts.full).double().square().sum(1).mean().sqrt())
    assert predicted == pytest.approx(float((simpler - whole).square().mean().sqrt()), rel=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_tiles_that_are_drawn_have_the_detail_of_the_frame(monkeypatch: pytest.MonkeyPatch, seed: int):
    """Whichever they are: what blur changes grows with it. A frame without any counts by its tiles."""
    monkeypatch.setattr(tiles, "PIXELS", 4 * 48**2)
    view, side = two_depths(150, 260, 3), 48
    draw = torch.Generator().manual_seed(5)
    ideal = torch.rand(3, 150, 260, generator=draw) * (torch.arange(260) / 260) ** 4
    green, detail = ideal.mean(0), torch.zeros(150, 260)
    detail[1:] += green.diff(dim=0).square()
    detail[:, 1:] += green.diff(dim=1).square()
    around = torch.nn.functional.pad(detail.double(), (side,) * 4)
    found = tiles.choose_tiles(view, ideal, CAMERA, side, seed)
    assert len(found.corners) == 4
    seen = [
        float((around[side + top :, side + left :][:side, :side] * taper.square()).sum())
        for (top, left), taper in zip(found.corners, found.taper, strict=True)
    ]
    assert float(found.shares @ torch.tensor(seen).double()) == pytest.approx(float(detail.sum()), rel=1e-4)
    flat = tiles.choose_tiles(view, torch.ones_like(ideal), CAMERA, side, seed)
    assert float(flat.shares.sum()) == pytest.approx(5 * 8)
