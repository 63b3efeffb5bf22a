"""Scores of deep scenes: what they are kept as, and as figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..record import write_csv
from .protocols import LENS_ALONE, OURS, WAYS

WHOLE, NEAR_EDGES, AWAY = "whole", "near edges", "away from edges"


@dataclass(frozen=True)
class SceneScore:
    """One score. image: photo, restored or wiener; region: `whole`, `near edges`, `away from edges`, `depth`
    with near_m <= depth < far_m, or another part by its name. light_error: see `restore.scores`."""

    scene: str
    way: str
    system: str
    image: str
    region: str
    near_m: float
    far_m: float
    psnr_db: float
    ssim: float
    pixels: int
    light_error: float


@dataclass(frozen=True)
class Measured:
    """A finished scene: its scores, and facts (sizes, shares, noise, seconds)."""

    scene: str
    rows: tuple[SceneScore, ...]
    facts: Mapping[str, float]

    def score(self, way: str, system: str, image: str, region: str = WHOLE) -> SceneScore | None:
        """The row of that name; None where the scene has none, such as a scene without edges."""
        wanted = (way, system, image, region)
        found = (row for row in self.rows if (row.way, row.system, row.image, row.region) == wanted)
        return next(found, None)

    def gain(self, way: str, system: str, region: str = WHOLE) -> float:
        """PSNR in dB of what the system restored above that of the lens alone; NaN where either lacks."""
        restored = self.score(way, system, "restored", region)
        alone = self.score(way, LENS_ALONE, "photo", region)
        return math.nan if restored is None or alone is None else restored.psnr_db - alone.psnr_db


@dataclass(frozen=True)
class SceneScores:
    """All finished scenes in order, and what was wrong with those that could not be finished, by name."""

    measured: tuple[Measured, ...]
    failed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def figures(outcome: SceneScores, networks: Sequence[str]) -> dict[str, float]:
    """Flat: psnr_db, ssim and light_error .SCENE.WAY.IMAGE, gain_db.SCENE.WAY.NETWORK, SCENE also `mean`;
    IMAGE is lens_alone, NETWORK, NETWORK.photo or NETWORK.wiener. networks: names of the systems."""
    found: dict[str, float] = {}
    for way in WAYS:
        images = {LENS_ALONE: (LENS_ALONE, "photo")}
        for network in networks:
            images |= {network: (network, "restored")}
            images |= {f"{network}.{image}": (network, image) for image in ("photo", "wiener")}
        for label, (system, image) in images.items():
            rows = {m.scene: m.score(way.name, system, image) for m in outcome.measured}
            for measure in ("psnr_db", "ssim", "light_error"):
                values = {scene: getattr(row, measure) for scene, row in rows.items() if row is not None}
                found |= _with_mean(
                    values, lambda scene, m=measure, w=way, i=label: f"{m}.{scene}.{w.name}.{i}"
                )
        for network in networks:
            gains = {m.scene: m.gain(way.name, network) for m in outcome.measured}
            found |= _with_mean(gains, lambda scene, w=way, n=network: f"gain_db.{scene}.{w.name}.{n}")
    found["scenes"] = float(len(outcome.measured))
    found["scenes.failed"] = float(len(outcome.failed))
    return found


def mean(values: Iterable[float]) -> float:
    """Mean of the finite values; NaN where there is none."""
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.nan


def worst(outcome: SceneScores, network: str, way: str = OURS) -> Measured | None:
    """The scene whose restored picture scores least."""
    scored = [(m, row) for m in outcome.measured if (row := m.score(way, network, "restored")) is not None]
    return min(scored, key=lambda each: each[1].psnr_db, default=(None, None))[0]


def write_table(path: Path, outcome: SceneScores) -> Path:
    """All rows as CSV."""
    names = tuple(SceneScore.__dataclass_fields__)
    return write_csv(
        path, names, [[getattr(row, n) for n in names] for m in outcome.measured for row in m.rows]
    )


def _with_mean(values: Mapping[str, float], name: Callable[[str], str]) -> dict[str, float]:
    return {name(scene): value for scene, value in {**values, "mean": mean(values.values())}.items()}
