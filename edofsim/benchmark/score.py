"""What entries make of a benchmark's photos, and how near it is to the truth."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from ..capture.noise import PhotoNoise
from ..capture.sensor import record, sensor_effects
from ..core.json_values import Json
from ..core.memory import give_back_memory
from ..core.progress import Progress
from ..data.taken import NOISE, Exposed, expose
from ..errors import InputError
from ..experiments.kept import Kept, key_of
from ..experiments.restorations import Known, known_of
from ..experiments.systems import camera_digest
from ..optics import Camera
from ..restore.scores import depth_ranges, flip_map, score_parts
from ..restore.truth import Truth
from .definition import Benchmark, Shot
from .entries import Entry, extra_files

WHOLE = "whole"
EDGE_PX = (0.0, 2.0, 8.0, 32.0, math.inf)
"""Distances from depth edges, in pixels, between which scores are taken together."""
FINISHED = "finished.jsonl"


@dataclass(frozen=True)
class Row:
    """A score of an entry's image of one photo, over a region: `whole`, `depth A-B m`, `edge A-B px`.

    psnr_db_se: see `restore.scores`.
    flip: NaN where that cannot be computed.
    failure: what was wrong with the image, in whose place a black one is scored.
    seconds: of the processor, the least of the two times that a photo is restored: what an entry keeps of a
        camera is there then.
    peak_mib: memory that the restoration added at its peak, NaN where the system does not say.
    gmacs: of matrix products and convolutions, counted in a run of their own for the first scene, NaN where
        none was counted.
    """

    entry: str
    scene: str
    family: str
    noise: int
    region: str
    psnr_db: float
    ssim: float
    flip: float
    psnr_db_se: float
    pixels: int
    seconds: float = math.nan
    peak_mib: float = math.nan
    gmacs: float = math.nan
    failure: str = ""


def score_scene(
    scene: str, progress: Progress, *, benchmark: Benchmark, entries: Sequence[Entry], folder: Path
) -> list[Row]:
    """All entries on all photos of a scene; what is kept in the folder is not done again."""
    kept = Kept(folder / FINISHED)
    metas = benchmark.scenes[scene]
    rows: list[Row] = []
    photos = _Photos(benchmark, metas)
    for number, entry in enumerate(entries):
        progress(number / len(entries), entry.name)
        key = _key(benchmark, entry, metas)
        known = _remembered(kept, key, entry.name)
        if known is None:
            known = [row for meta in metas for row in _rows(benchmark, entry, meta, photos)]
            if scene == next(iter(benchmark.scenes)):  # all have frames of one size
                of_scene = {str(meta["camera"]): meta for meta in metas}
                gmacs = median(_gmacs(entry, meta, photos) for meta in of_scene.values())
                known = [replace(row, gmacs=gmacs) for row in known]
            kept.put(key, {"rows": [asdict(row) for row in known]})
        rows += known
    return rows


def _remembered(kept: Kept, key: str, name: str) -> list[Row] | None:
    """The rows of a key, under the entry's name of today."""
    known = kept.get(key)
    return None if known is None else [replace(Row(**row), entry=name) for row in known["rows"]]


def _key(benchmark: Benchmark, entry: Entry, metas: Sequence[Json]) -> str:
    """Everything that decides an entry's rows of a scene."""
    camera = entry.camera()
    files: dict[str, str] = {}
    if entry.folder is not None:
        paths = [entry.folder / f"{meta['key']}{end}" for meta in metas for end in (".exr", ".png")]
        files = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in paths if p.is_file()}
    return key_of(
        data=benchmark.identity,
        scene=metas[0]["scene"],
        entry=[entry.digest, entry.uses, files],
        camera=None if camera is None else camera_digest(camera),
    )


class _Photos:
    """Photos of a scene, each taken once by each camera."""

    def __init__(self, benchmark: Benchmark, metas: Sequence[Json]) -> None:
        self.benchmark = benchmark
        self.shots = {str(meta["key"]): benchmark.shot(meta) for meta in metas}
        self.exposed: dict[str, Exposed] = {}

    def own(self, meta: Json, entry: Entry) -> tuple[Shot, Known]:
        """The photo that an entry restores, by its own camera if it has another one, and what it may know."""
        shot = self.shots[str(meta["key"])]
        own = entry.camera()
        name = shot.camera if own is None else camera_digest(own)
        if own is not None and self.benchmark.takes_the_photos_of(own, name, shot.camera):
            own, name = None, shot.camera
        known = self._known(name, own or self.benchmark.camera(shot.camera), shot.camera)
        if own is not None:
            if name not in self.exposed:
                view = self.benchmark.view(meta)
                self.exposed[name] = expose(view, known.camera, self.benchmark.recipe, shot.key)
            shot = _by(self.exposed[name], shot)
        return shot, replace(known, inverse_depth=shot.inverse_depth, truncated=shot.truncated)

    def _known(self, name: str, camera: Camera, first: str) -> Known:
        """What is known of all photos of a camera: its PSFs are found once. first: the benchmark's camera."""
        every = self.benchmark.known
        if name not in every:
            sensor = camera.recipe.sensor
            if self.benchmark.recipe.photos.saturation:
                sensor = sensor.model_copy(update={"saturation": True})
            camera = replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))
            wavelengths = self.benchmark.pairs.camera(first)["wavelengths"]
            nowhere = torch.tensor(math.nan)
            every[name] = known_of(camera, wavelengths, self.benchmark.ends, torch.zeros(3), nowhere)
        return every[name]


def _by(exposed: Exposed, shot: Shot) -> Shot:
    """The photo of another camera in the place of a benchmark's own, with the same seed of the noise."""
    effects = sensor_effects(exposed.camera, exposed.fidelity)
    photo, noise = exposed.photo, shot.noise
    if exposed.noise:
        noise = PhotoNoise("taken out", *(exposed.noise[name] for name in NOISE))
    image = record(photo.clean, effects, shot.seed)
    return replace(shot, photo=image, ideal=photo.ideal, noise=noise, truncated=photo.truncated)


def _rows(benchmark: Benchmark, entry: Entry, meta: Json, photos: _Photos) -> Iterator[Row]:
    shot, known = photos.own(meta, entry)
    failure, peak_mib, before = "", math.nan, _peak_mib(reset=True)
    taken: list[float] = []

    def restored(photo: Tensor) -> Tensor:
        began = time.process_time()
        image = entry.restored(photo, known, shot.key)
        taken.append(time.process_time() - began)
        return image

    try:
        image, left = restored(shot.photo), None
        peak_mib = _peak_mib() - before
        if entry.folder is None:
            left = Truth(shot.ideal, shot.noise).restored_noise(shot.photo, image, restored)
        seconds = min(taken)
    except InputError as error:
        image, failure, seconds, left = torch.zeros_like(shot.photo), str(error), math.nan, None
        if shot.noise.image is not None:  # a black image has none
            left = torch.zeros_like(shot.photo)
    regions = regions_of(shot)
    compared = Truth(shot.ideal, shot.noise).compared(image, left)
    scores = score_parts(*compared[:2], list(regions.values()), compared[2])
    flips = flip_map(image, shot.ideal)
    about = (entry.name, str(meta["scene"]), shot.family, int(meta["noise"]))
    for (name, mask), score in zip(regions.items(), scores, strict=True):
        seen = math.nan if flips is None else float((flips if mask is None else flips[mask]).mean())
        numbers = (score.psnr_db, score.ssim, seen, score.psnr_db_se, score.pixels)
        yield Row(*about, name, *numbers, seconds, peak_mib, failure=failure)


def _gmacs(entry: Entry, meta: Json, photos: _Photos) -> float:
    """Of a restoration, which is not timed."""
    shot, known = photos.own(meta, entry)
    try:
        with FlopCounterMode(display=False) as counted:
            entry.restored(shot.photo, known, shot.key)
    except InputError:
        return math.nan
    return counted.get_total_flops() / 2e9 or math.nan


def _peak_mib(*, reset: bool = False) -> float:
    """The most memory that this process has held since it was reset, in MiB; NaN where Linux does not say."""
    try:
        if reset:
            give_back_memory()  # what was freed and kept would be taken again, unseen
            Path("/proc/self/clear_refs").write_text("5")
        status = Path("/proc/self/status").read_text()
    except (OSError, AttributeError, TypeError):
        return math.nan
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def regions_of(shot: Shot) -> Mapping[str, Tensor | None]:
    """Where scores are taken: the whole, ranges of depth, and of the distance from depth edges; none is
    empty."""
    found: dict[str, Tensor | None] = {WHOLE: None}
    for near, far, mask in depth_ranges(shot.inverse_depth):
        found[f"depth {near:g}-{far:g} m"] = mask
    for low, high in zip(EDGE_PX, EDGE_PX[1:], strict=False):
        mask = (shot.edge_px >= low) & (shot.edge_px < high)
        if mask.any():
            found[f"edge {low:g}-{high:g} px"] = mask
    return found


def check_entries(benchmark: Benchmark, entries: Sequence[Entry]) -> None:
    """Raise InputError for files of an entry that belong to no photo, and for cameras whose pixels see
    another angle than the benchmark's."""
    keys = {str(meta["key"]) for meta in benchmark.pairs.metas}
    problems = [
        f"{path}: belongs to no photo of this benchmark" for e in entries for path in extra_files(e, keys)
    ]
    angle = float(benchmark.pairs.metas[0]["pixel_angle"])
    for entry in entries:
        camera = entry.camera()
        if camera is not None and abs(camera.pixel_angle / angle - 1) > 1e-3:
            problems.append(
                f"{entry.name}: a pixel of its camera sees {1e3 * camera.pixel_angle:.6g} mrad, one of the "
                f"benchmark's frames {1e3 * angle:.6g} mrad: choose focal length and pixel for that"
            )
    if problems:
        raise InputError(problems)
