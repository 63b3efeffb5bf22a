"""Accuracy in terms of the restored image: what is predicted from tiles, against whole photos."""

from __future__ import annotations

import pytest
import torch

from edofsim.capture import capture
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.plan import Restore, Target, parse_target, planner_of
from edofsim.plan.photo import Planner
from edofsim.plan.restored import RestoredTiles
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings, Sensor
from edofsim.render.view import View
from edofsim.restore.choice import restoring
from edofsim.restore.scores import psnr, within_scale

CAMERA = Camera.from_recipe(
    CameraRecipe(
        name="test",
        lens=PlanoConvexLens(aperture_radius_mm=1.0),
        psf=PsfSettings(window_px=32),
        sensor=Sensor(read_noise=0.005),
    )
)
BANDS, MARGIN = torch.linspace(420e-9, 720e-9, 7, dtype=torch.float64), 16
STEP = torch.where(torch.arange(80) < 40, 2.0, 0.0).expand(72, 80)
SLANTED = torch.linspace(0.0, 2.0, 80).expand(72, 80)


def left(photo: torch.Tensor, truncated: torch.Tensor) -> torch.Tensor:
    """A restoration that restores nothing."""
    return photo


def pictured(depth: torch.Tensor) -> View:
    """Light with detail of many sizes, as pictures have, at inverse depths [y, x]."""
    draw = torch.Generator().manual_seed(2)
    rows, columns = depth.shape
    parts = [torch.rand(1, len(BANDS), rows // k + 1, columns // k + 1, generator=draw) for k in (2, 8, 32)]
    grown = [torch.nn.functional.interpolate(each, (rows, columns), mode="bilinear")[0] for each in parts]
    light = 0.2 + sum(grown, torch.zeros(()))
    return View.flat(light, depth, wavelengths=BANDS, pixel_angle=CAMERA.pixel_angle, margin=MARGIN)


def whole(view: View, known: Planner, restore: Restore, change: dict[str, object]) -> float:
    """The shift of the score in whole photos."""
    full = known.facts.full
    scores = []
    for fidelity in (full.changed(change), full):
        photo = capture(view, CAMERA, fidelity)
        scores.append(psnr(within_scale(restore(photo.image, photo.truncated)), within_scale(photo.ideal)))
    return scores[0] - scores[1]


@pytest.mark.parametrize(
    ("depth", "effect"), [(SLANTED, "PSF window"), (SLANTED, "depth layers"), (STEP, "occlusion")]
)
@pytest.mark.parametrize("way", ["left as it is", "Wiener"])
def test_a_shift_of_the_score_is_what_whole_photos_show(depth: torch.Tensor, effect: str, way: str):
    """Of PSFs and of coarse photos, in light that is blurred to something else: against the difference of two
    scores that no tile has part in. The same sign, and the size to within a factor of 1.6."""
    view = pictured(depth)
    wiener = restoring(CAMERA, view.wavelengths, view.inverse_depth, None)
    restore: Restore = left if way == "left as it is" else wiener
    known = planner_of(view, CAMERA, restore=restore)
    rows = known.estimates.by_name()
    chosen = {name: row.full for name, row in rows.items()} | {effect: 0}
    predicted = RestoredTiles(known.facts, known.estimates, restore).shift_db(chosen)
    measured = whole(view, known, restore, dict(rows[effect].levels[0].change))
    assert abs(measured) > 0.02
    assert predicted == pytest.approx(measured, rel=0.6, abs=0.02)


@pytest.mark.parametrize("asked", [0.05, 0.5])
def test_the_score_that_is_promised_is_met(asked: float):
    view = pictured(SLANTED)
    restore = restoring(CAMERA, view.wavelengths, view.inverse_depth, None)
    known = planner_of(view, CAMERA, restore=restore)
    plan = known.plan(Target("score", db=asked))
    assert plan.fidelity != known.facts.full and plan.saves() > 0
    assert plan.score_shift_db is not None and abs(plan.score_shift_db) <= asked
    assert abs(whole(view, known, restore, vars(plan.fidelity))) <= asked
    assert f"{asked:g} dB" in plan.target and "restored" in plan.summary()


def test_a_score_that_the_user_stands_in_the_way_of_is_answered_with_why():
    view = pictured(SLANTED)
    known = planner_of(view, CAMERA, restore=left)
    plan = known.plan(Target("score", db=1e-3), {"PSF window": 0})
    assert "cannot be had" in plan.note and abs(plan.score_shift_db or 0) > 1e-3


def test_a_score_asks_for_what_restores():
    view = pictured(SLANTED)
    with pytest.raises(InputError, match="nothing is known here that restores"):
        planner_of(view, CAMERA).plan(parse_target("score:0.1dB", None))
