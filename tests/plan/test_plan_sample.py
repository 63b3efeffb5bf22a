"""The sample that effects are measured on."""

from __future__ import annotations

import torch

from edofsim.capture.fidelity import full_fidelity
from edofsim.optics import Camera
from edofsim.plan.sample import sample_of
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings
from edofsim.render.view import View

CAMERA = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=48)))


def test_tiles_of_other_depths_share_the_groups_of_bands():
    """Each more group of bands is nearer to every band on its own, though the parts of the frame that stand
    for all of it lie at other distances."""
    height, width, margin, bands = 384, 576, 24, 12
    rows, columns = height + 2 * margin, width + 2 * margin
    depth = torch.full((rows, columns), 0.3)
    depth[:, columns // 2 :] = 2.0
    view = View.flat(
        torch.rand(bands, rows, columns, generator=torch.Generator().manual_seed(0)),
        depth,
        wavelengths=torch.linspace(420e-9, 720e-9, bands),
        pixel_angle=CAMERA.pixel_angle,
        margin=margin,
    )
    sample = sample_of(view, CAMERA)
    assert len({float(tile.inverse_depth.mean()) for tile in sample.tiles}) > 1
    full = full_fidelity(CAMERA, view).changed({"occlusion": "none", "window_px": 48})
    every = sample.photo(full.changed({"band_groups": 0, "group_wavelengths": 0}))
    errors = [
        float(
            (sample.photo(full.changed({"band_groups": groups, "group_wavelengths": 0})) - every)
            .square()
            .sum()
        )
        for groups in (1, 2, 4, 8, bands)
    ]
    assert all(more < 0.8 * fewer for fewer, more in zip(errors, errors[1:], strict=False))
    assert errors[-1] < 1e-9
