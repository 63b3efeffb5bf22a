"""What leaving out each effect costs in accuracy: effect by effect, where anything could be gained by it."""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ..core.progress import Progress
from ..core.threads import in_turns
from .effect import Effect, Errors, Level, overall
from .facts import Facts, rms
from .otfs import FINE_NODES, fine_nodes_of

CHUNK = 2**16
"""Entries of differences whose products are summed at a time, so that little memory is touched."""
FINER = 1 / 2
"""Share of the error that a photo may have: where a level errs by less, finer ones leave others little."""


@dataclass(frozen=True)
class Estimate:
    """One effect.

    absent: why scene or camera do not have it, or empty.
    levels: from left out to full, those that were looked at.
    errors: of each level, per channel.
    images: [level] rows of `Estimates.products`, -1 for none.
    asked: whether it was looked at, else full is its only level.
    """

    effect: Effect
    absent: str
    levels: tuple[Level, ...]
    errors: tuple[Errors, ...]
    images: tuple[int, ...]
    asked: bool = True

    @property
    def full(self) -> int:
        """Number of the level that leaves nothing out."""
        return len(self.levels) - 1


@dataclass(frozen=True)
class Estimates:
    """All effects.

    products: [image, image], mean over pixels and channels of the product of two difference images (see
        `Effect.differences`), so that errors of several effects together are sums over it, with their
        correlation.
    """

    rows: tuple[Estimate, ...]
    products: Tensor

    @cached_property
    def by_name(self) -> Mapping[str, Estimate]:
        return {row.effect.name: row for row in self.rows}

    @cached_property
    def _listed(self) -> list[list[float]]:
        return self.products.tolist()

    def total(self, chosen: Mapping[str, int]) -> float:
        """Root mean square error of the photo with these levels of the effects."""
        images: list[int] = []
        noise = bias = 0.0
        for row in self.rows:
            level = chosen[row.effect.name]
            if level == row.full or self.moot(row, chosen):
                continue
            if row.images[level] >= 0:
                images.append(row.images[level])
                continue
            mean_square = sum(e * e for e in row.errors[level]) / len(row.errors[level])
            if row.effect.added == "bias":
                bias += mean_square**0.5
            else:
                noise += mean_square
        pairs = sum(self._listed[one][other] for one in images for other in images)
        return max(0.0, pairs + noise) ** 0.5 + bias

    def moot(self, row: Estimate, chosen: Mapping[str, int]) -> bool:
        """Whether an effect does not matter because the one that it is a part of is left out, or moot."""
        if row.effect.within not in chosen:
            return False
        whole = self.by_name[row.effect.within]
        return (chosen[row.effect.within] == 0 and whole.full > 0) or self.moot(whole, chosen)


def estimate(
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level] | None = None,
    asked: Collection[str] | None = None,
    progress: Progress | None = None,
) -> Estimates:
    """Measure levels of the effects that scene and camera have.

    more: by effect, one more level, which the user insists on.
    asked: names of the effects that are looked at, None for all of them.

    Of levels that err by more than `Facts.allowed` few are looked at, and of those that err by little of it
    the coarsest.
    """
    rows: list[Estimate] = []
    todo: dict[int, tuple[Effect, tuple[Level, ...], bool]] = {}
    for effect in effects:
        absent, levels = levels_of(facts, effect, more)
        if asked is not None and effect.name not in asked and len(levels) > 1:
            rows.append(Estimate(effect, absent, levels[-1:], (_nothing(facts),), (-1,), asked=False))
            continue
        measured = effect.error if len(levels) > 1 else None
        errors = [measured(facts, level) if measured else _nothing(facts) for level in levels[:-1]]
        if len(levels) > 1 and effect.error is None:
            all_levels = effect.one_pass or effect.name in (more or {}) or math.isinf(facts.allowed)
            todo[len(rows)] = (effect, levels, all_levels)
        rows.append(Estimate(effect, absent, levels, (*errors, _nothing(facts)), (-1,) * len(levels)))
    differences: list[Tensor] = []
    for row, found in zip(todo, _measured(facts, list(todo.values()), progress), strict=True):
        images = range(len(differences), len(differences) + len(found))
        differences.extend(found.values())
        errors = (*map(rms, found.values()), _nothing(facts))
        levels = tuple(rows[row].levels[level] for level in found)
        rows[row] = replace(
            rows[row], levels=(*levels, rows[row].levels[-1]), errors=errors, images=(*images, -1)
        )
    rows = _add_nested_effects(rows, differences)
    return Estimates(tuple(rows), _products(differences))


def _measured(
    facts: Facts, todo: Sequence[tuple[Effect, Sequence[Level], bool]], progress: Progress | None
) -> list[Mapping[int, Tensor]]:
    """What levels of effects change, by their number, several effects at a time; each effect with whether all
    of its levels are looked at. Those of one pass begin: they are seen in coarse photos alone, and need not
    wait for spectra that another thread makes. Where PSFs of many depths take long, and others would wait for
    them, all threads make these first."""
    effects = [effect for effect, *_ in todo]
    many = fine_nodes_of(facts.camera, facts.view, facts.ends) > FINE_NODES
    if many and not all(effect.one_pass for effect in effects):
        facts.spectra.make_fine_psfs()
    found: list[dict[int, Tensor]] = [{} for _ in todo]
    lock = threading.Lock()

    def measure(number: int) -> Iterator[None]:
        effect, levels, all_levels = todo[number]
        differences = effect.differences or of_psfs
        if progress:
            with lock:
                progress(sum(map(bool, found)) / len(todo), f"estimating {effect.name}")
        if all_levels:
            found[number].update(enumerate(differences(facts, levels[:-1])))
            return
        for level in _useful(found[number], len(levels) - 1, facts.allowed):
            (found[number][level],) = differences(facts, [levels[level]])
            yield

    first = sorted(range(len(todo)), key=lambda number: not effects[number].one_pass)
    in_turns([measure(number) for number in first], torch.device("cpu"))
    return [dict(sorted(each.items())) for each in found]


def _useful(found: Mapping[int, Tensor], count: int, most: float) -> Iterator[int]:
    """Which of `count` levels to look at, each once `found` has what those before it change, from coarse to
    fine: the coarsest of all, the coarsest that errs by no more than `most`, found by halves, as a finer one
    is taken to err by less, and finer ones up to one that errs by little of it."""

    def size(level: int) -> float:
        return overall(rms(found[level]))

    yield 0
    below, enough = (-1, 0) if size(0) <= most else (0, count)
    while enough - below > 1:
        middle = (below + enough) // 2
        yield middle
        below, enough = (below, middle) if size(middle) <= most else (middle, enough)
    while enough < count:
        if enough not in found:
            yield enough
        if size(enough) <= FINER * most:
            return
        enough += 1


def _products(differences: Sequence[Tensor]) -> Tensor:
    """Mean over channels of the products of differences, [image, image]; those that were seen in other parts
    of the view are taken as independent."""
    found = torch.zeros(len(differences), len(differences), dtype=torch.float64)
    for size in {each.shape for each in differences}:
        like = [k for k, each in enumerate(differences) if each.shape == size]
        at, flat = torch.tensor(like), [differences[k].flatten() for k in like]
        for parts in zip(*(each.split(CHUNK) for each in flat), strict=True):
            stack = torch.stack(parts)
            found[at[:, None], at] += (stack @ stack.T).double() / size[0]
    return found


def of_psfs(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """What levels change that change PSFs."""
    found = []
    for level in levels:
        reference = facts.spectra.full
        if level.change.keys() & AT_FULL_PUPIL:
            reference = reference.changed({"pupil_sampling_um": None})
        found.append(facts.spectra.by_psfs(reference.changed(level.change), reference))
    return found


AT_FULL_PUPIL = {"pupil_sampling_um", "lens_dispersion"}
"""Fields that change how far a lens is out of focus, or how finely its pupil is sampled: a coarse pupil is no
reference for them."""


def _add_nested_effects(rows: Sequence[Estimate], differences: list[Tensor]) -> list[Estimate]:
    """Effects that are left out with another, which was measured without them, err on top of it: their
    differences are added to that one's."""
    found = {row.effect.name: row for row in rows}
    for row in rows:
        if not row.effect.adds_to_parent or row.images[0] < 0:
            continue
        name = row.effect.within
        while name in found and found[name].full and found[name].images[0] >= 0:
            whole = found[name]
            place = whole.images[0]
            differences[place] = differences[place] + differences[row.images[0]]
            found[name] = replace(whole, errors=(rms(differences[place]), *whole.errors[1:]))
            name = whole.effect.within
    return list(found.values())


def levels_of(
    facts: Facts, effect: Effect, more: Mapping[str, Level] | None = None
) -> tuple[str, tuple[Level, ...]]:
    """Why an effect is absent, or empty; and its levels, with the one more that the user insists on."""
    absent = effect.absent(facts)
    if absent and effect.name not in (more or {}):
        return absent, (Level("none", {}),)
    levels = list(effect.levels(facts))
    if more and effect.name in more:
        levels.insert(len(levels) - 1, more[effect.name])
    return absent, tuple(levels)


def _nothing(facts: Facts) -> Errors:
    return (0.0,) * len(facts.response)
