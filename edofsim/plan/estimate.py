"""What leaving out each effect costs in accuracy: measured on the sample, effect by effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..capture.fidelity import Fidelity
from ..core.progress import Progress
from .effect import Effect, Errors, Level
from .facts import Facts, rms
from .sample import FINEST_LAYERS

References = dict[tuple[Fidelity, bool], Tensor]
"""Photos of the sample, by fidelity and whether fragments were moved to the depth nodes."""

NARROW = 64
"""Side of the PSFs in pixels while other effects than their window are measured, where they are no wider."""
LOST = 0.01
"""Fraction of the light beyond that window from which on PSFs count as wider."""


@dataclass(frozen=True)
class Estimate:
    """One effect. absent: why scene or camera do not have it, or empty; levels: from left out to full;
    errors: of each level, per channel; images: [level] rows of `Estimates.products`, -1 for none."""

    effect: Effect
    absent: str
    levels: tuple[Level, ...]
    errors: tuple[Errors, ...]
    images: tuple[int, ...]

    @property
    def full(self) -> int:
        """Number of the level that leaves nothing out."""
        return len(self.levels) - 1


@dataclass(frozen=True)
class Estimates:
    """All effects. products: [image, image], mean over pixels and channels of the product of two difference
    images, so that errors of several effects together are sums over it, with their correlation."""

    rows: tuple[Estimate, ...]
    products: Tensor

    def by_name(self) -> Mapping[str, Estimate]:
        return {row.effect.name: row for row in self.rows}

    def total(self, chosen: Mapping[str, int]) -> float:
        """Root mean square error of the photo with these levels of the effects."""
        images, noise, bias = [], 0.0, 0.0
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
        pairs = self.products[images][:, images].sum() if images else torch.zeros(())
        return float((pairs + noise).clamp_min(0).sqrt()) + bias

    def moot(self, row: Estimate, chosen: Mapping[str, int]) -> bool:
        """Whether an effect does not matter because the one that it is a part of is left out, or moot."""
        if row.effect.within not in chosen:
            return False
        whole = self.by_name()[row.effect.within]
        return (chosen[row.effect.within] == 0 and whole.full > 0) or self.moot(whole, chosen)


def estimate(
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level] | None = None,
    progress: Progress | None = None,
) -> Estimates:
    """Measure every level of every effect that scene and camera have.

    more: by effect, one more level, which the user insists on.
    """
    rows: list[Estimate] = []
    differences: list[Tensor] = []
    references: References = {}
    for number, effect in enumerate(effects):
        if progress:
            progress(number / len(effects), f"estimating {effect.name}")
        absent, levels = levels_of(facts, effect, more)
        if len(levels) == 1 or effect.error is not None:
            measured = effect.error if len(levels) > 1 else None
            errors = tuple(measured(facts, level) if measured else _nothing(facts) for level in levels)
            rows.append(Estimate(effect, absent, levels, errors, (-1,) * len(levels)))
            continue
        errors_found, images = [], []
        for difference in _differences(facts, effect, levels[:-1], references):
            errors_found.append(rms(difference))
            images.append(len(differences))
            differences.append(difference.flatten())
        errors_found.append(_nothing(facts))
        rows.append(Estimate(effect, absent, levels, tuple(errors_found), (*images, -1)))
    facts.sample.forget()
    rows = _add_nested_effects(rows, differences)
    stack = torch.stack(differences) if differences else torch.zeros(0, 1)
    return Estimates(tuple(rows), (stack @ stack.T).double() / len(facts.sample.response))


def _add_nested_effects(rows: Sequence[Estimate], differences: list[Tensor]) -> list[Estimate]:
    """Effects that are left out with another, which was measured without them, err on top of it: their
    differences are added to that one's."""
    found = {row.effect.name: row for row in rows}
    for row in rows:
        if not row.effect.beside or row.images[0] < 0:
            continue
        name = row.effect.within
        while name in found and found[name].full and found[name].images[0] >= 0:
            whole = found[name]
            place = whole.images[0]
            differences[place] = differences[place] + differences[row.images[0]]
            error = rms(differences[place].reshape(len(whole.errors[0]), -1))
            found[name] = replace(whole, errors=(error, *whole.errors[1:]))
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


def _differences(
    facts: Facts, effect: Effect, levels: Sequence[Level], references: References
) -> list[Tensor]:
    """The sample with each level minus the sample in full, the rest as the effect's sample says.

    references: the sample in full as effects before this one asked for it, which this one adds to.
    """
    found = []
    for level in levels:
        usual = {"layers": 7, "window_px": _narrow(facts), "pupil_sampling_um": facts.quick_pupil_um}
        usual |= {"sub_apertures": 1, "snapped": False}
        how = {**usual, **effect.sample, **level.sample}
        snapped = how.pop("snapped")
        rest = facts.full.changed(how)
        if facts.full.occlusion == "none":
            rest = replace(rest, occlusion="none")
        if (rest, snapped) not in references:
            references[rest, snapped] = facts.sample.photo(rest, snapped)
        photo = facts.sample.photo(rest.changed(_photo_fields(level)), snapped)
        found.append((photo - references[rest, snapped]) * _beyond(facts, level))
    return found


def _narrow(facts: Facts) -> int | None:
    if facts.camera.recipe.psf.window_px <= NARROW:
        return None
    plain = facts.full.changed({"band_groups": 1, "group_wavelengths": 1})
    return NARROW if facts.sample.narrow(plain, NARROW, LOST) else None


def _photo_fields(level: Level) -> dict[str, object]:
    return {key: value for key, value in level.change.items() if key != "hidden_surfaces"}


def _beyond(facts: Facts, level: Level) -> float:
    """Linear interpolation errs with the square of the step: what the sample's own finest layers lack."""
    layers = None if level.sample else level.change.get("layers")
    if not layers or facts.sample.depths is not None or layers >= FINEST_LAYERS:
        return 1.0
    return 1 / (1 - ((layers - 1) / (FINEST_LAYERS - 1)) ** 2)


def _nothing(facts: Facts) -> Errors:
    return (0.0,) * len(facts.sample.response)
