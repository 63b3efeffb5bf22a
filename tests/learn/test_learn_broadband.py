"""Training on light of all wavelengths beside three lines: PSFs, and what a bank is told of them."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w
import torch

from edofsim.errors import InputError
from edofsim.learn import shots, trainer
from edofsim.learn import views as views_
from edofsim.learn.doe import MaskMaps
from edofsim.learn.edges import Edges
from edofsim.learn.photographs import PlaneSource
from edofsim.learn.setup import Setup, prepare
from edofsim.learn.sources import draw_patches, packaged_images
from edofsim.learn.system import Draw, Planes
from edofsim.learn.trainer import train
from edofsim.learn.training_camera import TrainingCamera
from edofsim.learn.views import Views, open_views
from edofsim.learn.workers import Workers
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank, response, response_curves
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe
from edofsim.render.view import View
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.photograph_statistics import smoothest_spectra

WORKERS = Workers(0, 1, torch.device("cpu"))
SMALL = {"groups": 4, "distances": 1, "support": 9, "width": 4, "blocks": [1, 1]}


def _loaded(broadband: float, steps: int = 2, share: int = 1, **network: object) -> Loaded[TrainRecipe]:
    recipe = TrainRecipe.model_validate(
        {
            "name": "bank",
            "camera": "paper-clear",
            "seed": 1,
            "mask": {"kind": "height-map"},
            "psf": {"window_px": 32, "pupil_sampling_um": 21.0},
            "capture": {"inverse_depth_per_m": [1.0, 1.4]},
            "network": {"kind": "filter-bank", "settings": SMALL} | network,
            "doe": {"learning_rate_rad": 0.0},
            "data": {
                "patch_px": 48,
                "validation_patches": 8,
                "sources": [{"kind": "packaged", "broadband": broadband, "edges": 0.5}],
            },
            "optimiser": {"steps": steps, "batch": 2, "network_steps": share},
            "journal": {"save_every": 2, "validate_every": 100},
        }
    )
    return Loaded(recipe, Path("bank.toml"), "")


def _photo_of(setup: Setup, broadband: bool) -> Draw:
    """Of four photographs, out of focus."""
    sharp = draw_patches(packaged_images(96), 4, 64, (15, 16), torch.Generator().manual_seed(2))[0]
    scenes = Planes(sharp, torch.full((4,), 1.25), broadband=broadband)
    return Draw(scenes, torch.full((4,), 0.003), torch.Generator().manual_seed(3))


def test_a_broadband_psf_is_the_sum_over_wavelengths_by_the_response() -> None:
    """Against single PSFs, added up one by one; a pupil too coarse for the shortest wavelength is refined.
    What the channels see of each colour is that of its own spectrum, and of white all of it."""
    recipe = CameraRecipe(
        name="c", mask={"kind": "height-map"}, psf={"window_px": 32, "pupil_sampling_um": 21.0}
    )
    camera = Camera.from_recipe(recipe)
    optics = TrainingCamera(camera, 32, torch.device("cpu"))
    depths = torch.tensor([0.9, 1.3])
    found = optics.psfs(depths, True)
    curves = response_curves(camera)
    assert curves is not None
    ends = curves[0][[0, -1]]
    wavelengths = ends[0] + (ends[1] - ends[0]) * (torch.arange(8) + 0.5) / 8
    expected = torch.zeros_like(found)
    every = response(camera, wavelengths)
    spectra = smoothest_spectra(wavelengths, every)
    for wavelength, weights, spectrum in zip(wavelengths, every.T, spectra, strict=True):
        for index, depth in enumerate(depths):
            psf = psf_bank(camera, wavelength[None], depth[None], window_px=32).values[0, 0]
            expected[index] += torch.outer(weights, spectrum)[..., None, None].to(psf) * psf
    torch.testing.assert_close(found, expected, rtol=0, atol=2e-5)
    lines = optics.psfs(depths)
    assert (found.sum(2) - lines).abs().sum((-1, -2)).min() > 0.05  # no line stands for all of them
    assert (found[:, 1, 2].abs().sum((-1, -2)) > 0.05).all()  # green sees light of what is blue


@pytest.mark.parametrize("by_colour", [False, True])
def test_a_bank_is_told_the_light_that_the_sensor_sees(by_colour: bool) -> None:
    """Of each kind of light its own filters, those of lines for the checkpoint, whatever came last; by colour
    where it wants that."""
    settings = {**SMALL, "colour_psfs": by_colour}
    setup = prepare(_loaded(0.5, settings=settings), None, WORKERS)
    system, network = setup.system, setup.system.network
    system.set_initial_psfs(0.005)
    lines = network.filters.clone()
    with torch.no_grad():
        for broadband in (True, False, True):
            outcome = system(_photo_of(setup, broadband))
            assert outcome.broadband == broadband
            assert torch.equal(network.filters, lines) != broadband
        kept = network.filters.clone()
        expected = system.optics.with_mask(MaskMaps(system.mask())).psfs(
            network.psf_depths(system.depth_range), True, system.height_noise
        )
        network.set_psfs(expected if by_colour else expected.sum(2))
        assert torch.equal(network.filters, kept)
    system.store_final_psfs()
    assert torch.equal(network.filters, lines)


def test_filters_of_its_light_restore_a_broadband_photo_better() -> None:
    setup = prepare(_loaded(0.5), None, WORKERS)
    setup.system.set_initial_psfs(0.005)
    setup.system.eval()
    draw = _photo_of(setup, True)
    with torch.no_grad():
        own = setup.system(draw)
        setup.system.select_psfs(broadband=False)
        noisy = torch.zeros_like(own.ideal)
        border = setup.system.network.border
        whole = torch.nn.functional.pad(own.photo, (border,) * 4, mode="replicate")
        noisy = setup.system.network(whole)[..., border:-border, border:-border]
    inside = slice(12, -12)
    errors = [
        float((image - own.ideal)[..., inside, inside].square().mean()) for image in (own.restored, noisy)
    ]
    assert errors[0] < 0.98 * errors[1]


def test_the_parts_of_a_step_share_light_and_psfs() -> None:
    sharp = torch.rand(2, 3, 40, 40)
    psf = torch.rand(2, 3, 9, 9)
    planes = Planes(sharp, torch.tensor([1.0, 1.2])).reusing(psf, broadband=True)
    edges = Edges(sharp, sharp[:, :1], torch.tensor([1.0, 1.2])).reusing(psf, broadband=True)
    assert planes.broadband and edges.broadband and planes.psf is psf and edges.psf is psf


def test_a_share_of_the_photographs_is_broadband() -> None:
    source = prepare(_loaded(0.25), None, WORKERS).data.sources[0]
    assert isinstance(source, PlaneSource)
    drawn = [source.draw(2, torch.Generator().manual_seed(seed)).broadband for seed in range(200)]
    assert 0.15 < sum(drawn) / len(drawn) < 0.35
    assert [scenes.broadband for scenes in source.validation(16)] == [True, False, False, False]
    plain = prepare(_loaded(0.0), None, WORKERS).data.sources[0]
    assert not any(plain.draw(2, torch.Generator().manual_seed(seed)).broadband for seed in range(20))


def test_a_broadband_training_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    loaded = _loaded(0.5, steps=4, share=2)
    straight = train(loaded, tmp_path / "straight")
    with pytest.MonkeyPatch.context() as patch:
        drawn = trainer.draw_batch

        def dying(setup: Setup, step: int, workers: Workers, part: int = 0) -> Draw:
            if step == 2:
                raise InputError("power cut")
            return drawn(setup, step, workers, part)

        patch.setattr(trainer, "draw_batch", dying)
        with pytest.raises(InputError, match="power cut"):
            train(loaded, tmp_path / "stopped")
    resumed = train(loaded, tmp_path / "stopped", resume=True)
    first, second = (load_checkpoint(each.checkpoint).network.state_dict() for each in (straight, resumed))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_processes_share_gradients_and_no_filters(tmp_path: Path) -> None:
    """Half of the photos are broadband, other ones in each process: each keeps the filters of its own."""
    settings = {**SMALL, "colour_psfs": True}
    alone = _loaded(0.5, steps=30, settings=settings)
    recipe = tmp_path / "bank.toml"
    recipe.write_text(tomli_w.dumps(alone.recipe.model_dump(mode="json", exclude_none=True)))
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command += ["-m", "edofsim", "train", str(recipe), "--out", str(tmp_path / "both")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert done.returncode == 0, done.stderr[-2000:]
    both = load_checkpoint(tmp_path / "both" / "bank.safetensors").network.state_dict()
    single = load_checkpoint(train(alone, tmp_path / "alone").checkpoint).network.state_dict()
    assert torch.equal(both["filters"], single["filters"])
    assert not torch.equal(both["trunk.last.weight"], single["trunk.last.weight"])


def test_photos_of_views_are_taken_once_for_all_trainings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another training reads them; another mask, other layers or another view have photos of their own."""
    recipe = CameraRecipe(name="c", mask={"kind": "height-map"}, psf={"window_px": 16, "oversampling": 1})
    optics = TrainingCamera(Camera.from_recipe(recipe), 16, torch.device("cpu")).with_mask(
        MaskMaps(torch.zeros(239, 239))
    )
    taken: list[float] = []
    once = shots.capture_view
    monkeypatch.setattr(shots, "capture_view", lambda *how: taken.append(0.0) or once(*how))
    monkeypatch.setattr(shots, "_folder", lambda: tmp_path / "photos")
    shade = [0.5]

    def view(*_: object, **__: object) -> View:
        image = torch.linspace(0, shade[0], 3 * 72 * 62).reshape(3, 72, 62)
        angle = optics.camera.pixel_angle
        return View.flat(image, 0.8, wavelengths=PAPER_COLOURS, pixel_angle=angle, margin=16)

    monkeypatch.setattr("edofsim.learn.views.render", view)
    table = Views(scenes=("clutter",), members=2, layers=2, once=True)

    def opened(table: Views = table, optics: TrainingCamera = optics) -> views_.ViewSource:
        return open_views(table, 24, 0.5, optics, Path(), tmp_path, None, height_noise=40e-9)

    first, again = opened(), opened()
    assert len(taken) == 1  # members that look alike share a photo, too
    assert torch.equal(first.views[0].clean, again.views[0].clean)
    assert torch.equal(first.held_back[0].ideal, again.held_back[0].ideal)
    opened(table.model_copy(update={"layers": 3}))
    assert len(taken) == 2
    opened(optics=optics.with_mask(MaskMaps(torch.full((239, 239), 1e-7))))
    assert len(taken) == 3
    shade[0] = 0.6
    opened()
    assert len(taken) == 4


def test_photos_that_are_taken_once_have_the_veil_of_errors_of_fabrication(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the mean over masks: exp(-s^2) of the light goes where the design sends it, s the error of phase,
    and the rest is the mean of the picture. On the pupil's own fine grid errors of single samples would be
    smoothed, and scatter less."""
    recipe = CameraRecipe(name="c", mask={"kind": "height-map"}, psf={"window_px": 16, "oversampling": 1})
    optics = TrainingCamera(Camera.from_recipe(recipe), 16, torch.device("cpu")).with_mask(
        MaskMaps(torch.zeros(239, 239))
    )
    monkeypatch.setattr(shots, "_folder", lambda: tmp_path / "photos")
    image = 0.4 + 0.2 * torch.rand(3, 72, 62, generator=torch.Generator().manual_seed(4))
    angle = optics.camera.pixel_angle
    rising = PAPER_COLOURS.flip(0)
    flat = View.flat(image, 0.8, wavelengths=rising, pixel_angle=angle, margin=16)
    monkeypatch.setattr("edofsim.learn.views.render", lambda *_, **__: flat)
    table = Views(scenes=("clutter",), members=2, layers=2, once=True, bands="three")

    def shot(error: float) -> shots.Shot:
        found = open_views(table, 24, 0.5, optics, Path(), tmp_path, None, height_noise=error)
        first = found.views[0]
        assert isinstance(first, shots.Shot)
        return first

    designed, made = shot(0.0), shot(60e-9)
    phase = 2 * math.pi * 60e-9 * (optics.camera.mask_material.index(PAPER_COLOURS) - 1) / PAPER_COLOURS
    kept = (-phase.square()).exp().float()[:, None, None]
    assert 0.7 < float(kept.min()) < float(kept.max()) < 0.9
    veil = made.clean - kept * designed.clean
    mean = designed.clean.mean((1, 2), keepdim=True)
    assert veil.std((1, 2)).max() < 1e-5
    torch.testing.assert_close(veil, ((1 - kept) * mean).expand_as(veil), rtol=0.05, atol=0)
    assert torch.equal(made.ideal, designed.ideal)
