"""Deep scenes: photographed by the paper's protocol and by ours, restored, and scored against all in focus.

For each scene every way to simulate (see `protocols`) and every system: the lens alone, and each network with
its mask, restored by the network and by Wiener deconvolution. Scores are those of the whole picture, of its
depth ranges, and of the pixels within the blur radius of depth edges. So it shows how far the *conclusion*,
the gain of a mask and its network over the lens alone, depends on how cheaply a photo is simulated.

Truth is the all-in-focus image under the same response and exposure; truth and images are clipped at full
scale, as a sensor's are. The exposure puts the 99.5th percentile of the truth at 0.9 unless the camera says
otherwise. Finished scenes are kept in the folder, and gone on from.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from torch import Tensor

from ..capture.photo import PHOTO_MODEL_VERSION
from ..errors import EdofsimError
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_camera
from ..record import write_record
from ..render import View, render
from ..render.keys import view_key
from ..restore.checkpoint import find_checkpoint, shipped_checkpoints
from ..restore.scores import Score, depth_ranges, score, score_parts, within_scale
from .depth_edges import near_edges
from .drawing import write_csv
from .predictions import SCENES, small_version
from .protocols import LENS_ALONE, OURS, PAPER, WAYS, System, Taken, Way, systems_of, take, views_of

Progress = Callable[[float, str], None]

__all__ = ["SCENES", "Measured", "Row", "Seen", "figures", "measure", "run", "write_table"]

WHOLE, NEAR_EDGES, AWAY = "whole", "near edges", "away from edges"
SHOWN = (PAPER, OURS)
"""Ways whose images are kept for a page."""
VERSION = 4
"""Raised when the same scene and camera would give other scores, so that those in a folder are left."""

TRUTH_SAMPLES = 512
"""The fewest that a scene is rendered with. A rendering's grain is in the truth, but a blurred photo hardly
holds it: it counts as an error of every restoration, and cost up to 1.1 dB at 16 samples."""


def scored_version(recipe: SceneRecipe, *, quick: bool = False) -> SceneRecipe:
    """The scene with at least `TRUTH_SAMPLES`; quick: only the middle of its frame."""
    samples = max(TRUTH_SAMPLES, recipe.render.samples)
    chosen = small_version(recipe) if quick else recipe
    return chosen.model_copy(update={"render": chosen.render.model_copy(update={"samples": samples})})


@dataclass(frozen=True)
class Row:
    """One score. image: photo, restored or wiener; region: `whole`, `near edges`, `away from edges`, `depth`
    with near_m <= depth < far_m, or another part by its name."""

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


@dataclass(frozen=True)
class Measured:
    """A finished scene: its scores, and facts (sizes, shares, noise, seconds)."""

    scene: str
    rows: tuple[Row, ...]
    facts: Mapping[str, float]

    def score(self, way: str, system: str, image: str, region: str = WHOLE) -> Row | None:
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
class Seen:
    """What a page is made from, of one scene: recipes, view, systems, and what was taken in the ways of
    `SHOWN`, by way and system. edges: bool [y, x]."""

    scene: Loaded[SceneRecipe]
    camera: Loaded[CameraRecipe]
    view: View
    systems: tuple[System, ...]
    taken: Mapping[tuple[str, str], Taken]
    edges: Tensor


@dataclass(frozen=True)
class Outcome:
    """All finished scenes in order, and what was wrong with those that could not be finished, by name."""

    measured: tuple[Measured, ...]
    failed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def run(
    folder: Path,
    scenes: Sequence[Loaded[SceneRecipe]],
    *,
    networks: Sequence[str] | None = None,
    camera: str | None = None,
    quick: bool = False,
    seed: int = 0,
    cache: Path | None = None,
    device: str = "auto",
    show: Callable[[Measured, Seen], None] | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Measure every scene. folder: keeps a record of each that is finished, which is not measured again.

    networks: checkpoints, files or shipped names, None for all that ship; camera: in place of what the scene
    names; quick: the scenes' small versions; seed: of the sensor's noise; show: called with each scene's
    images before it counts as finished. A scene that cannot be read, rendered or photographed is left and
    told in the outcome.
    """
    say = progress or (lambda fraction, text: None)
    networks = networks or list(shipped_checkpoints())
    done: list[Measured] = []
    failed: dict[str, tuple[str, ...]] = {}
    for number, scene in enumerate(scenes):
        name = scene.recipe.name

        def tell(fraction: float, text: str, number: int = number, name: str = name) -> None:
            say((number + fraction) / len(scenes), f"{name}: {text}")

        try:
            taker = load_camera(camera or scene.recipe.camera, None if camera else scene.base)
            recipe = scored_version(scene.recipe, quick=quick)
            key = key_of(recipe, scene.base, taker, networks, seed)
            path = record_path(folder, name)
            known = read(path, key)
            if known is None:
                view = render(
                    recipe, scene.base, cache=cache, device=device, progress=lambda f, t: tell(0.4 * f, t)
                )
                systems = tuple(systems_of(taker, networks))
                known, taken, edges = measure(
                    name, view, systems, seed=seed, progress=lambda f, t: tell(0.4 + 0.6 * f, t)
                )
                if show:
                    show(known, Seen(scene, taker, view, systems, taken, edges))
                write(path, key, known)
            done.append(known)
        except EdofsimError as error:
            failed[name] = getattr(error, "problems", (str(error),))
    return Outcome(tuple(done), failed)


def measure(
    name: str,
    view: View,
    systems: Sequence[System],
    *,
    ways: Sequence[Way] = WAYS,
    parts: Mapping[str, Tensor] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Measured, dict[tuple[str, str], Taken], Tensor]:
    """Scores of a view by every way and system, the photos of the ways in `SHOWN`, and where edges are.

    parts: further regions to score, bool [y, x], by name.
    """
    started = time.perf_counter()
    edges = near_edges(view, systems[0].camera)
    regions = _regions(view, {NEAR_EDGES: edges, AWAY: ~edges, **(parts or {})})
    views = views_of(view, systems[0].camera)
    rows: list[Row] = []
    kept: dict[tuple[str, str], Taken] = {}
    jobs = [(way, system) for way in ways for system in systems]
    for number, (way, system) in enumerate(jobs):
        if progress:
            progress(number / len(jobs), f"{way.name}, {system.name}")
        taken = take(views[way.name], way, system, seed)
        for image, values in taken.images.items():
            about = (name, way.name, system.name, image)
            rows += [Row(*about, *place, *each) for place, each in _scores(values, taken.truth, regions)]
        if way.name in SHOWN:
            kept[way.name, system.name] = taken
    facts = _facts(view, edges, kept[OURS, systems[0].name])
    return Measured(name, tuple(rows), {**facts, "seconds": time.perf_counter() - started}), kept, edges


Region = tuple[str, float, float]


def _regions(view: View, named: Mapping[str, Tensor]) -> dict[Region, Tensor]:
    """Masks, bool [y, x], of depth ranges and of named parts, by name, near_m and far_m; none is empty."""
    depth = view.crop_margin(view.mean_inverse_depth()).cpu()
    found: dict[Region, Tensor] = {("depth", near, far): mask for near, far, mask in depth_ranges(depth)}
    for name, mask in named.items():
        if mask.any():
            found[name, 0.0, math.inf] = mask
    return found


def _scores(
    image: Tensor, truth: Tensor, regions: Mapping[Region, Tensor]
) -> Iterable[tuple[Region, tuple[float, float, int]]]:
    image, truth = within_scale(image).cpu(), truth.cpu()
    parts: list[Score] = [score(image, truth), *score_parts(image, truth, list(regions.values()))]
    for place, each in zip(((WHOLE, 0.0, math.inf), *regions), parts, strict=True):
        yield place, (each.psnr_db, each.ssim, each.pixels)


def _facts(view: View, edges: Tensor, taken: Taken) -> dict[str, float]:
    """What decides scores besides the camera. mean: of the truth; clipped: share of its values beyond full
    scale before it was clipped; noise_db: PSNR between the truth and itself rendered with another seed."""
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


def figures(outcome: Outcome, networks: Sequence[str]) -> dict[str, float]:
    """Flat: psnr_db and ssim .SCENE.WAY.IMAGE, gain_db.SCENE.WAY.NETWORK, SCENE also `mean`; IMAGE is
    lens_alone, NETWORK, NETWORK.photo or NETWORK.wiener. networks: names of the systems."""
    found: dict[str, float] = {}
    for way in WAYS:
        images = {LENS_ALONE: (LENS_ALONE, "photo")}
        for network in networks:
            images |= {network: (network, "restored")}
            images |= {f"{network}.{image}": (network, image) for image in ("photo", "wiener")}
        for label, (system, image) in images.items():
            rows = {m.scene: m.score(way.name, system, image) for m in outcome.measured}
            for measure in ("psnr_db", "ssim"):
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


def worst(outcome: Outcome, network: str, way: str = OURS) -> Measured | None:
    """The scene whose restored picture scores least."""
    scored = [m for m in outcome.measured if m.score(way, network, "restored") is not None]
    return min(scored, key=lambda m: m.score(way, network, "restored").psnr_db, default=None)


def write_table(path: Path, outcome: Outcome) -> Path:
    """All rows as CSV."""
    names = tuple(Row.__dataclass_fields__)
    return write_csv(
        path, names, [[getattr(row, n) for n in names] for m in outcome.measured for row in m.rows]
    )


def record_path(folder: Path, scene: str) -> Path:
    """Where a finished scene is kept."""
    return folder / f"{scene}.json"


def read(path: Path, key: str) -> Measured | None:
    """The finished scene of a record; None where there is none, or of other inputs, or it is damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["key"] != key:
            return None
        rows = tuple(Row(**{**row, **_numbers(row)}) for row in content["rows"])
        return Measured(content["scene"], rows, _numbers(content["facts"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write(path: Path, key: str, measured: Measured) -> None:
    rows = [{name: _plain(value) for name, value in asdict(row).items()} for row in measured.rows]
    facts = {name: _plain(value) for name, value in measured.facts.items()}
    write_record(path, {"key": key, "scene": measured.scene, "facts": facts, "rows": rows})


def _plain(value: Any) -> Any:
    """JSON has neither infinity nor NaN."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        n: float(v) if isinstance(v, str) and v in ("inf", "-inf", "nan") else v for n, v in values.items()
    }


def _with_mean(values: Mapping[str, float], name: Callable[[str], str]) -> dict[str, float]:
    return {name(scene): value for scene, value in {**values, "mean": mean(values.values())}.items()}


def key_of(
    recipe: SceneRecipe, base: Path, camera: Loaded[CameraRecipe], networks: Sequence[str], seed: int
) -> str:
    """What a record's scores depend on."""
    said = [VERSION, PHOTO_MODEL_VERSION, view_key(recipe, base), camera.recipe.model_dump(mode="json"), seed]
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for network in networks:
        digest.update(hashlib.sha256(find_checkpoint(network).read_bytes()).digest())
    return digest.hexdigest()
