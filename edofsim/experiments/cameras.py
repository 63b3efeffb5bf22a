"""The network for any camera beside Wiener deconvolution, on cameras that are named or on six.

The six are cameras that no network was trained for, and none of which a training drew: two with ordinary
lenses, a cubic mask, rings, a height map of another training, and the paper's with its mask at another focus.
Each camera photographs pictures as planes at random depths (see `planes`), and the middle of shipped scenes
with depth, rendered for its pixels, as `scene3d` does. Both are told the camera, as designed, and the range
of depths; neither is told more. Beside them stands what was trained for that camera alone, where there is
such a thing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import typer
from torch import Tensor

from .. import completion
from ..capture.framing import framed
from ..core.progress import Progress, part
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera
from ..optics.nodes import node_shares
from ..optics.sampling import plan_sampling
from ..options import CacheOption, LimitOption, PicturesOption, SeedOption
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_camera, load_scene
from ..render import render
from ..report import Column, Page, Section, Table, Text
from ..report.page import Cell
from ..restore.checkpoint import (
    ANY_CAMERA,
    Checkpoint,
    camera_with_mask,
    find_checkpoint,
    load_checkpoint,
    network_of,
)
from ..restore.conditioning import conditioned_on
from ..restore.network import apply_network
from ..restore.restore import for_any_camera
from ..restore.scores import psnr, within_scale
from .experiment import Findings
from .kept import Kept, key_of
from .photographs import Photographs, photographs
from .planes import RANDOM, Condition, PictureScore, averages, measure, write_rows
from .protocols import OURS, WAYS, System, of_three_lines, saturating, take
from .scene3d import scored_version
from .systems import NEAREST_PER_M, READ_NOISE, Contestant, filtered, paper_test, standing_psfs

SCENES = ("desk", "clutter")
FARTHER = ("hallway",)
"""The scene for a lens whose blur of half a metre takes more samples of its pupil than are allowed."""
FARTHER_PER_M = 1.0
"""The inverse depth up to which pictures stand for such a lens."""
OWN_MAP = "fourier-wiener"
"""The training whose height map stands for one of somebody's own."""
CUBIC = "cubic-dcnn"
"""The network that was trained for the cubic mask."""
REFOCUSED_M = 0.8
PHOTO, WIENER, ANY, OWN = "photo", "wiener", "any", "own"
WHAT = {PHOTO: "photo", WIENER: "Wiener", ANY: "for any camera", OWN: "for this camera"}


@dataclass(frozen=True)
class Taker:
    """A camera with its mask as designed; said: in words; nearest_per_m: inverse depth up to which its
    pictures stand; scenes: that it photographs; own: the network that was trained for it, None where there is
    none."""

    name: str
    said: str
    camera: Camera
    nearest_per_m: float = NEAREST_PER_M
    scenes: tuple[str, ...] = SCENES
    own: Checkpoint | None = None


def takers() -> list[Taker]:
    """The six."""
    shipped = {name: load_camera(name) for name in ("lens-50mm-f2", "paper-cubic", "paper-rings")}
    found = {name: Camera.from_recipe(known.recipe, known.base) for name, known in shipped.items()}
    short = load_camera("lens-25mm-f5").recipe
    lens = {"kind": "ideal", "focal_length_mm": 25, "f_number": 2.8}
    short = CameraRecipe.model_validate({**short.model_dump(), "name": "lens-25mm-f2", "lens": lens})
    learned = load_camera("paper-learned")
    focus = learned.recipe.focus.model_copy(update={"distance_m": REFOCUSED_M})
    moved = learned.recipe.model_copy(update={"focus": focus})
    own = load_checkpoint(OWN_MAP)
    return [
        Taker("50mm", "50 mm, f/2, pixels of 3.45 µm", found["lens-50mm-f2"], FARTHER_PER_M, FARTHER),
        Taker("25mm", "25 mm, f/2.8, pixels of 3.45 µm", Camera.from_recipe(short)),
        Taker("cubic", "the cubic mask", found["paper-cubic"], own=load_checkpoint(CUBIC)),
        Taker("rings", "phase rings", found["paper-rings"]),
        Taker(
            "height-map",
            "another height map",
            camera_with_mask(load_camera("paper-clear").recipe, own),
            own=own,
        ),
        Taker("refocused", f"the paper's, focus at {REFOCUSED_M} m", Camera.from_recipe(moved, learned.base)),
    ]


def asked_for(sources: Sequence[str]) -> list[Taker]:
    """Cameras by their recipes or shipped names. A lens whose blur of half a metre takes more samples of its
    pupil than are allowed stands for itself from a metre on, as that of 50 mm does. Raises InputError for a
    camera that cannot be read or is too large for that as well, and for two of one name."""
    found = [load_camera(source) for source in sources]
    names = [each.recipe.name for each in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"--camera: more than one is called {', '.join(twice)}; rename one of them")
    return [_taker(each) for each in found]


def _taker(found: Loaded[CameraRecipe]) -> Taker:
    name, camera = found.recipe.name, Camera.from_recipe(found.recipe, found.base)
    shortest = torch.tensor([420e-9], dtype=torch.float64)  # of the sensor's bands, in scenes
    window = found.recipe.psf.window_px
    try:
        plan_sampling(camera, shortest, torch.tensor([0.0, NEAREST_PER_M]), window)
    except InputError:
        plan_sampling(camera, shortest, torch.tensor([0.0, FARTHER_PER_M]), window)
        return Taker(name, f"{name}, up to {1 / FARTHER_PER_M:g} m", camera, FARTHER_PER_M, FARTHER)
    return Taker(name, name, camera, own=network_of(found))


def run(
    folder: Path,
    progress: Progress,
    data: PicturesOption = None,
    limit: LimitOption = None,
    cameras: Annotated[
        list[str] | None,
        typer.Option(
            "--camera",
            metavar="CAMERA",
            help="Camera recipe or shipped name; repeatable. Default: six that no training drew.",
            autocompletion=completion.cameras,
        ),
    ] = None,
    network: Annotated[
        str, typer.Option("--network", metavar="NETWORK", help="A checkpoint for any camera.")
    ] = ANY_CAMERA,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Pictures at random depths and deep scenes through any camera, restored by the network for any camera
    and by Wiener deconvolution. Interrupt it at any time: the same command goes on.

    Without --camera: six cameras that no network was trained for. With one set of weights for all of them,
    cameras that differ in their masks alone tell what the mask is worth.

    Figures: psnr_db.CAMERA.{random,SCENE}.{photo,wiener,any,own}, gain_db.CAMERA.{random,SCENE} (above Wiener
    deconvolution), gain_db.{mean,least}, gain_db.mean.{random,deep}; own, where something was trained for the
    camera, and gap_db.CAMERA.{random,SCENE}, by which that is better; gap_db.greatest; pictures, left_out.
    """
    found = photographs(data, limit)
    checkpoint = load_checkpoint(network)
    if not checkpoint.network.any_camera:
        raise InputError(f"--network {network}: this was trained for one camera; name one for any camera")
    digest = _digest(network)
    every = asked_for(cameras) if cameras else takers()
    scores: dict[str, dict[str, dict[str, float]]] = {}
    rows: list[PictureScore] = []
    for number, taker in enumerate(every):
        tell = part(progress, number / len(every), (number + 1) / len(every), taker.name)
        own, planes = _planes(taker, checkpoint, digest, found, folder, seed, part(tell, 0.0, 0.6))
        rows += planes
        scores[taker.name] = {RANDOM: own}
        for index, scene in enumerate(taker.scenes):
            tell(0.6 + 0.4 * index / len(taker.scenes), scene)
            scores[taker.name][scene] = _deep(taker, checkpoint, digest, scene, folder, seed, cache)
    figures = figures_of(scores)
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    table = _table(scores, every)
    page = Page(
        "Any camera",
        "The network for any camera beside Wiener deconvolution.",
        (Section("Scores", (table,)),),
        (Text("PSNR of photos and restorations. Both are told the camera and the range of depths."),),
    )
    outputs = {"planes": write_rows(folder / "cameras.csv", rows, "depth")}
    inputs = {"data": found.source, "network": str(network)}
    return Findings(figures, page, [table], outputs, found.problems, inputs)


def figures_of(scores: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, float]:
    """Flat, from PSNRs by camera, condition and what was judged."""
    figures: dict[str, float] = {}
    gains: dict[str, list[float]] = {RANDOM: [], "deep": []}
    for camera, conditions in scores.items():
        for condition, values in conditions.items():
            figures |= {f"psnr_db.{camera}.{condition}.{what}": value for what, value in values.items()}
            gain = figures[f"gain_db.{camera}.{condition}"] = values[ANY] - values[WIENER]
            gains[RANDOM if condition == RANDOM else "deep"].append(gain)
            if OWN in values:
                figures[f"gap_db.{camera}.{condition}"] = values[OWN] - values[ANY]
    for name, values in gains.items():
        if values:
            figures[f"gain_db.mean.{name}"] = sum(values) / len(values)
    together = [value for values in gains.values() for value in values]
    figures |= {"gain_db.mean": sum(together) / len(together), "gain_db.least": min(together)}
    gaps = [value for name, value in figures.items() if name.startswith("gap_db.")]
    return {**figures, **({"gap_db.greatest": max(gaps)} if gaps else {})}


def _planes(
    taker: Taker,
    checkpoint: Checkpoint,
    digest: str,
    data: Photographs,
    folder: Path,
    seed: int,
    progress: Progress,
) -> tuple[dict[str, float], list[PictureScore]]:
    """Means over the pictures at random depths, by three lines of light, and the rows."""
    camera = of_three_lines(taker.camera)
    nodes, stack = standing_psfs(camera, nearest_per_m=taker.nearest_per_m)
    shares = node_shares(nodes)
    known = hashlib.sha256(stack.numpy().tobytes()).hexdigest()
    about = checkpoint, replace(camera, read_noise=READ_NOISE), PAPER_COLOURS, nodes
    network = conditioned_on(*about)

    def restored(photo: Tensor, glare: Tensor) -> Tensor:
        return for_any_camera(network, photo, stack, READ_NOISE, glare, shares)

    contestants = [
        Contestant(WIENER, camera, lambda photo, glare: filtered(photo, stack, glare, nodes), known),
        Contestant(ANY, camera, restored, known + digest),
    ]
    if taker.own is not None:
        own = taker.own.network

        def by_own(photo: Tensor, glare: Tensor) -> Tensor:
            return apply_network(own, photo, glare=glare)

        contestants.append(Contestant(OWN, camera, by_own, known + _digest(taker.own.name)))
    condition = Condition(RANDOM, None, READ_NOISE, paper_test(seed))
    rows: list[PictureScore] = []
    values: dict[str, float] = {}
    for index, contestant in enumerate(contestants):
        place = folder / taker.name
        place.mkdir(parents=True, exist_ok=True)
        tell = part(progress, index / len(contestants), (index + 1) / len(contestants))
        measured = measure(
            contestant,
            data.pictures,
            [condition],
            place,
            seed=seed,
            nearest_per_m=taker.nearest_per_m,
            progress=tell,
        )
        means = averages(measured)
        values[PHOTO] = means[f"psnr_db.{contestant.name}.photo.{RANDOM}"]
        values[contestant.name] = means[f"psnr_db.{contestant.name}.{RANDOM}"]
        rows += [replace(row, system=f"{taker.name} {row.system}") for row in measured]
    return {what: values[what] for what in WHAT if what in values}, rows


def _deep(
    taker: Taker, checkpoint: Checkpoint, digest: str, name: str, folder: Path, seed: int, cache: Path | None
) -> dict[str, float]:
    """A scene with depth, the middle of its frame, as a sensor that saturates sees it."""
    loaded = load_scene(name)
    recipe = _with_pixels(scored_version(loaded.recipe, quick=True), taker.camera)
    kept = Kept(folder / "finished.jsonl")
    described = taker.camera.recipe.model_dump(mode="json")
    named = {} if taker.own is None else {OWN: _digest(taker.own.name)}
    key = key_of(camera=described, network=digest, scene=recipe.model_dump(mode="json"), seed=seed, **named)
    known = kept.get(key)
    if known is not None:
        return known
    view = render(recipe, loaded.base, cache=cache)
    camera = replace(taker.camera, recipe=saturating(taker.camera.recipe))
    way = next(way for way in WAYS if way.name == OURS)
    with torch.inference_mode():
        taken = take(view, way, System(ANY, camera, checkpoint), seed)
        images = {PHOTO: taken.images["photo"], WIENER: taken.images["wiener"], ANY: taken.images["restored"]}
        if taker.own is not None:
            own = System(OWN, camera, taker.own)
            images[OWN] = take(view, way, own, seed, like=taken).images["restored"]
    found = {what: psnr(within_scale(image), taken.truth) for what, image in images.items()}
    kept.put(key, found)
    return found


def _digest(network: str | Path) -> str:
    return hashlib.sha256(find_checkpoint(network).read_bytes()).hexdigest()


def _with_pixels(recipe: SceneRecipe, camera: Camera) -> SceneRecipe:
    """A scene whose pixels see what the camera's do."""
    frame = recipe.frame.model_copy(update={"pixel_angle_mrad": "auto"})
    return framed(recipe.model_copy(update={"frame": frame}), camera)


def _table(scores: Mapping[str, Mapping[str, Mapping[str, float]]], every: Sequence[Taker]) -> Table:
    columns = (
        Column("Camera"),
        Column("What it photographs"),
        *(Column(said, "dB", 2) for said in WHAT.values()),
        Column("Gain", "dB", 2),
    )
    rows: list[tuple[Cell, ...]] = []
    for taker in every:
        for condition, values in scores[taker.name].items():
            said = "pictures, random depths" if condition == RANDOM else condition
            found = (values.get(what) for what in WHAT)
            rows.append((taker.said, said, *found, values[ANY] - values[WIENER]))
    return Table(columns, tuple(rows))
