"""The training loop: draw, photograph, restore, judge, step; saved so that nothing of it can be lost."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor, nn

from .. import __version__
from ..core.interrupts import stoppable
from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import EdofsimError, InputError
from ..recipe.load import Loaded
from ..recipe.train import TrainRecipe
from ..restore.checkpoint import save_arrays, save_checkpoint
from .design import design
from .journal import Journal
from .schedule import fraction_done, generator_of, rate_factor
from .setup import Given, Setup, prepare
from .state import Position, load_state, save_state
from .system import Draw, JudgedPhotos
from .workers import Workers, join_workers

DRAWS, NOISE, VALIDATION = range(3)  # purposes of random numbers
DESIGN_TRUNCATED_ENERGY = 0.5  # one part in 100 of the light against half a part in 100 of the linear error
NO_GRADIENT = 100  # updates on end after which a training is given up
TEST_NOISE = 0.005  # read noise of the validation photos, as in the paper's tests


@dataclass(frozen=True)
class Trained:
    """checkpoint: what the training gave.
    figures: flat, as for --json.
    outputs: all files written.
    finished: False where it was stopped before its end and can be resumed.
    """

    checkpoint: Path
    figures: Mapping[str, float]
    outputs: tuple[Path, ...]
    finished: bool = True


@dataclass
class _Loop:
    """What the steps share."""

    setup: Setup
    wrapped: nn.Module
    optimiser: torch.optim.Optimizer
    position: Position
    workers: Workers
    out: Path
    limit: float | None
    started: float = field(default_factory=lambda: time.perf_counter())
    before: float = 0.0
    without_gradient: int = 0

    def seconds(self) -> float:
        return self.before + time.perf_counter() - self.started

    def fraction(self) -> float:
        steps = self.setup.recipe.optimiser.steps
        return self.workers.agree(fraction_done(self.position.step, steps, self.seconds(), self.limit))


def train(
    loaded: Loaded[TrainRecipe],
    out: Path,
    *,
    data: Path | None = None,
    resume: bool = False,
    max_minutes: float | None = None,
    device: str = "auto",
    cache: Path | None = None,
    progress: Progress | None = None,
    given: Given | None = None,
) -> Trained:
    """Follow a recipe; writes OUT/NAME.safetensors, OUT/state.safetensors, OUT/log.jsonl, OUT/pictures.

    data: folder of photographs for sources that name none.
    resume: go on from OUT/state.safetensors, to the same bytes as without the interruption (float32, CPU,
        same number of threads).
    max_minutes: end after this much time, with the decay of the learning rate fitted to it.
    device: auto, cpu, cuda.
    cache: of rendered views.
    given: in place of what the recipe names, see `fit`.
    loaded: the recipe, and the file that it was read from.
    out: folder of what is written.
    progress: is called with the part that is done, 0 to 1, and what is being done.

    Under `torchrun` every process takes its share of the batch. Ctrl-C saves and returns with `finished`
    False. Raises InputError for what cannot be used, EdofsimError where the disk refuses or the loss is no
    longer finite: then OUT/nan-state.safetensors holds the weights before that step and
    OUT/nan-batch.safetensors its photos.
    """
    with join_workers(device, loaded.recipe.device) as workers, _denormals_flushed():
        setup = prepare(loaded, data, workers, cache, progress, given)
        return _train(setup, out, workers, resume, max_minutes, progress)


def _train(
    setup: Setup,
    out: Path,
    workers: Workers,
    resume: bool,
    max_minutes: float | None,
    progress: Progress | None,
) -> Trained:
    recipe, state = setup.recipe, out / "state.safetensors"
    optimiser = _optimiser(setup)
    kept = recipe.doe.learning_rate_rad == 0
    position = Position()
    if resume:
        position = load_state(state, setup.system, optimiser, _plain(recipe), setup.data.sha256)
    elif state.exists():
        raise InputError(
            f"{state}: a training is here already; add --resume to go on, or choose another --out"
        )
    else:
        if recipe.doe.design_steps and recipe.doe.learn:
            _design(setup, progress)
        if setup.pool is None:
            setup.system.set_initial_psfs(sum(recipe.capture.read_noise) / 2)
    setup.system.mask.requires_grad_(not kept)
    limit = max_minutes * 60 if max_minutes else None
    wrapped = workers.wrap(setup.system, partly=recipe.optimiser.network_steps > 1)
    loop = _Loop(setup, wrapped, optimiser, position, workers, out, limit, before=position.seconds)
    opened = Journal(out, position.step) if workers.first else nullcontext()
    figures: dict[str, float] = {}
    path = out / f"{recipe.name}.safetensors"
    with opened as journal, stoppable() as stop:
        if workers.first and setup.judged_at_start and position.step == 0:
            validate(setup, journal, 0)  # what it starts from
        try:
            finished = _steps(loop, journal, stop, progress)
        except torch.OutOfMemoryError:
            raise EdofsimError("the GPU's memory is too small; use a smaller batch or patch") from None
        position.seconds = loop.seconds()
        if workers.first:
            _save(loop)  # first of all: who stops a training may not wait for more
            figures |= validate(setup, journal, position.step)
            save_result(setup, path, position, figures)
            figures |= journal.before() if journal is not None else {}
    figures |= {"steps": float(position.step), "seconds.training": position.seconds}
    pictures = tuple(sorted((out / "pictures").glob("*.png"))[-2:])
    return Trained(path, figures, (path, state, out / "log.jsonl", *pictures), finished)


def _design(setup: Setup, progress: Progress | None) -> None:
    """The mask alone first; every worker comes to the same mask by the same steps."""
    recipe, system = setup.recipe, setup.system
    if not list(system.mask.parameters()):
        raise InputError("doe.design_steps: this mask has nothing to design; choose another mask, or 0 steps")
    design(
        system.mask,
        system.optics,
        recipe.doe.design_steps,
        recipe.capture.inverse_depth_per_m,
        error=lambda psf, filters: system.network.linear_error(system.as_wanted(psf), filters),
        groups=system.network.groups,
        broadband=recipe.doe.design_broadband,
        wanted_db=recipe.doe.design_wanted_db,
        height_noise=recipe.doe.height_noise_nm * 1e-9,
        truncated_energy=DESIGN_TRUNCATED_ENERGY,
        seed=recipe.seed,
        progress=progress,
    )


def _steps(loop: _Loop, journal: Journal | None, stop: list[int], progress: Progress | None) -> bool:
    """Steps until the end (True) or a signal (False)."""
    setup, every = loop.setup, loop.setup.recipe.journal
    recent: list[Tensor] = []
    while (fraction := loop.fraction()) < 1:
        if loop.workers.agree(float(bool(stop))) > 0:
            return False
        outcome = _step(loop, fraction)
        loop.position.step += 1
        step = loop.position.step
        recent.append(outcome.loss.detach())
        if step % every.log_every == 0 and journal is not None:
            loss = float(torch.stack(recent).mean())
            recent.clear()
            rate = loop.optimiser.param_groups[0]["lr"]
            journal.write(step=step, loss=loss, learning_rate=rate, seconds=round(loop.seconds(), 2))
            if progress:
                progress(fraction, f"step {step}, loss {loss:.4f}")
        if not loop.workers.first:
            continue
        if step % every.pictures_every == 0 and journal is not None:
            rows = [[outcome.ideal[0], outcome.photo[0], outcome.restored[0]]]
            journal.picture(step, [[image.detach() for image in row] for row in rows], setup.maps().height)
        if step % every.save_every == 0:
            loop.position.seconds = loop.seconds()
            _save(loop)
        if step % every.validate_every == 0 and journal is not None:
            figures = validate(setup, journal, step)
            at = Position(step, loop.seconds())
            save_result(setup, loop.out / f"{setup.recipe.name}.safetensors", at, figures)
    return True


def _step(loop: _Loop, fraction: float) -> JudgedPhotos:
    """One update of the mask, and as many of the network as the recipe says."""
    settings = loop.setup.recipe.optimiser
    factor = rate_factor(fraction, settings.decay, settings.warmup, settings.final_rate)
    for group in loop.optimiser.param_groups:
        group["lr"] = group["full_rate"] * factor
    frozen = fraction >= 1 - settings.frozen_statistics
    first = _update(loop, draw_batch(loop.setup, loop.position.step, loop.workers), frozen)
    for part in range(1, settings.network_steps):
        draw = draw_batch(loop.setup, loop.position.step, loop.workers, part)
        if first.psf is not None and loop.setup.pool is None:
            draw = replace(draw, scenes=draw.scenes.reusing(first.psf, first.broadband))
        _update(loop, draw, frozen)
    return first


def _update(loop: _Loop, draw: Draw, frozen: bool) -> JudgedPhotos:
    """One step of the optimiser for all that the loss depends on. frozen: the running means stay."""
    setup = loop.setup
    loop.wrapped.train()
    if frozen:
        for module in setup.system.network.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
    # a batch that is not finite spoils the running means before its loss is known
    means = [buffer.clone() for buffer in setup.system.network.buffers()]
    outcome = loop.wrapped(draw)
    loop.optimiser.zero_grad(set_to_none=True)
    outcome.loss.backward()
    parameters = [p for group in loop.optimiser.param_groups for p in group["params"] if p.grad is not None]
    size = torch.stack([p.grad.square().sum() for p in parameters]).sum() + outcome.loss.detach()
    # one number that is not finite where any is; all workers stop together
    if not math.isfinite(loop.workers.agree(float(size))):
        with torch.no_grad():
            for buffer, before in zip(setup.system.network.buffers(), means, strict=True):
                buffer.copy_(before)
        _give_up(loop, outcome)
    weights = [p for p in setup.system.network.parameters() if p.grad is not None]
    clip = setup.recipe.optimiser.clip_gradient or math.inf
    length = float(nn.utils.clip_grad_norm_(weights, clip)) if weights else math.inf
    loop.without_gradient = loop.without_gradient + 1 if length == 0 else 0
    if loop.without_gradient >= NO_GRADIENT:  # in all workers alike, as their gradients are
        raise EdofsimError(
            f"step {loop.position.step}: the network has had no gradient for {NO_GRADIENT} updates: all that "
            "it gives is black or beyond full scale, and nothing will change; start anew with a lower "
            "optimiser.learning_rate, or with optimiser.clip_gradient"
        )
    loop.optimiser.step()
    return outcome


def draw_batch(setup: Setup, step: int, workers: Workers, part: int = 0) -> Draw:
    """What a step photographs, in each of its parts: the same for the same seed, step and worker."""
    recipe, where = setup.recipe, workers.rank + (part << 16)
    generator = generator_of(recipe.seed, DRAWS, step, where)
    count = workers.share(recipe.optimiser.batch)
    scenes = setup.data.draw(count, generator)
    noise = generator_of(recipe.seed, NOISE, step, where, setup.device)
    if setup.pool is not None:
        camera = setup.pool.camera(recipe.seed, step)
        return Draw(scenes, torch.full((count,), camera.read_noise), noise, camera)
    low, high = recipe.capture.read_noise
    read_noise = low + (high - low) * torch.rand(count, generator=generator)
    return Draw(scenes, read_noise, noise)


@torch.no_grad()
def validate(setup: Setup, journal: Journal | None, step: int) -> dict[str, float]:
    """PSNR and loss of the validation patches, the same photos and noise each time; PSNR by source too, see
    `TrainingData`."""
    system = setup.system
    was_training = system.training
    system.eval()
    scores: dict[str, list[Tensor]] = {}
    losses: list[Tensor] = []
    photos: list[Tensor] = []
    for index, (source, scenes) in enumerate(setup.data.validation):
        generator = generator_of(setup.recipe.seed, VALIDATION, index, 0, setup.device)
        noise, camera = TEST_NOISE, None
        if setup.pool is not None:
            camera = setup.pool.validation[index % len(setup.pool.validation)]
            noise = camera.read_noise
        outcome = system(Draw(scenes, torch.tensor([noise]), generator, camera))
        scores.setdefault(source, []).append(_psnr(outcome.restored, outcome.ideal))
        photos.append(_psnr(outcome.photo, outcome.ideal))
        losses.append(outcome.loss)
    system.train(was_training)
    every = [score for found in scores.values() for score in found]
    figures = {
        "validation_loss": float(torch.stack(losses).mean()),
        "psnr_db.validation": float(torch.cat(every).mean()),
        "psnr_db.validation_photo": float(torch.cat(photos).mean()),
    }
    for source, found in scores.items():
        figures[f"psnr_db.validation.{source}"] = float(torch.cat(found).mean())
    if journal is not None:
        journal.write(step=step, **figures)
    return figures


def _psnr(image: Tensor, ideal: Tensor) -> Tensor:
    """Of each image [batch, 3, y, x]; [batch], in dB."""
    return -10 * (image - ideal).square().mean((1, 2, 3)).log10()


def save_result(setup: Setup, path: Path, position: Position, figures: Mapping[str, float]) -> Path:
    """The checkpoint with its card."""
    card: Json = {
        "name": setup.recipe.name,
        "camera": setup.camera.model_dump(mode="json", exclude={"schema_"}),
        "recipe": _for_card(setup.recipe),
        "data": {"sources": list(setup.data.described), "sha256": setup.data.sha256},
        "versions": {"edofsim": __version__, "torch": torch.__version__},
        "seed": setup.recipe.seed,
        "step": position.step,
        "hours": round(position.seconds / 3600, 1),
        "figures": dict(figures),
    }
    if setup.history:
        card["history"] = list(setup.history)
    if setup.auxiliary:
        card["auxiliary"] = list(setup.auxiliary)
    setup.system.store_final_psfs()
    maps, how = setup.maps(), {"sampling": setup.sampling}
    return save_checkpoint(path, setup.system.network, card, **how, **maps._asdict())


def _optimiser(setup: Setup) -> torch.optim.Optimizer:
    """Adam with a rate for the network and one for a mask that learns; its values do not decay."""
    settings, doe = setup.recipe.optimiser, setup.recipe.doe
    groups: list[Json] = []
    network, mask = (list(module.parameters()) for module in (setup.system.network, setup.system.mask))
    groups.append(
        {"params": network, "full_rate": settings.learning_rate, "weight_decay": settings.weight_decay}
    )
    if mask and doe.learning_rate_rad > 0:
        groups.append({"params": mask, "full_rate": doe.learning_rate_rad, "weight_decay": 0.0})
    return torch.optim.Adam(groups, lr=settings.learning_rate, betas=settings.betas)


def _give_up(loop: _Loop, outcome: JudgedPhotos) -> None:
    """Keep what a person needs to find out why the loss is no longer finite, and say where."""
    state, batch = loop.out / "nan-state.safetensors", loop.out / "nan-batch.safetensors"
    if loop.workers.first:
        _save_state(loop, state)
        images = {name: getattr(outcome, name) for name in ("photo", "restored", "ideal")}
        save_arrays(batch, images, {"step": json.dumps(loop.position.step)})
    raise EdofsimError(
        f"step {loop.position.step}: the loss or its gradient is not finite; the weights before it are in "
        f"{state}, its photos in {batch}; lower the learning rates and start anew"
    )


def _save(loop: _Loop) -> None:
    loop.setup.system.select_psfs(broadband=False)
    _save_state(loop, loop.out / "state.safetensors")


def _save_state(loop: _Loop, path: Path) -> None:
    setup = loop.setup
    save_state(path, setup.system, loop.optimiser, loop.position, _plain(setup.recipe), setup.data.sha256)


def _plain(recipe: TrainRecipe) -> Json:
    return recipe.model_dump(mode="json", by_alias=True)


def _for_card(recipe: TrainRecipe) -> Json:
    """The recipe for a card: of a file that something started from, its name, not its folder on this disk."""
    plain = _plain(recipe)
    network, doe = plain["network"], plain["doe"]
    for table, key in ((network, "start"), (network, "auxiliary"), (doe, "start")):
        if table[key] is not None:
            table[key] = Path(table[key]).name
    return plain


@contextmanager
def _denormals_flushed() -> Generator[None]:
    """Numbers below the normal range count as 0: channels that die shrink into it, and steps took ten times
    as long. Threads that are started within inherit the setting."""
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
