"""Cameras drawn at random, and a training over them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.errors import InputError
from edofsim.learn.camera_pool import Pooled, camera_pool
from edofsim.learn.edges import Edges
from edofsim.learn.random_cameras import random_camera, widest_blur_px
from edofsim.learn.setup import prepare
from edofsim.learn.shots import by_stored_psfs
from edofsim.learn.system import Planes
from edofsim.learn.trainer import draw_batch, train
from edofsim.learn.training_camera import StoredPsfs, TrainingCamera
from edofsim.learn.views import normalise_depth_range
from edofsim.learn.workers import Workers
from edofsim.optics import PAPER_COLOURS, psf_bank
from edofsim.recipe.kinds import MASKS
from edofsim.recipe.load import Loaded, load_train
from edofsim.recipe.train import CamerasTable, TrainRecipe
from edofsim.render.view import View
from edofsim.restore.camera_bank import CameraBank
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.light import without_glare
from edofsim.restore.network import build_network
from edofsim.restore.restore import deconvolved

WORKERS = Workers(0, 1, torch.device("cpu"))
SMALL = {"groups": 2, "distances": 2, "support": 5, "width": 4, "blocks": [1, 1]}
NOISE = (0.001, 0.02)
EVERY = CamerasTable(masks=tuple(MASKS), lenses=("ideal", "achromat", "plano-convex"), blur_px=(3, 40))
RANDOM = {
    "count": 3,
    "validation": 2,
    "focal_length_mm": [5, 10],
    "blur_px": [2, 10],
    "masks": ["clear", "cubic", "height-map"],
    "strength_rad": [3, 6],
    "window_px": 16,
}


def _recipe(steps: int = 4, kind: str = "camera-bank", **more: object) -> Loaded[TrainRecipe]:
    values = {
        "name": "any",
        "camera": "paper-clear",
        "seed": 3,
        "network": {"kind": kind, "settings": SMALL},
        "cameras": RANDOM,
        "doe": {"learn": False},
        "data": {"patch_px": 48, "validation_patches": 8, "sources": [{"kind": "packaged", "edges": 0.5}]},
        "optimiser": {"steps": steps, "batch": 2, "network_steps": 2, "precision": "float32"},
        "journal": {"save_every": 2, "validate_every": 2},
    }
    return Loaded(TrainRecipe.model_validate({**values, **more}), Path("any.toml"), "")


@pytest.mark.parametrize("number", range(len(MASKS)))
def test_a_drawn_camera_is_within_the_ranges(number: int) -> None:
    drawn = random_camera(EVERY, 1, number, 0, NOISE)
    recipe = drawn.camera.recipe
    assert recipe.mask.kind == list(MASKS)[number]
    assert 3 <= widest_blur_px(drawn) <= 40
    assert NOISE[0] <= drawn.read_noise <= NOISE[1]
    assert EVERY.pixel_um[0] <= recipe.sensor.pixel_um <= EVERY.pixel_um[1]
    far, near = drawn.depths
    assert 0 <= far < near <= EVERY.nearest_per_m[1]
    psf_bank(drawn.camera, PAPER_COLOURS, drawn.depths, window_px=32)


def test_the_same_number_gives_the_same_camera_and_others_differ() -> None:
    first, again, other = (random_camera(EVERY, 1, number, 0, NOISE) for number in (0, 0, 12))
    assert first.camera.recipe == again.camera.recipe and first.depths == again.depths
    assert first.camera.recipe != other.camera.recipe
    height_map = [
        random_camera(CamerasTable(masks=("height-map",)), 1, n, 0, NOISE).camera for n in (0, 0, 1)
    ]
    maps = [camera.height_map for camera in height_map]
    assert maps[0] is not None and torch.equal(maps[0], maps[1])
    assert maps[0].shape != maps[2].shape or not torch.equal(maps[0], maps[2])


def test_the_geometric_blur_is_that_of_the_lens() -> None:
    """f^2 / N over the pixel, times the distance from focus in dioptres, for a far focus."""
    drawn = random_camera(CamerasTable(), 1, 0, 0, NOISE)
    recipe = drawn.camera.recipe
    away = max(abs(depth - 1 / recipe.focus.distance_m) for depth in drawn.depths)
    focal = float(drawn.camera.lens.focal_length(587.6e-9))
    expected = 2 * drawn.camera.aperture_radius * focal / drawn.camera.pixel * away
    assert widest_blur_px(drawn) == pytest.approx(expected, rel=0.1)


def test_ranges_without_a_camera_are_refused() -> None:
    with pytest.raises(InputError, match="blur_px"):
        random_camera(CamerasTable(blur_px=(1e5, 2e5)), 1, 0, 0, NOISE)


def test_cameras_for_validation_are_others() -> None:
    recipe = _recipe().recipe
    network = build_network("camera-bank", SMALL)
    pool = camera_pool(recipe, network, torch.device("cpu"), None)
    assert pool is not None
    names = [camera.name for camera in (*pool.training, *pool.validation)]
    assert len(set(names)) == 5
    drawn = {pool.camera(3, step).name for step in range(40)}
    assert drawn == {camera.name for camera in pool.training}


def test_psfs_are_looked_up_where_the_scene_stands_in_its_range() -> None:
    stored = torch.arange(4.0).reshape(4, 1, 1, 1).expand(4, 3, 2, 2).to(torch.float16)
    camera = random_camera(EVERY, 1, 0, 0, NOISE).camera
    optics = TrainingCamera(camera, 2, torch.device("cpu"), StoredPsfs(stored, (0.0, 2.0), 5.0))
    found = optics.psfs(torch.tensor([0.0, 0.49, 0.51, 1.9, 2.0]))
    assert found[:, 0, 0, 0].tolist() == [0, 0, 1, 3, 3]
    assert found.dtype == torch.float32


def _stored(window: int = 8, depths: int = 6) -> TrainingCamera:
    """PSFs of random numbers, a tenth of whose light is beyond their window."""
    values = torch.rand(depths, 3, window, window, generator=torch.Generator().manual_seed(2))
    stored = (0.9 * values / values.sum((-1, -2), keepdim=True)).to(torch.float16)
    camera = random_camera(EVERY, 1, 0, 0, NOISE).camera
    return TrainingCamera(camera, window, torch.device("cpu"), StoredPsfs(stored, (0.0, 2.0), 5.0))


def _radiance(rows: int, columns: int, seed: int) -> torch.Tensor:
    return torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(seed))


def _flat(radiance: torch.Tensor, inverse_depth: torch.Tensor | float, margin: int) -> View:
    return View.flat(radiance, inverse_depth, wavelengths=PAPER_COLOURS, pixel_angle=1e-3, margin=margin)


def test_a_view_through_stored_psfs_is_the_sum_of_its_points() -> None:
    """Each pixel's light spread by the PSF of its depth, one after the other."""
    optics, margin, window = _stored(), 4, 8
    radiance = _radiance(14, 13, 5)
    depth = torch.randint(6, (14, 13), generator=torch.Generator().manual_seed(6)) / 3 + 1 / 6
    found, truncated = by_stored_psfs(_flat(radiance, depth, margin), optics.stored, 8, "none")
    wanted = torch.zeros(3, 14 + 2 * window, 13 + 2 * window)
    for row in range(14):
        for column in range(13):
            psf = optics.psfs(depth[row, column][None])[0]
            place = row - window // 2 + window, column - window // 2 + window
            spread = radiance[:, row, column, None, None] * psf
            wanted[:, place[0] : place[0] + window, place[1] : place[1] + window] += spread
    wanted = wanted[:, window + margin : window + 14 - margin, window + margin : window + 13 - margin]
    lost = 1 - torch.stack([optics.psfs(each[None])[0].sum((-1, -2)) for each in depth.flatten()], 1)
    glare = (radiance.flatten(1) * lost).mean(1)
    assert torch.allclose(found, wanted + glare[:, None, None], atol=1e-5)
    assert torch.allclose(truncated, glare / radiance.flatten(1).mean(1), atol=1e-5)


def test_a_view_of_one_depth_is_the_plane_of_a_photograph() -> None:
    optics, radiance = _stored(), _radiance(24, 24, 7)
    found, _ = by_stored_psfs(_flat(radiance, 1.2, 4), optics.stored, 16, "hidden")
    depth, mean = torch.tensor([1.2]), radiance.mean((-1, -2))[None]
    plane = Planes(radiance[None, :, 1:, 1:], depth, mean=mean).photograph(optics)
    assert found.shape == (3, 16, 16)
    assert torch.allclose(found, plane.clean[0], atol=1e-5)


def test_what_lies_behind_an_edge_of_a_view_is_seen_past_it() -> None:
    """One picture in front of another, hidden light known: as photographs with an edge are composited."""
    optics, near, far = _stored(), _radiance(24, 24, 8), _radiance(24, 24, 9)
    stored = replace(optics.stored, values=optics.stored.values / 0.9)
    optics = replace(optics, stored=stored)  # no glare, which both take from other pictures
    cover = torch.zeros(24, 24)
    cover[:, :11] = 1
    seen = _flat(cover * near + (1 - cover) * far, 0.5 + cover, 4)
    pixels = torch.nonzero(cover.flatten() > 0).squeeze(1)
    order = torch.cat([torch.arange(576), pixels]).argsort(stable=True)

    def with_hidden(visible: torch.Tensor, behind: torch.Tensor) -> torch.Tensor:
        return torch.cat([visible, behind.to(visible)], -1)[..., order]

    view = replace(
        seen,
        pixel=with_hidden(seen.pixel, pixels),
        coverage=with_hidden(seen.coverage, torch.ones(len(pixels))),
        inverse_depth=with_hidden(seen.inverse_depth, torch.full((len(pixels),), 0.5)),
        radiance=with_hidden(seen.radiance, far.flatten(1)[:, pixels]),
        hidden=with_hidden(seen.hidden, torch.ones(len(pixels))),
    )
    found, _ = by_stored_psfs(view, optics.stored, 16, "hidden")
    sharp = torch.stack([far, near])[..., 1:, 1:]
    covers = cover[None, None, 1:, 1:].expand(2, 1, -1, -1)
    edge = Edges(sharp, covers, torch.tensor([0.5, 1.5])).photograph(optics)
    assert torch.allclose(found, edge.clean[1], atol=1e-4)
    assert not torch.allclose(by_stored_psfs(seen, optics.stored, 16, "hidden")[0], found, atol=1e-2)


def test_a_view_is_stretched_to_the_range_of_the_cameras() -> None:
    depth = torch.linspace(0.4, 0.9, 144).reshape(12, 12)
    found = normalise_depth_range(_flat(0.01 * _radiance(12, 12, 1), depth, 2), (0.0, 2.0))
    assert found.inverse_depth.aminmax() == (0, 2)
    assert torch.allclose(found.inverse_depth.diff(), 2 / 0.5 * depth.flatten().diff(), atol=1e-4)
    assert 0.5 < found.all_in_focus().max() < 2
    flat = normalise_depth_range(_flat(_radiance(12, 12, 1), 0.7, 2), (0.5, 2.0))
    assert flat.inverse_depth.aminmax() == (0.5, 0.5)


@pytest.mark.parametrize("wrong", [{"once": True}, {"bands": "all"}, {"sub_apertures": 2}])
def test_views_for_many_cameras_go_by_stored_psfs(wrong: dict[str, object]) -> None:
    data = {"patch_px": 48, "sources": [{"kind": "views", "scenes": ["clutter"], **wrong}]}
    with pytest.raises(InputError, match="stored PSFs"):
        prepare(_recipe(data=data), None, WORKERS)


def test_each_step_has_a_camera_whose_noise_and_filters_are_used() -> None:
    setup = prepare(_recipe(), None, WORKERS)
    seen = set()
    for step in range(6):
        draw = draw_batch(setup, step, WORKERS)
        assert draw.camera is not None
        assert draw.read_noise.tolist() == pytest.approx([draw.camera.read_noise] * 2)
        setup.system(draw)
        assert isinstance(setup.system.network, CameraBank)
        assert torch.equal(setup.system.network.filters, draw.camera.known.filters)
        seen.add(draw.camera.name)
    assert len(seen) > 1


def test_the_network_sees_photos_without_glare_and_what_wiener_deconvolution_makes() -> None:
    """As in use: by the light that leaves the windows of the photo's own PSFs."""
    network = build_network("camera-bank", {**SMALL, "linear": True})
    known = CameraBank(**SMALL).condition(_stored().stored.values.float(), 0.01)
    shares = torch.tensor([0.2, 0.0, 0.3, 0.1, 0.4, 0.0])
    pooled = Pooled("one", _stored(), 0.01, known, shares)
    radiance = torch.rand(2, 3, 47, 47)
    captured = Planes(radiance, torch.tensor([0.3, 1.5])).photograph(pooled.optics)
    seen = pooled.seen(network, captured.clean, captured)
    assert seen.shape == (2, 6, 40, 40)
    for photo, psf, found in zip(captured.clean, captured.psf, seen, strict=True):
        light = without_glare(photo, 1 - psf.sum((-1, -2)))
        torch.testing.assert_close(found[:3], light)
        between = pooled.optics.stored.values[[0, 2, 3, 4]].float()
        expected = deconvolved(light, between, 0.01, torch.tensor([0.2, 0.3, 0.1, 0.4]))
        torch.testing.assert_close(found[3:], expected, atol=1e-4, rtol=0)
    alone = pooled.seen(build_network("camera-bank", SMALL), captured.clean, captured)
    assert torch.equal(alone, seen[:, :3])


def test_what_a_network_is_told_are_psfs_at_the_depths_of_use() -> None:
    """Of a lens with a large blur closer about its focus than those that photos are taken by."""
    random = {**RANDOM, "count": 1, "validation": 1, "blur_px": [20, 40], "masks": ["clear"], "window_px": 48}
    recipe = _recipe(cameras=random).recipe
    network = build_network("camera-bank", SMALL)
    pool = camera_pool(recipe, network, torch.device("cpu"), None)
    assert pool is not None and isinstance(network, CameraBank)
    pooled = pool.training[0]
    assert float(pooled.shares.sum()) == pytest.approx(1) and bool((pooled.shares >= 0).all())
    even = network.condition(pooled.optics.stored.values.float(), pooled.read_noise)
    assert (pooled.known.filters - even.filters).abs().max() > 1e-3


def test_a_training_goes_on_as_if_it_had_not_been_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from edofsim.learn import trainer

    few = {"cameras": {**RANDOM, "count": 2, "validation": 1}}
    whole = train(_recipe(**few), tmp_path / "whole")
    real = trainer._step

    def stopping(loop: trainer._Loop, fraction: float) -> object:
        if loop.position.step == 2:
            raise KeyboardInterrupt
        return real(loop, fraction)

    with monkeypatch.context() as changed, pytest.raises(KeyboardInterrupt):
        changed.setattr(trainer, "_step", stopping)
        train(_recipe(**few), tmp_path / "parts")
    resumed = train(_recipe(**few), tmp_path / "parts", resume=True)
    first, second = (load_checkpoint(each.checkpoint).network.state_dict() for each in (whole, resumed))
    assert all(torch.equal(first[name], second[name]) for name in first)
    start = build_network("camera-bank", SMALL).state_dict()
    assert any(not torch.equal(first[name], start[name]) for name in first if "last" in name)


def test_network_and_table_go_together() -> None:
    for wrong in (_recipe(cameras=None), _recipe(kind="filter-bank")):
        with pytest.raises(InputError, match="go together"):
            prepare(wrong, None, WORKERS)


def test_the_shipped_recipe_draws_cameras_of_many_kinds() -> None:
    table = load_train("universal").recipe.cameras
    assert table is not None and len(set(table.masks)) >= 10
