"""The main job on one page: render, plan, expose, restore, score, report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .capture import Fidelity, Photo, capture
from .capture.checks import check_fits
from .capture.device import torch_device
from .capture.fidelity import simpler_camera
from .capture.fidelity_file import WHERE, read_fidelity
from .capture.field import frame_of
from .capture.framing import framed, seen_through
from .capture.guessed import lacks_hidden, with_guessed
from .capture.noise import PhotoNoise, photo_noise
from .capture.presets import PRESETS, preset
from .core.memory import give_back_renderers_memory
from .core.progress import Progress
from .core.stopwatch import Stopwatch
from .core.threads import in_threads
from .optics import Camera
from .optics.nodes import nodes_between
from .plan import (
    RESTORED,
    Facts,
    Plan,
    Target,
    checked_overrule,
    facts_of,
    insisted_rendering,
    learn_rates,
    look,
    plan_alone,
    plan_figures,
    plan_photo,
    plan_scene,
    simpler_recipe,
    with_predicted,
)
from .recipe import CameraRecipe, Loaded, SceneRecipe
from .record import peak_memory_mib
from .render import cached, render
from .render.view import View
from .restore import channel_psfs, choose_network, restore
from .restore.checkpoint import Checkpoint
from .restore.gains import gain_figures, gains
from .restore.places import Method
from .restore.scores import DepthScore, Score, TruthNoise, score_by_depth
from .restore.truth import Truth, noise_figures, samples_for


@dataclass(frozen=True)
class Run:
    """All that the main job made. Images are linear [channel, y, x], full scale 1.

    wiener: the photo restored by Wiener deconvolution, for comparison where a network restored.
    psfs: `channel_psfs` of the camera as the plan simulates it, at the inverse depths `psf_depths` [depth] in
        1/m, from far to near, that stand for the scene (`nodes_between`).
    plan_lens_alone: of the photo through the lens alone.
    noise: of the photo.
    noises: what images are scored without, by the names of scores.
    gains: of the restored image in dB, see `restore.gains`.
    """

    scene: Loaded[SceneRecipe]
    camera: Loaded[CameraRecipe]
    optics: Camera
    checkpoint: Checkpoint | None
    seed: int
    view: View
    plan: Plan
    plan_lens_alone: Plan
    photo: Photo
    psfs: Tensor
    psf_depths: Tensor
    restored: Tensor
    restored_by: Method
    wiener: Tensor | None
    lens_alone: Photo
    noise: PhotoNoise
    noises: Mapping[str, TruthNoise]
    scores: Mapping[str, Score]
    by_depth: Mapping[str, tuple[DepthScore, ...]]
    gains: Mapping[str, float]
    seconds: Mapping[str, float]
    peak_memory_mib: float


def run(
    scene: Loaded[SceneRecipe],
    camera: Loaded[CameraRecipe],
    *,
    cache: Path | None = None,
    network: str | Path | None = None,
    resample: bool = False,
    overrule: Mapping[str, object] | None = None,
    target: Target | None = None,
    fidelity: str | Path | None = None,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> Run:
    """Photograph a scene, restore the photo, and score both, next to a photo through the lens alone.

    Either photo has a plan of its own: what a mask evens out, the bare lens may show, and nothing is restored
    from its photo (see `plan_alone`).

    cache: folder of rendered views, None for the default one.
    network: see `choose_network`.
    resample: the view, where the scene's pixels see another angle than the camera's (see `framed`).
    overrule: what replaces the plan's choices (see `plan_photo`).
    target: the accuracy or time that is planned for, None for one that keeps the restored image's PSNR
        (`RESTORED`).
    fidelity: a preset or a file that says what is simulated, in place of a plan.
    seed: of the sensor's noise.
    device: auto, cpu or cuda.

    Raises InputError for what cannot be used, EngineError where nothing can render.
    """
    watch, overrule, target = Stopwatch(progress), checked_overrule(overrule), target or RESTORED
    compute = torch_device(device)
    checkpoint, optics = choose_network(network, camera)
    asked = {"resample": resample, "overrule": overrule, "target": target, "fidelity": fidelity}
    view, plan, facts = planned_view(scene, optics, watch, cache=cache, device=device, **asked)
    work = _Work(view, optics, plan, checkpoint, seed, compute, watch)
    rival = work.plan_alone(facts, overrule, target)
    known = facts.view
    del facts
    give_back_renderers_memory()
    photo, lens_alone = work.photos(known, rival)
    psfs, depths = work.psfs()
    restores = _Restores(work, photo, psfs, depths)
    with watch.stage("restore", 0.93, 0.94):
        restored, by = restores.by_network(photo.image)
    wiener = None
    if checkpoint is not None:
        with watch.stage("wiener", 0.94, 0.96):
            wiener = restores.by_wiener(photo.image)
    with watch.stage("score", 0.96, 0.98):
        noise, noises, scores, by_depth = restores.scored(restored, wiener, rival, lens_alone)
    means = gains({name: whole.psnr_db for name, whole in scores.items()})
    photos = (view, plan, rival, photo, psfs, depths, restored, by, wiener, lens_alone)
    found = (noise, noises, scores, by_depth, means, watch.seconds, peak_memory_mib())
    return Run(scene, camera, optics, checkpoint, seed, *photos, *found)


@dataclass(frozen=True)
class _Work:
    """What the stages of a run share, once its photo is planned."""

    view: View
    optics: Camera
    plan: Plan
    checkpoint: Checkpoint | None
    seed: int
    compute: torch.device | str
    watch: Stopwatch

    @property
    def alone(self) -> Camera:
        """The lens alone."""
        return self.optics.without_mask()

    @property
    def bare(self) -> bool:
        """Whether that is the camera itself."""
        return not self.optics.mask_given and self.optics.recipe == self.alone.recipe

    def plan_alone(self, facts: Facts, overrule: Mapping[str, object], target: Target) -> Plan:
        """The plan of the photo through the lens alone."""
        with self.watch.stage("plan lens alone", 0.68, 0.7) as tell:
            if self.bare:
                return self.plan
            if self.plan.replayed:
                return _alone_as(self.plan.replayed, self.view, self.alone)
            return plan_alone(self.plan, facts, self.alone, overrule, target, progress=tell)

    def photos(self, known: View, rival: Plan) -> tuple[Photo, Photo]:
        """The photo, and that through the lens alone, exposed alike. known: the view with what is behind its
        edges."""
        how = {"seed": self.seed, "device": self.compute}
        with self.watch.stage("expose", 0.7, 0.82):
            fidelity = self.plan.fidelity.of_photo()
            seen = known if fidelity.uncovers else self.view
            photo = capture(seen, self.optics, fidelity, **how)
            photo = with_predicted(photo, self.plan)
        if self.compute == "cpu":
            learn_rates(self.plan.seconds, photo.seconds)
        with self.watch.stage("lens alone", 0.82, 0.92):
            if self.bare:
                return photo, photo
            taken, exposure = rival.fidelity.of_photo(), photo.exposure
            seen = known if taken.uncovers else self.view
            return photo, capture(seen, self.alone, taken, exposure=exposure, **how)

    def psfs(self) -> tuple[Tensor, Tensor]:
        """PSFs of the camera as simulated, and the inverse depths that they stand for."""
        with self.watch.stage("psfs", 0.92, 0.93):
            simpler = simpler_camera(self.optics, self.plan.fidelity.of_photo())
            depths = nodes_between(simpler, self.view.wavelengths, *self.view.inverse_depth.aminmax())
            return channel_psfs(simpler, self.view.wavelengths, depths), depths

    def noise_of(self, camera: Camera, plan: Plan, photo: Photo) -> PhotoNoise:
        """The noise of the rendering in a photo."""
        return photo_noise(self.view, camera, plan.fidelity.of_photo(), photo, self.compute)


@dataclass(frozen=True)
class _Restores:
    """Restorations of a photo, and scores of all its images."""

    work: _Work
    photo: Photo
    psfs: Tensor
    depths: Tensor

    def by_network(self, image: Tensor) -> tuple[Tensor, Method]:
        return self._restore(image, checkpoint=self.work.checkpoint, truncated=self.photo.truncated)

    def by_wiener(self, image: Tensor) -> Tensor:
        return self._restore(image)[0]

    def _restore(
        self,
        image: Tensor,
        **how: Any,  # pyrefly: ignore[explicit-any]
    ) -> tuple[Tensor, Method]:
        view = self.work.view
        how |= {"psfs": self.psfs, "frame": frame_of([view])}
        return restore(image, self.work.optics, view.wavelengths, self.depths, **how)

    def scored(
        self, restored: Tensor, wiener: Tensor | None, rival: Plan, lens_alone: Photo
    ) -> tuple[PhotoNoise, dict[str, TruthNoise], dict[str, Score], dict[str, tuple[DepthScore, ...]]]:
        """Noise of the photo, what each image is scored without, and scores as wholes and by depth."""
        work, photo = self.work, self.photo
        truth = Truth(photo.ideal, work.noise_of(work.optics, work.plan, photo))
        alone = truth.noise if work.bare else work.noise_of(work.alone, rival, lens_alone)
        images = {"photo": (photo.image, truth.noise.image)}
        again = truth.restored_noise(photo.image, restored, lambda x: self.by_network(x)[0])
        images["restored"] = restored, again
        if wiener is not None:
            images["wiener"] = wiener, truth.restored_noise(photo.image, wiener, self.by_wiener)
        images["lens_alone"] = lens_alone.image, alone.image
        scores, by_depth, noises = _scored(images, truth, work.view)
        return truth.noise, noises, scores, by_depth


def _scored(
    images: Mapping[str, tuple[Tensor, Tensor | None]], truth: Truth, view: View
) -> tuple[dict[str, Score], dict[str, tuple[DepthScore, ...]], dict[str, TruthNoise]]:
    """Scores of images with their noise, as wholes and by depth, and what they are without, each by name."""
    inverse_depth = view.crop_margin(view.mean_inverse_depth())
    compared = {name: truth.compared(*pair) for name, pair in images.items()}

    def judged(each: tuple[Tensor, Tensor, TruthNoise]) -> tuple[Score, tuple[DepthScore, ...]]:
        return score_by_depth(*each, inverse_depth)

    found = in_threads(judged, list(compared.values()), truth.ideal.device)
    scores = {name: whole for name, (whole, _) in zip(images, found, strict=True)}
    by_depth = {name: parts for name, (_, parts) in zip(images, found, strict=True)}
    return scores, by_depth, {name: noise for name, (_, _, noise) in compared.items()}


def planned_view(
    scene: Loaded[SceneRecipe],
    camera: Camera,
    watch: Stopwatch,
    *,
    resample: bool = False,
    overrule: Mapping[str, object] | None = None,
    target: Target | None = None,
    fidelity: str | Path | None = None,
    cache: Path | None = None,
    device: str = "auto",
) -> tuple[View, Plan, Facts]:
    """The stages `render`, `guess` and `plan`: the view of a scene, the plan of its photo, and the facts that
    it was planned on. See `run`.

    The view is rendered as its recipe says, as it is also the truth that photos are scored against, but for
    effects of rendering that the user leaves out; the photo is planned on it. Only where a time is asked for,
    rendering is planned as well, on a preview (stage `preview`), unless the view is in the cache: what can be
    done in a time depends on the machine.
    """
    overrule, recipe = checked_overrule(overrule), framed(scene.recipe, camera, resample)
    if fidelity is not None:
        how = {"cache": cache, "device": device}
        return _replayed_view(str(fidelity), recipe, scene.base, camera, watch, **how)
    rendered = recipe.source is None or recipe.source.rendered
    timed = target is not None and target.kind == "time"
    if rendered:
        recipe = simpler_recipe(recipe, insisted_rendering(overrule))
    if rendered and timed and cached(recipe, scene.base, cache=cache) is None:
        with watch.stage("preview", 0.0, 0.1) as tell:
            preview = look(recipe, scene.base, camera, cache=cache, device=device)
            plan = plan_scene(preview, camera, overrule=overrule, target=target, progress=tell)
        recipe = simpler_recipe(recipe, plan.fidelity)
    with watch.stage("render", 0.1, 0.6) as tell:
        view = render(recipe, scene.base, cache=cache, device=device, progress=tell)
        seen, view = seen_through(camera, recipe, view)
    give_back_renderers_memory()
    known = _behind_edges(view, camera, watch)
    with watch.stage("plan", 0.62, 0.68) as tell:
        left = target
        if target is not None and target.kind == "time":
            left = replace(target, spent=sum(watch.seconds.values()))
        facts = facts_of(known, camera, recipe=seen)
        plan = plan_photo(
            known,
            camera,
            overrule,
            left,
            every_effect=False,
            facts=facts,
            progress=tell,
        )
    return view, plan, facts


def _behind_edges(view: View, camera: Camera, watch: Stopwatch) -> View:
    """The stage `guess`, where it is not known what lies behind the view's edges: all photos composite it."""
    if not lacks_hidden(view):
        return view
    with watch.stage("guess", 0.6, 0.62):
        return with_guessed(view, camera)


def _replayed_view(
    given: str,
    recipe: SceneRecipe,
    base: Path,
    camera: Camera,
    watch: Stopwatch,
    **how: Any,  # pyrefly: ignore[explicit-any]
) -> tuple[View, Plan, Facts]:
    """The view that a given fidelity asks for, that fidelity as a plan, and facts of the view. given: a name
    of `PRESETS`, or a file. Raises InputError for a fidelity that does not fit."""
    read = None if given in PRESETS else Fidelity.load(given)
    if read is not None:
        check_fits(read, camera, recipe)
        recipe = simpler_recipe(recipe, read)
    with watch.stage("render", 0.0, 0.6) as tell:
        view = render(recipe, base, progress=tell, **how)
        seen, view = seen_through(camera, recipe, view)
    known = _behind_edges(view, camera, watch)
    with watch.stage("plan", 0.62, 0.68):
        chosen = read or preset(given, camera, view)
        facts = facts_of(known, camera, recipe=seen)
    return view, _as_given(chosen, given), facts


def _alone_as(given: str, view: View, alone: Camera) -> Plan:
    """The same through the lens alone: a run's file has its fidelity, others are taken for both."""
    if given in PRESETS:
        return _as_given(preset(given, alone, view), given)
    return _as_given(read_fidelity(Path(given), Fidelity, ("fidelity_lens_alone", *WHERE)), given)


def _as_given(fidelity: Fidelity, given: str) -> Plan:
    return Plan((), fidelity, replayed=given, target=f"the fidelity of {given}")


def figures(result: Run) -> dict[str, float]:
    """The figures of `--json`, flat: what, of which image, where."""
    found: dict[str, float] = {}
    for name, whole in result.scores.items():
        parts = {f".{part.near_m:g}m_to_{part.far_m:g}m": part.score for part in result.by_depth[name]}
        for where, each in {"": whole, **parts}.items():
            found[f"psnr_db.{name}{where}"], found[f"ssim.{name}{where}"] = each.psnr_db, each.ssim
            found[f"psnr_db_se.{name}{where}"], found[f"ssim_se.{name}{where}"] = (
                each.psnr_db_se,
                each.ssim_se,
            )
    found |= {f"seconds.{stage.replace(' ', '_')}": seconds for stage, seconds in result.seconds.items()}
    found["seconds.total"] = sum(result.seconds.values())
    found["peak_memory_mib"] = result.peak_memory_mib
    found["render_noise"] = result.view.noise
    found |= gain_figures(result.gains)
    found |= noise_figures(result.noise)
    if (wanted := samples_for(result.scores["restored"], result.view.metadata.get("samples", 0))) is not None:
        found["samples_for_0.05_db"] = wanted
    found |= plan_figures(result.plan, result.seconds["plan"])
    alone = plan_figures(result.plan_lens_alone, result.seconds["plan lens alone"])
    stem = "plan."
    return found | {
        f"plan_lens_alone.{name.removeprefix(stem)}": value
        for name, value in alone.items()
        if name.startswith(stem)
    }
