"""Deep scenes: photographed by the paper's protocol and by ours, restored, and scored against all in focus.

For each scene every way to simulate (see `protocols`) and every system: the lens alone, and each network with
its mask, restored by the network and by Wiener deconvolution. Scores are those of the whole picture, of its
depth ranges, and of the pixels within the blur radius of depth edges. So it shows how far the *conclusion*,
the gain of a mask and its network over the lens alone, depends on how cheaply a photo is simulated.

Truth is the all-in-focus image under the same response and exposure. The sensor saturates: photos, truth and
what is restored are clipped at full scale, and lamps and highlights of a scene with them. The exposure puts
the 99.5th percentile of the truth at 0.9 unless the camera says otherwise. Finished scenes are kept in the
folder, and gone on from.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from torch import Tensor

from .. import completion
from ..core.files import write_bytes
from ..core.progress import Progress, part
from ..errors import EdofsimError, InputError
from ..options import CacheOption, CameraOption, MembersOption, NetworksOption, QuickOption, SeedOption
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_camera, load_scene
from ..recipe.load import shipped, shipped_folder
from ..record import writable_folder
from ..render import render
from ..render.keys import view_key
from ..render.view import View
from ..report import Link, write_page
from ..restore.checkpoint import find_checkpoint, load_checkpoint, shipped_checkpoints
from ..restore.scores import depth_ranges, light_error, score_parts, within_scale
from ..scene.family import in_place_of
from .depth_edges import near_edges
from .experiment import Findings, in_paper, in_parts
from .kept import Kept
from .kept import key_of as kept_key
from .predictions import small_version
from .protocols import (
    LENS_ALONE,
    OURS,
    PAPER,
    WAYS,
    System,
    Taken,
    Way,
    same_photo,
    systems_of,
    take,
    views_of,
)
from .scene_scores import (
    AWAY,
    NEAR_EDGES,
    WHOLE,
    Measured,
    SceneScore,
    SceneScores,
    figures,
    worst,
    write_table,
)

SHOWN = (PAPER, OURS)
"""Ways whose images are kept for a page."""
TRUTH_SAMPLES = 512
"""The fewest that a scene is rendered with. A rendering's noise is in the truth, but a blurred photo hardly
holds it: it counts as an error of every restoration, and cost up to 1.1 dB at 16 samples."""


def scored_version(recipe: SceneRecipe, *, quick: bool = False) -> SceneRecipe:
    """The scene with at least `TRUTH_SAMPLES`; quick: only the middle of its frame."""
    samples = max(TRUTH_SAMPLES, recipe.render.samples)
    chosen = small_version(recipe) if quick else recipe
    return chosen.model_copy(update={"render": chosen.render.model_copy(update={"samples": samples})})


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


@in_paper(lambda paper: {"quick": not paper.full, "seed": paper.seed, "cache": paper.cache})
@in_parts("scenes", lambda: list(shipped(shipped_folder("scenes"))))
def run(
    folder: Path,
    progress: Progress,
    scenes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE...]",
            help="Recipes or shipped names; default all shipped.",
            autocompletion=completion.scenes,
        ),
    ] = None,
    networks: NetworksOption = None,
    camera: CameraOption = None,
    quick: QuickOption = False,
    members: MembersOption = 0,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Deep scenes through the lens alone and through learned masks, by the paper's protocol and by ours:
    scores whole, by depth and near depth edges, and what each way to simulate concludes (paper, Fig. 13).

    Interrupt it at any time: scenes that are finished are kept in --out. What cannot be read is named at the
    end, and the others are finished. Scenes are rendered with at least 512 samples a pixel, as the noise of
    the truth counts against every restoration.

    Figures, SCENE also `mean`: {psnr_db,ssim,light_error}.SCENE.WAY.IMAGE with IMAGE one of
    {lens_alone,NETWORK,NETWORK.photo,NETWORK.wiener}, gain_db.SCENE.WAY.NETWORK (above the lens alone),
    scenes, scenes.failed; light_error: by what part of the truth's the mean is off in the worst channel;
    WAY: paper, linear, none, over, normalised, hidden, sub_apertures (ours).
    """
    from .scene3d_page import card, overview_page, scene_page, scores_table, strip, ways_table

    loaded, broken = readable(scenes or list(shipped(shipped_folder("scenes"))))
    if broken and not loaded:
        raise InputError([text for texts in broken.values() for text in texts])
    loaded = in_place_of(loaded, members, seed)
    sources = names_of(networks)
    names = list(sources.values())
    each = writable_folder(folder / "scenes")

    def show(measured: Measured, seen: Seen) -> None:
        for system in seen.systems[1:]:
            page = scene_page(measured, seen, system, Link("../scene3d.html", "Deep scenes"))
            write_page(each / f"{measured.scene}-{system.name}.html", page)
        ours = seen.taken[OURS, seen.systems[1].name]
        alone = seen.taken[OURS, LENS_ALONE]
        shown = strip(ours.truth, alone, ours.images["restored"], measured.scene)
        write_bytes(each / f"{measured.scene}.png", shown.png)

    outcome = measured_scenes(
        folder,
        loaded,
        networks=list(sources),
        camera=camera,
        quick=quick,
        seed=seed,
        cache=cache,
        show=show,
        progress=progress,
    )
    outcome = SceneScores(outcome.measured, {**broken, **outcome.failed})
    every = outcome.measured
    links = []
    for m in every:
        for name in names:
            title = m.scene if len(names) == 1 else f"{m.scene}, {name}"
            links.append(card(m, name, f"scenes/{m.scene}-{name}.html", title, each / f"{m.scene}.png"))
    lows = {name: low for name in names if (low := worst(outcome, name)) is not None}
    shown = [table(every, name) for name in names for table in (scores_table, ways_table)] if every else []
    worsts = [
        f"worst of {name}: {low.scene}, {row.psnr_db:.2f} dB"
        for name, low in lows.items()
        if (row := low.score(OURS, name, "restored")) is not None
    ]
    return Findings(
        figures(outcome, names),
        overview_page(outcome, names, links),
        shown=[*shown, *worsts],
        outputs={"scores": write_table(folder / "scene3d.csv", outcome)},
        problems=[text for texts in outcome.failed.values() for text in texts],
        inputs={"scenes": [m.scene for m in every], "networks": list(sources)},
        record={"worst": {n: lows[n].scene if n in lows else None for n in names}, "failed": outcome.failed},
    )


def readable(
    scenes: Sequence[str],
) -> tuple[list[Loaded[SceneRecipe]], dict[str, tuple[str, ...]]]:
    """The recipes that can be read, and what is wrong with the others, by what was typed."""
    loaded: list[Loaded[SceneRecipe]] = []
    broken: dict[str, tuple[str, ...]] = {}
    for scene in scenes:
        try:
            recipe = load_scene(scene)
        except InputError as error:
            broken[str(scene)] = error.problems
            continue
        twin = next((other for other in loaded if other.recipe.name == recipe.recipe.name), None)
        if twin is None:
            loaded.append(recipe)
        elif twin.path.resolve() != recipe.path.resolve():
            problem = (
                f"{scene}: its name is {recipe.recipe.name!r}, as that of {twin.path}; rename one of them"
            )
            broken[str(scene)] = (problem,)
    return loaded, broken


def names_of(networks: Sequence[str] | None) -> Mapping[str, str]:
    """Names of the systems by what was typed, of all that ship for None. Raises InputError for a checkpoint
    that cannot be used, and for two of one name."""
    sources = dict.fromkeys(networks or shipped_checkpoints())
    names = {source: load_checkpoint(source).name for source in sources}
    if len(set(names.values())) < len(names):
        raise InputError(f"{', '.join(names)}: two of these checkpoints have the same name; give one of them")
    return names


def measured_scenes(
    folder: Path,
    scenes: Sequence[Loaded[SceneRecipe]],
    *,
    networks: Sequence[str],
    progress: Progress,
    camera: str | None = None,
    quick: bool = False,
    seed: int = 0,
    cache: Path | None = None,
    show: Callable[[Measured, Seen], None] | None = None,
) -> SceneScores:
    """Measure every scene. folder: keeps each that is finished, which is not measured again.

    networks: checkpoints, files or shipped names; camera: in place of what the scene names; quick: the
    scenes' small versions; seed: of the sensor's noise; show: called with each scene's images before it
    counts as finished. A scene that cannot be read, rendered or photographed is left and told in the outcome.
    """
    kept = Kept(folder / "finished.jsonl")
    done: list[Measured] = []
    failed: dict[str, tuple[str, ...]] = {}
    for number, scene in enumerate(scenes):
        name = scene.recipe.name
        tell = part(progress, number / len(scenes), (number + 1) / len(scenes), name)
        try:
            taker = load_camera(camera or scene.recipe.camera, None if camera else scene.base)
            recipe = scored_version(scene.recipe, quick=quick)
            key = key_of(recipe, scene.base, taker, networks, seed)
            known = remembered(kept, key)
            if known is None:
                view = render(recipe, scene.base, cache=cache, progress=part(tell, 0.0, 0.4))
                systems = tuple(systems_of(taker, networks))
                known, taken, edges = measure(name, view, systems, seed=seed, progress=part(tell, 0.4, 1.0))
                if show:
                    show(known, Seen(scene, taker, view, systems, taken, edges))
                kept.put(key, asdict(known))
            done.append(known)
        except EdofsimError as error:
            failed[name] = getattr(error, "problems", (str(error),))
    return SceneScores(tuple(done), failed)


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
    rows: list[SceneScore] = []
    kept: dict[tuple[str, str], Taken] = {}
    # the first of the systems that take the same photo
    alike = [next(i for i, each in enumerate(systems) if same_photo(each, system)) for system in systems]
    for step, way in enumerate(ways):
        of_way: list[Taken] = []
        for number, system in enumerate(systems):
            if progress:
                progress((step + number / len(systems)) / len(ways), f"{way.name}, {system.name}")
            like = of_way[alike[number]] if alike[number] < number else None
            taken = take(views[way.name], way, system, seed, like=like)
            of_way.append(taken)
            for image, values in taken.images.items():
                about = (name, way.name, system.name, image)
                scores = _scores(values, taken.truth, regions)
                rows += [SceneScore(*about, *place, *each) for place, each in scores]
        if way.name in SHOWN:
            kept |= {(way.name, system.name): each for system, each in zip(systems, of_way, strict=True)}
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
) -> Iterable[tuple[Region, tuple[float, float, int, float]]]:
    image, truth = within_scale(image).cpu(), truth.cpu()
    masks = [None, *regions.values()]
    parts = score_parts(image, truth, masks)
    for place, mask, each in zip(((WHOLE, 0.0, math.inf), *regions), masks, parts, strict=True):
        yield place, (each.psnr_db, each.ssim, each.pixels, light_error(image, truth, mask))


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


def remembered(kept: Kept, key: str) -> Measured | None:
    """The finished scene of a key; None where there is none."""
    found = kept.get(key)
    if found is None:
        return None
    return Measured(found["scene"], tuple(SceneScore(**row) for row in found["rows"]), found["facts"])


def key_of(
    recipe: SceneRecipe, base: Path, camera: Loaded[CameraRecipe], networks: Sequence[str], seed: int
) -> str:
    """What a scene's scores depend on."""
    return kept_key(
        view=view_key(recipe, base),
        camera=camera.recipe.model_dump(mode="json"),
        seed=seed,
        networks=[hashlib.sha256(find_checkpoint(name).read_bytes()).hexdigest() for name in networks],
    )
