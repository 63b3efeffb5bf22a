"""What is guessed behind depth edges, by closed forms: a white scene is white through any lens, and what is
even goes on evenly.

Pictures with depths hold nothing behind their edges. Where all light is added a white disc before a white
wall makes a photo from 0.1 to 1.3; the truth is 1 everywhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

import edofsim
from edofsim.api import photograph
from edofsim.capture import Fidelity, capture, guessed
from edofsim.capture.guessed import guessed_fragments, push_pull, with_guessed
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.render.view import View

SIDE, MARGIN = 64, 64
WAVELENGTHS = [482e-9, 546.5e-9, 611e-9]
NEAR, MIDDLE, FAR = 1 / 0.6, 1.0, 1 / 3.0
CAMERAS = {
    "paper-clear": lambda: edofsim.camera("paper-clear"),
    "paper-learned": lambda: edofsim.camera("paper-learned"),
    "35 mm f/4": lambda: edofsim.camera(focal_length=35e-3, f_number=4, pixel=3.45e-6, focus=1.5, window=128),
}


def grid() -> tuple[np.ndarray, np.ndarray]:
    n = SIDE + 2 * MARGIN
    y, x = np.mgrid[:n, :n] - n / 2 + 0.5
    return y, x


def depths(shape: str, camera: Camera | None = None) -> np.ndarray:
    """Inverse depths [y, x] in 1/m of the frame with its margin. Planes slant by no more than 30 pixels of
    blur: the light of a steeper one, whose every point is blurred by its own PSF, is thinned, edges or not;
    None: by all of the depths."""
    y, x = grid()
    range_ = NEAR - FAR if camera is None else min(NEAR - FAR, 30 / blur_per_dioptre(camera))
    plane = FAR + range_ * (y - y.min()) / np.ptp(y)
    if shape == "disc":
        return np.where(y**2 + x**2 < 20**2, NEAR, FAR)
    if shape == "disc at the border":
        return np.where(y**2 + (x - SIDE / 2) ** 2 < 15**2, NEAR, FAR)
    if shape == "thin bars":
        return np.where(x.astype(int) % 16 < 2, NEAR, FAR)
    if shape == "step":
        return np.where(x < 3, NEAR, FAR)
    if shape == "nested":
        return np.where(y**2 + x**2 < 12**2, NEAR, np.where(y**2 + x**2 < 28**2, MIDDLE, FAR))
    if shape == "slanted":
        return plane
    if shape == "disc before a slanted plane":
        return np.where(y**2 + x**2 < 16**2, 2.2, plane)
    if shape == "noisy":
        noise = np.random.default_rng(0).normal(0, 0.02, y.shape)
        return np.where(y**2 + x**2 < 20**2, NEAR, FAR) + noise
    if shape == "before nothing":
        return np.where(y**2 + x**2 < 20**2, NEAR, 0.0)
    raise AssertionError(shape)


SHAPES = (
    "disc",
    "disc at the border",
    "thin bars",
    "step",
    "nested",
    "slanted",
    "disc before a slanted plane",
    "noisy",
    "before nothing",
)


def picture(camera: Camera, depth: np.ndarray, light: np.ndarray | float = 1.0) -> View:
    image = np.broadcast_to(light, (3, *depth.shape))
    return View.flat(
        torch.tensor(image, dtype=torch.float32),
        torch.tensor(depth, dtype=torch.float32),
        wavelengths=WAVELENGTHS,
        pixel_angle=camera.pixel_angle,
        margin=MARGIN,
    )


def off(view: View, camera: Camera, fidelity: Fidelity | None = None) -> float:
    """By how much a white photo is not white, at most."""
    return float((capture(view, camera, fidelity, exposure=1.0).clean - 1).abs().max())


@pytest.fixture(scope="module", params=CAMERAS)
def camera(request: pytest.FixtureRequest) -> Camera:
    return CAMERAS[request.param]()


@pytest.fixture(scope="module")
def clear() -> Camera:
    return CAMERAS["paper-clear"]()


@pytest.mark.parametrize("shape", SHAPES)
def test_a_white_scene_is_white(camera: Camera, shape: str):
    """Light neither comes nor goes at edges: closed form, 1 everywhere."""
    assert off(picture(camera, depths(shape, camera)), camera) < 0.01


def test_adding_all_light_is_not_white(camera: Camera):
    """What the test above would see if nothing were guessed."""
    view = picture(camera, depths("disc"))
    assert off(view, camera, Fidelity(occlusion="none")) > 0.05
    assert off(view, camera, Fidelity(hidden_surfaces=False)) > 0.05


def test_a_white_scene_is_white_through_sub_apertures(camera: Camera):
    photo = capture(picture(camera, depths("disc")), camera, Fidelity(sub_apertures=3), exposure=1.0)
    assert photo.how.sub_apertures == 3
    assert float((photo.clean - 1).abs().max()) < 0.01


def test_what_is_even_goes_on_evenly_behind_two_fronts(clear: Camera):
    """A disc before a larger one before a wall, each of one colour and depth: behind each lies the next, as
    wide as the two blurs that meet at the edge (radii by geometric optics), and nothing else."""
    y, x = grid()
    radius = np.hypot(y, x)
    light = np.where(radius < 12, 0.9, np.where(radius < 28, 0.5, 0.2))
    view = picture(clear, depths("nested"), light)
    found = with_guessed(view, clear)
    hidden = found.hidden
    assert int(hidden.sum()) == guessed_fragments(found) > 0
    assert torch.equal(found.radiance[:, ~hidden], view.radiance)
    behind = found.pixel[hidden]
    r, depth = torch.as_tensor(radius).flatten()[behind], found.inverse_depth[hidden].double()
    colour = found.radiance[:, hidden].double()
    # distance to the disc's border, at most, of what must be filled: both blurs' radii
    per_dioptre = clear.aperture_radius * clear.sensor_distance / clear.pixel
    focus = 1 / clear.recipe.focus.distance_m
    for edge, near, far, shade in ((12, NEAR, MIDDLE, 0.5), (28, MIDDLE, FAR, 0.2)):
        wide = per_dioptre * (abs(near - focus) + abs(far - focus))
        there = (r < edge) & (depth - far).abs().lt(1e-6)
        wanted = (radius < edge) & (radius > edge - wide)
        filled = torch.zeros(radius.size, dtype=torch.bool)
        filled[behind[there]] = True
        assert bool(filled[torch.as_tensor(wanted).flatten()].all())
        assert bool(((colour[:, there] - shade).abs() < 2e-3).all())
    known = (depth - MIDDLE).abs().lt(1e-6) | (depth - FAR).abs().lt(1e-6)
    assert bool(known.all())


def layered(camera: Camera) -> tuple[View, View]:
    """A grey disc before a bright one before a dark wall: as a picture, and with all that is behind."""
    y, x = grid()
    discs = [np.hypot(y, x) < 12, np.hypot(y, x) < 28, np.ones(y.shape, bool)]
    fragments = [
        (pixel, depth, shade, hides)
        for k, (disc, depth, shade) in enumerate(
            zip(discs, (NEAR, MIDDLE, FAR), (0.4, 0.9, 0.1), strict=True)
        )
        for pixel in np.flatnonzero(disc)
        for hides in [any(before.flat[pixel] for before in discs[:k])]
    ]
    fragments.sort(key=lambda each: (each[0], -each[1]))
    pixel, depth, shade, hides = (torch.tensor(each) for each in zip(*fragments, strict=True))
    light = np.where(discs[0], 0.4, np.where(discs[1], 0.9, 0.1))
    seen = picture(camera, depths("nested"), light)
    whole = replace(
        seen,
        pixel=pixel,
        coverage=torch.ones(len(pixel)),
        inverse_depth=depth.float(),
        radiance=shade.float().expand(3, -1).clone(),
        hidden=hides,
    )
    return seen, whole


def test_a_photo_is_that_of_the_whole_scene_where_what_is_hidden_is_even(camera: Camera):
    seen, whole = layered(camera)
    truth = capture(whole, camera, exposure=1.0)
    photo = capture(seen, camera, exposure=1.0)
    assert truth.how.hidden_surfaces == "rendered" and truth.how.guessed_fragments == 0
    assert photo.how.hidden_surfaces == "guessed"
    error = float((photo.clean - truth.clean).square().mean().sqrt())
    for way in ("none", "over", "normalised"):
        other = capture(seen, camera, Fidelity(occlusion=way), exposure=1.0)
        assert other.how.hidden_surfaces == "not used"
        assert error < 0.3 * float((other.clean - truth.clean).square().mean().sqrt())


def without_depth(view: View, camera: Camera) -> View:
    found = with_guessed(view, camera)
    return replace(found, inverse_depth=torch.where(found.hidden, FAR, found.inverse_depth))


def too_narrow(view: View, camera: Camera) -> View:
    with pytest.MonkeyPatch.context() as patched:
        whole = guessed.edges_of

        def narrow(seen: View, by: Camera) -> guessed.Edges:
            found = whole(seen, by)
            return replace(found, width=found.width.clamp_max(2))

        patched.setattr(guessed, "edges_of", narrow)
        return with_guessed(view, camera)


@pytest.mark.parametrize("mutant", [without_depth, too_narrow])
def test_that_would_be_seen_if_the_guess_were_wrong(clear: Camera, mutant):
    """The test above tells a fill at the wrong depth, and one that is too narrow, from the right one."""
    seen, whole = layered(clear)
    truth = capture(whole, clear, exposure=1.0).clean

    def error(view: View) -> float:
        return float((capture(view, clear, exposure=1.0).clean - truth).square().mean().sqrt())

    assert error(mutant(seen, clear)) > 3 * error(seen)


@pytest.mark.parametrize("shape", ["nested", "three side by side"])
def test_a_surface_is_guessed_once_behind_a_front(clear: Camera, shape: str):
    """Of several levels each finds what is far: behind the front it stands once, and farther than that."""
    y, x = grid()
    disc = np.where(y**2 + x**2 < 20**2, NEAR, np.where(x < 0, FAR, MIDDLE))
    found = with_guessed(picture(clear, depths(shape) if shape == "nested" else disc), clear)
    gap = 1 / blur_per_dioptre(clear)
    order = torch.argsort(found.inverse_depth, descending=True, stable=True)
    order = order[torch.argsort(found.pixel[order], stable=True)]
    pixel, depth = found.pixel[order], found.inverse_depth[order]
    same = pixel[1:] == pixel[:-1]
    assert int(same.sum()) > 100
    assert float((depth[:-1] - depth[1:])[same].min()) > 0.99 * gap


def test_gradients_reach_the_light_that_a_guess_is_made_of(clear: Camera):
    """Against finite differences, in float64: the photo is linear in light."""
    y, x = grid()
    light = 0.5 + 0.3 * np.sin(0.3 * x) * np.cos(0.2 * y)
    view = picture(clear, depths("disc"), light)
    view = replace(view, radiance=view.radiance.double(), coverage=view.coverage.double())
    weight = torch.randn(3, SIDE, SIDE, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    way = torch.randn(view.radiance.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)

    def seen(radiance: Tensor) -> Tensor:
        photo = capture(replace(view, radiance=radiance), clear, exposure=1.0, dtype=torch.float64)
        return (photo.clean * weight).sum()

    radiance = view.radiance.clone().requires_grad_()
    seen(radiance).backward()
    assert radiance.grad is not None
    step = 1e-3
    slope = (seen(view.radiance + step * way) - seen(view.radiance - step * way)) / (2 * step)
    assert float((radiance.grad * way).sum()) == pytest.approx(float(slope), rel=1e-6)


def test_a_guess_is_the_same_each_time_and_only_where_nothing_is_known(clear: Camera):
    seen, whole = layered(clear)
    one, other = with_guessed(seen, clear), with_guessed(seen, clear)
    assert torch.equal(one.radiance, other.radiance) and torch.equal(one.pixel, other.pixel)
    few = Fidelity(layers=3, band_groups=1, group_wavelengths=1)
    photo, known = capture(seen, clear, few), capture(one, clear, few)
    assert torch.equal(photo.image, known.image) and photo.how == known.how
    assert with_guessed(whole, clear) is whole
    looked = replace(seen, metadata={"hidden": "none: no depth edge"})
    assert with_guessed(looked, clear) is looked


def test_a_slanted_plane_has_no_edge(camera: Camera):
    assert guessed_fragments(with_guessed(picture(camera, depths("slanted")), camera)) == 0


def test_background_is_behind_what_stands_before_it(clear: Camera):
    """`inf` in a depth map is background: inverse depth 0 behind the disc; holes are filled from around."""
    y, x = grid()
    metres = np.where(np.hypot(y, x) < 20, 0.6, np.inf)
    metres[:4, :4] = np.nan
    view = View.from_image(np.ones((*metres.shape, 3)), metres, pixel_angle=clear.pixel_angle, margin=0)
    found = with_guessed(view, clear)
    assert guessed_fragments(found) > 0
    assert bool((found.inverse_depth[found.hidden] == 0).all())


def test_plans_and_photos_by_hand_treat_edges_alike(clear: Camera):
    view = picture(clear, depths("disc"))
    for photo in (photograph(view, clear), photograph(view, clear, accuracy="full")):
        assert photo.how.occlusion == "hidden" and photo.how.hidden_surfaces == "guessed"
        assert float((photo.clean / photo.exposure - 1).abs().max()) < 0.01
    plan = edofsim.plan_for(view, clear)
    (row,) = [each for each in plan.decisions if each.effect == "hidden surfaces"]
    assert "not known" in row.why and "guessed" in row.why


def test_sub_apertures_are_simulated_or_refused(clear: Camera):
    view = picture(clear, depths("disc"))
    for fidelity in (
        Fidelity(sub_apertures=3, occlusion="normalised"),
        Fidelity(sub_apertures=3, hidden_surfaces=False),
    ):
        with pytest.raises(InputError, match="sub_apertures = 3"):
            photograph(view, clear, fidelity)
    assert photograph(view, clear, Fidelity(sub_apertures=3)).how.sub_apertures == 3


def test_push_pull_keeps_what_is_known_and_stays_within_it():
    generator = torch.Generator().manual_seed(0)
    light = torch.rand(2, 13, 18, generator=generator)
    known = (torch.rand(13, 18, generator=generator) > 0.6).float()
    found = push_pull(light * known, known)
    assert torch.equal((found * known), light * known)
    assert float(found.min()) >= float((light + 1 - known).min()) - 1e-6
    assert float(found.max()) <= float((light * known).max()) + 1e-6
    assert torch.allclose(push_pull(known[None] * 0.7, known), torch.tensor(0.7))


def test_mixtures_of_three_spectra_are_filled_as_every_band_is(clear: Camera):
    """A picture's light in its three spectra; each band by itself where gradients are wanted."""
    y, x = grid()
    image = np.stack([0.5 + 0.4 * np.sin(k * x / 9 + y / 7) for k in (1, 2, 3)], -1)
    view = View.from_image(image, 1 / depths("nested"), pixel_angle=clear.pixel_angle, margin=0)
    few = with_guessed(view, clear).radiance
    every = with_guessed(replace(view, radiance=view.radiance.clone().requires_grad_()), clear).radiance
    assert guessed._spectra(view.radiance) is not None and every.requires_grad
    assert float((few - every).abs().max()) < 1e-5 * float(every.max())
