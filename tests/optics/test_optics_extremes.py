"""Cameras at the ends of what a number can be: PSFs, or one sentence."""

from __future__ import annotations

import pytest

from edofsim.errors import InputError
from edofsim.optics import Camera, psf_bank
from edofsim.recipe.camera import CameraRecipe


@pytest.mark.parametrize(
    "change, complaint",
    [
        ({"fabrication": {"pitch_um": 1e30}, "mask": {"kind": "cubic"}}, "fabrication.pitch_um = 1e.30"),
        ({"fabrication": {"pitch_um": 1e-30}, "mask": {"kind": "cubic"}}, "fabrication.pitch_um = 1e-30"),
        ({"fabrication": {"pitch_um": 2**70}, "mask": {"kind": "cubic"}}, "to 5000 um"),
        ({"mask": {"kind": "gaussian", "waist": 1e-6}}, "lets no light through"),
        ({"sensor": {"pixel_um": 1e30}}, r"need 3\.19\d*e\+31 samples"),
    ],
)
def test_cameras_that_cannot_be(change: dict, complaint: str):
    camera = Camera.from_recipe(CameraRecipe.model_validate({"name": "a", **change}))
    with pytest.raises(InputError, match=complaint):
        psf_bank(camera, [543e-9], [1.0])


@pytest.mark.parametrize("radius", [1e-30, 1e-6])
def test_a_hole_too_small_for_an_image_lets_its_light_past_the_window(radius: float):
    recipe = CameraRecipe.model_validate({"name": "a", "lens": {"aperture_radius_mm": radius}})
    bank = psf_bank(Camera.from_recipe(recipe), [543e-9], [1.0])
    assert float(bank.truncated) > 0.99
