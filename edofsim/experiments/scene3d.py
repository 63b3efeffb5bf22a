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

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from torch import Tensor

from ..capture.depth_edges import near_edges
from ..capture.framing import framed, seen_through
from ..core.files import write_bytes
from ..core.progress import Progress, part
from ..errors import EdofsimError, InputError
from ..options import (
    CacheOption,
    CameraOption,
    MembersOption,
    NetworksOption,
    QuickOption,
    ResampleOption,
    SeedOption,
    ShippedScenes,
)
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
from ..recipe.load import shipped, shipped_folder
from ..record import writable_folder
from ..render import render
from ..render.keys import view_key
from ..render.view import View
from ..report import Link, write_page
from ..restore.checkpoint import shipped_checkpoints
from ..scene.family import in_place_of
from .experiment import Findings, in_paper, in_parts
from .failures import Failures
from .kept import Kept
from .kept import key_of as kept_key
from .predictions import small_version
from .protocols import (
    OURS,
    PAPER,
    WAYS,
    Capture,
    Lens,
    System,
    Way,
    capture_restored,
    converged_db,
    lenses_of,
    same_photo,
    views_of,
)
from .scene3d_page import cards, overview_page, scene_page, scores_table, strip, ways_table
from .scene_scores import (
    AWAY,
    NEAR_EDGES,
    Measured,
    SceneScore,
    SceneScores,
    facts_of,
    figures,
    regions_of,
    scores_of,
    worst,
    write_table,
)
from .sources import Source, one_of_each, system_of
from .systems import camera_digest

SHOWN = (PAPER, OURS)
"""Ways whose images are kept for a page."""
TRUTH_SAMPLES = 64
"""The fewest that a scene is rendered with. Scores are without the rendering's noise, but not without what it
leaves uncertain: see their standard errors."""


def scored_version(recipe: SceneRecipe, *, quick: bool = False) -> SceneRecipe:
    """The scene with at least `TRUTH_SAMPLES`.

    quick: only the middle of its frame.
    """
    samples = max(TRUTH_SAMPLES, recipe.render.samples)
    chosen = small_version(recipe) if quick else recipe
    return chosen.model_copy(update={"render": chosen.render.model_copy(update={"samples": samples})})


@dataclass(frozen=True)
class Seen:
    """What a page is made from, of one scene and lens: the view, and what was taken in the ways of `SHOWN`,
    by way and system.

    edges: bool [y, x].
    """

    scene: Loaded[SceneRecipe]
    lens: Lens
    view: View
    taken: Mapping[tuple[str, str], Capture]
    edges: Tensor

    @property
    def systems(self) -> tuple[System, ...]:
        """The lens alone, and the others that could be judged."""
        return tuple(each for each in self.lens.every if (OURS, each.name) in self.taken)


def _show(folder: Path, measured: Measured, seen: Seen) -> None:
    """The pages and the picture of a scene."""

    judged = [system for system in seen.systems if system.restoration is not None]
    for system in judged:
        page = scene_page(measured, seen, system, Link("../scene3d.html", "Deep scenes"))
        write_page(folder / f"{measured.scene}-{system.name}.html", page)
    alone = seen.taken.get((OURS, seen.lens.alone.name))
    if judged and alone is not None:
        ours = seen.taken[OURS, judged[0].name]
        shown = strip(ours.truth, alone, ours.images["restored"], measured.scene)
        write_bytes(folder / f"{measured.scene}.png", shown.png)


@in_paper(lambda paper: {"quick": not paper.full, "seed": paper.seed, "cache": paper.cache})
@in_parts("scenes", lambda options: list(shipped(shipped_folder("scenes"))))
def run(
    folder: Path,
    progress: Progress,
    scenes: ShippedScenes = None,
    networks: NetworksOption = None,
    camera: CameraOption = None,
    quick: QuickOption = False,
    members: MembersOption = 0,
    resample: ResampleOption = False,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Score restored photos of deep scenes.

    Scenes are photographed through the lens alone and through masks, by the paper's protocol and by ours.
    Scores are of the whole frame, by depth and near depth edges, for each way to simulate (paper, Fig. 13).

    The same command resumes interrupted work. What cannot be used, a scene or a
    system, is named at the end, and the others are finished. Scores are without the noise of the rendering;
    scenes are rendered in the pixels of each lens.

    Figures, SCENE also `mean`: {psnr_db,ssim,light_error}.SCENE.WAY.IMAGE, {psnr_db,ssim}_se.* (standard
    errors by the noise of the rendering), with IMAGE one of
    {lens_alone,NETWORK,NETWORK.photo,NETWORK.wiener}, and NETWORK.lens_alone where there are several lenses;
    gain_db.SCENE.WAY.NETWORK.over_{photo,lens_alone,wiener};
    converged_db.{SCENE,least}.WAY.{lens_alone,NETWORK.photo}: PSNR between the photo and that of twice as
    many depth layers; scenes, scenes.failed; light_error: relative error of the mean, worst channel;
    WAY: paper, linear, none, over, normalised, hidden, sub_apertures (ours).
    """

    loaded, broken = readable(scenes or list(shipped(shipped_folder("scenes"))))
    if broken and not loaded:
        raise InputError([text for texts in broken.values() for text in texts])
    sources, failures = sources_of(networks)
    names = [source.name for source in sources]
    show = partial(_show, writable_folder(folder / "scenes"))
    how = {"camera": camera, "quick": quick, "resample": resample, "seed": seed, "cache": cache}
    loaded = in_place_of(loaded, members, seed)
    outcome = measured_scenes(folder, loaded, networks=sources, show=show, progress=progress, **how)
    outcome = SceneScores(every := outcome.measured, {**broken, **outcome.failed})
    problems = [*failures.sentences, *outcome.problems]
    if not any(row.image == "restored" for m in every for row in m.rows):
        raise InputError(problems)
    lows = {name: low for name in names if (low := worst(outcome, name)) is not None}
    shown = [table(every, name) for name in names for table in (scores_table, ways_table)] if every else []
    worsts = [
        f"worst of {name}: {low.scene}, {row.psnr_db:.2f} dB"
        for name, low in lows.items()
        if (row := low.score(OURS, name, "restored")) is not None
    ]
    return Findings(
        figures(outcome, names),
        overview_page(outcome, names, cards(every, names, folder)),
        shown=[*shown, *worsts],
        outputs={"scores": write_table(folder / "scene3d.csv", outcome)},
        problems=problems,
        inputs={"scenes": [m.scene for m in every], "networks": names},
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


def sources_of(systems: Sequence[str] | None) -> tuple[list[Source], Failures]:
    """Systems by what was typed, all networks that ship with a mask for None; and what is wrong with those
    that are none. Raises InputError where all are, and for two of one name."""
    failures = Failures()
    found: list[Source] = []
    for text in dict.fromkeys(systems or shipped_checkpoints()):
        with failures.of(text):
            found.append(system_of(text))
    failures.check(len(found))
    one_of_each([each.name for each in found])
    return found, failures


def measured_scenes(
    folder: Path,
    scenes: Sequence[Loaded[SceneRecipe]],
    *,
    networks: Sequence[Source],
    progress: Progress,
    camera: str | None = None,
    quick: bool = False,
    resample: bool = False,
    seed: int = 0,
    cache: Path | None = None,
    show: Callable[[Measured, Seen], None] | None = None,
) -> SceneScores:
    """Measure every scene.

    folder: keeps each that is finished, which is not measured again.

    networks: systems.
    camera: in place of what the scene names.
    quick: the scenes' small versions.
    resample: views of scenes whose pixels see another angle than a camera's.
    seed: of the sensor's noise.
    show: called with each scene's images, lens by lens, before it counts as finished.

    A scene that cannot be read, rendered or photographed is left and named in the outcome, a system in the
    scene's.
    """
    kept = Kept(folder / "finished.jsonl")
    done: list[Measured] = []
    failed: dict[str, tuple[str, ...]] = {}
    for number, scene in enumerate(scenes):
        name = scene.recipe.name
        tell = part(progress, number / len(scenes), (number + 1) / len(scenes), name)
        try:
            camera_recipe = load_camera(camera or scene.recipe.camera, None if camera else scene.base)
            lenses, failures = lenses_of(camera_recipe, networks)
            failures.check(len(lenses))
            recipe = scored_version(scene.recipe, quick=quick)
            frames = [framed(recipe, lens.alone.camera, resample) for lens in lenses]
            key = key_of(frames, scene.base, lenses, networks, seed)
            known = remembered(kept, key)
            if known is None:
                every: list[Measured] = []
                for place, (lens, frame) in enumerate(zip(lenses, frames, strict=True)):
                    say = part(tell, place / len(lenses), (place + 1) / len(lenses))
                    view = render(frame, scene.base, cache=cache, progress=part(say, 0.0, 0.4))
                    _, view = seen_through(lens.alone.camera, frame, view)
                    rest = part(say, 0.4, 1.0)
                    one, taken, edges = measure(name, view, lens.every, seed=seed, progress=rest)
                    if show:
                        show(one, Seen(scene, lens, view, taken, edges))
                    every.append(one)
                known = together(every, failures)
                if not known.problems:
                    kept.put(key, asdict(known))
            done.append(known)
        except EdofsimError as error:
            failed[name] = getattr(error, "problems", (str(error),))
    return SceneScores(tuple(done), failed)


def together(every: Sequence[Measured], failures: Failures) -> Measured:
    """A scene that was measured lens by lens. Raises InputError where no system could be judged."""
    problems = {name: texts for m in every for name, texts in m.problems.items()} | failures.found
    rows = tuple(row for m in every for row in m.rows)
    Failures(problems).check(sum(row.image == "restored" for row in rows))
    facts = {lens: facts for m in every for lens, facts in m.facts.items()}
    lenses = {system: lens for m in every for system, lens in m.lenses.items()}
    return Measured(every[0].scene, rows, facts, lenses, problems)


def measure(
    name: str,
    view: View,
    systems: Sequence[System],
    *,
    ways: Sequence[Way] = WAYS,
    parts: Mapping[str, Tensor] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Measured, dict[tuple[str, str], Capture], Tensor]:
    """Scores of a view by every way and system, the photos of the ways in `SHOWN`, and where edges are.

    systems: of one lens, the lens alone first.
    parts: further regions to score, bool [y, x], by name. A system that cannot be judged by a way has no
        rows, and what was measured says so.
    """
    started = time.perf_counter()
    alone = systems[0]
    edges = near_edges(view, alone.camera)
    regions = regions_of(view, {NEAR_EDGES: edges, AWAY: ~edges, **(parts or {})})
    views = views_of(view, alone.camera)
    failures = Failures()
    rows: list[SceneScore] = []
    kept: dict[tuple[str, str], Capture] = {}
    far: dict[tuple[object, ...], float] = {}
    for step, way in enumerate(ways):
        of_way: dict[str, Capture] = {}
        for number, system in enumerate(systems):
            if progress:
                progress((step + number / len(systems)) / len(ways), f"{way.name}, {system.name}")
            if system.name in failures.found:
                continue
            # the first of the systems that take the same photo
            alike = (each for each in systems[:number] if each.name in of_way and same_photo(each, system))
            like = next((each.name for each in alike), None)
            with failures.of(system.name):
                shown = views[way.name]
                taken = capture_restored(shown, way, system, seed, like=of_way[like] if like else None)
                of_way[system.name] = taken
                # sub-apertures are no part of it
                about_layers = like or system.name, way.flat, way.encoded, way.occlusion, way.layers
                if about_layers not in far:
                    far[about_layers] = converged_db(shown, way, system)
                photo = taken.photo.how.layers, far[about_layers]
                for image in taken.images:
                    about = (name, way.name, system.name, image)
                    scores = scores_of(taken, image, regions)
                    rows += [SceneScore(*about, *place, *each, *photo) for place, each in scores]
        if way.name in SHOWN:
            kept |= {(way.name, system): taken for system, taken in of_way.items()}
    rows = [row for row in rows if row.system not in failures.found]
    kept = {key: taken for key, taken in kept.items() if key[1] not in failures.found}
    facts: dict[str, dict[str, float]] = {}
    if ours := next((taken for (way_name, _), taken in kept.items() if way_name == OURS), None):
        facts[alone.name] = {**facts_of(view, edges, ours), "seconds": time.perf_counter() - started}
    lenses = {system.name: alone.name for system in systems[1:]}
    return Measured(name, tuple(rows), facts, lenses, failures.found), kept, edges


def remembered(kept: Kept, key: str) -> Measured | None:
    """The finished scene of a key; None where there is none."""
    found = kept.get(key)
    if found is None:
        return None
    rows = tuple(SceneScore(**row) for row in found["rows"])
    return Measured(found["scene"], rows, found["facts"], found["lenses"])


def key_of(
    recipes: Sequence[SceneRecipe],
    base: Path,
    lenses: Sequence[Lens],
    networks: Sequence[Source],
    seed: int,
) -> str:
    """What a scene's scores depend on.

    recipes: of the view of each lens.
    """
    return kept_key(
        views=[view_key(recipe, base) for recipe in recipes],
        cameras={system.name: camera_digest(system.camera) for lens in lenses for system in lens.every},
        seed=seed,
        networks={source.name: source.restoration.digest for source in networks},
    )
