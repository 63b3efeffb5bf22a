"""A depth edge far off the axis: photos through a lens that varies over the field, against clipped pupils."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture import Fidelity, capture
from edofsim.capture import field as captured
from edofsim.experiments import occlusion, occlusion_cameras
from edofsim.experiments.occlusion_cameras import Edge
from edofsim.optics.field import Frame, relative_light
from edofsim.reference import clipped_pupils
from edofsim.reference.pinhole import Crop

sys.path.insert(0, str(Path(__file__).parents[1] / "example_package"))
from edofsim_example.off_axis_lens import OffAxisLens

ANGLE = 1.626e-4
WINDOW = 32
AXIS = (-900.0, 1300.0)


def test_a_depth_edge_in_a_corner_against_clipped_pupils(screens, monkeypatch: pytest.MonkeyPatch):
    """With the coma and the cat's eye of its place; by the PSFs of other places, photo and truth are apart.
    Light that leaves the windows of PSFs is in neither."""
    module = sys.modules[capture.__module__]
    glare_of = module.glare_of
    monkeypatch.setattr(module, "glare_of", lambda *of: tuple(0 * each for each in glare_of(*of)))
    model, view = screens.two(ANGLE, 32, WINDOW // 2)
    view = replace(view, axis=AXIS)
    edge = Edge(Crop(10, 8, 8, 16), 2.5, 1.25)
    behind = occlusion_cameras.focus_distances(edge)["behind"]
    plain = occlusion_cameras.camera_with("clear", behind, ANGLE, WINDOW, aperture_mm=1.2)
    focal = float(plain.lens.focal_length(587.6e-9))
    lens = {"focal_length_mm": focal * 1e3, "f_number": focal / (2 * plain.aperture_radius)}
    camera = replace(plain, lens=OffAxisLens(kind="off-axis", coma=4.0, shadow=2.0, **lens))
    frame = Frame(view.height, view.width, AXIS, view.pixel_angle)
    here = camera.at_field(frame.field(edge.where.top + 4, edge.where.left + 8))
    truth = clipped_pupils(view, model, [here], edge.where, rays=32)[0] * relative_light(here)
    inside = (
        slice(None),
        slice(edge.where.top, edge.where.top + edge.where.height),
        slice(edge.where.left, edge.where.left + edge.where.width),
    )
    fidelity = Fidelity(field_step_px=64, sub_apertures=4)
    axes = {"field": AXIS, "axis": None, "upside down": (-AXIS[0], AXIS[1])}
    found = {
        name: capture(replace(view, axis=axis), camera, fidelity, exposure=1.0).clean[inside]
        for name, axis in axes.items()
    }
    scores = {name: occlusion.psnr(torch.as_tensor(photo), truth) for name, photo in found.items()}
    print(scores)
    assert scores["field"] > 30
    assert scores["field"] > max(scores["axis"], scores["upside down"]) + 3
    # sub-apertures of places 128 pixels apart change the photo as those of places as close as the PSFs' do
    coarse = found["field"]
    monkeypatch.setattr(captured, "CHANGE_STEP_PX", 1)
    fine = capture(replace(view, axis=AXIS), camera, fidelity, exposure=1.0).clean[inside]
    without = replace(fidelity, sub_apertures=1)
    none = capture(replace(view, axis=AXIS), camera, without, exposure=1.0).clean[inside]
    apart = {name: occlusion.psnr(each, fine) for name, each in (("coarse", coarse), ("none", none))}
    assert apart["coarse"] > 60 and apart["coarse"] > apart["none"] + 10
