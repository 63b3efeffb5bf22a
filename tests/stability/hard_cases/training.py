"""Hard steps of training: they end finite, or stop and say where the last good state is."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import torch

from edofsim.errors import EdofsimError
from edofsim.learn import train, trainer
from edofsim.learn.setup import Setup
from edofsim.learn.system import Draw, Planes
from edofsim.learn.workers import Workers
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe
from edofsim.restore.checkpoint import load_arrays, load_checkpoint, save_checkpoint
from edofsim.restore.network import apply_network, build_network
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import distance
from edofsim.stability.views import uniform

STEPS = 3


def small(**changes: object) -> Loaded[TrainRecipe]:
    """A training of three steps on the pictures of scikit-image. changes: tables of the recipe."""
    tables: dict[str, object] = {
        "name": "hard",
        "camera": "paper-clear",
        "seed": 1,
        "device": "cpu",
        "mask": {"kind": "height-map", "pitch_um": 100.0},
        "psf": {"window_px": 16, "oversampling": 1, "pupil_sampling_um": 21.0},
        "data": {"patch_px": 16, "validation_patches": 2, "sources": [{"kind": "packaged"}]},
        "optimiser": {"steps": STEPS, "batch": 2, "precision": "float32"},
        "journal": {"log_every": 1, "save_every": 1, "validate_every": 100, "pictures_every": 100},
    }
    for table, values in changes.items():
        known = tables.get(table)
        if isinstance(known, dict) and isinstance(values, dict):
            tables[table] = {**known, **values}
        else:
            tables[table] = values
    return Loaded(TrainRecipe.model_validate(tables), Path("hard.toml"), "")


def _losses(folder: Path) -> list[float]:
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


def _finite(**changes: dict[str, object]) -> Callable[[], Iterator[Finding]]:
    """Losses and weights stay finite over the steps."""

    def check() -> Iterator[Finding]:
        def run(precision: str) -> float:
            how = {**changes, "optimiser": {**changes.get("optimiser", {}), "precision": precision}}
            with TemporaryDirectory() as folder:
                trained = train(small(**how), Path(folder) / "out")
                checkpoint = load_checkpoint(trained.checkpoint)  # refuses what is not finite
                losses = _losses(Path(folder) / "out")
            ended = checkpoint.card["step"] == STEPS and all(map(math.isfinite, losses))
            return 0.0 if ended else math.nan

        yield timed("joint, float32", 0.0, lambda: run("float32"))
        yield timed("joint, mixed", 0.0, lambda: run("bfloat16"))

    return check


def _nan_in_one_sample() -> Iterator[Finding]:
    """The second batch holds a NaN: the training stops there, its state before it is kept and finite."""
    draw_batch = trainer.draw_batch

    def poisoned(setup: Setup, step: int, workers: Workers, part: int = 0) -> Draw:
        draw = draw_batch(setup, step, workers, part)
        if step == 1:
            assert isinstance(draw.scenes, Planes)
            draw.scenes.sharp[0, 0, 5, 5] = torch.nan
        return draw

    def run() -> float:
        with TemporaryDirectory() as folder, patch.object(trainer, "draw_batch", poisoned):
            try:
                train(small(), Path(folder) / "out")
            except EdofsimError as error:
                load_arrays(Path(folder) / "out" / "nan-state.safetensors", "state")
                return 0.0 if "step 1" in str(error) else 1.0
        return 1.0

    yield timed("joint, float32, message", 0.0, run)


def _resumed() -> Iterator[Finding]:
    """Stopped after each step in turn, then gone on with: the same losses as without a stop."""
    draw_batch = trainer.draw_batch
    with TemporaryDirectory() as folder:
        train(small(), Path(folder) / "straight")
        straight = _losses(Path(folder) / "straight")
    for stop in range(1, STEPS):

        def run(stop: int = stop) -> float:
            class Killed(Exception):
                pass

            def dying(setup: Setup, step: int, workers: Workers, part: int = 0) -> Draw:
                if step == stop:
                    raise Killed
                return draw_batch(setup, step, workers, part)

            with TemporaryDirectory() as folder:
                out = Path(folder) / "out"
                with patch.object(trainer, "draw_batch", dying), suppress(Killed):
                    train(small(), out)
                train(small(), out, resume=True)
                losses = _losses(out)
            return max(abs(a - b) for a, b in zip(losses, straight, strict=True))

        yield timed(f"killed in step {stop}, float32", 0.0, run)


def _dead_channels() -> Iterator[Finding]:
    """A network whose weights shrank to 1e-40: its checkpoint holds zeros, and restores the same picture."""
    for kind in ("dcnn", "local-unet", "filter-bank"):

        def kept(kind: str = kind) -> float:
            torch.manual_seed(0)
            network = build_network(kind).eval()
            with torch.no_grad():
                next(network.parameters()).mul_(1e-39)
            photo = uniform(3, 12, 12).float()
            before = apply_network(network, photo)
            with TemporaryDirectory() as folder:
                path = save_checkpoint(Path(folder) / "dead.safetensors", network, {"name": "dead"})
                arrays, _ = load_arrays(path, "checkpoint")
                after = apply_network(load_checkpoint(path).network, photo)
            sizes = torch.cat([value.abs().flatten() for name, value in arrays.items() if "weight" in name])
            left = (sizes > 0) & (sizes < torch.finfo(torch.float32).tiny)
            return distance(after, before) + float(left.sum())

        yield timed(f"{kind}, float32", 1e-6, kept)


CASES: tuple[Case, ...] = (
    Case(
        "dead channels",
        "training",
        "weights that decayed to 1e-40",
        "arithmetic a hundred times slower",
        "zeros in their place, the same picture",
        _dead_channels,
    ),
    Case(
        "NaN in one sample",
        "training",
        "a batch with a broken pixel",
        "weights that are NaN for ever",
        "a stop, the last good state kept",
        _nan_in_one_sample,
    ),
    Case(
        "slope of 1e8",
        "training",
        "a loss a hundred million times too steep",
        "weights that overflow",
        "finite weights",
        _finite(loss={"alpha": 1e8}),
    ),
    Case(
        "no noise",
        "training",
        "read noise 0, heights exact",
        "division by noise",
        "finite weights",
        _finite(capture={"read_noise": [0.0, 0.0]}, doe={"height_noise_nm": 0.0}),
    ),
    Case(
        "much noise",
        "training",
        "read noise of half of full scale",
        "clamps without slope",
        "finite weights",
        _finite(capture={"read_noise": [0.5, 0.5]}),
    ),
    Case(
        "learning rate 10",
        "training",
        "steps far too long",
        "weights that overflow",
        "finite weights",
        _finite(optimiser={"learning_rate": 10.0}),
    ),
    Case(
        "killed in any step",
        "training",
        "a power cut",
        "a step lost or done twice",
        "the same losses, bit for bit",
        _resumed,
    ),
)
