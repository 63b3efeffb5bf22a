"""Views counted for the work of their photos, against counts one fragment after another."""

from __future__ import annotations

from bisect import bisect_left

import torch

from edofsim.optics import Camera
from edofsim.plan.facts import facts_of
from edofsim.recipe.camera import CameraRecipe
from edofsim.render.view import View

CAMERA = Camera.from_recipe(CameraRecipe(name="c", psf={"window_px": 16}))


def test_slabs_span_the_fragments_that_they_hold():
    depth = torch.full((60, 70), 0.2)
    depth[20:33, 41:48] = 2.0  # two things in front of a wall
    depth[45:51, 9:30] = 1.2
    view = View.flat(
        torch.rand(3, 60, 70, generator=torch.Generator().manual_seed(1)),
        depth,
        wavelengths=torch.linspace(450e-9, 650e-9, 3),
        pixel_angle=CAMERA.pixel_angle,
        margin=6,
    )
    facts = facts_of(view, CAMERA)
    seen, shape, cuts = facts.view, facts.shape, sorted(facts.cuts)
    assert len(cuts) >= 1 and shape.slabs is not None and not shape.in_tiles
    places: dict[int, list[tuple[int, int]]] = {}
    for pixel, inverse_depth in zip(seen.pixel.tolist(), seen.inverse_depth.tolist(), strict=True):
        places.setdefault(bisect_left(cuts, inverse_depth), []).append(divmod(pixel, 70))
    spans = [
        [max(axis) - min(axis) + 1 for axis in zip(*places[slab], strict=True)] for slab in sorted(places)
    ]
    assert shape.slabs.extent.tolist() == spans and len(spans) > 1
    assert shape.slabs.around.tolist() == [len(seen.pixel)] * len(spans)
