"""From a recipe to a plan, without rendering it: the view if it is in the cache, else small renderings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from torch import Tensor

from ..capture.fidelity import Fidelity, disperses, simpler_recipe
from ..capture.framing import seen_through
from ..capture.photograph import all_in_focus
from ..capture.prepare import channel_weights
from ..capture.sensor import automatic_exposure
from ..core.progress import Progress
from ..optics import Camera
from ..recipe import SceneRecipe
from ..render import Task, cached, forecast, render
from ..render.fetch import run_of
from ..render.settings import SURVEY_SAMPLES, samples_of_a_pass
from ..render.view import View
from .costs import Rendering
from .effect import Plan, Values
from .facts import Facts, facts_of
from .photo import plan_photo
from .target import Target

SIDE_PX = 64
SAMPLES = 16
"""Most pixels along a side, and samples, of thumbnails."""
PREVIEW_SAMPLES = 4
RAY = 1e-7
"""Reference seconds of a ray from one surface to the next, on one thread: about that of shipped scenes. What
the rays of this scene take on this machine, previews measure; that is reported."""
SURVEY_RAY_COST = 0.1
"""A ray of the survey of depths, in seconds of a path."""
BOUNCES = (2, 3)
"""Path lengths that thumbnails are rendered with, to see what longer paths add."""


@dataclass(frozen=True)
class SceneFacts:
    """What is known of a scene before its photo. facts.

    rendering: what its view costs.
    disk_mib: of the view.
    recipe: of the scene.
    """

    facts: Facts
    rendering: Rendering
    disk_mib: float
    recipe: SceneRecipe


def look(
    recipe: SceneRecipe,
    base: Path,
    camera: Camera,
    *,
    preview: bool = False,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> SceneFacts:
    """Facts of a scene from its view where that is in the cache or read from files, else from a preview; both
    with the camera's pixels.

    preview: from a preview whatever the cache holds, for a choice that must not depend on it.
    """
    view = None if preview else cached(recipe, base, cache=cache)
    if view is None and recipe.source is not None and not recipe.source.rendered:
        view = render(recipe, base, cache=cache)  # read, not rendered
    if view is not None:
        seen, view = seen_through(camera, recipe, view)
        return SceneFacts(facts_of(view, camera, recipe=seen), Rendering(), 0.0, recipe)
    how: Values = {"cache": cache, "device": device, "progress": progress}
    # the first rendering compiles kernels: a thumbnail's does, so that the preview's seconds are of rays
    render(thumbnail(recipe), base, **how)
    small = preview_of(recipe)
    seen_quickly = render(small, base, **how)
    noise_ratio = (recipe.render.samples / small.render.samples) ** 0.5
    seen, through = seen_through(camera, recipe, seen_quickly)
    facts = facts_of(through, camera, recipe=seen, noise_ratio=noise_ratio)
    bounce_errors, plain = seen_in_thumbnails(facts, base, **how)
    facts = replace(facts, bounce_errors=bounce_errors, glass_error=plain)
    expected = forecast([Task(recipe, base)], cache=cache)
    taken = _seconds(recipe, base, cache)

    def reference(fidelity: Fidelity) -> float:
        return RAY * _rays(simpler_recipe(recipe, fidelity), seen_quickly, fidelity)

    def seconds(fidelity: Fidelity) -> float:
        if taken is None:
            return expected.seconds
        planned = simpler_recipe(recipe, fidelity)
        times = _rays(planned, seen_quickly, fidelity) / _rays(small, seen_quickly, Fidelity())
        surveyed = max(times * min(1.0, SURVEY_SAMPLES / planned.render.samples) - 1, 0.0)
        return taken[0] + taken[1] * (times + SURVEY_RAY_COST * surveyed)

    return SceneFacts(facts, Rendering(reference, seconds), expected.bytes / 2**20, recipe)


def seen_in_thumbnails(
    facts: Facts,
    base: Path,
    *,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> tuple[dict[int, tuple[float, ...]], tuple[float, ...]]:
    """What small renderings say of rendering: the error of each channel of the photo if paths end after so
    many bounces, and if glass does not disperse (empty where none does).

    cache, device, progress: of `render`.
    """
    recipe = facts.recipe
    how: Values = {"cache": cache, "device": device, "progress": progress}
    bounce_errors: dict[int, tuple[float, ...]] = {}
    if recipe is None or recipe.source is not None:
        return bounce_errors, ()
    small = thumbnail(recipe)
    lengths = [length for length in BOUNCES if length < recipe.render.max_depth]
    if not lengths and not disperses(recipe):
        return bounce_errors, ()
    whole = render(small, base, **how)

    def error(fidelity: Fidelity) -> tuple[float, ...]:
        without = render(simpler_recipe(small, fidelity), base, **how)
        return _in_photo(_difference(without, whole, facts.camera), facts, small)

    for length in lengths:
        bounce_errors[length] = error(Fidelity(bounces=length))
    return bounce_errors, error(Fidelity(scene_dispersion=False)) if disperses(recipe) else ()


def plan_scene(
    scene_facts: SceneFacts,
    camera: Camera,
    *,
    overrule: Values | None = None,
    target: Target | None = None,
    progress: Progress | None = None,
) -> Plan:
    """The plan for a scene that was looked at. See `plan_photo`."""
    return plan_photo(
        scene_facts.facts.view,
        camera,
        overrule,
        target,
        facts=scene_facts.facts,
        progress=progress,
        rendering=scene_facts.rendering,
        disk_mib=scene_facts.disk_mib,
    )


def thumbnail(recipe: SceneRecipe) -> SceneRecipe:
    """The same scene with pixels so large that its longer side has at most `SIDE_PX`, and few samples."""
    frame = recipe.frame
    coarser = max(1, -(-max(frame.width_px, frame.height_px) // SIDE_PX))
    small = frame.model_copy(
        update={
            "width_px": max(1, frame.width_px // coarser),
            "height_px": max(1, frame.height_px // coarser),
            "margin_px": -(-frame.margin_px // coarser),
            "pixel_angle_mrad": frame.pixel_angle * 1e3 * coarser,
        }
    )
    return _sampled(recipe, SAMPLES).model_copy(update={"frame": small})


def preview_of(recipe: SceneRecipe) -> SceneRecipe:
    """The same frame, pixel for pixel, with few samples: right depths and edges, noisy light."""
    return _sampled(recipe, PREVIEW_SAMPLES)


def _sampled(recipe: SceneRecipe, most: int) -> SceneRecipe:
    render = recipe.render.model_copy(update={"samples": min(most, recipe.render.samples)})
    return recipe.model_copy(update={"render": render})


def _rays(recipe: SceneRecipe, view: View, fidelity: Fidelity) -> float:
    """Rays of a rendering, those behind edges counted as in the view, longer paths in proportion."""
    frame = recipe.frame
    pixels = (frame.width_px + 2 * frame.margin_px) * (frame.height_px + 2 * frame.margin_px)
    behind = 0.0
    if recipe.render.hidden and fidelity.hidden_surfaces:
        behind = float(view.hidden.sum()) / (view.padded_shape[0] * view.padded_shape[1])
    return pixels * (1 + behind) * recipe.render.samples * recipe.render.max_depth


def _seconds(recipe: SceneRecipe, base: Path, cache: Path | None) -> tuple[float, float] | None:
    """What the preview of a scene took, in seconds: once (loading, compiling), and for its rays, as its last
    pass tells; None where its entry in the cache does not say."""
    small = preview_of(recipe)
    run = run_of(small, base, cache)
    # entries of earlier versions have no such field, and what was interrupted after its last pass has 0
    if run is None or not run.get("last_pass_seconds", {}).get("all"):
        return None
    rays = run["last_pass_seconds"]["all"] * passes_of(small.render.samples)
    return sum(run["seconds"][name] for name in ("load", "survey", "paths")) - rays, rays


def passes_of(samples: int) -> int:
    """Passes that this many samples a pixel are taken in."""
    return -(-samples // samples_of_a_pass(samples))


def _difference(view: View, whole: View, camera: Camera) -> Tensor:
    """Difference of two thumbnails' all-in-focus images, [channel, y, x], exposed as the whole.

    Both follow the same random numbers, so that what differs is the light of the longer paths.
    """
    weights = channel_weights(camera, whole.wavelengths).to(whole.radiance)
    ideal = all_in_focus(whole, weights)
    other = all_in_focus(view, weights)
    exposure = automatic_exposure(whole.crop_margin(ideal), noisy=whole.noise > 0)
    return whole.crop_margin(other - ideal).double() * exposure


def _in_photo(difference: Tensor, facts: Facts, small: SceneRecipe) -> tuple[float, ...]:
    """Root mean square of a thumbnail's difference [channel, y, x] as it will be in the photo, per channel.

    What a Gaussian leaves of it is light that differs; the rest is noise of few samples (paths that glass
    sends elsewhere are other samples). The recipe's samples leave less noise, and the photo's blur less yet:
    a PSF leaves `facts.averaging` of it, the root of sum psf^2, which a Gaussian of 1 / (2 sqrt(pi) sigma)
    has. The Gaussian here is as wide as that of the photo, and at least one pixel of the thumbnail.
    """

    coarser = small.frame.pixel_angle / facts.scene.frame.pixel_angle
    fewer = small.render.samples / facts.scene.render.samples
    found = []
    for plane, kept in zip(difference.numpy(), facts.averaging, strict=True):
        sigma = max(1.0, 1 / (2 * math.pi**0.5 * kept) / coarser)
        left = 1 / (4 * math.pi * sigma**2)
        whole = float(np.square(plane).mean())
        blurred = float(np.square(gaussian_filter(plane, sigma)).mean())
        light = min(max((blurred - left * whole) / (1 - left), 0.0), whole)
        found.append(math.sqrt(light + kept**2 * fewer * (whole - light)))
    return tuple(found)
