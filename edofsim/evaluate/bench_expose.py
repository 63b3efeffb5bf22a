"""What a photo costs: low rank against brute force, with the error that it buys; memory; how cost grows.

Brute force convolves each of 475 depths and 31 bands on its own in float64, as the paper's 3D experiment
does; depths at which the scene has nothing are skipped, to its advantage. Both sides blur the same view,
without occlusion, which no brute force has. PSFs and factors are made before the clock starts; a second ratio
has their making on both sides.
"""

from __future__ import annotations

import gc
import math
import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..expose.bands import merged_bands
from ..expose.blurring import Blurring
from ..expose.factors import band_groups, factorise, joint_groups
from ..expose.kernels import HeldKernels, StreamedKernels
from ..expose.light import seen
from ..expose.methods import METHODS
from ..expose.photograph import all_in_focus
from ..expose.prepare import BRUTE_DEPTHS, channel_weights, choose_nodes
from ..expose.sensor import automatic_exposure
from ..optics import Camera, psf_bank
from ..recipe import load_camera, load_scene
from ..record import peak_memory_mib
from ..render.view import View

Progress = Callable[[float, str], None]

SCENES = ("desk", "hallway")
TOLERANCES = (50.0, 40.0)
SIZE = 512
SAMPLES = 16
REPEATS = 5


@dataclass(frozen=True)
class Setting:
    """A camera, and the height map that takes the place of its mask, if any."""

    camera: Camera
    height: Tensor | None = None


def run(progress: Progress | None = None, out: Path | None = None) -> dict[str, float]:
    """Figures, by scene (desk, hallway) and mask (clear, cubic, smooth):

    speedup.{scene}.{mask}.{50,40}db, psnr_db.(same), rank.(same), seconds.(same): low rank against brute,
    PSFs at hand; speedup_with_psfs.(same): PSFs and factors computed on both sides;
    seconds_brute.{scene}.{mask}, seconds_brute_psfs.{scene}.{mask};
    growth.{depths,bands,pixels,tolerance_db}.{n}: seconds at n over seconds at the first n;
    growth.doubled_depths: seconds at 64 depth nodes over seconds at 32;
    peak_memory_mib.1024px_31b_{16,64,475}d: of a process that takes one photo, occlusion included.
    out: a folder for the plot `expose-cost.png`.
    """
    say = progress or (lambda fraction, text: None)
    figures = speed(lambda f, text: say(0.85 * f, text))
    figures |= growth(lambda f, text: say(0.85 + 0.05 * f, text))
    for number, depths in enumerate((16, 64, BRUTE_DEPTHS)):
        say(0.9 + 0.1 * number / 3, f"memory at 1024 x 1024 with {depths} depths")
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            figures[f"peak_memory_mib.1024px_31b_{depths}d"] = pool.apply(memory_of_a_photo, (depths,))
    if out is not None:
        plot(figures, out / "expose-cost.png")
    say(1.0, "done")
    return figures


def settings() -> dict[str, Setting]:
    """The cameras that are compared: clear aperture, cubic mask, a random smooth relief."""
    clear = Camera.from_recipe(load_camera("paper-clear").recipe)
    cubic = Camera.from_recipe(load_camera("paper-cubic").recipe)
    return {"clear": Setting(clear), "cubic": Setting(cubic), "smooth": Setting(clear, smooth_relief())}


def smooth_relief(samples: int = 238, width: float = 10.0, top: float = 1.135e-6, seed: int = 0) -> Tensor:
    """White noise under a Gaussian of `width` samples, from 0 to `top` metres: [n, n], float32.

    238 samples of 21 um and 1.135 um are those of the paper's mask (Fig. `MTF`).
    """
    noise = torch.randn(samples, samples, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    f = torch.fft.fftfreq(samples, dtype=torch.float64)
    window = torch.exp(-2 * (math.pi * width) ** 2 * (f[:, None] ** 2 + f**2))
    relief = torch.fft.ifft2(torch.fft.fft2(noise) * window).real
    return ((relief - relief.min()) / (relief.max() - relief.min()) * top).float()


def rendered(scene: str, progress: Progress) -> View:
    """The view of a shipped scene at the size of the benchmark, from the cache if it was rendered before."""
    from ..render import render

    loaded = load_scene(scene)
    frame = loaded.recipe.frame.model_copy(update={"width_px": SIZE, "height_px": SIZE})
    samples = loaded.recipe.render.model_copy(update={"samples": SAMPLES})
    recipe = loaded.recipe.model_copy(update={"frame": frame, "render": samples})
    return render(recipe, loaded.base, progress=progress)


def speed(say: Progress) -> dict[str, float]:
    """Low rank against brute force, mask by mask and scene by scene."""
    views = {name: rendered(name, lambda f, text: say(0.0, text)) for name in SCENES}
    farthest = min(float(view.inverse_depth.min()) for view in views.values())
    nearest = max(float(view.inverse_depth.max()) for view in views.values())
    nodes = torch.linspace(farthest, nearest, BRUTE_DEPTHS, dtype=torch.float64)
    cameras = settings()
    figures: dict[str, float] = {}
    for number, (mask, setting) in enumerate(cameras.items()):
        share = number / len(cameras)
        say(share, f"{mask}: PSFs at {BRUTE_DEPTHS} depths")
        bank, psf_seconds = _timed(lambda s=setting: _bank(s, views[SCENES[0]].wavelengths, nodes))
        for k, (scene, view) in enumerate(views.items()):
            say(share + (0.2 + 0.4 * k) / len(cameras), f"{mask}, {scene}: brute force")
            found = _against_brute(view, setting, bank, nodes, psf_seconds)
            for key, value in found.items():
                kind, _, tolerance = key.partition(".")
                figures[".".join(filter(None, (kind, scene, mask, tolerance)))] = value
        del bank
        gc.collect()
    return figures


def _against_brute(
    view: View, setting: Setting, bank: Tensor, nodes: Tensor, brute_psf_seconds: float
) -> dict[str, float]:
    weights = channel_weights(setting.camera, view.wavelengths)
    exact = view.to(dtype=torch.float64)
    in_double = StreamedKernels(
        lambda some: bank[torch.searchsorted(nodes, some)].double(),
        nodes,
        view.wavelengths,
        bank.shape[-1],
        ahead=1,
    )
    brute = Blurring(in_double, weights, METHODS["brute"])
    exposure = automatic_exposure(view.crop_margin(all_in_focus(exact, weights)))
    truth, brute_seconds = _timed(lambda: brute.light(exact, seen(exact)))
    truth = view.crop_margin(truth) * exposure
    figures = {"seconds_brute": brute_seconds, "seconds_brute_psfs": brute_psf_seconds}
    shortest = float(view.wavelengths.min())
    for tolerance in TOLERANCES:
        few = choose_nodes(
            view.inverse_depth, view.coverage, setting.camera, shortest, "low_rank", "auto", tolerance
        )
        psfs, psf_seconds = _timed(lambda few=few: _bank(setting, view.wavelengths, few))
        kernels = HeldKernels(psfs, few, view.wavelengths)
        blurring = Blurring(kernels, weights.float(), METHODS["low_rank"], tolerance)
        _, first_seconds = _timed(lambda b=blurring: b.light(view, seen(view)))  # factors, then blurs
        seconds = _median_seconds(lambda b=blurring: b.light(view, seen(view)))
        photo = view.crop_margin(blurring.light(view, seen(view))).double() * exposure
        groups = [joint_groups(weights.float()), band_groups(weights.float())]
        name = f"{tolerance:.0f}db"
        with_psfs = (brute_seconds + brute_psf_seconds) / (first_seconds + psf_seconds)
        figures |= {
            f"speedup.{name}": brute_seconds / seconds,
            f"seconds.{name}": seconds,
            f"speedup_with_psfs.{name}": with_psfs,
            f"psnr_db.{name}": -10 * math.log10(float((photo - truth).square().mean())),
            f"rank.{name}": sum(each.rank for each in factorise(kernels, groups, tolerance)),
        }
    return figures


def growth(say: Progress) -> dict[str, float]:
    """How the time of a photo grows, each quantity alone: depth nodes, bands, pixels, tolerance."""
    camera = settings()["cubic"].camera
    view = synthetic_view(256, 31)
    nodes = torch.linspace(0, 2, 129, dtype=torch.float64)
    psfs = _bank(Setting(camera), view.wavelengths, nodes)

    def seconds(view: View, step: int = 4, tolerance: float = 50.0, bands: int = 31) -> float:
        groups = torch.tensor_split(torch.arange(31), bands)
        middle = torch.tensor([int(group[len(group) // 2]) for group in groups])
        kernels = HeldKernels(psfs[::step][:, middle], nodes[::step], view.wavelengths)
        weights = channel_weights(camera, view.wavelengths).float()
        blurring = Blurring(kernels, weights, METHODS["low_rank"], tolerance)
        blurring.light(view, seen(view))
        return _median_seconds(lambda: blurring.light(view, seen(view)))

    tries: dict[str, dict[int, Callable[[], float]]] = {
        "depths": {n: (lambda n=n: seconds(view, step=128 // n)) for n in (16, 32, 64, 128)},
        "bands": {n: (lambda n=n: seconds(merged_bands(view, n), bands=n)) for n in (4, 8, 16, 31)},
        "pixels": {n * n: (lambda n=n: seconds(synthetic_view(n, 31))) for n in (128, 256, 512)},
        "tolerance_db": {n: (lambda n=n: seconds(view, tolerance=n)) for n in (30, 40, 50, 60)},
    }
    figures = {}
    for number, (name, of) in enumerate(tries.items()):
        say(number / len(tries), f"growth with {name}")
        times = {n: measure() for n, measure in of.items()}
        first = next(iter(times.values()))
        figures |= {f"growth.{name}.{n}": t / first for n, t in times.items()}
    figures["growth.doubled_depths"] = figures["growth.depths.64"] / figures["growth.depths.32"]
    return figures


def memory_of_a_photo(depths: int) -> float:
    """Peak memory of this process in MiB after one photo of 1024 x 1024 pixels and 31 bands.

    To be called in a process of its own.
    """
    from ..expose import expose

    camera = settings()["clear"].camera
    view = synthetic_view(1024, 31, camera.pixel_angle)
    expose(view, camera, method="low_rank", layers=depths, occlusion="hidden")
    return peak_memory_mib()


def synthetic_view(size: int, bands: int, pixel_angle: float = 1.626e-4, margin: int = 64) -> View:
    """A random slanted surface, and a bar in front of it with what it hides: fragments of every depth."""
    side = size + 2 * margin
    depth = torch.linspace(0.0, 1.5, side).expand(side, side).reshape(-1)
    bar = torch.zeros(side, side, dtype=torch.bool)
    bar[:, side // 2 : side // 2 + side // 16] = True
    bar = bar.reshape(-1)
    behind = torch.nonzero(bar).squeeze(1)
    pixel = torch.cat([torch.arange(side * side), behind])
    order = torch.argsort(pixel, stable=True)
    inverse_depth = torch.cat([torch.where(bar, torch.full_like(depth, 2.0), depth), depth[behind]])
    generator = torch.Generator().manual_seed(0)
    return View(
        height=size,
        width=size,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(order)),
        inverse_depth=inverse_depth[order],
        radiance=torch.rand(bands, len(order), generator=generator),
        hidden=(torch.arange(len(pixel)) >= side * side)[order],
        wavelengths=torch.linspace(420e-9, 720e-9, bands, dtype=torch.float64),
        pixel_angle=pixel_angle,
    )


def plot(figures: dict[str, float], path: Path) -> Path:
    """Time against depth nodes, bands, pixels and tolerance, each relative to its first. Returns the path."""
    from .drawing import OKABE_ITO, new_figure, save

    names = ("depths", "bands", "pixels", "tolerance_db")
    figure, grid = new_figure(1, len(names))
    for axes, name in zip(grid[0], names, strict=True):
        points = sorted(
            (float(key.rsplit(".", 1)[1]), value)
            for key, value in figures.items()
            if key.startswith(f"growth.{name}.")
        )
        axes.plot(*zip(*points, strict=True), "o-", color=OKABE_ITO[0])
        axes.set_xlabel(name.replace("_db", " (dB)"))
        axes.set_ylabel("time, relative to the first")
        axes.set_ylim(bottom=0)
    return save(figure, path)


def _bank(setting: Setting, wavelengths: Tensor, nodes: Tensor) -> Tensor:
    """PSFs computed anew: a bank that is at hand already would take no time."""
    from ..optics import cache

    cache.forget()
    return psf_bank(setting.camera, wavelengths, nodes, height=setting.height).values


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def _median_seconds(work: Callable[[], Any]) -> float:
    return statistics.median(_timed(work)[1] for _ in range(REPEATS))
