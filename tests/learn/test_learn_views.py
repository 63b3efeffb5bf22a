"""Scenes with depth as training data, on views made by hand: no renderer is needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from edofsim.errors import InputError
from edofsim.learn.doe import MaskMaps
from edofsim.learn.reader import Wanted
from edofsim.learn.system import Planes
from edofsim.learn.training_camera import TrainingCamera
from edofsim.learn.training_data import gather
from edofsim.learn.views import ViewParts, Views, ViewSource, in_colours, open_views, scenes_of, training_rows
from edofsim.optics import PAPER_COLOURS, Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.train import TrainRecipe
from edofsim.render.view import View

WINDOW = 16
PSF = {"window_px": WINDOW, "oversampling": 1, "pupil_sampling_um": 21.0}
CAMERA = CameraRecipe(name="c", mask={"kind": "height-map"}, psf=PSF, sensor={"exposure": 1.0})


def _optics() -> TrainingCamera:
    return TrainingCamera(Camera.from_recipe(CAMERA), WINDOW, torch.device("cpu"))


def _view(
    height: int, width: int, margin: int, wavelengths: torch.Tensor, inverse_depth: float = 0.8
) -> View:
    """A plane with a random picture."""
    shape = (len(wavelengths), height + 2 * margin, width + 2 * margin)
    return View.flat(
        torch.rand(*shape, generator=torch.Generator().manual_seed(7)),
        inverse_depth,
        wavelengths=wavelengths,
        pixel_angle=_optics().camera.pixel_angle,
        margin=margin,
    )


def _source(table: Views) -> ViewSource:
    view = _view(40, 30, 4, PAPER_COLOURS)
    return ViewSource((view,), (), table, 12, WINDOW // 2, 0.3, {}, "")


def test_a_plane_photographed_by_the_compositor_is_the_plane_of_the_paper() -> None:
    """One surface at one depth: `Planes`, the paper's own model, is the reference."""
    optics, height = _optics(), 0.3e-6 * torch.rand(239, 239, generator=torch.Generator().manual_seed(1))
    view = _view(12, 10, WINDOW, PAPER_COLOURS)
    table = Views(scenes=("s",), layers=2)
    found = ViewParts((view,), torch.ones(1, 3), table).photograph(optics.with_mask(MaskMaps(height)))
    picture = view.radiance.reshape(1, 3, 12 + 2 * WINDOW, 10 + 2 * WINDOW)
    before, after = WINDOW - 1 - WINDOW // 2, WINDOW // 2
    cut = picture[..., WINDOW - before : WINDOW + 12 + after, WINDOW - before : WINDOW + 10 + after]
    around = WINDOW - WINDOW // 2  # light from farther out cannot reach the frame
    mean = picture[..., around:-around, around:-around].mean((-1, -2))
    plane = Planes(cut, torch.tensor([0.8]), mean=mean).photograph(optics.with_mask(MaskMaps(height)))
    assert torch.allclose(found.ideal, plane.ideal, atol=1e-6)
    assert torch.allclose(found.clean, plane.clean, atol=2e-5)
    assert float(found.truncated) == pytest.approx(float(plane.truncated), abs=0.02)


def test_gradients_of_a_scene_reach_the_mask() -> None:
    height = torch.full((239, 239), 0.6e-6, requires_grad=True)
    draw = _source(Views(scenes=("s",))).draw(2, torch.Generator().manual_seed(1))
    found = draw.photograph(_optics().with_mask(MaskMaps(height)))
    (found.clean - found.ideal).square().sum().backward()
    assert found.clean.shape == (2, 3, 12, 12)
    assert torch.isfinite(height.grad).all() and (height.grad != 0).any()


def test_exposures_vary_and_saturate() -> None:
    table = Views(scenes=("s",), exposure=(0.25, 2.5))
    draw = _source(table).draw(8, torch.Generator().manual_seed(2))
    assert draw.factors.min() >= 0.25 and draw.factors.max() <= 2.5
    assert draw.factors.max() > 1.2 and torch.equal(draw.factors[:, 0], draw.factors[:, 2])
    found = draw.photograph(_optics())
    assert found.ideal.max() <= 1 and found.clean.max() <= 1


def test_the_rows_kept_for_validation_are_never_drawn() -> None:
    source = _source(Views(scenes=("s",)))
    last = training_rows(40, 12, 0.3)
    assert last == 28
    row = torch.arange(48)[:, None].expand(48, 38).reshape(-1).to(torch.float32)
    marked = View(**{**source.views[0].__dict__, "inverse_depth": row})
    parts = ViewSource((marked,), (), source.table, 12, 0, 0.3, {}, "").draw(
        200, torch.Generator().manual_seed(3)
    )
    rows = torch.cat([part.inverse_depth for part in parts.parts]) - 4  # the margin
    assert rows.min() == 0 and rows.max() == last - 1
    kept = ViewSource((marked,), (), source.table, 12, 0, 0.3, {}, "").validation(3)
    assert min(float(batch.parts[0].inverse_depth.min()) - 4 for batch in kept) >= last


def test_bands_are_interpolated_to_the_papers_colours() -> None:
    """A spectrum linear in wavelength is met exactly."""
    bands = torch.linspace(420e-9, 720e-9, 31, dtype=torch.float64)
    view = _view(2, 2, 0, bands)
    linear = (bands * 1e6).to(torch.float32)[:, None].expand(31, 4)
    colours = in_colours(View(**{**view.__dict__, "radiance": linear}))
    assert torch.allclose(
        colours.radiance, (PAPER_COLOURS * 1e6).to(torch.float32)[:, None].expand(3, 4), atol=1e-6
    )
    with pytest.raises(InputError, match="482 to 611 nm"):
        in_colours(_view(2, 2, 0, bands[10:]))


def test_frames_too_small_are_refused_by_name_before_anything_is_rendered() -> None:
    with pytest.raises(InputError, match="'clutter'.*256 x 256"):
        scenes_of(Views(scenes=("clutter",)), 200, 0.3, Path())


def test_a_family_gives_its_members_by_seed() -> None:
    found = scenes_of(Views(scenes=("clutter",), members=3, seed=5), 96, 0.3, Path())
    assert [recipe.seed for recipe, _ in found] == [5, 6, 7]
    assert len({recipe.model_dump_json() for recipe, _ in found}) == 3


def test_of_a_family_the_last_members_are_kept_for_validation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of three members, rounded up; for validation alone, all of them. No renderer: each member's view
    is a plane at a 1024th of its seed in 1/m."""
    monkeypatch.setattr(
        "edofsim.learn.views.render",
        lambda recipe, *_, **__: _view(40, 30, 4, PAPER_COLOURS, recipe.seed / 1024),
    )

    def seed_of(view: View) -> float:
        return 1024 * float(view.inverse_depth[0])

    table = Views(scenes=("clutter",), members=3, seed=5)

    def seeds(share: float) -> tuple[list[float], list[float]]:
        source = open_views(table, 24, share, _optics(), Path(), tmp_path, None)
        trained, kept = ([seed_of(v) for v in views] for views in (source.views, source.held_back))
        assert {seed_of(scenes.parts[0]) for scenes in source.validation(6)} == set(kept)
        return trained, kept

    assert seeds(0.5) == ([5.0], [6.0, 7.0])
    assert seeds(1.0) == ([], [5.0, 6.0, 7.0])
    table = table.model_copy(update={"members": 0})
    assert seeds(1.0) == ([], [1000.0])  # the scene itself


def test_members_start_at_the_recipes_own_seed_as_render_has_them() -> None:
    found = scenes_of(Views(scenes=("clutter",), members=2), 96, 0.3, Path())
    assert [recipe.seed for recipe, _ in found] == [1000, 1001]


def test_patches_of_a_view_photographed_once_are_those_that_steps_photograph(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for veiling glare, an even light: it is a part of the mean of the whole, or of the part. So is what
    errors of fabrication scatter."""
    view = _view(40, 30, WINDOW, PAPER_COLOURS)
    monkeypatch.setattr("edofsim.learn.views.render", lambda *_, **__: view)
    fine = CAMERA.model_copy(update={"psf": CAMERA.psf.model_copy(update={"pupil_sampling_um": "auto"})})
    optics = TrainingCamera(Camera.from_recipe(fine), WINDOW, torch.device("cpu")).with_mask(
        MaskMaps(torch.zeros(239, 239))
    )
    table = Views(scenes=("clutter",), members=2, layers=2, exposure=(0.3, 0.3))

    def source(once: bool, noise: float = 0.0) -> ViewSource:
        changed = table.model_copy(update={"once": once})
        return open_views(changed, 24, 0.5, optics, Path(), tmp_path, None, height_noise=noise)

    cut, drawn = (source(once).draw(2, torch.Generator().manual_seed(1)) for once in (True, False))
    found, expected = (scenes.photograph(optics) for scenes in (cut, drawn))
    assert torch.allclose(found.ideal, expected.ideal, atol=1e-6)
    difference = found.clean - expected.clean
    assert torch.allclose(difference, difference.mean((-1, -2), keepdim=True), atol=1e-5)
    assert (expected.clean - expected.ideal).abs().max() > 0.1
    made = source(True, noise=40e-9)
    assert not torch.allclose(made.views[0].clean, source(True).views[0].clean, atol=2e-3)


def test_a_mask_that_learns_cannot_be_photographed_once(tmp_path: Path) -> None:
    table = Views(scenes=("motorcycle",), once=True)
    recipe = TrainRecipe(name="r", camera="paper-clear", data={"sources": [table]})
    with pytest.raises(InputError, match="once = true"):
        table.open(Wanted(recipe, _optics(), Path(), None, tmp_path))


def test_a_photograph_with_depths_is_a_source(tmp_path: Path) -> None:
    """The motorcycle of scikit-image needs no renderer: opened, drawn and photographed."""
    table = Views(scenes=("motorcycle",), layers=3)
    source = open_views(table, 24, 0.1, _optics(), Path(), tmp_path, None)
    draw = source.draw(2, torch.Generator().manual_seed(1))
    found = draw.photograph(_optics())
    assert found.clean.shape == (2, 3, 24, 24) and torch.isfinite(found.clean).all()
    depths = torch.cat([part.inverse_depth for part in draw.parts])
    assert float(depths.min()) > 0.6 and float(depths.max()) < 1.8  # 0.6 to 1.5 m, as its recipe says


def test_a_folder_without_pictures_ends_a_training_before_views_are_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rendered: list[str] = []
    monkeypatch.setattr("edofsim.learn.views.render", lambda recipe, *_, **__: rendered.append(recipe.name))
    sources = [Views(scenes=("clutter",)), {"kind": "natural"}]
    recipe = TrainRecipe(name="r", camera="paper-clear", data={"sources": sources})
    with pytest.raises(InputError, match="holds no pictures"):
        gather(recipe, _optics(), Path(), tmp_path)
    assert not rendered


def test_a_pupil_too_coarse_for_a_view_is_refused_before_any_step(tmp_path: Path) -> None:
    """Only a corner is near: patches drawn at random might miss it for long, validation meet it last."""
    picture, depth = tmp_path / "p.png", tmp_path / "d.npy"
    Image.fromarray(np.full((40, 40, 3), 128, np.uint8)).save(picture)
    metres = np.full((40, 40), 1.5, np.float32)
    metres[-2:, -2:] = 0.3
    np.save(depth, metres)
    scene = tmp_path / "near.toml"
    scene.write_text(
        f'''
name = "near"
camera = "paper-clear"
[frame]
width_px = 40
height_px = 40
[source]
kind = "rgbd"
image = "{picture.name}"
[source.depth]
path = "{depth.name}"
holds = "depth"
'''
    )
    table = Views(scenes=(str(scene),), layers=2)
    with pytest.raises(InputError, match=r"scene 'near': psf.pupil_sampling_um = 21 is too coarse.*0\.3"):
        open_views(table, 12, 0.3, _optics(), tmp_path, tmp_path / "cache", None)
