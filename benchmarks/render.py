"""What a view costs: against Mitsuba's own ways to many bands at equal noise, and against its own size.

The three ways that are compared get the same scene, frame, number of samples, bounces and threads, and use no
roulette. Times are of rendering alone, kernels compiled and scene loaded, in turns; on processors
they are processor seconds, which other work on the machine disturbs least. Noise is the root mean square
difference of two images with other seeds, relative to each band's mean. Seconds times noise squared is what
an image of noise 1 would take, so that its ratio is that of times at equal noise.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.packed import PackedScene
from edofsim.core.progress import Progress, silent
from edofsim.recipe import load_scene
from edofsim.record import peak_memory_mib
from edofsim.render.engine import use_engine
from edofsim.render.rendering import render_model, render_stage
from edofsim.render.settings import RenderSettings
from edofsim.render.translate import build_stage
from edofsim.scene import build_scene
from edofsim.scene.model import BandTexture, SceneModel

SAMPLES = 64
WIDTH, HEIGHT = 240, 192
TURNS = 4


def run(progress: Progress | None = None) -> dict[str, float]:
    """Figures, each the name and a number:

    times_path_image: seconds of all bands over seconds of one rgb image of Mitsuba's path integrator;
    the same with depth survey, fragments and hidden surfaces: times_path_image.view;
    equal_noise_speedup.{packed,specfilm}: how many times faster than ceil(bands / 3) rgb passes, and
    than Mitsuba's spectral film; noise.{bands,packed,specfilm} at SAMPLES a pixel;
    {seconds,peak_memory_mib}.{size}_{bands}b_{samples}s: what whole views cost.
    """
    say = progress or silent
    figures = in_a_process(compare_ways)
    cases = [(256, 31, 16), (512, 31, 16), (1024, 31, 16), (512, 3, 16), (512, 61, 16), (512, 31, 64)]
    for number, (size, bands, samples) in enumerate(cases):
        say(0.5 + 0.5 * number / len(cases), f"a view of {size} x {size}, {bands} bands, {samples} samples")
        seconds, memory = in_a_process(whole_view, size, bands, samples)
        name = f"{size}px_{bands}b_{samples}s"
        figures[f"seconds.{name}"] = seconds
        figures[f"peak_memory_mib.{name}"] = memory
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


def compare_ways() -> dict[str, float]:
    """Seconds and noise of each way to a 31-band image."""
    model, settings = desk(WIDTH, HEIGHT, SAMPLES)
    plain = replace(settings, hidden=False, fragments=1)
    mi = use_engine()
    stage = build_stage(mi, model)
    packed_scene = PackedScene(mi, model, settings)
    ours = {
        "bands": lambda seed: _bands(mi, stage, model, plain, seed),
        "packed": lambda seed: _packed(packed_scene, model, seed),
        "view": lambda seed: _bands(mi, stage, model, settings, seed),
    }
    images = {name: [] for name in ours}
    for seed in range(TURNS):
        for name, way in ours.items():
            images[name].append(_timed(way, seed))
    film = SpectralFilm(use_engine(colours="spectral"), model, settings)
    images["specfilm"] = [_timed(film.image, seed) for seed in range(TURNS)]
    cost = {name: _cost(taken) for name, taken in images.items()}
    passes = -(-len(model.wavelengths) // 3)
    one_image = cost["packed"][0] / passes
    product = {name: seconds * noise**2 for name, (seconds, noise) in cost.items()}
    return {
        "times_path_image": cost["bands"][0] / one_image,
        "times_path_image.view": cost["view"][0] / one_image,
        "equal_noise_speedup.packed": product["packed"] / product["bands"],
        "equal_noise_speedup.specfilm": product["specfilm"] / product["bands"],
        **{f"noise.{name}": noise for name, (_, noise) in cost.items()},
        **{f"seconds_image.{name}": seconds for name, (seconds, _) in cost.items()},
    }


def _timed(way: Callable[[int], np.ndarray], seed: int) -> tuple[np.ndarray, float]:
    """An image and its seconds: of the processors where they render, else of the clock."""
    import mitsuba as mi

    clock = time.perf_counter if mi.variant().startswith("cuda") else time.process_time
    begun = clock()
    image = way(seed)
    return image, clock() - begun


def _cost(images: list[tuple[np.ndarray, float]]) -> tuple[float, float]:
    """Median seconds without the first image, which compiled, and relative noise of one image."""
    taken = [image for image, _ in images[1:]]
    level = np.mean(taken, axis=(0, 2, 3))
    variance = np.var(taken, axis=0, ddof=1).mean(axis=(1, 2))
    seconds = statistics.median(seconds for _, seconds in images[1:])
    return seconds, float(np.sqrt((variance / level**2).mean()))


def _bands(mi: Any, stage: Any, model: SceneModel, settings: RenderSettings, seed: int) -> np.ndarray:
    """A view of a loaded scene, float64 [band, y, x]: survey, paths, sums and fragments."""
    seeded = replace(settings, seed=seed)
    view = render_stage(mi, stage, model.wavelengths, seeded, {}, lambda *_: None, None, time.perf_counter())
    return view.all_in_focus().numpy().astype(np.float64)


def _packed(scene: PackedScene, model: SceneModel, seed: int) -> np.ndarray:
    """All passes of the packed route, float64 [band, y, x]."""
    parts = []
    for start in range(0, len(model.wavelengths), 3):
        scene.set_bands(scene.triple(start))
        parts.append(scene.image(SAMPLES, seed + 1))
    return np.concatenate(parts)[: len(model.wavelengths)]


class SpectralFilm:
    """The scene as Mitsuba's spectral variant renders it, four wavelengths a path, into a film of box-shaped
    bands. Spectra are Mitsuba's; of pictures it takes the colour, which is all that it can carry."""

    def __init__(self, mi: Any, model: SceneModel, settings: RenderSettings) -> None:
        from edofsim.render.translate import make_mesh, plugin_with

        self._mi, self._nm = mi, np.asarray(model.wavelengths) * 1e9
        contents: dict[str, Any] = {"type": "scene"}
        for number, item in enumerate(model.objects):
            reflectance = self._spectrum(item.surface.reflectance, flipped=0)
            bsdf = mi.load_dict(plugin_with(item.surface, reflectance))
            lamp = None
            if item.emission is not None:
                lamp = {"type": "area", "radiance": self._regular(item.emission)}
            contents[f"object{number}"] = make_mesh(mi, item, bsdf, lamp)
        if model.environment is not None:
            radiance = model.environment.radiance
            if radiance.image is None:
                contents["sky"] = {"type": "constant", "radiance": self._regular(radiance.basis[0])}
            else:
                contents["sky"] = {
                    "type": "envmap",
                    "bitmap": mi.Bitmap(self._picture(radiance)[:, ::-1].copy()),
                }
        rows, columns = settings.padded_shape
        half = 0.5 * (self._nm[1] - self._nm[0])
        bands = {
            f"band{number:03d}": {
                "type": "irregular",
                "wavelengths": f"{nm - half - 0.01}, {nm - half}, {nm + half}, {nm + half + 0.01}",
                "values": "0, 1, 1, 0",
            }
            for number, nm in enumerate(self._nm)
        }
        contents["sensor"] = {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(columns / 2 * settings.pixel_angle))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, 1.0, 1.0, 1.0])),
            "near_clip": 1e-3,
            "far_clip": 1e6,
            "film": {
                "type": "specfilm",
                "width": columns,
                "height": rows,
                "rfilter": {"type": "box"},
                **bands,
            },
            "sampler": {"type": "independent"},
        }
        contents["integrator"] = {"type": "path", "max_depth": settings.max_depth, "rr_depth": 1000}
        self._scene = mi.load_dict(contents, optimize=False)

    def _regular(self, values: np.ndarray) -> dict[str, Any]:
        return {
            "type": "regular",
            "wavelength_min": float(self._nm[0]),
            "wavelength_max": float(self._nm[-1]),
            "values": ", ".join(f"{max(float(v), 1e-6):.7g}" for v in values),
        }

    def _picture(self, value: BandTexture) -> np.ndarray:
        """An rgb picture of the values near 610, 550 and 460 nm."""
        bands = [int(np.argmin(abs(self._nm - nm))) for nm in (610, 550, 460)]
        return np.clip(value.image @ value.basis[:, bands], 0, 1e4).astype(np.float32)

    def _spectrum(self, value: BandTexture, flipped: int) -> dict[str, Any]:
        if value.image is None:
            return self._regular(value.basis[0])
        picture = np.ascontiguousarray(self._picture(value)[::-1]).clip(0, 0.98)
        return {"type": "bitmap", "bitmap": self._mi.Bitmap(picture), "raw": False, "wrap_mode": "repeat"}

    def image(self, seed: int) -> np.ndarray:
        """One image, float64 [band, y, x]."""
        pixels = np.array(self._mi.render(self._scene, spp=SAMPLES, seed=seed + 1), np.float64)
        return np.moveaxis(pixels, -1, 0)


def whole_view(size: int, bands: int, samples: int) -> tuple[float, float]:
    """Seconds and peak memory in MiB of loading the desk and viewing it in size x size pixels, no margin."""
    model, settings = desk(size, size, samples, bands)
    begun = time.perf_counter()
    render_model(model, settings)
    return time.perf_counter() - begun, peak_memory_mib()
