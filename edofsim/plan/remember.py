"""Estimates that outlive the process: a scene and camera that were looked at once are planned at once."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import platformdirs
import torch

from ..capture.photo import PHOTO_MODEL_VERSION
from .effect import Effect, Level
from .effects import EFFECTS
from .estimate import Estimate, Estimates, Progress, estimate, levels_of
from .facts import Facts

VERSION = 16
"""Raised when the same view and camera would be estimated otherwise."""
KEPT = 200
"""Estimates that are kept; those used longest ago go first."""


def remembered(
    facts: Facts,
    effects: Sequence[Effect],
    more: Mapping[str, Level] | None = None,
    progress: Progress | None = None,
) -> Estimates:
    """`estimate`, or what it found before. Where nothing can be written, it is estimated each time."""
    path = _folder() / f"{_key(facts, effects, more or {})}.json"
    known = _read(path, facts, effects, more)
    if known is not None:
        return known
    found = estimate(facts, effects, more, progress)
    content = {
        "rows": [
            {
                "labels": [level.label for level in row.levels],
                "errors": row.errors,
                "images": row.images,
                "absent": row.absent,
            }
            for row in found.rows
        ],
        "products": found.products.tolist(),
    }
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(json.dumps(content), encoding="utf-8")
        temporary.replace(path)
        oldest = sorted(path.parent.glob("*.json"), key=lambda each: each.stat().st_mtime)[:-KEPT]
        for each in oldest:
            each.unlink(missing_ok=True)
    except OSError:
        with suppress(OSError):
            temporary.unlink()
    return found


def _read(
    path: Path, facts: Facts, effects: Sequence[Effect], more: Mapping[str, Level] | None
) -> Estimates | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = []
        for effect, row in zip(effects, content["rows"], strict=True):
            absent, levels = levels_of(facts, effect, more)
            if absent != row["absent"] or [level.label for level in levels] != row["labels"]:
                return None
            errors = tuple(tuple(float(e) for e in level) for level in row["errors"])
            rows.append(Estimate(effect, absent, levels, errors, tuple(row["images"])))
        size = len(content["products"])
        products = torch.tensor(content["products"], dtype=torch.float64).reshape(size, size)
        os.utime(path)
        return Estimates(tuple(rows), products)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _folder() -> Path:
    return Path(platformdirs.user_cache_dir("edofsim", appauthor=False)) / "plans"


def _key(facts: Facts, effects: Sequence[Effect], more: Mapping[str, Level]) -> str:
    said = {
        "version": [VERSION, PHOTO_MODEL_VERSION],
        "camera": facts.camera.recipe.model_dump(mode="json", exclude={"name", "purpose"}),
        "effects": [[effect.name, EFFECTS.code_of(effect.name)] for effect in effects],
        "more": {name: [level.label, repr(level.change)] for name, level in more.items()},
        "rendering": [facts.shorter, facts.plain_glass, facts.final, facts.grain],
        "margin_px": [facts.view.height, facts.view.width, facts.view.margin],
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode())
    height = facts.camera.height_map
    for tensor in (facts.view.radiance, facts.view.inverse_depth, facts.view.pixel, height):
        if tensor is not None:
            digest.update(tensor.detach().cpu().contiguous().numpy())
    file = getattr(facts.camera.recipe.mask, "file", None)
    if file is not None and (facts.camera.base / file).is_file():
        digest.update((facts.camera.base / file).read_bytes())
    return digest.hexdigest()[:32]
