"""Scores of deep scenes: what they are kept as, and as figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from torch import Tensor

from ..record import write_csv
from ..render.view import View
from ..restore.gains import RIVALS, gains
from ..restore.scores import depth_ranges, light_error, score_parts, within_scale
from .failures import Failures
from .protocols import LENS_ALONE, OURS, WAYS, Capture

WHOLE, NEAR_EDGES, AWAY = "whole", "near edges", "away from edges"
FACTS = ("edges", "mean", "clipped", "noise_db", "bands", "nearest_m", "farthest_m")


@dataclass(frozen=True)
class SceneScore:
    """One score.

    image: photo, restored or wiener.
    region: `whole`, `near edges`, `away from edges`, `depth` with near_m <= depth < far_m, or another part by
        its name.
    light_error: see `restore.scores`.
    layers: of depth, of its photo.
    converged_db: how far from convergence that is (`protocols.converged_db`).
    psnr_db_se, ssim_se: standard errors by the noise of the rendering (see `restore.scores.Score`).
    """

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
    psnr_db_se: float = math.nan
    ssim_se: float = math.nan
    layers: int = 0
    converged_db: float = math.nan


@dataclass(frozen=True)
class Measured:
    """A finished scene: its scores, and by lens facts (sizes, shares, noise, seconds).

    lenses: by system, what its lens alone is called in the rows.
    problems: by system, of those that could not be judged.
    """

    scene: str
    rows: tuple[SceneScore, ...]
    facts: Mapping[str, Mapping[str, float]]
    lenses: Mapping[str, str] = field(default_factory=dict)
    problems: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def lens(self, system: str) -> str:
        """What the lens alone of a system is called."""
        return self.lenses.get(system, LENS_ALONE)

    def facts_of(self, system: str) -> Mapping[str, float]:
        """Facts of what a system photographed; NaN where it could not."""
        return self.facts.get(self.lens(system)) or dict.fromkeys(FACTS, math.nan)

    def score(self, way: str, system: str, image: str, region: str = WHOLE) -> SceneScore | None:
        """The row of that name; None where the scene has none, such as a scene without edges. The image
        `LENS_ALONE` of a system is the photo of its lens."""
        place = (self.lens(system), "photo") if image == LENS_ALONE else (system, image)
        wanted = (way, *place, region)
        found = (row for row in self.rows if (row.way, row.system, row.image, row.region) == wanted)
        return next(found, None)

    def gains(self, way: str, system: str, region: str = WHOLE) -> dict[str, float]:
        """PSNR in dB of what the system restored above each rival, see `restore.gains`."""
        rows = {name: self.score(way, system, name, region) for name in (*RIVALS, "restored")}
        return gains({name: row.psnr_db for name, row in rows.items() if row is not None})

    def gain(self, way: str, system: str, region: str = WHOLE) -> float:
        """PSNR in dB of what the system restored above that of the lens alone; NaN where either is
        missing."""
        return self.gains(way, system, region).get(LENS_ALONE, math.nan)


@dataclass(frozen=True)
class SceneScores:
    """All finished scenes in order, and what was wrong with those that could not be finished, by name."""

    measured: tuple[Measured, ...]
    failed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """A sentence for each scene and system that could not be finished."""
        failures = Failures({name: texts for name, texts in self.failed.items()})
        for m in self.measured:
            failures.found |= {f"{system}, {m.scene}": texts for system, texts in m.problems.items()}
        return failures.sentences


def figures(outcome: SceneScores, networks: Sequence[str]) -> dict[str, float]:
    """Flat: psnr_db, ssim, light_error, psnr_db_se and ssim_se .SCENE.WAY.IMAGE,
    gain_db.SCENE.WAY.NETWORK.over_{photo,lens_alone,wiener}, converged_db.SCENE.WAY.IMAGE of photos; SCENE
    also `mean`, and `least` of converged_db. IMAGE is lens_alone (of the first lens), NETWORK, NETWORK.photo,
    NETWORK.wiener, and where there are several lenses NETWORK.lens_alone.

    networks: names of the systems.
    """
    found: dict[str, float] = {}
    several = len({lens for m in outcome.measured for lens in m.lenses.values()}) > 1
    for way in WAYS:
        images = {LENS_ALONE: (LENS_ALONE, "photo")}
        for network in networks:
            images |= {network: (network, "restored")}
            images |= {f"{network}.{image}": (network, image) for image in ("photo", "wiener")}
            images |= {f"{network}.{LENS_ALONE}": (network, LENS_ALONE)} if several else {}
        for label, (system, image) in images.items():
            rows = {m.scene: m.score(way.name, system, image) for m in outcome.measured}
            for measure in ("psnr_db", "ssim", "light_error", "psnr_db_se", "ssim_se"):
                values = {scene: getattr(row, measure) for scene, row in rows.items() if row is not None}
                of_mean = mean_error if measure.endswith("_se") else mean
                found |= _with_mean(
                    values, lambda scene, m=measure, w=way, i=label: f"{m}.{scene}.{w.name}.{i}", of_mean
                )
            if image == "photo":
                far = {scene: row.converged_db for scene, row in rows.items() if row is not None}
                found |= {f"converged_db.{scene}.{way.name}.{label}": value for scene, value in far.items()}
                least = min((value for value in far.values() if not math.isnan(value)), default=math.nan)
                found[f"converged_db.least.{way.name}.{label}"] = least
        for network in networks:
            every = {m.scene: m.gains(way.name, network) for m in outcome.measured}
            for rival in RIVALS:
                name = f"{way.name}.{network}.over_{rival}"
                values = {scene: each.get(rival, math.nan) for scene, each in every.items()}
                found |= _with_mean(values, lambda scene, n=name: f"gain_db.{scene}.{n}")
    found["scenes"] = float(len(outcome.measured))
    found["scenes.failed"] = float(len(outcome.failed))
    return found


Region = tuple[str, float, float]


def regions_of(view: View, named: Mapping[str, Tensor]) -> dict[Region, Tensor]:
    """Masks, bool [y, x], of depth ranges and of named parts, by name, near_m and far_m; none is empty.

    named: masks [y, x], bool, by name.
    """
    depth = view.crop_margin(view.mean_inverse_depth()).cpu()
    found: dict[Region, Tensor] = {("depth", near, far): mask for near, far, mask in depth_ranges(depth)}
    for name, mask in named.items():
        if mask.any():
            found[name, 0.0, math.inf] = mask
    return found


def scores_of(
    taken: Capture, name: str, regions: Mapping[Region, Tensor]
) -> Iterable[tuple[Region, tuple[float, float, int, float, float, float]]]:
    """Of an image of what was taken: the fields of a `SceneScore` from psnr_db on, by region.

    regions: masks [y, x], bool, by name and depths.
    """
    image, truth, noise = taken.compared(name)
    masks = [None, *regions.values()]
    parts = score_parts(image, truth, masks, noise)
    clipped = within_scale(image).cpu(), within_scale(truth).cpu()
    for place, mask, each in zip(((WHOLE, 0.0, math.inf), *regions), masks, parts, strict=True):
        off = light_error(*clipped, mask)
        yield place, (each.psnr_db, each.ssim, each.pixels, off, each.psnr_db_se, each.ssim_se)


def facts_of(view: View, edges: Tensor, taken: Capture) -> dict[str, float]:
    """What decides scores in addition to the camera. mean: of the truth; clipped: share of values beyond full
    scale before it was clipped; noise_db: PSNR between the truth and itself rendered with another seed.

    edges: [y, x], bool.
    """
    truth = taken.truth
    # two renderings differ by sqrt(2) times the standard error of one
    wander = math.sqrt(2) * view.noise * float(truth.double().square().mean().sqrt())
    return {
        "width_px": view.width,
        "height_px": view.height,
        "bands": view.bands,
        "nearest_m": 1 / max(float(view.inverse_depth.max()), 1e-9),
        "farthest_m": 1 / max(float(view.inverse_depth.min()), 1e-9),
        "edges": float(edges.double().mean()),
        "exposure": taken.photo.exposure,
        "mean": float(truth.mean()),
        "clipped": float((taken.photo.ideal > 1).double().mean()),
        "render_noise": view.noise,
        "noise_db": -20 * math.log10(wander) if wander > 0 else math.inf,
    }


def mean(values: Iterable[float]) -> float:
    """Mean of the finite values; NaN where there is none."""
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.nan


def worst(outcome: SceneScores, network: str) -> Measured | None:
    """The scene whose restored picture scores least."""
    scored = [(m, row) for m in outcome.measured if (row := m.score(OURS, network, "restored")) is not None]
    return min(scored, key=lambda each: each[1].psnr_db, default=(None, None))[0]


def write_table(path: Path, outcome: SceneScores) -> Path:
    """All rows as CSV, those of restored images with their gains."""
    names = tuple(SceneScore.__dataclass_fields__)
    lines = []
    for m in outcome.measured:
        for row in m.rows:
            own = _gains_of(m, row) if row.image == "restored" else {}
            lines.append([*(getattr(row, n) for n in names), *(own.get(rival, "") for rival in RIVALS)])
    return write_csv(path, (*names, *(f"gain_db_over_{rival}" for rival in RIVALS)), lines)


def _gains_of(measured: Measured, row: SceneScore) -> dict[str, float]:
    """Of a row of what was restored, over the same region."""
    place = row.way, row.region, row.near_m, row.far_m
    alike = {
        (each.system, each.image): each.psnr_db
        for each in measured.rows
        if (each.way, each.region, each.near_m, each.far_m) == place
    }
    found = {"photo": (row.system, "photo"), "wiener": (row.system, "wiener")}
    found |= {LENS_ALONE: (measured.lens(row.system), "photo")}
    known = {name: alike[key] for name, key in found.items() if key in alike}
    return gains({**known, "restored": row.psnr_db})


def mean_error(values: Iterable[float]) -> float:
    """Standard error of the mean of what has these errors; NaN where one of them is not known."""
    known = list(values)
    return math.sqrt(sum(value**2 for value in known)) / len(known) if known else math.nan


def _with_mean(
    values: Mapping[str, float],
    name: Callable[[str], str],
    of_mean: Callable[[Iterable[float]], float] = mean,
) -> dict[str, float]:
    return {name(scene): value for scene, value in {**values, "mean": of_mean(values.values())}.items()}
