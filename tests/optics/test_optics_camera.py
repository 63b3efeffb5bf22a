"""The paper's camera in numbers, and cameras that cannot be."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from pydantic import ValidationError

from edofsim.errors import InputError
from edofsim.optics import (
    PAPER_COLOURS,
    Camera,
    defocus,
    focal_length,
    focus_distance,
    psf_bank,
    sampling_bound,
)
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.load import load_camera


def camera(**recipe) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="test", **recipe))


def test_focal_length_and_sensor_distance_of_the_paper():
    paper = camera()
    # R / (n - 1) with Malitson's n = 1.45846 at 587.6 nm; then 1/f - 1/1.5 (Akpinar et al.: 36 and 36.9 mm)
    focal = 16.51e-3 / 0.45846
    assert float(focal_length(paper, 587.6e-9)) == pytest.approx(focal, rel=5e-5)
    assert paper.sensor_distance == pytest.approx(1 / (1 / focal - 1 / 1.5), rel=5e-5)
    assert paper.pixel_angle == pytest.approx(6e-6 / 36.9e-3, rel=1e-3)


def test_focus_distances_of_the_three_colours():
    # computed by hand with Malitson's silica; the paper rounds to 1.62, 1.30 and 1.04 m
    expected = torch.tensor([1.614, 1.294, 1.037], dtype=torch.float64)
    assert torch.allclose(focus_distance(camera(), PAPER_COLOURS), expected, rtol=5e-3)


def test_largest_defocus_and_sampling_bound_of_the_paper():
    psi = defocus(camera(), PAPER_COLOURS[:, None], torch.tensor([0.0, 2.0]))
    largest = float(psi.abs().max())
    assert largest == pytest.approx(44.4, abs=0.05)  # the paper rounds to 45
    assert sampling_bound(camera(), largest) == pytest.approx(22e-6, rel=0.01)  # it samples at 21 um
    assert float(defocus(camera(), 420e-9, 0.0)) == pytest.approx(-58.4, abs=0.1)


def test_defocus_is_negative_beyond_the_focus_and_linear_in_inverse_depth():
    paper = camera()
    focus = 1 / float(focus_distance(paper, 543e-9))
    psi = defocus(paper, 543e-9, torch.tensor([focus - 0.3, focus, focus + 0.3], dtype=torch.float64))
    assert float(psi[0]) < 0 < float(psi[2])
    assert float(psi[1]) == pytest.approx(0, abs=1e-9)
    assert float(psi[2]) == pytest.approx(math.pi / 543e-9 * 0.3 * 2.5e-3**2, rel=1e-9)


@pytest.mark.parametrize(
    ("recipe", "word"),
    [
        ({"lens": {"aperture_radius_mm": 0}}, "aperture_radius_mm"),
        ({"lens": {"aperture_radius_mm": -1}}, "aperture_radius_mm"),
        ({"sensor": {"pixel_um": 0}}, "pixel_um"),
        ({"focus": {"distance_m": -1.0}}, "distance_m"),
        ({"fabrication": {"levels": 1, "height_limit_um": 1.2}}, "at least 2 grey levels"),
        ({"fabrication": {"levels": 98}}, "height_limit_um or level_nm"),
        ({"fabrication": {"levels": 98, "height_limit_um": 0.01, "level_nm": 12.0}}, "below one grey level"),
        ({"fabrication": {"wrap_wavelength_nm": 543}}, "height_limit_um"),
        ({"mask": {"kind": "annular", "inner_radius": 1.5}}, "inner_radius"),
        ({"mask": {"kind": "annular", "inner_radius": 1.0}}, "inner_radius"),
        (
            {"mask": {"kind": "rings", "rings": [dict(inner_radius=0.5, outer_radius=1.2, phase_rad=3)]}},
            "outer_radius",
        ),
        ({"mask": {"kind": "coded", "pattern": ["010", "01"]}}, "equal length"),
        ({"mask": {"kind": "coded", "pattern": ["00", "00"]}}, "no light"),
        ({"mask": {"kind": "tangent", "beta_rad": 2.0}}, "beta_rad"),
        ({"psf": {"window_px": 0}}, "window_px"),
    ],
)
def test_recipes_that_no_camera_can_have_are_refused(recipe, word):
    with pytest.raises(ValidationError, match=word):
        CameraRecipe(name="impossible", **recipe)


@pytest.mark.parametrize(
    ("recipe", "words"),
    [
        ({"focus": {"distance_m": 0.03}}, ["focus.distance_m = 0.03", "36.01 mm"]),
        ({"lens": {"aperture_radius_mm": 17.0}}, ["aperture_radius_mm = 17", "16.51"]),
        ({"lens": {"material": "fused-silca"}}, ["lens.material", "did you mean 'fused-silica'"]),
        ({"lens": {"material": "air"}}, ["does not refract"]),
        ({"focus": {"wavelength_nm": 90.0}}, ["focus.wavelength_nm", "90 nm"]),
        ({"mask": {"kind": "cubic", "material": "jelly"}}, ["mask.material", "jelly"]),
        ({"mask": {"kind": "height-map", "pitch_um": 6000.0}}, ["pitch_um = 6000", "larger than the pupil"]),
    ],
)
def test_cameras_that_cannot_work_say_why(recipe, words):
    with pytest.raises(InputError) as refused:
        camera(**recipe)
    for word in words:
        assert word in str(refused.value)


def test_all_problems_are_named_at_once():
    with pytest.raises(InputError) as refused:
        camera(lens={"material": "butter"}, mask={"kind": "cubic", "material": "jelly"})
    assert len(refused.value.problems) == 2


def test_without_mask_keeps_lens_and_sensor():
    masked = camera(mask={"kind": "cubic"}, fabrication={"preset": "paper-training"})
    bare = masked.without_mask()
    assert bare.recipe.mask.kind == "clear" and bare.recipe.fabrication is None
    assert bare.sensor_distance == masked.sensor_distance and bare.recipe.lens == masked.recipe.lens


SHIPPED = sorted((Path(__file__).parents[2] / "scenes" / "cameras").glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=[path.stem for path in SHIPPED])
def test_shipped_cameras_work_and_the_papers_share_its_geometry(path):
    loaded = load_camera(path)
    assert loaded.recipe.name == path.stem and loaded.recipe.purpose
    seen = Camera.from_recipe(loaded.recipe, loaded.base)
    assert seen.pixel_angle == pytest.approx(camera().pixel_angle) or not path.stem.startswith("paper-")
    bank = psf_bank(seen, PAPER_COLOURS[1:2], [0.0], window_px=16)
    assert float(bank.values.sum() + bank.truncated) == pytest.approx(1, abs=1e-5)
