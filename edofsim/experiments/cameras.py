"""What restores photos of any camera, against Wiener deconvolution, on cameras that are named or on six.

The six are cameras that no network was trained for, and none of which a training drew: two with ordinary
lenses, a cubic mask, rings, a height map of another training, and the paper's with its mask at another focus.
Each camera photographs pictures as planes at random depths (see `planes`), and the middle of shipped scenes
with depth, rendered for its pixels, as `scene3d` does. All know the camera, as designed, and the range of
depths, and nothing more. Next to them stand the photo, that of the lens alone, and what was trained for that
camera alone, where there is such a thing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch

from ..capture.framing import framed
from ..core.progress import Progress, part
from ..errors import InputError
from ..optics import Camera
from ..optics.sampling import plan_sampling
from ..options import CacheOption, LimitOption, PicturesOption, SeedOption, cameras_option, systems_option
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_camera, load_scene
from ..render import render
from ..report import Page, Section, Text
from ..restore.checkpoint import ANY_CAMERA, camera_with_mask, network_of
from ..restore.scores import level_and_error
from .camera_figures import ANY, OWN, PHOTO, WIENER, figures_of, restored_in, table, write_gains
from .experiment import Findings
from .failures import Failures
from .kept import Kept, key_of
from .photographs import Photographs, photographs
from .planes import RANDOM, Condition, PictureScore, averages, measure, write_rows
from .protocols import LENS_ALONE, OURS, WAYS, Capture, System, capture_restored, saturating
from .restorations import ByNetwork, ByWiener, Restoration, digest_of
from .scene3d import scored_version
from .sources import Source, system_of
from .systems import (
    NEAREST_PER_M,
    READ_NOISE,
    EvaluatedSystem,
    camera_digest,
    of_three_lines,
    paper_test,
    with_restoration,
)

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


@dataclass(frozen=True)
class TestedCamera:
    """A camera with its mask as designed.

    said: in words.
    nearest_per_m: inverse depth up to which its pictures stand.
    scenes: that it photographs.
    own: what restores its photos alone, such as the network that was trained for it, None where there is
        none.
    """

    name: str
    said: str
    camera: Camera
    nearest_per_m: float = NEAREST_PER_M
    scenes: tuple[str, ...] = SCENES
    own: Restoration | None = None


def tested_cameras() -> list[TestedCamera]:
    """The six."""
    shipped = {name: load_camera(name) for name in ("lens-50mm-f2", "paper-cubic", "paper-rings")}
    found = {name: Camera.from_recipe(known.recipe, known.base) for name, known in shipped.items()}
    short = load_camera("lens-25mm-f5").recipe
    lens = {"kind": "ideal", "focal_length_mm": 25, "f_number": 2.8}
    short = CameraRecipe.model_validate({**short.model_dump(), "name": "lens-25mm-f2", "lens": lens})
    learned = load_camera("paper-learned")
    focus = learned.recipe.focus.model_copy(update={"distance_m": REFOCUSED_M})
    moved = learned.recipe.model_copy(update={"focus": focus})
    own, cubic = (ByNetwork.of(name) for name in (OWN_MAP, CUBIC))
    return [
        TestedCamera("50mm", "50 mm, f/2, pixels of 3.45 µm", found["lens-50mm-f2"], FARTHER_PER_M, FARTHER),
        TestedCamera("25mm", "25 mm, f/2.8, pixels of 3.45 µm", Camera.from_recipe(short)),
        TestedCamera("cubic", "the cubic mask", found["paper-cubic"], own=cubic),
        TestedCamera("rings", "phase rings", found["paper-rings"]),
        TestedCamera(
            "height-map",
            "another height map",
            camera_with_mask(load_camera("paper-clear").recipe, own.checkpoint),
            own=own,
        ),
        TestedCamera(
            "refocused", f"the paper's, focus at {REFOCUSED_M} m", Camera.from_recipe(moved, learned.base)
        ),
    ]


def asked_for(sources: Sequence[str], failures: Failures | None = None) -> list[TestedCamera]:
    """Cameras by their recipes or shipped names. A lens whose blur of half a metre takes more samples of its
    pupil than are allowed stands for itself from a metre on, as that of 50 mm does.

    failures: takes those that cannot be read, or are too large for that as well.

    Raises InputError for them otherwise, and for two of one name.
    """
    failed = Failures() if failures is None else failures
    found: list[TestedCamera] = []
    for source in sources:
        with failed.of(source):
            found.append(_tested_of(load_camera(source)))
    failed.check(0 if failures is None else 1)
    names = [each.name for each in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"--camera: more than one is called {', '.join(twice)}; rename one of them")
    return found


def _tested_of(found: Loaded[CameraRecipe]) -> TestedCamera:
    network = network_of(found)
    own = None if network is None else ByNetwork(network, digest_of(network.path or network.name))
    return _tested(found.recipe.name, Camera.from_recipe(found.recipe, found.base), own)


def _tested(name: str, camera: Camera, own: Restoration | None) -> TestedCamera:
    shortest = torch.tensor([420e-9], dtype=torch.float64)  # of the sensor's bands, in scenes
    window = camera.recipe.psf.window_px
    try:
        plan_sampling(camera, shortest, torch.tensor([0.0, NEAREST_PER_M]), window)
    except InputError:
        plan_sampling(camera, shortest, torch.tensor([0.0, FARTHER_PER_M]), window)
        said = f"{name}, up to {1 / FARTHER_PER_M:g} m"
        return TestedCamera(name, said, camera, FARTHER_PER_M, FARTHER, own)
    return TestedCamera(name, name, camera, own=own)


CamerasOption = Annotated[
    list[str] | None,
    cameras_option("Camera recipe or shipped name; repeatable. Default: six cameras that no training used."),
]
AnySystemsOption = Annotated[
    list[str] | None,
    systems_option(
        f"{ANY_CAMERA}. A system that names a camera is evaluated with that one, others with each --camera."
    ),
]


def run(
    folder: Path,
    progress: Progress,
    data: PicturesOption = None,
    limit: LimitOption = None,
    cameras: CamerasOption = None,
    systems: AnySystemsOption = None,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Compare restorations for any camera.

    Pictures at random depths and deep scenes, restored by the network for any camera and by Wiener
    deconvolution. The same command resumes interrupted work. A camera or a system that
    cannot be used is named, and the others are finished.

    Without --camera: six cameras that no network was trained for. With one set of weights for all of them,
    cameras that differ only in their masks show what the mask is worth.

    Figures: psnr_db.CAMERA.{random,SCENE}.IMAGE with IMAGE one of {photo,lens_alone,wiener,any,own,SYSTEM},
    psnr_db_se.CAMERA.SCENE.IMAGE (standard errors by the noise of the rendering),
    gain_db.CAMERA.{random,SCENE}.IMAGE.over_{photo,lens_alone,wiener} of what is restored,
    gain_db.{mean,mean.random,mean.deep,least}.over_wiener of the first system; any: the first network for any
    camera; own, where something was trained for the camera, and gap_db.CAMERA.{random,SCENE}, by which that
    is better; gap_db.greatest; pictures, left_out.
    """
    found = photographs(data, limit)
    failures = Failures()
    sources: list[Source] = []
    for text in systems or [ANY_CAMERA]:
        with failures.of(text):
            sources.append(system_of(text))
    failures.check(len(sources))
    restorers = by_name([source.restoration for source in sources if not source.names_camera])
    every: list[TestedCamera] = []
    if cameras or restorers:
        every += asked_for(cameras, failures) if cameras else tested_cameras()
    for source in (source for source in sources if source.names_camera):
        with failures.of(source.name):
            every.append(_tested(source.name, source.camera(None), source.restoration))
    by = {WIENER: ByWiener(), **restorers}
    judges = [Judge(tested, by, failures, folder, seed, cache) for tested in every]
    scores, errors, rows = _judged(judges, found, failures, progress)
    figures = figures_of(scores, errors)
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    shown = table(scores, {tested.name: tested.said for tested in every}, errors)
    page = Page(
        "Any camera",
        "Photos of any camera, and what is restored from them.",
        (Section("Scores", (shown,)),),
        (Text("PSNR of photos and restorations. All know the camera and the range of depths."),),
    )
    outputs = {"planes": write_rows(folder / "cameras.csv", rows, "depth")}
    outputs["gains"] = write_gains(folder / "cameras-gains.csv", scores)
    inputs = {"data": found.source, "systems": [source.name for source in sources]}
    problems = [*found.problems, *failures.sentences]
    return Findings(figures, page, [shown], outputs, problems, inputs)


def _judged(
    judges: Sequence[Judge], data: Photographs, failures: Failures, progress: Progress
) -> tuple[dict[str, dict[str, dict[str, float]]], dict[str, dict[str, float]], list[PictureScore]]:
    """Scores of each camera's pictures and scenes, standard errors of these, and the rows of pictures.

    Raises InputError where nothing was judged."""
    scores: dict[str, dict[str, dict[str, float]]] = {}
    errors: dict[str, dict[str, float]] = {}
    rows: list[PictureScore] = []
    for number, judge in enumerate(judges):
        name, scenes = judge.tested.name, judge.tested.scenes
        tell = part(progress, number / len(judges), (number + 1) / len(judges), name)
        with failures.of(name):
            own, planes = judge.planes(data, part(tell, 0.0, 0.6))
            rows += planes
            scores[name] = {RANDOM: own}
        for index, scene in enumerate(scenes if name in scores else ()):
            tell(0.6 + 0.4 * index / len(scenes), scene)
            with failures.of(f"{name}, {scene}"):
                judged = judge.deep(scene)
                scores[name][scene] = {what: level for what, (level, _) in judged.items()}
                errors[f"{name}.{scene}"] = {what: error for what, (_, error) in judged.items()}
    failures.check(len(scores))
    return scores, errors, rows


def by_name(restorations: Sequence[Restoration]) -> dict[str, Restoration]:
    """What restores photos of any camera, by its name in figures: the first network is `ANY`. Wiener
    deconvolution, which is there in any case, is left out."""
    found: dict[str, Restoration] = {}
    for each in restorations:
        network = isinstance(each, ByNetwork)
        name = ANY if network and ANY not in found else each.name
        if not isinstance(each, ByWiener):
            found[name] = each
    return found


@dataclass(frozen=True)
class Judge:
    """Scores of a camera by everything that restores its photos.

    by: Wiener deconvolution first.
    """

    tested: TestedCamera
    by: Mapping[str, Restoration]
    failures: Failures
    folder: Path
    seed: int
    cache: Path | None

    @property
    def restorers(self) -> dict[str, Restoration]:
        """All, that which is for this camera alone last."""
        return {**self.by, **({} if self.tested.own is None else {OWN: self.tested.own})}

    def planes(self, data: Photographs, progress: Progress) -> tuple[dict[str, float], list[PictureScore]]:
        """Means over the pictures at random depths, by three lines of light, and the rows. Raises
        InputError where nothing restores them."""
        tested = self.tested
        camera = of_three_lines(tested.camera)
        lens = camera.without_mask()
        alone = EvaluatedSystem(LENS_ALONE, lens, lambda photo, glare: photo, camera_digest(lens))
        place = self.folder / tested.name
        place.mkdir(parents=True, exist_ok=True)
        evaluated_systems = [alone]
        for name, by in self.restorers.items():
            evaluated_systems.append(with_restoration(name, camera, by, nearest_per_m=tested.nearest_per_m))
        condition = Condition(RANDOM, None, READ_NOISE, paper_test(self.seed))
        how = {"seed": self.seed, "nearest_per_m": tested.nearest_per_m}
        rows: list[PictureScore] = []
        values: dict[str, float] = {}
        for index, evaluated_system in enumerate(evaluated_systems):
            tell = part(progress, index / len(evaluated_systems), (index + 1) / len(evaluated_systems))
            with self.failures.of(f"{tested.name}, {evaluated_system.name}"):
                measured = measure(evaluated_system, data.pictures, [condition], place, progress=tell, **how)
                means = averages(measured)
                if evaluated_system is not alone:
                    values[PHOTO] = means[f"psnr_db.{evaluated_system.name}.photo.{RANDOM}"]
                values[evaluated_system.name] = means[f"psnr_db.{evaluated_system.name}.{RANDOM}"]
                rows += [replace(row, system=f"{tested.name} {row.system}") for row in measured]
        if not restored_in(values):
            raise InputError("nothing restored its photos")
        return values, rows

    def deep(self, name: str) -> dict[str, tuple[float, float]]:
        """A scene with depth, the middle of its frame, as a sensor that saturates sees it: PSNR and its
        standard error."""
        loaded = load_scene(name)
        recipe = _with_pixels(scored_version(loaded.recipe, quick=True), self.tested.camera)
        kept = Kept(self.folder / "finished.jsonl")
        digests = {name: by.digest for name, by in self.restorers.items()}
        scene = recipe.model_dump(mode="json")
        key = key_of(
            errors=True, camera=camera_digest(self.tested.camera), by=digests, scene=scene, seed=self.seed
        )
        known = kept.get(key)
        if known is not None:
            return known
        view = render(recipe, loaded.base, cache=self.cache)
        camera = replace(self.tested.camera, recipe=saturating(self.tested.camera.recipe))
        way = next(way for way in WAYS if way.name == OURS)
        found: dict[str, tuple[float, float]] = {}

        def judged(what: str, image: str, taken: Capture) -> None:
            compared, truth, noise = taken.compared(image)
            found[what] = level_and_error(compared, truth, noise)

        failed = len(self.failures.found)
        with torch.inference_mode():
            alone = capture_restored(view, way, System(LENS_ALONE, camera.without_mask()), self.seed)
            taken = capture_restored(view, way, System(WIENER, camera, ByWiener()), self.seed)
            for what, each in ((PHOTO, taken), (LENS_ALONE, alone)):
                judged(what, "photo", each)
            judged(WIENER, "wiener", taken)
            for what, by in self.restorers.items():
                with self.failures.of(f"{self.tested.name}, {name}, {what}"):
                    own = capture_restored(view, way, System(what, camera, by), self.seed, like=taken)
                    judged(what, "restored", own)
        if len(self.failures.found) == failed:
            kept.put(key, found)
        return found


def _with_pixels(recipe: SceneRecipe, camera: Camera) -> SceneRecipe:
    """A scene whose pixels see what the camera's do."""
    frame = recipe.frame.model_copy(update={"pixel_angle_mrad": "auto"})
    return framed(recipe.model_copy(update={"frame": frame}), camera)
