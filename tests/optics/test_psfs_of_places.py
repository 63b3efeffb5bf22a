"""PSFs of places in the field that come from those of others."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from edofsim.optics import Camera, psf_bank
from edofsim.optics import cache as bank_cache
from edofsim.optics import psf as psf_module
from edofsim.optics.lenses.prescription import PrescriptionLens
from edofsim.optics.pupil import mask_delay
from edofsim.recipe.load import load_camera

ASIDE, LESS = 0.03, 0.012
PLACES = [(x, y) for a, b in ((ASIDE, LESS), (LESS, ASIDE)) for x in (a, -a) for y in (b, -b)]
PLACES += [(0.0, -ASIDE), (-ASIDE, 0.0), (0.0, 0.0)]
WAVELENGTH = torch.tensor([540e-9], dtype=torch.float64)
DEPTHS = torch.tensor([0.0, 0.5, 1.5], dtype=torch.float64)


@pytest.fixture(scope="module")
def doublet() -> Camera:
    return Camera.from_recipe(load_camera("doublet-25mm-f6").recipe)


def by_itself(camera: Camera, window: int, monkeypatch: pytest.MonkeyPatch) -> Tensor:
    """By the wave of its own place, on one grid of the pupil for all depths."""
    with monkeypatch.context() as alone:
        alone.setattr(psf_module, "_from_others", lambda *given: None)
        bank_cache.forget()
        return psf_bank(camera, WAVELENGTH, DEPTHS, window_px=window).values


@pytest.mark.parametrize("window", [32, 33])
def test_psfs_of_a_round_lens_are_those_of_one_place_turned(
    doublet: Camera, window: int, monkeypatch: pytest.MonkeyPatch
):
    for place in PLACES:
        seen_by = doublet.seen_at(place)
        own = by_itself(seen_by, window, monkeypatch)
        turned = psf_bank(seen_by, WAVELENGTH, DEPTHS, window_px=window).values
        assert turned.shape == own.shape
        assert float((turned - own).norm() / own.norm()) < 3e-4, place


def test_places_as_far_from_the_axis_share_their_work(doublet: Camera, monkeypatch: pytest.MonkeyPatch):
    seen = []
    whole = psf_module.aperture
    monkeypatch.setattr(psf_module, "aperture", lambda *given: seen.append(given) or whole(*given))
    bank_cache.forget()
    for place in PLACES[:8]:
        psf_bank(doublet.seen_at(place), WAVELENGTH, DEPTHS[1:2], window_px=32)
    assert len(seen) == 1


def test_psfs_behind_a_mask_are_computed_place_by_place(monkeypatch: pytest.MonkeyPatch):
    recipe = load_camera("doublet-25mm-f6").recipe
    masked = recipe.model_validate(recipe.model_dump() | {"mask": {"kind": "cubic", "alpha_rad": 20}})
    camera = Camera.from_recipe(masked)
    for place in ((ASIDE, LESS), (-LESS, ASIDE)):
        seen_by = camera.seen_at(place)
        own = by_itself(seen_by, 32, monkeypatch)
        again = psf_bank(seen_by, WAVELENGTH, DEPTHS, window_px=32).values
        assert float((again - own).norm() / own.norm()) < 2e-3


def test_a_mask_in_the_stop_counts_more_at_an_angle():
    """By Snell's law."""
    recipe = load_camera("doublet-25mm-f6").recipe
    front = {**recipe.lens.model_dump(exclude_unset=True), "f_number": 10.0}
    plain = [{**each, "stop": False} for each in front["surfaces"]]
    front["surfaces"] = [{"stop": True}, *plain]
    keys = {"lens": front, "mask": {"kind": "cubic", "alpha_rad": 20}}
    camera = Camera.from_recipe(recipe.model_validate(recipe.model_dump() | keys))
    n = float(camera.mask_material.index(540e-9))
    assert mask_delay(camera, 540e-9) == 2 * math.pi / 540e-9 * (n - 1)
    for degrees in (5.0, 20.0):
        angle = math.radians(degrees)
        within = math.asin(math.sin(angle) / n)
        expected = 2 * math.pi / 540e-9 * (n * math.cos(within) - math.cos(angle))
        seen = camera.at_field((0.0, -math.tan(angle)))
        assert mask_delay(seen, 540e-9) == pytest.approx(expected, rel=1e-9)
    # near the axis within a lens, by Lagrange's invariant: as much steeper as the entrance pupil is larger
    gauss = Camera.from_recipe(load_camera("double-gauss-50mm-f4").recipe).lens
    assert isinstance(gauss, PrescriptionLens)
    larger = gauss.held().first.opening
    assert larger > 1.3
    assert gauss.slant((0.0, 0.01)) == pytest.approx(0.01 * larger, rel=2e-3)
