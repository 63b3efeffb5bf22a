"""Masks in the stop of a lens of surfaces, against the same relief as a surface of glass that is traced."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from edofsim.errors import InputError
from edofsim.optics import Camera, cache, psf_bank
from edofsim.optics.field import Frame, step_for
from edofsim.optics.grid import NO_WRAPS, PupilGrid, sampled_at
from edofsim.optics.lenses.prescription import PrescriptionLens, _held, _wave
from edofsim.optics.mask_surface import MaskSurface
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.materials import material
from edofsim.optics.prescription.outline import delay, in_stop, opening
from edofsim.optics.pupil import StrongMask, aperture, refuse_strong
from edofsim.recipe import CameraRecipe
from edofsim.recipe.load import load_camera

GREEN = 543e-9
INDEX = 4.9  # so that a relief is low
AIR, GLASS = {"thickness_mm": 0.0}, {"nd": INDEX, "vd": 1e6}  # glass of one index
DOUBLET = (
    {"radius_mm": 33.3, "thickness_mm": 9.0, "glass": "N-BAF10"},
    {"radius_mm": -22.28, "thickness_mm": 2.5, "glass": "N-SF10"},
    {"radius_mm": -291.07},
)
THIN = 1e-3


def lens_of(*front: dict) -> PrescriptionLens:
    return PrescriptionLens(
        kind="prescription",
        surfaces=(*front, *DOUBLET),
        f_number=6.0,
        traced_at_m=4.0,
        traced_at_nm=GREEN * 1e9,
    )


def with_plate(bulge_mm: float) -> PrescriptionLens:
    """A plate before the lens, the stop, whose glass is thicker by a (r / 4 mm)^4."""
    plate = {"stop": True, "thickness_mm": THIN, **GLASS}
    return lens_of(plate, {**AIR, "aspheres_mm": (0.0, bulge_mm / 4**4)})


def relief_of(lens: PrescriptionLens, bulge_mm: float) -> MaskSurface:
    radius = lens.aperture_radius
    grid = PupilGrid(258, 2 * radius / 256, radius)
    scale = _held(lens).lens.stop_radius / 4  # places in the stop, over 4 mm
    height = 1e-3 * bulge_mm * (grid.radius_squared() / radius**2 * scale**2).square()
    return MaskSurface(grid, height, NO_WRAPS, INDEX)


def missed(bulge_mm: float, tangent: float) -> tuple[float, float]:
    """By rays through the plate as a surface, and as measured, waves."""
    bare, made = with_plate(0.0), with_plate(bulge_mm)
    waves = [_wave(lens, tangent, GREEN) for lens in (bare, made)]
    axis = torch.linspace(-1, 1, 161, dtype=torch.float64) * waves[0].half
    s, t = axis[None, :], axis[:, None] + waves[0].middle
    inside = opening(waves[1], s, t, math.pi / 2) > 0.5
    surface = relief_of(bare, bulge_mm)
    sine = bare.slant((0.0, tangent))
    added = surface.at(*in_stop(waves[0], s, t, math.pi / 2))[0] * 1e3
    added = added * float(surface.lifted(sine**2))
    off = (delay(waves[1], s, t, math.pi / 2) - delay(waves[0], s, t, math.pi / 2) - added)[inside]
    exact = float((off - off.mean()).square().mean().sqrt()) * 1e-3 / GREEN
    return exact, bare.misplaced(surface, GREEN, (0.6 * tangent, 0.8 * tangent))


@pytest.mark.parametrize("tangent", [0.0, 0.15, 0.3])
@pytest.mark.parametrize("bulge_mm", [0.0013, 0.004])
def test_what_is_missed_is_what_rays_through_the_relief_say(bulge_mm: float, tangent: float) -> None:
    exact, measured = missed(bulge_mm, tangent)
    print(exact, measured)
    assert measured == pytest.approx(exact, rel=0.15, abs=3e-4)  # the relief has a thickness


def camera_of(lens: PrescriptionLens, **keys: object) -> Camera:
    recipe = {
        "name": "own",
        "lens": lens.model_dump(),
        "focus": {"distance_m": 4.0},
        "sensor": {"pixel_um": 3.0},
    }
    return Camera.from_recipe(CameraRecipe.model_validate(recipe | keys))


def bulge(camera: Camera, height_mm: float) -> Tensor:
    """The plate's relief as a height map that just covers the pupil."""
    lens, count = camera.lens, 301
    assert isinstance(lens, PrescriptionLens)
    at = ((torch.arange(count, dtype=torch.float64) + 0.5) / count * 2 - 1) * (
        _held(lens).lens.stop_radius / 4
    )
    return 1e-3 * height_mm * (at[None, :].square() + at[:, None].square()).square()


def psf(camera: Camera, field: tuple[float, float]) -> Tensor:
    bank = psf_bank(camera.at_field(field), [GREEN], [0.25], window_px=48, dtype=torch.float64)
    return bank.values[0, 0] / bank.values.sum()


@pytest.mark.parametrize("field", [(0.0, 0.0), (-0.2, 0.15)])
def test_a_mask_is_where_rays_cross_the_stop(field, monkeypatch: pytest.MonkeyPatch) -> None:
    """PSFs through it, against those of the lens with the relief as one more surface of silica."""
    plate = {"stop": True, "thickness_mm": THIN, "glass": "fused-silica"}
    made = camera_of(lens_of(plate, {"aspheres_mm": (0.0, 0.006 / 4**4)}))
    bare = with_map(camera_of(lens_of(plate, {})), 0.006)
    true = psf(made, field)
    apart = float((psf(bare, field) - true).abs().sum() / 2)
    monkeypatch.setattr(PrescriptionLens, "in_stop", lambda *of: None)
    cache.forget()
    beside = float((psf(bare, field) - true).abs().sum() / 2)
    cache.forget()
    print(apart, beside)
    assert apart < 0.01
    assert field == (0.0, 0.0) or beside > 5 * apart


def with_map(camera: Camera, height_mm: float) -> Camera:
    recipe = camera.recipe.model_copy(update={"mask": ClearMask()})
    return replace(camera, recipe=recipe, mask_material=material("fused-silica")).with_height(
        bulge(camera, height_mm)
    )


def with_mask(name: str, mask: dict) -> Camera:
    recipe = load_camera(name).recipe.model_dump(exclude_unset=True) | {"mask": mask}
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


def test_strong_masks_at_wide_angles_are_refused() -> None:
    """Where light comes from is what counts, and how steep the mask is."""
    cubic = {"kind": "cubic", "alpha_rad": 30.0}
    phone, wide = with_mask("aspheres-5mm-f3", cubic), (0.3, 0.25)
    refuse_strong(phone)
    with pytest.raises(InputError, match=r"the mask \(cubic\) bends rays.*21.3 degrees.*weaker mask"):
        psf_bank(phone.at_field(wide), [GREEN], [1.0], window_px=16)
    frame = Frame.about(2400, 2800, phone)
    with pytest.raises(StrongMask):
        step_for(phone, frame, torch.tensor([GREEN]), (1.0, 1.0), 50.0)
    refuse_strong(with_mask("aspheres-5mm-f3", {**cubic, "alpha_rad": 10.0}).at_field(wide))
    rings = [{"inner_radius": 0.0, "outer_radius": 0.5, "phase_rad": 3.0}]
    refuse_strong(with_mask("aspheres-5mm-f3", {"kind": "rings", "rings": rings}).at_field(wide))


@pytest.mark.parametrize("name", ["doublet-25mm-f6", "double-gauss-50mm-f4", "aspheres-5mm-f3"])
def test_masks_of_papers_are_taken_over_the_frames_that_ship(name: str) -> None:
    camera = with_mask(name, {"kind": "cubic", "alpha_rad": 30.0})
    refuse_strong(camera.seen_at(Frame.about(384, 512, camera).field(0.0, 0.0)))


def test_maps_are_sampled_at_with_their_wraps() -> None:
    grid = PupilGrid(64, 2 / 62, 1.0)
    u, v = grid.normalised()
    smooth = 2.3 * (u.square() - 0.7 * v.square() + 0.4 * u * v) + 0.9 * u
    at = (torch.rand(2, 500, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 2 - 1) * 0.9
    true = 2.3 * (at[0].square() - 0.7 * at[1].square() + 0.4 * at[0] * at[1]) + 0.9 * at[0]
    wrapped = smooth - (smooth / 0.5).floor() * 0.5
    assert sampled_at(smooth, grid, *at, NO_WRAPS) == pytest.approx(true, abs=1e-12)
    found = sampled_at(wrapped, grid, *at, 0.5)
    assert (found - true + ((true - found) / 0.5).round() * 0.5).abs().max() < 1e-12
    assert float(found.max()) < 0.5 + 0.12 and float(found.min()) > -0.12


def test_edges_of_a_stop_in_the_stop() -> None:
    """An obstruction of half the radius, at an angle: where rays meet the stop at half of it."""
    camera = camera_of(lens_of({"stop": True}), mask={"kind": "annular", "inner_radius": 0.5})
    lens, field = camera.lens, (0.0, 0.4)
    radius = lens.aperture_radius
    grid = PupilGrid(514, 2 * radius / 512, radius)
    lets_by = aperture(camera.at_field(field), grid).regions[0][0][:, 257]  # along the field
    inner = lets_by[:257].lt(0.5).nonzero()
    inner = inner[(inner.diff(dim=0, prepend=inner[:1]) > 1).nonzero()[-1, 0], 0]  # the hole's upper edge
    v = lens.in_stop(grid.centres[None, 256:258], grid.centres.flip(0)[:, None], field)[1, :, 0]
    assert float(v[inner]) == pytest.approx(0.5, abs=0.01)
    assert float(grid.centres.flip(0)[inner] / radius) < 0.45
