"""The benchmark of photos, small: ways that are compared in time have one image, to the PSNR asked for."""

from __future__ import annotations

import pytest
import torch

from benchmarks import photos
from edofsim.capture import Fidelity
from edofsim.experiments.kept import Kept
from edofsim.optics import Camera

LAYERS = (5, 9, 17, 33)
WINDOW = 32


@pytest.fixture(scope="module")
def camera():
    """That of the benchmark, with a small window."""
    recipe = photos.cameras()["clear"].recipe
    psf = recipe.psf.model_copy(update={"window_px": WINDOW})
    return Camera.from_recipe(recipe.model_copy(update={"psf": psf}))


@pytest.fixture(scope="module")
def view(camera):
    """The benchmark's slanted surface, with a spectrum that is smooth over its bands."""
    return photos.synthetic_view(32, 3, camera.pixel_angle, margin=WINDOW // 2)


def test_what_a_user_writes_has_the_image_of_the_layers(view, camera):
    """Two codes for one sum, which share the PSFs alone: float32 rounding apart."""
    few = Fidelity(layers=7)
    ours = photos.by_layers(view, camera, few, repeats=1)
    theirs = photos.by_plain_layers(view, camera, few, 1.0)
    assert (ours.image - theirs.image).abs().max() < 1e-5 * ours.image.max()


def test_brute_force_has_the_image_of_the_layers(camera):
    """With all of its depths blurred, at as many nodes; in float64."""
    view = photos.synthetic_view(24, 2, camera.pixel_angle, margin=WINDOW // 2)
    brute, depths = photos.by_brute_force(view, camera, torch.float64, timed_depths=photos.BRUTE_DEPTHS)
    assert depths > 100
    ours = photos.by_layers(view, camera, Fidelity(layers=photos.BRUTE_DEPTHS), repeats=1)
    assert (ours.image - brute.image).abs().max() < 1e-5 * ours.image.max()


def test_seconds_of_some_depths_stand_for_all(view, camera, monkeypatch):
    """A clock that says 2 s for anything: of 3 timed depths, so many times as many seconds."""
    monkeypatch.setattr(photos, "timed", lambda work: (work(), 2.0))
    way, depths = photos.by_brute_force(view, camera, torch.float32, timed_depths=3)
    assert way.seconds == pytest.approx(2.0 * depths / 3)
    assert way.seconds_psfs == pytest.approx(2.0 * depths / 3)


def test_the_compared_ways_meet_what_is_asked(view, camera):
    """Each by the setting that the benchmark finds for it; and the ratio is against the fastest of the others
    that meet it."""
    found = photos.compare(view, camera, layers=LAYERS)
    for asked in (50, 40):
        name = f"{asked}db"
        for way in ("gathered", "layered", "plain"):
            assert found[f"psnr_db.{way}", name] >= asked
        others = [found[f"times_faster.{way}", name] for way in ("layered", "plain", "brute")]
        assert found["times_faster.strongest", name] == min(others)
        with_psfs = found["times_faster_with_psfs.strongest", name]
        assert with_psfs <= found["times_faster_with_psfs.plain", name]
    assert found["layers.layered", "50db"] >= found["layers.layered", "40db"]


def test_finished_pieces_are_not_measured_again(tmp_path, monkeypatch):
    """Unless the code has changed."""
    calls = []

    def measure():
        calls.append(1)
        return {"figure": 2.0}

    kept = Kept(tmp_path / "pieces.jsonl")
    for _ in range(2):
        assert photos.once(kept, "piece", measure) == {"figure": 2.0}
    assert len(calls) == 1
    photos.once(kept, "another", measure)
    monkeypatch.setattr(photos, "code_of", lambda folder: "a line was changed")
    photos.once(kept, "piece", measure)
    assert len(calls) == 3
