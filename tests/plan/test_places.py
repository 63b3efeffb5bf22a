"""What a plan takes photos to lose that have the PSFs and the light of the axis all over the frame."""

from __future__ import annotations

import pytest
import torch

from edofsim.capture import Fidelity, capture
from edofsim.capture.field import Part, image_over_field
from edofsim.optics import Camera
from edofsim.optics.field import Frame
from edofsim.plan import decibels, facts_of, overall
from edofsim.plan.work import _over_field
from edofsim.recipe import CameraRecipe
from edofsim.recipe.load import load_camera
from edofsim.render.view import View

HEIGHT, WIDTH, MARGIN = 32, 48, 16
EXPOSURE = 0.8


def seen_through(name: str, focal_mm: float, pixel_um: float) -> tuple[Camera, View]:
    """A camera of that lens, scaled; squares of random light in its focus, and behind it on the right."""
    recipe = load_camera(name).recipe
    lens = {**recipe.lens.model_dump(exclude_unset=True), "focal_length_mm": focal_mm, "f_number": 8.0}
    sensor = recipe.sensor.model_copy(update={"pixel_um": pixel_um}).model_dump()
    keys = {"lens": lens, "sensor": sensor, "psf": {"window_px": 2 * MARGIN}}
    camera = Camera.from_recipe(CameraRecipe.model_validate(recipe.model_dump() | keys))
    rows, columns = HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN
    squares = torch.rand(3, rows // 4, columns // 4, generator=torch.Generator().manual_seed(1))
    depth = torch.full((rows, columns), 1 / recipe.focus.distance_m)
    depth[:, columns // 2 :] = 0.2
    how = {"wavelengths": torch.linspace(450e-9, 650e-9, 3), "pixel_angle": camera.pixel_angle}
    light = squares.repeat_interleave(4, 1).repeat_interleave(4, 2)
    return camera, View.flat(light, depth, margin=MARGIN, metadata={"hidden": "none"}, **how)


@pytest.mark.parametrize(
    ("name", "focal_mm", "pixel_um"),
    [
        ("doublet-25mm-f6", 25.0, 20.0),
        ("doublet-25mm-f6", 25.0, 60.0),
        pytest.param("double-gauss-50mm-f4", 50.0, 60.0, marks=pytest.mark.slow),
    ],
)
def test_the_axis_all_over_the_frame_errs_as_photos_do(name: str, focal_mm: float, pixel_um: float):
    """Mean square over the frame, of photos that blur each source by the PSFs of its own place."""
    camera, view = seen_through(name, focal_mm, pixel_um)
    whole = Fidelity(field_step_px=16, occlusion="none", layers=2, layers_db=70.0)
    both = (whole, whole.changed({"field_step_px": 0}))
    true, axis = (capture(view, camera, each, exposure=EXPOSURE).clean for each in both)
    truth = decibels(float((axis - true).double().square().mean().sqrt()))
    facts = facts_of(view, camera)
    estimate = decibels(overall(facts.without_places(0)) * EXPOSURE / facts.exposure)
    print(truth, estimate)
    assert 35 < truth < 75
    assert estimate == pytest.approx(truth, abs=3)


@pytest.mark.parametrize("step", [16, 24, 64])
def test_work_counts_the_places_that_photos_are_joined_from(step: int):
    """And the pixels that each of them blurs: seen in what a photo asks for."""
    camera, view = seen_through("doublet-25mm-f6", 25.0, 20.0)
    frame, asked = Frame.about(HEIGHT, WIDTH, camera), []

    def image(here: Camera, part: Part) -> torch.Tensor:
        some = part(view, MARGIN)
        asked.append((some.height + 2 * MARGIN) * (some.width + 2 * MARGIN))
        return torch.zeros(some.height, some.width)

    image_over_field(camera, frame, step, image)
    count, wider = _over_field(facts_of(view, camera).shape, 2 * MARGIN, step)
    assert count == len(asked)
    whole = (HEIGHT + 2 * MARGIN) * (WIDTH + 2 * MARGIN)
    assert wider == pytest.approx(max(1.0, sum(asked) / whole))
