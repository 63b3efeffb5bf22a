"""What ways to take down Monte-Carlo noise would gain: adaptive samples, denoising, direct light as a control
variate, and care for the noisiest light.

`python -m docs.studies.noise_ways [SCENE...] [--truth N] [--json FILE]` renders 96 x 72 pixels from the
middle of the frame of shipped scenes, one surface a pixel, and judges the three channels of the camera
`paper-clear`, without optics, exposed automatically, full scale 1. Each figure is there twice: of unclipped
images, where lamps beyond full scale count as they are, and of images (truth and what is judged) clipped at
full scale.

The truth has seeds of its own and shares no sample with what is judged; its own noise, told by its two
halves, is subtracted from errors. Where less than a tenth of that noise is left, there is no figure. Gains
are the samples that plain rendering takes for the same error, over those that the way takes, to which the
time of denoising is added as the samples that it would pay for. Denoising needs the package `mitsuba_oidn`;
without it the rest runs. Scenes that only Mitsuba's own spectral variant carries can't be judged.
"""

from __future__ import annotations

import argparse
import shlex
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.ndimage import uniform_filter

from edofsim.capture.framing import framed
from edofsim.capture.prepare import channel_weights
from edofsim.capture.sensor import automatic_exposure
from edofsim.optics import Camera
from edofsim.recipe import load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render.depths import unparted
from edofsim.render.engine import use_engine
from edofsim.render.passes import Sums, groups_of
from edofsim.render.rendering import take_samples
from edofsim.render.settings import RenderSettings
from edofsim.scene import build_scene
from edofsim.scene.model import SceneModel

SCENES = ("desk", "hallway", "clutter", "night")
SIZE = (96, 72)
"""Columns and rows."""
SHOTS = {16: 16, 64: 16, 256: 4}
"""Samples a pixel, and how many images of each are judged."""
LIGHT_SHOTS = 4
TARGET_DB = 45.0
PILOT = 4
"""Samples of each of four images that adaptive samples are planned by."""
DARKEST = 0.02
"""Added to the albedo that images are divided by before they are denoised."""
DEPTH_STEP = 0.02
"""Steps of inverse depth from pixel to pixel, in 1/m, that are edges."""
INSTALL = (
    "denoising: not installed; pip install --no-deps mitsuba-oidn nanobind-backend (drjit comes with edofsim)"
)


@dataclass(frozen=True)
class Loaded:
    """A scene in the engine. weights: [channel, band]."""

    model: SceneModel
    stage: Any
    settings: RenderSettings
    weights: np.ndarray


def loaded(model: SceneModel, settings: RenderSettings, weights: np.ndarray) -> Loaded:
    """A model brought into the engine."""
    mi = use_engine("cpu")
    from edofsim.render.translate import build_stage

    return Loaded(model, build_stage(mi, model), settings, weights)


def shipped(name: str, width: int, height: int) -> Loaded:
    """The middle of a shipped scene as the camera `paper-clear` frames it. Raises InputError."""
    found, with_camera = load_scene(name), load_camera("paper-clear")
    camera = Camera.from_recipe(with_camera.recipe, with_camera.base)
    recipe = framed(found.recipe, camera)
    model = build_scene(recipe, found.base)
    settings = RenderSettings.from_recipe(recipe)
    settings = replace(settings, width=width, height=height, margin=0, hidden=False, fragments=1)
    weights = channel_weights(camera, torch.as_tensor(np.asarray(model.wavelengths, np.float64))).numpy()
    return loaded(model, settings, weights)


def shot(
    scene: Loaded, seed: int, samples: int, depth: int | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Channels [channel, y, x] in W/m2/sr, inverse depth [y, x] in 1/m and processor seconds of one image.

    depth: of the longest paths, 2 for direct light alone; else the scene's own.
    """
    settings = replace(
        scene.settings, seed=seed, samples=samples, max_depth=depth or scene.settings.max_depth
    )
    rows, columns = settings.padded_shape
    groups = groups_of([unparted(np.arange(rows * columns, dtype=np.int64))], [])
    sums = Sums.empty(groups, scene.stage.bands)
    begun = time.process_time()
    take_samples(scene.stage, settings, groups, sums, lambda *_: None, None)
    seconds = time.process_time() - begun
    bands = sums.radiance.reshape(-1, rows, columns) / sums.samples
    depths = (sums.inverse_depth / np.maximum(sums.count, 1)).reshape(rows, columns)
    return np.einsum("cb,byx->cyx", scene.weights, bands), depths, seconds


def adaptive_bound(variance: np.ndarray) -> float:
    """Gain of samples shared out among pixels by their standard deviation, which is the most that any sharing
    gains: mean(variance) / mean(deviation)^2. variance: [...], of one sample of each pixel."""
    return float(variance.mean() / np.sqrt(variance).mean() ** 2)


def adaptive_gain(variance: np.ndarray, estimate: np.ndarray) -> float:
    """Gain of samples shared out by an estimate of the deviation. variance, estimate: [...], all above 0."""
    return float(variance.mean() / (variance * estimate.mean() / estimate).mean())


def control_gain(direct: float, rest: float, cost: float) -> float:
    """Gain of sampling direct light apart: variances of it and of what is left after it is subtracted, both
    over the variance of all light; cost of a sample of it, over that of a whole path, which the rest takes.
    Samples are shared out as is best: the time for error 1 is (sqrt(rest) + sqrt(direct cost))^2."""
    return 1 / (np.sqrt(rest) + np.sqrt(direct * cost)) ** 2


def samples_for(error: float, plain: Mapping[int, float]) -> float:
    """Samples a pixel with which plain rendering has a mean square error. plain: errors by samples. Between
    these it follows a power law, beyond them 1 / samples, as passes with 64 samples each are independent."""
    count = np.array(sorted(plain), float)
    known = np.minimum.accumulate([plain[int(n)] for n in count])
    if not known[-1] < error < known[0]:
        end = -1 if error <= known[-1] else 0
        return float(count[end] * known[end] / error)
    return float(np.exp(np.interp(-np.log(error), -np.log(known), np.log(count))))


def errors(images: np.ndarray, halves: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Mean square error of each channel, less the truth's noise; NaN where less than a tenth of that is left.

    images: [n, channel, y, x]; halves: [2, channel, y, x], of the truth; where: bool [y, x].
    """
    noise = ((halves[0] - halves[1]) ** 2 / 4)[:, where].mean(1)
    left = ((images - halves.mean(0)) ** 2)[:, :, where].mean((0, 2)) - noise
    return np.where(left > 0.1 * noise, left, np.nan)


def psnr(error: np.ndarray | float) -> float:
    """In dB of full scale 1, of a mean square error, or of the mean of several."""
    return float(-10 * np.log10(np.mean(error)))


def edges_of(truth: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """bool [y, x]: a quarter of the pixels, where brightness changes most, and steps in depth."""
    steps = np.hypot(*np.gradient(np.log(np.maximum(truth.mean(0), 0) + 1e-3)))
    return (steps > np.quantile(steps, 0.75)) | (np.hypot(*np.gradient(depth)) > DEPTH_STEP)


def denoiser(scene: Loaded) -> Callable[[np.ndarray], np.ndarray] | None:
    """Denoising of images [channel, y, x], divided by the albedo of what is met first, with normals as guide;
    None where `mitsuba_oidn` is not installed."""
    try:
        denoise = import_module("mitsuba_oidn").denoise
    except ImportError:
        return None
    albedo, normal = first_met(scene)
    guide: dict[str, Any] = {"albedo": np.ones_like(normal), "normal": normal, "hdr": True, "clean_aux": True}

    def denoised(image: np.ndarray) -> np.ndarray:
        plain = np.ascontiguousarray(np.moveaxis(image / albedo, 0, -1), np.float32)
        return albedo * np.moveaxis(np.asarray(denoise(plain, **guide)), -1, 0)

    return denoised


def first_met(scene: Loaded, samples: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Albedo + DARKEST, [channel, y, x], and normals, float32 [y, x, 3], of what pixels meet first."""
    import drjit as dr
    import mitsuba as mi

    from edofsim.render import paths, rays, tracing

    rows, columns = scene.settings.padded_shape
    pixels = mi.UInt32(np.arange(rows * columns, dtype=np.uint32))
    drawn = rays.Samples(pixels, samples, 0, 0, ())
    towards = rays.camera_rays(tracing.lens_of(scene.settings), drawn).ray.d
    si = scene.stage.scene.ray_intersect(mi.Ray3f(dr.zeros(mi.Point3f, drawn.size), towards))
    met = si.is_valid()
    albedo = paths.reflectance(scene.stage, paths.object_fields(scene.stage, si, met), si.uv, met)

    def mean(value: Any) -> np.ndarray:
        lit = dr.select(met, mi.Float(value), 0.0)
        return np.array(dr.block_sum(lit, samples)).reshape(rows, columns) / samples

    bands = np.clip([mean(albedo[band]) for band in range(scene.stage.bands)], 0, 1)
    share = scene.weights / scene.weights.sum(1, keepdims=True)
    normal = np.stack([mean(si.sh_frame.n[axis]) for axis in range(3)], -1)
    return np.einsum("cb,byx->cyx", share, bands) + DARKEST, np.ascontiguousarray(normal, np.float32)


def lights_of(model: SceneModel) -> dict[str, SceneModel]:
    """The scene with each of its lights alone, by their names."""
    found = {} if model.environment is None else {"sky": model}
    found |= {one.name: replace(model, environment=None) for one in model.objects if one.emission is not None}
    return {
        name: replace(
            base,
            objects=tuple(one if one.name == name else replace(one, emission=None) for one in base.objects),
        )
        for name, base in found.items()
    }


def measure(scene: Loaded, truth: int, shots: Mapping[int, int] = SHOTS) -> dict[str, float]:
    """Figures of a scene, `unclipped` and `clipped`. truth: samples a pixel; shots: as SHOTS.

    In gains of adaptive samples and direct light, and shares of lights, pixels of a channel that are beyond
    full scale in the truth have no noise where images are clipped.
    """
    shot(scene, 1, min(shots))  # compiles
    halves, (depth, _) = zip(
        *[(s[0], s[1]) for s in (shot(scene, 10 + k, truth // 2) for k in (0, 1))], strict=True
    )
    exposure = automatic_exposure(torch.as_tensor(np.mean(halves, 0)))
    halves = np.stack(halves) * exposure
    edge = edges_of(halves.mean(0), depth)
    regions = {"whole": np.ones_like(edge), "flat": ~edge, "edges": edge}
    middle = sorted(shots)[len(shots) // 2]

    def images(
        of: Loaded, first: int, number: int, samples: int, paths: int | None = None
    ) -> tuple[np.ndarray, float]:
        taken = [shot(of, first + k, samples, paths) for k in range(number)]
        return np.stack([one[0] for one in taken]) * exposure, statistics.median(one[2] for one in taken)

    plain = {count: images(scene, 1000 * count, number, count) for count, number in shots.items()}
    seconds = plain[middle][1] / middle
    denoise = denoiser(scene)
    clean = {count: np.stack([denoise(x) for x in plain[count][0]]) for count in plain} if denoise else {}
    begun = time.process_time()
    _ = denoise(plain[middle][0][0]) if denoise else None
    denoising = time.process_time() - begun
    every = plain[middle][0]
    direct, direct_seconds = images(scene, 1000 * middle, len(every), middle, 2)
    pilot = images(scene, 5, 4, PILOT)[0].var(0, ddof=1).mean(0)
    estimate = np.sqrt(np.maximum(uniform_filter(pilot, 5), 0))
    estimate = np.maximum(estimate, 0.2 * estimate.mean() + 1e-12)
    alone = {
        name: images(loaded(model, scene.settings, scene.weights), 500, LIGHT_SHOTS, middle)[0].var(0, ddof=1)
        for name, model in lights_of(scene.model).items()
    }
    out: dict[str, float] = {"edge_share": float(edge.mean()), "ms_per_sample": 1e3 * seconds}
    for clip, top in (("unclipped", np.inf), ("clipped", 1.0)):
        limited = np.minimum(halves, top)
        out[f"{clip}.truth_db"] = psnr((limited[0] - limited[1]) ** 2 / 4)
        found: dict[tuple[str, int], np.ndarray] = {}
        for way, by_count in (("plain", {n: x[0] for n, x in plain.items()}), ("denoised", clean)):
            for count, taken in by_count.items():
                for region, where in regions.items():
                    error = errors(np.minimum(taken, top), limited, where)
                    out[f"{clip}.psnr_db.{way}.{count}.{region}"] = psnr(error)
                    found |= {(way, count): error} if region == "whole" else {}
        worst = {count: found["plain", count].max() for count in plain}
        out[f"{clip}.samples_to_45_db"] = samples_for(10 ** (-TARGET_DB / 10), worst)
        out[f"{clip}.seconds_to_45_db"] = seconds * out[f"{clip}.samples_to_45_db"]
        seen = np.where(limited.mean(0) < top, 1.0, 0.0)
        variance, of_direct, of_rest = ((x.var(0, ddof=1) * seen) for x in (every, direct, every - direct))
        by_pixel, whole = variance.mean(0), float(variance.mean())
        out[f"{clip}.gain.adaptive_bound"] = adaptive_bound(by_pixel)
        out[f"{clip}.gain.adaptive_estimated"] = adaptive_gain(by_pixel, estimate)
        curve = {count: float(found["plain", count].mean()) for count in plain}
        for count in clean if len(plain) > 1 else ():
            equal = samples_for(float(found["denoised", count].mean()), curve)
            out[f"{clip}.gain.denoised.{count}"] = equal / (count + denoising / seconds)
        rest = float(of_rest.mean()) / whole
        cost = direct_seconds / (seconds * middle)
        out[f"{clip}.gain.direct_apart"] = control_gain(float(of_direct.mean()) / whole, rest, cost)
        out[f"{clip}.gain.direct_without_noise"] = 1 / rest if rest > 0 else np.inf
        out |= {f"{clip}.noise_share.{name}": float((x * seen).mean()) / whole for name, x in alone.items()}
    return out


def table(figures: Mapping[str, Mapping[str, float]]) -> str:
    """Figures of scenes, a row each; of lights the one with the most noise alone."""
    ways = ("unclipped", "clipped")
    rows: dict[str, list[str]] = {}
    for found in figures.values():
        for way in ways:
            own = {
                name.removeprefix(f"{way}."): value
                for name, value in found.items()
                if name.startswith(f"{way}.")
            }
            lights = {name: own.pop(name) for name in list(own) if name.startswith("noise_share.")}
            shown = {
                name: f"{value:.4g}"
                for name, value in (found | own).items()
                if name.partition(".")[0] not in ways
            }
            noisiest = max(lights, key=lambda name: lights[name])
            shown["noisiest light"] = noisiest.partition(".")[2].rpartition("/")[2][:14]
            shown["its noise alone"] = f"{lights[noisiest]:.4g}"
            for name, value in shown.items():
                rows.setdefault(name, []).append(value)
    heads = {"": [scene for scene in figures for _ in ways], "full scale": [*ways] * len(figures)}
    return "\n".join(
        f"{name:28}" + "".join(f"{each:>15}" for each in row) for name, row in (heads | rows).items()
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command: see the top."""
    parser = argparse.ArgumentParser(
        prog="python -m docs.studies.noise_ways", description="Ways against noise."
    )
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--truth", type=int, default=4096, help="samples a pixel of the truth")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args(arguments)
    found: dict[str, dict[str, float]] = {}
    for name in asked.scenes:
        found[name] = measure(shipped(name, *SIZE), asked.truth)
        print(f"{name} is measured", flush=True)
    print(table(found))
    if not any(".gain.denoised." in name for each in found.values() for name in each):
        print(INSTALL)
    if asked.json:
        flat = {f"{scene}.{name}": value for scene, each in found.items() for name, value in each.items()}
        figures = {name: value for name, value in flat.items() if np.isfinite(value)}
        typed = shlex.join(["python", "-m", "docs.studies.noise_ways", *(arguments or sys.argv[1:])])
        about = record("noise_ways", figures=figures, typed=typed, truth_samples=asked.truth)
        write_record(asked.json, about)


if __name__ == "__main__":
    main()
