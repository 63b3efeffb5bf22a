"""Occlusion against rays: two or three surfaces seen through every point of a square pupil.

The oracle shifts each surface by its defocus times the pupil point, lays the shifted surfaces over each other
and averages over the pupil. That is the exact image of geometric optics; its PSFs are the shifts themselves.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial

import pytest
import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.blurring import Blurring
from edofsim.capture.coarse import CoarsePixels
from edofsim.capture.crop import crop
from edofsim.capture.light import light_of
from edofsim.capture.occlusion import OCCLUSIONS
from edofsim.capture.occlusion.hidden import TILE, composite
from edofsim.capture.occlusion.slabs import cuts, hides, revealed
from edofsim.capture.occlusion.sub_apertures import change_by_sub_apertures
from edofsim.optics import Camera, PsfField, between_part_variance
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings
from edofsim.render.view import View

BANDS, MARGIN, REACH = 2, 12, 4
SIZE = 40


def pupil() -> list[tuple[int, int]]:
    return [(y, x) for y in range(-REACH, REACH + 1) for x in range(-REACH, REACH + 1)]


def ray_traced(sheets, defocus: list[int]) -> Tensor:
    """[band, y, x] over the padded frame; sheets as for `stacked_view`, near to far, the last one opaque."""
    total = 0
    for s in pupil():
        image, clear = 0, 1
        for (coverage, _, radiance), shift in zip(sheets, defocus, strict=True):
            move = (s[0] * shift, s[1] * shift)
            shifted = torch.roll(coverage, move, (0, 1))
            image = image + clear * shifted * torch.roll(radiance, move, (1, 2))
            clear = clear * (1 - shifted)
        total = total + image
    return total / len(pupil())


def in_part(across: int, part: int, y: int, x: int) -> bool:
    """Whether a point of the pupil lies in one of across x across parts."""
    return part == (y * across // (2 * REACH + 1)) * across + x * across // (2 * REACH + 1)


def kernels_for(bench, depths: list[float], defocus: list[int], part=lambda y, x: True) -> PsfField:
    """The PSFs of those shifts: nodes ascend, so the farthest surface comes first. part: of the pupil, by
    the indices of its points."""
    window = 2 * MARGIN + 1
    values = torch.zeros(len(depths), BANDS, window, window, dtype=torch.float64)
    for k, shift in enumerate(reversed(defocus)):
        for y, x in pupil():
            if not part(y + REACH, x + REACH):
                continue
            values[k, :, MARGIN + y * shift, MARGIN + x * shift] += 1 / len(pupil())
    nodes = torch.tensor(list(reversed(depths)), dtype=torch.float64)
    return PsfField(values, nodes, bench.wavelengths(BANDS))


def surfaces(bench, count: int, textured: bool = True):
    """Overlapping opaque sheets at 2.0, 1.0, 0.2 dioptres, each larger than what is in front of it."""
    side = SIZE + 2 * MARGIN
    depths = [2.0, 1.0, 0.2][3 - count :]
    rows, columns = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    shapes = [(rows - 30) ** 2 + (columns - 26) ** 2 < 13**2, columns + rows // 4 < 42, rows >= 0][
        3 - count :
    ]
    sheets = []
    for k, (depth, shape) in enumerate(zip(depths, shapes, strict=True)):
        radiance = (
            bench.texture(BANDS, side, side, seed=k) if textured else torch.ones(BANDS, side, side).double()
        )
        sheets.append((shape.double(), torch.full((side, side), depth, dtype=torch.float64), radiance))
    return sheets, depths


def composed(bench, name: str, sheets, depths, defocus, **change) -> tuple[Tensor, Tensor]:
    """(photo, truth) of the frame."""
    view = replace(bench.stacked_view(sheets, MARGIN), **change)
    blur = Blurring(
        kernels_for(bench, depths, defocus),
        torch.eye(BANDS, dtype=torch.float64),
        gap=0.05,
    )
    return view.crop_margin(OCCLUSIONS[name](view, blur)), view.crop_margin(ray_traced(sheets, defocus))


def psnr(image: Tensor, truth: Tensor) -> float:
    return -10 * torch.log10((image - truth).square().mean()).item()


@pytest.mark.parametrize("defocus", [[1, 0], [0, 1], [2, 0], [0, -2]])
def test_hidden_is_exact_for_two_surfaces_of_which_one_is_in_focus(bench, defocus):
    photo, truth = composed(bench, "hidden", *surfaces(bench, 2), defocus)
    assert (photo - truth).abs().max() < 1e-10


@pytest.mark.parametrize("defocus", [[1, -1], [2, 1], [1, 2], [2, -1]])
def test_hidden_is_good_when_nothing_is_in_focus(bench, defocus):
    """Blurred coverage and blurred light are averaged over the pupil apart; rays know which go together."""
    scores = {}
    for name in ("none", "over", "normalised", "hidden"):
        photo, truth = composed(bench, name, *surfaces(bench, 2), defocus)
        scores[name] = psnr(photo, truth)
    assert scores["hidden"] > 35
    assert scores["hidden"] > max(scores["none"], scores["over"], scores["normalised"] - 1)


@pytest.mark.parametrize("defocus", [[1, -1], [2, 1], [-1, 2]])
def test_hidden_through_each_point_of_the_pupil_is_what_rays_see(bench, defocus):
    """Part by part it comes nearer to the rays; with a part for each point it is them."""
    sheets, depths = surfaces(bench, 2)
    view = bench.stacked_view(sheets, MARGIN)
    truth = view.crop_margin(ray_traced(sheets, defocus))
    scores = {}
    for across in (1, 3, 2 * REACH + 1):
        parts = [
            kernels_for(bench, depths, defocus, partial(in_part, across, part)) for part in range(across**2)
        ]
        response = torch.eye(BANDS, dtype=torch.float64)
        blur = Blurring(kernels_for(bench, depths, defocus), response, gap=0.05)
        image = OCCLUSIONS["hidden"](view, blur)
        if across > 1:
            change = change_by_sub_apertures(view, blur, parts)
            image = image + change
        scores[across] = psnr(view.crop_margin(image), truth)
        if across == 3:  # places of 9 points differ 60/9 in the mean square, means of threes 6
            made_up = psnr(view.crop_margin(image + (60 / 9 / 6 - 1) * change), truth)
    assert scores[1] < scores[3] - 3
    assert scores[3] < made_up - 0.1
    assert scores[2 * REACH + 1] > 200


class _Apart:
    """Light through one set of PSFs, blocked through another."""

    def __init__(self, light: Blurring, cover: Blurring) -> None:
        self.gap, self.reach = light.gap, light.reach
        self.light, self.coverage = light.light, cover.coverage

    def slab(self, view, which, part, amount):
        return self.light(view, which, part), self.coverage(view, which, amount)


@pytest.mark.parametrize("margin", [MARGIN, MARGIN + 3])
@pytest.mark.parametrize("together", [False, True])
def test_what_parts_change_is_what_compositing_each_by_itself_changes(bench, monkeypatch, margin, together):
    """Spectra that parts and slabs share, against each part composited from the start; in tiles and whole,
    slabs transformed together and by themselves."""
    small = math.inf if together else 0
    monkeypatch.setattr(sys.modules[change_by_sub_apertures.__module__], "SMALL_FRAME", small)
    torch.set_num_threads(3)  # parts are shared out among threads
    sheets, depths = surfaces(bench, 3)
    response = torch.rand(3, BANDS, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    response /= response.sum(1, keepdim=True)
    pupil = [kernels_for(bench, depths, [2, 1, -1], partial(in_part, 2, part)) for part in range(4)]
    little = torch.tensor([0.01, 1.0, 1.0], dtype=torch.float64)[:, None, None, None]
    pupil[0] = replace(pupil[0], source=pupil[0].values * little)  # its light has left the window
    how = (kernels_for(bench, depths, [2, 1, -1]), response)
    alone = Blurring(*how, gap=0.05)
    instead = torch.cat([how[0].values[:1], pupil[0].values[1:]])  # there the whole pupil stands in
    blocking = [replace(pupil[0], source=instead), *pupil[1:]]
    apart = [
        _Apart(Blurring(light, *how[1:], gap=0.05), Blurring(cover, *how[1:], gap=0.05))
        for light, cover in zip(pupil, blocking, strict=True)
    ]
    view = crop(bench.stacked_view(sheets, MARGIN), 0, 0, SIZE, SIZE, margin)
    for tile in (TILE, 8):
        monkeypatch.setattr(sys.modules[composite.__module__], "TILE", tile)
        each = sum(OCCLUSIONS["hidden"](view, one) for one in apart)
        slow = view.crop_margin(each - OCCLUSIONS["hidden"](view, alone))
        change = view.crop_margin(change_by_sub_apertures(view, alone, pupil))
        assert slow.abs().max() > 0.01
        assert (change - slow).abs().max() < 1e-12


@pytest.mark.parametrize("side", [2, 3])
def test_light_in_coarse_pixels_is_its_mean_and_a_constant_stays_one(bench, side):
    """Rows and columns that are no multiple of the side: the last coarse pixels hold fewer fine ones."""
    view = bench.flat_view(torch.full((BANDS, 11, 13), 0.7, dtype=torch.float64), 1.0, 0)
    light = light_of(view, torch.tensor([1.0], dtype=torch.float64), torch.arange(11 * 13))
    pixels = CoarsePixels(side)
    image = pixels.light(light).at_node(0)
    assert image.shape[1:] == (math.ceil(11 / side), math.ceil(13 / side))
    assert (image - 0.7).abs().max() < 1e-12
    assert (pixels.interpolated(image, 11, 13) - 0.7).abs().max() < 1e-12
    ramp = torch.arange(24, dtype=torch.float64).expand(1, 24, 24)
    view = bench.flat_view(ramp, 1.0, 0)
    light = light_of(view, torch.tensor([1.0], dtype=torch.float64), torch.arange(24 * 24))
    found = pixels.interpolated(pixels.light(light).at_node(0), 24, 24)
    inner = slice(2 * side + 1, -2 * side - 1)
    assert (found - ramp)[:, inner, inner].abs().max() < 0.1 * side  # of steps of 1 from pixel to pixel


def step_view(camera: Camera, side: int) -> View:
    """Half of a frame is near, on a textured surface far behind it that is known everywhere."""
    draw = torch.Generator().manual_seed(4)
    margin = camera.recipe.psf.window_px // 2
    padded = side + 2 * margin
    near = (torch.arange(padded**2) % padded) < padded // 2
    behind = torch.nonzero(near).squeeze(1)
    pixel = torch.cat([torch.arange(padded**2), behind])
    hidden = torch.arange(len(pixel)) >= padded**2
    order = torch.argsort(pixel * 2 + hidden)
    return View(
        height=side,
        width=side,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=torch.cat([2.0 * near, torch.full((len(behind),), 0.3)])[order],
        radiance=torch.rand(1, len(pixel), generator=draw)[:, order],
        hidden=hidden[order],
        wavelengths=torch.tensor([546e-9], dtype=torch.float64),
        pixel_angle=camera.pixel_angle,
    )


def test_what_sub_apertures_change_is_the_same_in_pixels_twice_as_wide():
    """Pixels of the view against coarse ones, at the same nodes and bands: the change has so little
    fine detail that they err by a part of it, though the surfaces are noise from pixel to pixel."""
    lens = PlanoConvexLens(aperture_radius_mm=1.5)
    camera = Camera.from_recipe(CameraRecipe(name="step", lens=lens, psf=PsfSettings(window_px=48)))
    view = step_view(camera, 64)
    images = {
        name: capture(view, camera, Fidelity(layers=2, **how), exposure=1.0).clean.double()
        for name, how in {
            "whole": {},
            "coarse": {"sub_apertures": 3, "sub_aperture_pixel": 2},
            "fine": {"sub_apertures": 3, "sub_aperture_pixel": 1},
        }.items()
    }
    change = (images["fine"] - images["whole"]).square().mean()
    error = (images["coarse"] - images["fine"]).square().mean()
    assert change > 1e-7
    assert error < change / 5


def test_dark_fringe_of_compositors_without_hidden_surfaces(bench):
    """A blurred front over a sharp back of the same radiance. Half of the light at the edge comes from the
    front and half from what the front hides: a compositor that cannot see it is left with 1 - (1/2)(1/2)."""
    sheets, depths = surfaces(bench, 2, textured=False)
    lowest = {}
    for name in ("none", "over", "hidden"):
        photo, _ = composed(bench, name, sheets, depths, [2, 0])
        lowest[name] = float(photo.min())
    assert lowest["hidden"] > 1 - 1e-12
    assert lowest["over"] < 0.6
    assert lowest["none"] < 0.6


@pytest.mark.parametrize("name", ["normalised", "hidden"])
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("defocus", [[1, 0, -1], [2, -1, 0], [0, 1, 2]])
def test_constant_radiance_stays_constant_across_depth_edges(bench, name, count, defocus):
    """A room whose walls all have one radiance looks the same everywhere, whatever covers what."""
    photo, _ = composed(bench, name, *surfaces(bench, count, textured=False), defocus[:count])
    assert (photo - 1).abs().max() < 1e-10


def test_three_surfaces(bench):
    sheets, depths = surfaces(bench, 3)
    photo, truth = composed(bench, "hidden", sheets, depths, [2, 1, 0])
    plain, _ = composed(bench, "none", sheets, depths, [2, 1, 0])
    assert psnr(photo, truth) > 35
    assert psnr(photo, truth) > psnr(plain, truth) + 6


def test_a_far_surface_whose_blur_barely_reaches_does_not_fill_a_seam(bench):
    """One connected surface, cut into two slabs whose blurs are alike: nothing is seen through the seam.
    Of what is far behind, the part that is known ends 11 pixels away, and its blur after 12. Were that to
    fill what is behind the seam, a quarter of the light there would be the far surface's: half is the near
    slab's, and half of the rest the middle one's."""
    sheets, depths = surfaces(bench, 3, textured=False)
    side = SIZE + 2 * MARGIN
    columns = torch.arange(side).expand(side, side)
    left, right = (columns < 31).double(), ((columns >= 31) | (columns < 6)).double()
    bright = torch.full_like(sheets[2][2], 2.0)
    whole = [(left, *sheets[0][1:]), (right, *sheets[1][1:]), (sheets[2][0], sheets[2][1], bright)]
    view = bench.stacked_view(whole, MARGIN)
    known = (view.inverse_depth > 0.5) | (view.pixel % side < 20) | (view.pixel % side > 52)
    view = replace(
        view,
        pixel=view.pixel[known],
        coverage=view.coverage[known],
        inverse_depth=view.inverse_depth[known],
        radiance=view.radiance[:, known],
        hidden=view.hidden[known],
    )
    kernels = kernels_for(bench, depths, [1, 1, 3])
    blur = Blurring(kernels, torch.eye(BANDS, dtype=torch.float64), gap=0.05)
    seam = OCCLUSIONS["hidden"](view, blur)[:, :, 30:32]
    assert (seam - 1).abs().max() < 1 / 8


def test_each_channel_has_its_own_coverage(bench):
    """A front that is blurred in one band and sharp in the other: an edge that is blurred with one band's PSF
    for both would be wrong in the other."""
    sheets, depths = surfaces(bench, 2)
    view = bench.stacked_view(sheets, MARGIN)
    kernels = kernels_for(bench, depths, [2, 0])
    sharp = kernels_for(bench, depths, [0, 0])
    values = torch.stack([kernels.values[:, 0], sharp.values[:, 1]], 1)
    blur = Blurring(
        PsfField(values, kernels.inverse_depths, kernels.wavelengths),
        torch.eye(2).double(),
        gap=0.05,
    )
    photo = view.crop_margin(OCCLUSIONS["hidden"](view, blur))
    assert (photo[0] - view.crop_margin(ray_traced(sheets, [2, 0]))[0]).abs().max() < 1e-10
    assert (photo[1] - view.crop_margin(ray_traced(sheets, [0, 0]))[1]).abs().max() < 1e-10


def test_far_from_edges_the_linear_image_is_untouched(bench):
    """Tiles without an edge in reach are bit for bit the linear image; the others equal one composite."""
    side = 320
    depth = torch.full((side, side), 0.2, dtype=torch.float64)
    shape = torch.zeros(side, side, dtype=torch.float64)
    shape[20:60, 20:60] = 1
    texture = [bench.texture(BANDS, side, side, seed=k) for k in (0, 1)]
    view = bench.stacked_view(
        [(shape, depth + 1.8, texture[0]), (torch.ones_like(shape), depth, texture[1])], MARGIN
    )
    blur = Blurring(kernels_for(bench, [2.0, 0.2], [2, 1]), torch.eye(2).double(), gap=0.05)
    photo, linear = OCCLUSIONS["hidden"](view, blur), OCCLUSIONS["none"](view, blur)
    whole = composite(view, blur, cuts(view, blur.gap))
    assert torch.equal(view.crop_margin(photo)[:, 128:], view.crop_margin(linear)[:, 128:])
    assert torch.allclose(view.crop_margin(photo), view.crop_margin(whole), atol=1e-9)


def test_a_slanted_surface_that_hides_nothing_is_not_cut(bench):
    side = SIZE + 2 * MARGIN
    view = bench.flat_view(
        bench.texture(BANDS, side, side),
        torch.linspace(0.2, 2, side, dtype=torch.float64).expand(side, side),
        MARGIN,
    )
    assert cuts(view, 0.05) == []
    assert not hides(view, 0.05).front.numel()


def test_cuts_lie_where_least_is_cut(bench):
    """Two sheets with a third between them that hides nothing: one cut serves, and it spares the third."""
    sheets, _ = surfaces(bench, 2)
    view = bench.stacked_view(sheets, MARGIN)
    between = replace(view, inverse_depth=view.inverse_depth.clone())
    alone = torch.nonzero(~view.hidden & (view.inverse_depth < 0.5)).squeeze(1)[:300]
    between.inverse_depth[alone] = torch.linspace(0.3, 0.8, 300, dtype=torch.float64)
    at = cuts(between, 0.05)
    assert len(at) == 1
    assert 0.8 < at[0] < 1.0


def test_every_hidden_fragment_lies_behind_a_cut(bench):
    sheets, _ = surfaces(bench, 3)
    view = bench.stacked_view(sheets, MARGIN)
    at = torch.tensor(cuts(view, 0.05))
    pairs = hides(view, 0.05)
    near, far = view.inverse_depth[pairs.front], view.inverse_depth[pairs.behind]
    assert bool(((at[:, None] < near) & (at[:, None] >= far)).any(0).all())
    assert len(at) == 2


def test_revealed_coverage_never_exceeds_the_pixel(bench):
    """Half a pixel of front, half of back seen and half hidden: with the front gone, all the back shows; of
    two full coverages the nearer one shows."""
    view = bench.flat_view(torch.ones(1, 1, 3, dtype=torch.float64), 1.0, 0)
    view = replace(
        view,
        pixel=torch.tensor([0, 0, 0, 1, 1]),
        coverage=torch.tensor([0.5, 0.5, 0.5, 1.0, 1.0]).double(),
        inverse_depth=torch.tensor([2.0, 1.0, 1.0, 2.0, 1.0]).double(),
        radiance=torch.ones(1, 5).double(),
        hidden=torch.tensor([False, False, True, False, True]),
    )
    assert revealed(view, torch.arange(5)).tolist() == [0.5, 0.5, 0.0, 1.0, 0.0]
    assert revealed(view, torch.tensor([1, 2, 4])).tolist() == [0.5, 0.5, 1.0]


@pytest.mark.parametrize("name", ["over", "normalised", "hidden"])
def test_gradients_with_coverage_exactly_zero_and_one(bench, name):
    """Finite gradients to radiance, coverage, PSFs with coverage 0 and 1, empty layers, a one-pixel layer."""
    sheets, depths = surfaces(bench, 3)
    sheets[0][0].zero_()
    sheets[0][0][30, 30] = 1
    view = bench.stacked_view(sheets, MARGIN)
    nothing = torch.zeros(1, dtype=torch.int64)
    view = replace(
        view,
        pixel=torch.cat([nothing, view.pixel]),
        coverage=torch.cat([nothing.double(), view.coverage]).requires_grad_(),
        inverse_depth=torch.cat([nothing.double() + 1.5, view.inverse_depth]),
        radiance=torch.cat([torch.zeros(BANDS, 1).double(), view.radiance], 1).requires_grad_(),
        hidden=torch.cat([nothing.bool(), view.hidden]),
    )
    base = kernels_for(bench, [2.0, 1.5, 1.0, 0.2], [2, 1, 1, 0])
    values = base.values.clone().requires_grad_()
    kernels = PsfField(values, base.inverse_depths, base.wavelengths)
    blur = Blurring(kernels, torch.eye(BANDS, dtype=torch.float64), gap=0.05)
    OCCLUSIONS[name](view, blur).square().sum().backward()
    for grad in (view.radiance.grad, view.coverage.grad, values.grad):
        assert torch.isfinite(grad).all()
    assert view.radiance.grad.any()


def test_gradcheck_through_occlusion(bench):
    """Analytic against numerical derivatives of the composite by PSFs, radiance and coverage, float64."""
    window, side = 5, 9
    shape = torch.zeros(side, side, dtype=torch.float64)
    shape[:, :4] = 1
    shape[:, 4] = 0.5
    depth = torch.ones(side, side, dtype=torch.float64)
    sheets = [
        (shape, depth * 2, bench.texture(2, side, side)),
        (depth, depth * 0.2, bench.texture(2, side, side, 1)),
    ]
    view = bench.stacked_view(sheets, 2)
    base = bench.kernels(torch.tensor([0.2, 2.0], dtype=torch.float64), 2, window, growth=1.0)

    def picture(values, radiance, scale):
        kernels = PsfField(values, base.inverse_depths, base.wavelengths)
        blur = Blurring(kernels, bench.response(2, 2), gap=0.05)
        changed = replace(view, radiance=radiance, coverage=view.coverage * scale)
        return view.crop_margin(OCCLUSIONS["hidden"](changed, blur))

    values = base.values.clone().requires_grad_()
    radiance = view.radiance.clone().requires_grad_()
    scale = torch.full((1,), 0.9, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(picture, (values, radiance, scale), fast_mode=True)


def test_gradients_pass_sub_apertures(bench):
    """Against differences, for light and for PSFs; without gradients, by threads, the same numbers."""
    sheets, depths = surfaces(bench, 2)
    view = bench.stacked_view(sheets, MARGIN)
    whole = kernels_for(bench, depths, [2, 1])
    through = [kernels_for(bench, depths, [2, 1], partial(in_part, 2, part)) for part in range(4)]
    response = torch.eye(BANDS, dtype=torch.float64)
    pattern = torch.rand(BANDS, *view.padded_shape, generator=torch.Generator().manual_seed(1)).double()

    def weighed(light, scale):
        seen = replace(view, radiance=light)
        psfs = [replace(each, source=each.values * scale) for each in through]
        change = change_by_sub_apertures(seen, Blurring(whole, response, gap=0.05), psfs)
        return (change * pattern).sum()

    light = view.radiance.clone().requires_grad_()
    scale = torch.ones(BANDS, 1, 1, dtype=torch.float64, requires_grad=True)
    found = weighed(light, scale)
    assert abs(float(found.detach() - weighed(view.radiance, scale.detach()))) < 1e-9
    found.backward()
    # the change is linear in the light: its derivative, applied to the light itself, is the change
    assert float((light.grad * light.detach()).sum()) == pytest.approx(float(found.detach()), rel=1e-9)
    step = 1e-6
    ends = [float(weighed(view.radiance, scale.detach() * (1 + s * step))) for s in (1, -1)]
    assert float(scale.grad.sum()) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)


def test_a_photo_makes_up_for_what_few_sub_apertures_do_not_tell(monkeypatch):
    """By the share that they do tell: were it half of what it is, the photo would change twice as much."""
    camera = Camera.from_recipe(CameraRecipe(name="step", psf=PsfSettings(window_px=32)))
    view = step_view(camera, 24)

    def photo(across: int) -> Tensor:
        return capture(view, camera, Fidelity(layers=2, sub_apertures=across), exposure=1.0).clean.double()

    whole, few = photo(1), photo(2)
    gain = between_part_variance(camera, 2)
    monkeypatch.setattr("edofsim.capture.imaging.between_part_variance", lambda *_: gain / 2)
    assert (few - whole).abs().max() > 1e-4
    assert (photo(2) - whole - 2 * (few - whole)).abs().max() < 1e-6
    monkeypatch.setattr("edofsim.capture.imaging.between_part_variance", lambda *_: 1.0)
    assert (photo(2) - whole - gain * (few - whole)).abs().max() < 1e-6
