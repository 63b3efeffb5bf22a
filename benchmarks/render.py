"""What a view costs: against Mitsuba's own ways to many bands, each with its best sampler, and against its
own size.

All ways get the same scene, frame, bounces and threads, use no roulette, and are asked for the same numbers
of samples a pixel; Mitsuba's samplers round these as they must (`orthogonal` takes 25, 121 and 289 for 16, 64
and 256), and the noise is of what they took. Every way of Mitsuba's is tried with each of `SAMPLERS`. Ours
has samplers of its own: Owen-scrambled Sobol pairs, stratified within a pass, of which a view has at least
two.

Ours is one path for all bands: its noise is the same in all of them, and the sum over the bands of a sensor
channel has no less. The noise of `specfilm`, whose paths carry four wavelengths each, and of rgb passes with
seeds of their own averages over the bands of a channel. So noise is told twice: of one band, which is what a
spectral cube needs, and of one sensor channel, which is what a photo needs.

Tried for the noise of a channel, and left: bands in two, three and six interleaved groups, each on paths of
its own, took 1.0, 1.2 and 1.4 to 2.2 times as long at equal noise. All samples in one pass, stratified
together, have 0.79, 0.96 and 0.75 of the variance at 16, 64 and 256 samples, but leave no passes to tell the
noise by.

Times are of rendering alone, kernels compiled and scene loaded, the medians of turns; on processors they are
processor seconds, which other work on the machine disturbs least. Noise is the root mean square difference of
images with other seeds, relative to the mean of each band or channel. Seconds times noise squared is what an
image of noise 1 would take if noise fell with the square root of the samples; the ratio of ways at the same
samples is that of their times at equal noise. Stratified samples do better than that, so that ratios hold for
their number of samples alone.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from benchmarks.packed import PackedScene
from benchmarks.spectral_film import SpectralFilm
from edofsim.capture.prepare import channel_weights
from edofsim.core.progress import Progress, silent
from edofsim.optics import Camera
from edofsim.recipe import load_camera, load_scene
from edofsim.record import peak_memory_mib
from edofsim.render.engine import use_engine
from edofsim.render.rendering import render_model, render_stage
from edofsim.render.settings import RenderSettings
from edofsim.render.translate import build_stage
from edofsim.render.view import View
from edofsim.scene import build_scene
from edofsim.scene.model import SceneModel

SAMPLES = (16, 64, 256)
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
"""All that Mitsuba 3.9 has."""
SIZE, FULL_SIZE = (120, 96), (240, 192)
"""Width and height of the frame."""
TURNS = 3
COLOURS_NM = (610.0, 550.0, 460.0)
"""The bands of the rgb image."""
VIEWS = ((256, 31, 16), (512, 31, 16), (512, 3, 16), (512, 61, 16))
FULL_VIEWS = (*VIEWS, (1024, 31, 16), (512, 31, 64))
"""(side in pixels, bands, samples) of whole views."""


def run(progress: Progress | None = None, full: bool = False) -> dict[str, float]:
    """Figures, each the name and a number; N: samples a pixel that were asked for, 16, 64 or 256.

    channel_ratio.strongest.{specfilm,packed,rgb}.Ns: seconds times noise squared of a sensor channel, over
    ours: below 1 the other way is faster at equal noise; of the sampler that makes it least;
    band_ratio.(same): of one band; both least first. `packed`: ceil(bands / 3) rgb passes; `rgb`: one of
    them, an image of three bands without the others;
    {channel_ratio,band_ratio,channel_noise,band_noise,seconds,samples}.{specfilm,rgb}.SAMPLER.Ns, of `packed`
    with the sampler that is best for one of its passes, and of `bands`, ours;
    times_path_image.Ns: seconds of all bands over the median of one rgb image; times_path_image.view.Ns: with
    the survey of depths, fragments and hidden surfaces;
    view.{seconds,peak_memory_mib}.{size}px_{bands}b_{samples}s: what whole views cost.
    full: a frame of 240 x 192 pixels in place of 120 x 96, and larger views.
    """
    say = progress or silent
    say(0.0, "ways to many bands")
    figures = in_a_process(compare_ways, *(FULL_SIZE if full else SIZE), SAMPLES, SAMPLERS)
    cases = FULL_VIEWS if full else VIEWS
    for number, (size, bands, samples) in enumerate(cases):
        say(0.7 + 0.3 * number / len(cases), f"a view of {size} x {size}, {bands} bands, {samples} samples")
        seconds, memory = in_a_process(whole_view, size, bands, samples)
        name = f"{size}px_{bands}b_{samples}s"
        figures[f"view.seconds.{name}"] = seconds
        figures[f"view.peak_memory_mib.{name}"] = memory
    say(1.0, "done")
    return figures


def in_a_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a new process, so that memory and compiled kernels are its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def desk(width: int, height: int, samples: int, bands: int = 31) -> tuple[SceneModel, RenderSettings]:
    """The desk in a frame of another size: as much of it is seen, in other pixels, and no margin."""
    loaded = load_scene("desk")
    recipe = loaded.recipe.model_copy(
        update={"bands": loaded.recipe.bands.model_copy(update={"count": bands})}
    )
    settings = RenderSettings.from_recipe(recipe)
    angle = settings.pixel_angle * settings.width / width
    settings = replace(settings, width=width, height=height, margin=0, pixel_angle=angle, samples=samples)
    return build_scene(recipe, loaded.base), settings


@dataclass(frozen=True)
class Cost:
    """seconds of one image of all its bands; samples a pixel that it took; relative noise of one band and of
    one sensor channel."""

    seconds: float
    samples: int
    band: float
    channel: float

    def product(self, which: str) -> float:
        """Seconds times the square of a noise, `band` or `channel`."""
        return self.seconds * getattr(self, which) ** 2


def cost_of(images: list[np.ndarray], seconds: list[float], samples: int, weights: np.ndarray) -> Cost:
    """Of images [band, y, x] with other seeds, and their seconds. weights: [channel, band]."""
    stack = np.stack(images)
    channels = np.einsum("cb,nbyx->ncyx", weights, stack)
    return Cost(statistics.median(seconds), samples, relative_noise(stack), relative_noise(channels))


def relative_noise(images: np.ndarray) -> float:
    """Of one image: scatter of images [n, band, y, x], relative to each band's mean, over all bands."""
    variance = images.var(axis=0, ddof=1).mean(axis=(1, 2))
    return float(np.sqrt((variance / images.mean(axis=(0, 2, 3)) ** 2).mean()))


def compare_ways(
    width: int, height: int, counts: tuple[int, ...], samplers: tuple[str, ...]
) -> dict[str, float]:
    """Figures of `run`, of each way to an image, for these samples a pixel and samplers of Mitsuba's."""
    model, settings = desk(width, height, counts[0])
    weights = sensor_weights(model)
    costs = our_costs(model, settings, counts, weights)
    mi = use_engine()
    for sampler in samplers:
        scene = PackedScene(mi, model, settings, sampler=sampler)
        scene.set_bands(colour_bands(model))
        for count in counts:
            costs["rgb", sampler, count] = turns(
                lambda seed, c=count, s=scene: s.image(c, seed), lambda s=scene: s.samples, np.eye(3)
            )
    for count in counts:
        best = min(samplers, key=lambda name: costs["rgb", name, count].product("band"))
        scene = PackedScene(mi, model, settings, sampler=best)
        costs["packed", best, count] = packed_cost(scene, model, count, weights)
    mi = use_engine(colours="spectral")
    for sampler in samplers:
        film = SpectralFilm(mi, model, settings, sampler)
        for count in counts:
            costs["specfilm", sampler, count] = turns(
                lambda seed, c=count, f=film: f.image(c, seed), lambda f=film: f.samples, weights
            )
    return figures_of(costs)


Costs = dict[tuple[str, str, int], Cost]
"""By way, sampler ("" for ours) and samples asked for."""


def our_costs(
    model: SceneModel, settings: RenderSettings, counts: tuple[int, ...], weights: np.ndarray
) -> Costs:
    """Of ours: `bands`, the image alone, and `view`, the view with all that is in one."""
    mi = use_engine()
    stage = build_stage(mi, model)
    costs: Costs = {}
    for count in counts:
        view = replace(settings, samples=count)
        image = replace(view, hidden=False, fragments=1)
        for name, wanted in (("bands", image), ("view", view)):
            costs[name, "", count] = turns(
                lambda seed, w=wanted: view_image(mi, stage, model, w, seed), lambda c=count: c, weights
            )
    return costs


def turns(image: Callable[[int], np.ndarray], samples: Callable[[], int], weights: np.ndarray) -> Cost:
    """The cost of images with other seeds, the first of which compiles and is not timed."""
    taken = [timed(image, seed) for seed in range(1, TURNS + 1)]
    return cost_of([found for found, _ in taken], [took for _, took in taken[1:]], samples(), weights)


def packed_cost(scene: PackedScene, model: SceneModel, samples: int, weights: np.ndarray) -> Cost:
    """Of all passes, each with a seed of its own, so that noise averages over a channel's bands. The bands
    are set on the clock; a pass is timed by the median of all, as they do the same work."""
    bands = len(model.wavelengths)
    images, seconds = [], []
    for turn in range(2):
        passes = []
        for start in range(0, bands, 3):

            def one(seed: int, start: int = start) -> np.ndarray:
                scene.set_bands(scene.triple(start))
                return scene.image(samples, seed)

            found, took = timed(one, 1 + start + 1000 * turn)
            passes.append(found)
            seconds.append(took)
        images.append(np.concatenate(passes)[:bands])
    return cost_of(images, [statistics.median(seconds) * len(passes)], scene.samples, weights)


def figures_of(costs: Costs) -> dict[str, float]:
    """Figures of `run`: the smallest ratios first."""
    ratios: dict[str, float] = {}
    strongest: dict[str, dict[str, float]] = {"channel": {}, "band": {}}
    rest: dict[str, float] = {}
    for (way, sampler, count), cost in costs.items():
        name = ".".join(part for part in (way, sampler, f"{count}s") if part)
        rest[f"seconds.{name}"], rest[f"samples.{name}"] = cost.seconds, float(cost.samples)
        rest[f"band_noise.{name}"], rest[f"channel_noise.{name}"] = cost.band, cost.channel
        if way in ("bands", "view"):
            continue
        ours = costs["bands", "", count]
        for which, least in strongest.items():
            if (way, which) == ("rgb", "band"):
                continue  # it has three of the bands
            ratio = cost.product(which) / ours.product(which)
            ratios[f"{which}_ratio.{name}"] = ratio
            key = f"{which}_ratio.strongest.{way}.{count}s"
            least[key] = min(ratio, least.get(key, ratio))
    times: dict[str, float] = {}
    for count in sorted({count for _, _, count in costs}):
        one = statistics.median(
            cost.seconds / cost.samples for (way, _, n), cost in costs.items() if way == "rgb" and n == count
        )
        for way, name in (("bands", ""), ("view", "view.")):
            times[f"times_path_image.{name}{count}s"] = costs[way, "", count].seconds / count / one
    sorted_ratios = {
        name: ratio
        for least in strongest.values()
        for name, ratio in sorted(least.items(), key=lambda each: each[1])
    }
    return sorted_ratios | times | ratios | rest


def sensor_weights(model: SceneModel) -> np.ndarray:
    """What each band adds to each channel of the paper's sensor, [channel, band]."""
    camera = Camera.from_recipe(load_camera("paper-clear").recipe)
    return channel_weights(camera, torch.as_tensor(np.asarray(model.wavelengths, np.float64))).numpy()


def colour_bands(model: SceneModel) -> list[int]:
    """The bands of the rgb image."""
    at = np.asarray(model.wavelengths) * 1e9
    return [int(np.argmin(abs(at - nm))) for nm in COLOURS_NM]


def timed(way: Callable[[int], np.ndarray], seed: int) -> tuple[np.ndarray, float]:
    """An image and its seconds: of the processors where they render, else of the clock."""
    import mitsuba as mi

    clock = time.perf_counter if mi.variant().startswith("cuda") else time.process_time
    begun = clock()
    image = way(seed)
    return image, clock() - begun


def view_image(mi: Any, stage: Any, model: SceneModel, settings: RenderSettings, seed: int) -> np.ndarray:
    """A view of a loaded scene, float64 [band, y, x]: survey, paths, sums and fragments."""
    seeded = replace(settings, seed=seed)
    view = View.of(
        render_stage(mi, stage, model.wavelengths, seeded, {}, lambda *_: None, None, time.perf_counter())
    )
    return view.all_in_focus().numpy().astype(np.float64)


def whole_view(size: int, bands: int, samples: int) -> tuple[float, float]:
    """Seconds and peak memory in MiB of loading the desk and viewing it in size x size pixels, no margin."""
    model, settings = desk(size, size, samples, bands)
    begun = time.perf_counter()
    render_model(model, settings)
    return time.perf_counter() - begun, peak_memory_mib()
