"""The two references on scenes of screens: rays, the edges of shadows, and each other."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from edofsim.errors import InputError
from edofsim.reference import clipped_pupil, clipped_pupils, thin_lens
from edofsim.reference.pinhole import Crop, pixel_directions
from edofsim.reference.visibility import pupil_points, visible
from edofsim.render.engine import use_engine
from edofsim.render.translate import build_stage

SIZE, WINDOW = 16, 56
MARGIN = WINDOW // 2
RADIUS_MM = 1.0


def two_screens(screens, camera):
    return screens.two(camera.pixel_angle, SIZE, MARGIN)


def psnr(image, truth) -> float:
    return -10 * torch.log10((image - truth).square().mean()).item()


def test_rays_say_which_part_of_the_pupil_sees_a_point(screens):
    """By similar triangles: a point at 0.8 m, d to the right of the edge of a screen at 0.4 m as the pinhole
    sees it, is seen from the pupil points with s > -d / (1 - 0.4 / 0.8)."""
    camera = screens.camera(2.0, WINDOW, radius_mm=RADIUS_MM)
    model, view = two_screens(screens, camera)
    mi = use_engine("auto")
    scene = build_stage(mi, model).scene
    points = pupil_points(64, 2e-3)
    side = SIZE + 2 * MARGIN
    columns = np.array([1, 3, 6]) + side // 2
    pixel = side // 2 * side + columns
    seen, nearer = visible(
        mi,
        scene,
        pixel_directions(view, Crop(0, 0, SIZE, SIZE), MARGIN, pixel),
        np.full(3, 1 / 0.8),
        points,
    )
    for k, column in enumerate(columns):
        edge = -(column + 0.5 - side / 2) * view.pixel_angle * 0.4 / 0.5
        expected = points[0, :, 0] > edge
        assert (seen[k] == expected[None, :]).mean() > 0.98
        blocked = (~seen[k]).sum()
        assert nearer[k] == pytest.approx(blocked * (1 / 0.4 - 1 / 0.8), rel=1e-3)


def test_the_references_agree_for_a_clear_aperture_at_large_defocus(screens):
    """Rays through Mitsuba's thin lens against waves through clipped pupils: 40 dB at an occluding edge where
    both surfaces are blurred, over 25 and 9 pixels.

    The edge bends light over (wavelength / difference of inverse depth)^(1/2) = 0.7 mm of the pupil; it has
    to be wide for rays to be true. Its PSFs have rings of 4 um, which have to be resolved within pixels.
    """
    camera = screens.camera(2.0, WINDOW, radius_mm=2.5, angle=4e-4, oversampling=4)
    model, view = two_screens(screens, camera)
    where = Crop(0, 0, SIZE, SIZE)
    waves = clipped_pupil(view, model, camera, where, window_px=WINDOW, rays=32)[0]
    rays = thin_lens(
        model,
        view,
        where,
        aperture_radius=camera.aperture_radius,
        focus_distances=[2.0],
        samples=4096,
        max_depth=1,
    )[0]
    assert psnr(waves, rays) > 40
    flat = view.crop_margin(view.all_in_focus())[0]
    assert psnr(flat, rays) < 25  # the blur is what is compared


def test_several_cameras_at_once_are_as_one_by_one(screens):
    cameras = [screens.camera(focus, WINDOW, radius_mm=RADIUS_MM, angle=1.6e-4) for focus in (0.5, 2.0)]
    model, view = two_screens(screens, cameras[0])
    where = Crop(8, 8, 4, 4)
    settings = dict(window_px=12, rays=24)
    together = clipped_pupils(view, model, cameras, where, **settings)
    for camera, image in zip(cameras, together, strict=True):
        alone = clipped_pupil(view, model, camera, where, **settings)
        assert (image - alone).abs().max() < 1e-3


def test_bad_input_is_refused(screens):
    camera = screens.camera(2.0, WINDOW, radius_mm=RADIUS_MM)
    model, view = two_screens(screens, camera)
    with pytest.raises(InputError, match="X,Y,WIDTH,HEIGHT"):
        clipped_pupil(view, model, camera, Crop(10, 0, SIZE, 4))
    wider = screens.camera(2.0, WINDOW, radius_mm=2.0)
    with pytest.raises(InputError, match="one by one"):
        clipped_pupils(view, model, [camera, wider], Crop(0, 0, 4, 4))
    with pytest.raises(InputError, match="mrad"):
        clipped_pupil(view, model, screens.camera(2.0, WINDOW, angle=3e-4), Crop(0, 0, 4, 4))
    with pytest.raises(InputError, match="one a band"):
        thin_lens(model, view, Crop(0, 0, 4, 4), aperture_radius=1e-3, focus_distances=[1.0, 2.0])
    with pytest.raises(InputError, match="above 0"):
        thin_lens(model, view, Crop(0, 0, 4, 4), aperture_radius=1e-3, focus_distances=[-1.0])
