"""A scene rendered: survey of depths, passes of samples, fragments."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from ..core.interrupts import interruptible
from ..core.json_values import Json
from ..core.progress import Progress, part, silent
from ..errors import InputError
from ..recipe.scene import SceneRecipe
from ..scene.model import SceneModel
from .depths import NOWHERE, DepthSurvey, survey, unparted
from .engine import thread_count, use_engine
from .foreign import load_foreign
from .fragments import Fragments
from .partial import load_partial, save_partial
from .passes import LEAST_PASSES, Group, Launch, Sums, groups_of, launches_of, pass_sizes
from .settings import INTEGRATOR, RenderSettings
from .translate import build_stage

if TYPE_CHECKING:
    from .foreign import ForeignStage
    from .translate import Stage

HIDDEN_LAYERS = 2
"""Surfaces behind the visible one that a pupil may look at, one behind the other."""

SURVEY_SHARE = 0.1
"""Part of the time that loading and the survey of depths take; for the progress bar only."""

SAVE_SECONDS = 20.0
"""Work is saved about so often: the most that a killed process loses."""


def render_model(
    model: SceneModel,
    settings: RenderSettings,
    *,
    device: str = "auto",
    progress: Progress | None = None,
    partial: Path | None = None,
) -> Fragments:
    """Render a scene.

    partial: file that keeps finished work when this is interrupted, and that is gone on from.

    The same model and settings give the same bytes, however often it was interrupted and with any number of
    threads. Raises InputError for a scene that cannot be carried, EngineError where nothing can render.
    """
    begun = time.perf_counter()
    with interruptible(progress or silent) as say:
        mi = use_engine(device)

        say(0.0, f"loading {len(model.objects)} objects")
        stage = build_stage(mi, model)
        about = {"scene": model.name, "route": _route(model)}
        return render_stage(mi, stage, model.wavelengths, settings, about, say, partial, begun)


def render_foreign(
    recipe: SceneRecipe,
    base: Path,
    settings: RenderSettings,
    reasons: Sequence[str],
    *,
    device: str = "auto",
    progress: Progress | None = None,
    partial: Path | None = None,
) -> Fragments:
    """Render a Mitsuba scene through Mitsuba's spectral variant, for the reasons given. See
    `render_model`. Raises InputError for a scene that Mitsuba cannot render."""

    begun = time.perf_counter()
    with interruptible(progress or silent) as say:
        mi = use_engine(device, colours="spectral")
        say(0.0, f"loading the scene into Mitsuba's spectral variant: {reasons[0]}")
        stage = load_foreign(mi, recipe, base)
        route = "four bands a path, by Mitsuba's spectral variant: " + "; ".join(reasons)
        about = {"scene": recipe.name, "route": route}
        try:
            return render_stage(mi, stage, stage.wavelengths, settings, about, say, partial, begun)
        except RuntimeError as error:
            if "out of memory" in str(error):
                raise
            said = " ".join(str(error).split())[:300]
            raise InputError(f"{recipe.name}: Mitsuba cannot render this scene: {said}") from error


def render_stage(
    mi: ModuleType,
    stage: Stage | ForeignStage,
    wavelengths: np.ndarray,
    settings: RenderSettings,
    about: Mapping[str, object],
    say: Progress,
    partial: Path | None,
    begun: float,
) -> Fragments:
    """Survey, samples and fragments of a stage that is loaded.

    wavelengths: [band], metres.
    """
    loaded = time.perf_counter()
    surveys, limits, hidden = survey_layers(stage, settings, part(say, 0.0, SURVEY_SHARE))
    surveyed = time.perf_counter()
    groups = groups_of(surveys, limits)
    sums = load_partial(partial, groups, stage.bands) if partial else None
    sums = sums or Sums.empty(groups, stage.bands)
    take_samples(stage, settings, groups, sums, say, partial)
    metadata = {
        **about,
        "integrator": INTEGRATOR,
        "mitsuba": version("mitsuba"),
        "drjit": version("drjit"),
        "samples": sums.samples,
        "hidden": hidden,
        "layers": [len(found.pixels) for found in surveys],
        "pupil_radius_m": settings.pupil_radius,
        "broken_samples": sums.broken,
    }
    metadata |= {"chief_rays": settings.chief_rays} if settings.chief_rays else {}
    seconds = {"load": loaded - begun, "survey": surveyed - loaded, "paths": sums.seconds}
    run = {"variant": mi.variant(), "threads": thread_count(), "seconds": seconds}
    run["last_pass_seconds"] = {"all": sums.last_pass}
    return assemble(wavelengths, settings, groups, sums, {**metadata, "run": run})


def _route(model: SceneModel) -> str:
    if not model.dispersive:
        return "many bands a path"
    names = ", ".join(model.dispersive)
    return f"many bands a path; one band a path behind glass that disperses light ({names})"


def survey_layers(
    stage: Stage | ForeignStage, settings: RenderSettings, progress: Progress
) -> tuple[list[DepthSurvey], list[np.ndarray], str]:
    """What each layer sees: the visible one, then the hidden ones behind it; the limits of the latter (see
    `rays.Samples`, float32 [pixel of the frame]); and a sentence on them."""
    from .tracing import depth_tiles

    rows, columns = settings.padded_shape
    everything = np.arange(rows * columns, dtype=np.int64)
    limits: list[np.ndarray] = []

    def look(pixels: np.ndarray) -> DepthSurvey:
        tiles = depth_tiles(stage, settings, pixels, limits, lambda part: progress(part, "measuring depth"))
        return survey(tiles, settings.gap, settings.fragments)

    if not settings.hidden and settings.fragments == 1:
        # Every pixel has one fragment of all its samples, whatever their depths
        return [unparted(everything)], limits, "not rendered: the recipe says so"
    surveys = [look(everything)]
    if not settings.hidden:
        return surveys, limits, "not rendered: the recipe says so"
    for _ in range(HIDDEN_LAYERS):
        limits.append(_limits(surveys[-1], surveys[0], settings))
        found = look(np.flatnonzero(limits[-1] < np.inf))
        if not len(found.pixels):
            break
        surveys.append(found)
    if len(surveys) == 1:
        return surveys, limits, "none: no depth edge"
    share = 100 * len(surveys[1].pixels) / (rows * columns)
    return surveys, limits, f"behind {share:.1f} % of the pixels, {len(surveys) - 1} deep"


def _limits(last: DepthSurvey, seen: DepthSurvey, settings: RenderSettings) -> np.ndarray:
    """Inverse depth above which the pupil looks behind surfaces of the last layer, float32 [pixel of the
    frame]; infinite where it looks behind none."""
    from .edges import seen_around

    rows, columns = settings.padded_shape
    farthest = seen.farthest.reshape(rows, columns)
    limits = np.full(rows * columns, np.inf, np.float32)
    reach = settings.pupil_radius / settings.pixel_angle
    for surface in range(settings.fragments):
        top = last.tops[:, surface]
        level = np.full(rows * columns, -np.inf, np.float32)
        level[last.pixels] = np.where(top == NOWHERE, -np.inf, top)
        reached = seen_around(level.reshape(rows, columns), farthest, settings.gap, reach).ravel()
        below = np.full(rows * columns, NOWHERE, np.float32)
        if surface < settings.fragments - 1:
            below[last.pixels] = last.bounds[:, surface]
        limits[reached] = below[reached]
    return limits


def take_samples(
    stage: Stage | ForeignStage,
    settings: RenderSettings,
    groups: tuple[Group, ...],
    sums: Sums,
    say: Progress,
    partial: Path | None,
) -> None:
    """Launch what is missing in `sums`, in order, until there are enough samples or the noise is low
    enough. Sums are whole wherever progress is reported."""
    from .tracing import run_launch

    before = 0
    clock = _Clock(settings, groups, sums, say)
    saved = time.perf_counter()
    try:
        for number, size in enumerate(pass_sizes(settings)):
            launches = launches_of(groups, number, size, stage.bands)
            spent = sums.seconds
            for launch in launches[max(0, sums.launches - before) :]:
                start = time.perf_counter()
                result = run_launch(stage, settings, groups[launch.group], launch)
                sums.add(launch, groups, result)
                now = time.perf_counter()
                sums.seconds += now - start
                clock.tick(launch, sums)
                if partial and now - saved > SAVE_SECONDS:
                    save_partial(partial, sums)
                    saved = now
            before += len(launches)
            if sums.passes == number:
                sums.finished(number, size)
                sums.last_pass = sums.seconds - spent
            if sums.passes == number + 1 and _good_enough(sums, settings):
                break
    except (KeyboardInterrupt, SystemExit):
        if partial and sums.launches:
            save_partial(partial, sums)
        raise


def _good_enough(sums: Sums, settings: RenderSettings) -> bool:
    return settings.noise is not None and sums.passes >= LEAST_PASSES and sums.noise() <= settings.noise


class _Clock:
    """Turns launches into a fraction and a message with the time left."""

    def __init__(
        self, settings: RenderSettings, groups: tuple[Group, ...], sums: Sums, say: Progress
    ) -> None:
        self.settings, self.say = settings, say
        self.pixels = sum(len(group.pixels) for group in groups)
        self.done = 0
        self.started = time.perf_counter()
        self.first = sums.samples * self.pixels

    def tick(self, launch: Launch, sums: Sums) -> None:
        """After a launch."""
        self.done += (launch.stop - launch.start) * launch.weight
        wanted = self.settings.samples
        noise = ""
        if self.settings.noise is not None and sums.passes >= 2:
            now = sums.noise()
            wanted = sums.samples * max(1.0, (now / self.settings.noise) ** 2)
            noise = f", noise {100 * now:.2g} % of at most {100 * self.settings.noise:.2g} %"
        total = wanted * self.pixels
        fraction = min(1.0, (self.first + self.done) / total)
        left = (time.perf_counter() - self.started) * max(0.0, total - self.first - self.done) / self.done
        self.say(SURVEY_SHARE + (1 - SURVEY_SHARE) * fraction, f"tracing paths, {left:.0f} s left{noise}")


def assemble(
    wavelengths: np.ndarray,
    settings: RenderSettings,
    groups: tuple[Group, ...],
    sums: Sums,
    metadata: Json,
) -> Fragments:
    """Fragments from sums, sorted by pixel and from near to far.

    wavelengths: [band], metres.
    """
    pixel = np.concatenate([np.tile(group.pixels, group.surfaces) for group in groups])
    hidden = np.concatenate([np.full(group.slots, group.layer > 0) for group in groups])
    met = np.flatnonzero(sums.count > 0)
    inverse_depth = (sums.inverse_depth[met] / sums.count[met]).astype(np.float32)
    order = np.lexsort((hidden[met], -inverse_depth, pixel[met]))
    slot, inverse_depth = met[order], inverse_depth[order]
    radiance = np.empty((len(wavelengths), len(slot)), np.float32)
    for total, mean in zip(sums.radiance, radiance, strict=True):
        mean[:] = total[slot] / sums.samples
    return Fragments(
        height=settings.height,
        width=settings.width,
        margin=settings.margin,
        pixel=pixel[slot],
        coverage=(sums.count[slot] / sums.samples).astype(np.float32),
        inverse_depth=inverse_depth,
        radiance=radiance,
        hidden=hidden[slot],
        wavelengths=np.asarray(wavelengths, np.float64).copy(),
        pixel_angle=settings.pixel_angle,
        noise=sums.noise(),
        metadata=metadata,
        half_difference=sums.half_difference(slot),
    )
