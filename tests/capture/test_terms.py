"""Photos by sums of few kernels, with weights for each source, against sums over sources and many places."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from hard_cases.lens_field import with_nearer

from edofsim.capture import Fidelity, Photo, capture
from edofsim.capture import terms as captured
from edofsim.capture.field import Part, change_over_field
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics import terms as optics_terms
from edofsim.optics.field import Frame, relative_light
from edofsim.optics.psf import psf_bank
from edofsim.optics.terms import Grid, cubic, terms_of
from edofsim.plan import parse_target, plan_photo
from edofsim.recipe.load import load_camera
from edofsim.render.view import View

PIXELS = (16, 32)
AXIS = (-112.0, -176.0)
BANDS = torch.linspace(500e-9, 600e-9, 2, dtype=torch.float64)


@pytest.fixture(scope="module")
def doublet() -> Camera:
    recipe = load_camera("doublet-25mm-f6").recipe
    psf = recipe.psf.model_copy(update={"window_px": 24})
    return Camera.from_recipe(recipe.model_copy(update={"psf": psf}))


@pytest.fixture(scope="module")
def corner(doublet: Camera) -> View:
    """A slope of smooth depth in a corner of a frame, and before it a disc that hides a part of it."""
    margin, (height, width) = 12, PIXELS
    rows, columns = height + 2 * margin, width + 2 * margin
    blocks = torch.rand(2, rows // 4, columns // 4, generator=torch.Generator().manual_seed(1))
    light = blocks.repeat_interleave(4, 1).repeat_interleave(4, 2)
    y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    depth = 0.45 + 0.2 * x / columns
    how = {"wavelengths": BANDS, "pixel_angle": doublet.pixel_angle, "margin": margin}
    slope = replace(View.flat(light, depth, **how, metadata={"hidden": "known"}), axis=AXIS)
    return with_nearer(slope, (y - rows / 2) ** 2 + (x - columns / 2) ** 2 < 80, 0.75)


@pytest.fixture(autouse=True, scope="module")
def no_glare() -> Iterator[None]:
    """Light that leaves windows is by places what lands around each, as if all light were there."""
    module = sys.modules[capture.__module__]
    with pytest.MonkeyPatch.context() as patch:
        with_glare = module.glare_of
        patch.setattr(module, "glare_of", lambda *of: tuple(0 * each for each in with_glare(*of)))
        yield


def photo(view: View, camera: Camera, folder: Path, **how: object) -> Photo:
    return capture(view, camera, Fidelity(layers_db=70.0, **how), exposure=1.0, cache=folder)


def db(error: torch.Tensor) -> float:
    return float(-10 * torch.log10(error.double().square().mean()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("psfs")


@pytest.fixture(scope="module")
def by_places(corner: View, doublet: Camera, folder: Path) -> Photo:
    """Each place by PSFs of its own, which know nothing of kernels."""
    return photo(corner, doublet, folder, field_step_px=16, field_terms=False)


def test_a_depth_edge_in_a_corner(corner: View, doublet: Camera, folder: Path, by_places: Photo) -> None:
    """The cat's eye of a near disc over a slope, as hats over many places see it."""
    found = photo(corner, doublet, folder, field_step_px=64)
    by_axis = photo(corner, doublet, folder, field_step_px=0)
    print(db(found.clean - by_places.clean), db(by_axis.clean - by_places.clean))
    assert db(found.clean - by_places.clean) > 56
    assert db(by_axis.clean - by_places.clean) < 46


@pytest.mark.parametrize("asked", [55, pytest.param(60, marks=pytest.mark.slow)])
def test_plans_keep_their_promise_at_the_edge(
    asked: int, corner: View, doublet: Camera, folder: Path, by_places: Photo
) -> None:
    """Kernels, places, depths and all else that a plan leaves out, together: within a decibel."""
    plan = plan_photo(corner, doublet, None, parse_target(f"{asked}dB", None))
    assert plan.fidelity.field_terms and plan.fidelity.field_step_px != 0
    found = capture(corner, doublet, plan.fidelity, exposure=1.0, cache=folder)
    print(db(found.clean - by_places.clean))
    assert db(found.clean - by_places.clean) > asked - 1


def _transposed(view: View) -> tuple[float, float]:
    y, x = (view.height / 2, view.width / 2) if view.axis is None else view.axis
    return x, y


FAULTS = {
    "transposed field": (View, "axis_px", property(_transposed)),
    "mirrored places": (captured, "cubic", lambda at, count: cubic(at.flip(0), count)),
    "few kernels": (captured, "HALF", 100.0),
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_is_another_photo(
    corner: View,
    doublet: Camera,
    by_places: Photo,
    fault: tuple,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    """Each on purpose, by the measure of the test above."""
    optics_terms.KEPT.forget()
    monkeypatch.setattr(*fault)
    found = photo(corner, doublet, tmp_path, field_step_px=64)
    optics_terms.KEPT.forget()
    print(db(found.clean - by_places.clean))
    assert db(found.clean - by_places.clean) < 53


def test_terms_are_the_psfs_of_their_places(doublet: Camera, tmp_path: Path) -> None:
    """Each PSF at a place of the grid, summed from kernels, against the one that it stands for; and where it
    is not far enough from focus to be taken for that of the axis."""
    frame, nodes = Frame(*PIXELS, AXIS, doublet.pixel_angle), torch.tensor([0.4, 0.5, 0.7])
    how = {"window_px": 24, "db": 66.0, "cache": tmp_path}
    terms = terms_of(doublet, frame, 64, BANDS, nodes.double(), None, **how)
    for down, across in ((0, 0), (1, 2)):
        y = AXIS[0] + (terms.first[0] + down) * terms.step
        x = AXIS[1] + (terms.first[1] + across) * terms.step
        here = doublet.seen_at(frame.field(y, x))
        own = psf_bank(here, BANDS, nodes, window_px=24).values * relative_light(here)
        summed = torch.tensordot(terms.factors[down, across], terms.kernels, 1)
        even = own.sum((-2, -1)) / summed.sum((-2, -1))  # white scenes are as bright as the place's light
        assert even == pytest.approx(torch.ones(3, 2), abs=0.03)
        summed = summed * even[..., None, None]
        assert float((summed - own).abs().max()) < 4e-3 * float(own.max())
        assert terms.lost[down, across] == pytest.approx(relative_light(here) - own.sum((-2, -1)), abs=1e-3)
    optics_terms.KEPT.forget()
    again = terms_of(doublet, frame, 64, BANDS, nodes.double(), None, **how)
    for part in ("kernels", "factors", "lost"):
        assert torch.equal(getattr(again, part), getattr(terms, part))
    assert (again.first, again.step) == (terms.first, terms.step)


def test_a_damaged_file_is_made_anew(doublet: Camera, tmp_path: Path) -> None:
    frame, nodes = Frame(*PIXELS, AXIS, doublet.pixel_angle), torch.tensor([0.5], dtype=torch.float64)
    how = {"window_px": 16, "db": 50.0, "cache": tmp_path}
    terms = terms_of(doublet, frame, 512, BANDS[1:2], nodes, None, **how)
    (file,) = tmp_path.glob("terms-*")
    file.write_bytes(file.read_bytes()[:-7])
    optics_terms.KEPT.forget()
    assert torch.equal(terms_of(doublet, frame, 512, BANDS[1:2], nodes, None, **how).factors, terms.factors)


def test_cubics_are_exact_for_cubics() -> None:
    at = torch.linspace(-0.3, 6.2, 40, dtype=torch.float64)
    for count, power in ((7, 3), (3, 2), (2, 1), (1, 0)):
        inside = at.clamp(0, count - 1)
        values = torch.arange(count, dtype=torch.float64) ** power
        assert cubic(inside, count) @ values == pytest.approx(inside**power, abs=1e-9)


@pytest.mark.parametrize("axis", [(20.0, 28.0), (-900.0, 1300.0), (0.0, 56.0)])
def test_places_reach_all_around_a_frame(axis: tuple[float, float]) -> None:
    grid = Grid.around(Frame(40, 56, axis, 1e-4), 16, 100.0)
    assert grid.step <= (200 if min(len(grid.down), len(grid.across)) >= 4 else 100)
    for side, length, place in ((grid.down, 40, axis[0]), (grid.across, 56, axis[1])):
        ends = side[0] * grid.step + place, side[-1] * grid.step + place
        assert ends[0] <= -16 + 1e-6 and ends[1] >= length + 16 - 1e-6
        assert len(side) > 1 and side[1] * grid.step + place > -16 - 1e-6


def test_a_dark_frame_is_refused(doublet: Camera, tmp_path: Path) -> None:
    frame = Frame(40, 56, (-90000.0, 0.0), doublet.pixel_angle)
    with pytest.raises(InputError, match="axis"):
        terms_of(doublet, frame, 512, BANDS, torch.tensor([0.5]), None, window_px=16, db=50.0, cache=tmp_path)


@pytest.mark.parametrize(("change", "everywhere"), [(1e-7, True), (0.3, False)])
def test_sub_apertures_of_the_axis_serve_where_they_change_little(
    doublet: Camera, change: float, everywhere: bool
) -> None:
    """Of a doublet, whose PSFs at the corner differ: little change errs by less than asked wherever it is."""
    frame = Frame.about(192, 256, doublet)
    axes = SimpleNamespace(wavelengths=torch.tensor([550e-9]), ends=(0.5, 1.0))
    seen, flat = [], torch.ones(1, 192, 256)
    view = View.flat(flat, flat[0], wavelengths=axes.wavelengths, pixel_angle=doublet.pixel_angle)

    def changed(here: Camera, part: Part) -> torch.Tensor:
        seen.append(here)
        at = part(view, 0)
        return torch.full((1, 3, at.height, at.width), change)

    fidelity = Fidelity(layers_db=60.0)
    found = change_over_field(doublet, fidelity, frame, 64, axes, 1.0, changed)
    assert (len(seen) == 1) == everywhere
    assert float(found[0, 0, 96, 128]) == pytest.approx(change, rel=1e-3)
    assert float(found[0, 0, 0, 0]) < 0.9995 * float(found[0, 0, 96, 128])  # less light at the corner
