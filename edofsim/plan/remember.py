"""Estimates that outlive the process: a scene and camera that were looked at once are planned at once."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import torch

from ..core.progress import Progress
from ..core.sources import code_of_rooms
from ..core.store import Store, user_folder
from ..optics.cache import identity
from ..recipe.kinds import SENSOR_EFFECTS
from .effect import Effect, Level, decibels
from .effects import EFFECTS
from .estimate import Estimate, Estimates, estimate, levels_of
from .facts import Facts

ROOMS = ("capture", "core", "optics", "plan", "recipe", "render")
"""Folders whose code decides what is estimated: another line of it, and estimates are made anew."""
KEPT = 200
"""Estimates that are kept; those used longest ago go first."""


def remembered(
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level] | None = None,
    asked: Collection[str] | None = None,
    progress: Progress | None = None,
) -> Estimates:
    """`estimate`, or what it found before. Where nothing can be written, it is estimated each time."""
    if asked is not None and not asked:
        return estimate(facts, effects, more, asked)
    key = _key(facts, effects, more or {}, asked)
    kept = Store("{}.json", lambda path: _read(path, facts, effects, more), _write, most_files=KEPT)
    known = kept.find(key, _folder())
    if known is not None:
        return known
    found = estimate(facts, effects, more, asked, progress)
    kept.keep(key, found, _folder())
    return found


def _write(found: Estimates, path: Path) -> None:
    names = ("errors", "images", "absent", "asked")
    rows = [
        {"levels": list(map(_named, row.levels)), **{name: getattr(row, name) for name in names}}
        for row in found.rows
    ]
    path.write_text(json.dumps({"rows": rows, "products": found.products.tolist()}), encoding="utf-8")


def _read(
    path: Path,
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level] | None,
) -> Estimates:
    content = json.loads(path.read_text(encoding="utf-8"))
    rows = []
    for effect, row in zip(effects, content["rows"], strict=True):
        absent, levels = levels_of(facts, effect, more)
        by_name = {_named(level): level for level in levels}
        if absent != row["absent"] or not by_name.keys() >= set(row["levels"]):
            raise ValueError("of other levels")
        levels = tuple(by_name[name] for name in row["levels"])
        errors = tuple(tuple(float(e) for e in level) for level in row["errors"])
        rows.append(Estimate(effect, absent, levels, errors, tuple(row["images"]), row["asked"]))
    size = len(content["products"])
    products = torch.tensor(content["products"], dtype=torch.float64).reshape(size, size)
    return Estimates(tuple(rows), products)


def _named(level: Level) -> str:
    """Its label and what it changes: two layers that a user insists on may be labelled as a plan's own."""
    return f"{level.label}: {level.change!r}"


def _folder() -> Path:
    return user_folder() / "plans"


def _key(
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level],
    asked: Collection[str] | None,
) -> str:
    said = {
        "code": code_of_rooms(*ROOMS),
        "optics": identity(facts.camera),
        "sensor": [SENSOR_EFFECTS.code_of(effect.kind) for effect in facts.camera.recipe.sensor.effects],
        "view": facts.fingerprint,
        "camera": facts.camera.recipe.model_dump(mode="json", exclude={"name", "purpose"}),
        "effects": [[effect.name, EFFECTS.code_of(effect.name)] for effect in effects],
        "more": {name: _named(level) for name, level in more.items()},
        "asked": None if asked is None else sorted(asked),
        "most_db": round(decibels(facts.allowed), 3),
        "rendering": [facts.bounce_errors, facts.glass_error, facts.view.noise, facts.noise_ratio],
        "frame": [facts.view.height, facts.view.width, facts.view.margin, facts.view.axis_px],
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode())
    digest.update(facts.response.numpy().tobytes())
    return digest.hexdigest()[:32]
