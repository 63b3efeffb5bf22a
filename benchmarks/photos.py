"""What a photo costs: low rank against brute force, with the error that it buys; memory; how cost grows.

Brute force convolves each of 475 depths and 31 bands on its own in float64, as the paper's 3D experiment
does; depths at which the scene has nothing are skipped, to its advantage. Both sides blur the same view,
without occlusion, which no brute force has. PSFs and factors are made before the clock starts; a second ratio
has their making on both sides. Both run in one process, one after the other.
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
from matplotlib.figure import Figure
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.bands import merged_bands
from edofsim.capture.convolution import Grid
from edofsim.capture.factors import band_groups, factorise, joint_groups
from edofsim.capture.kernels import HeldKernels, StreamedKernels
from edofsim.capture.light import Light, light_of, seen
from edofsim.capture.methods import METHODS
from edofsim.capture.methods.low_rank import blur_with
from edofsim.capture.photograph import all_in_focus
from edofsim.capture.prepare import BRUTE_DEPTHS, channel_weights, choose_nodes
from edofsim.capture.sensor import automatic_exposure
from edofsim.core.files import whole
from edofsim.core.progress import Progress, part, silent
from edofsim.experiments.kept import Kept, code_of, key_of
from edofsim.experiments.occlusion import smooth_relief
from edofsim.optics import Camera, psf_bank
from edofsim.recipe import load_camera, load_scene
from edofsim.record import machine, peak_memory_mib
from edofsim.render.view import View
from edofsim.report.plot import BLUE, WIDE_IN, Plot, new_figure

SCENES = ("desk", "hallway")
MASKS = ("clear", "cubic", "smooth")
TOLERANCES = (50.0, 40.0)
SIZE = 512
SAMPLES = 16
REPEATS = 5
BLOCK = 48
"""Depths of brute force at a time: their PSFs fit into memory, and they are kept once done."""
MEMORY_DEPTHS = (16, 64, BRUTE_DEPTHS)


def run(progress: Progress | None = None, out: Path | None = None) -> dict[str, float]:
    """Figures, by scene (desk, hallway) and mask (clear, cubic, smooth), without occlusion on either side:

    unoccluded.speedup.{scene}.{mask}.{50,40}db: low rank against brute, PSFs and factors at hand;
    unoccluded.speedup_with_psfs.(same): PSFs and factors computed on both sides;
    unoccluded.{psnr_db,rank,nodes,seconds,seconds_psfs,seconds_factors}.(same): of low rank;
    unoccluded.{seconds_brute,seconds_brute_psfs,brute_depths}.{scene}.{mask};
    occluded.seconds.{scene}.{mask}: a whole photo with hidden surfaces at 50 dB, PSFs and factors at hand;
    growth.{depths,bands,pixels,tolerance_db}.{n}: seconds at n over seconds at the first n;
    growth_rank.{n}: rank at that tolerance; growth.doubled_depths: seconds at 64 depth nodes over at 32;
    peak_memory_mib.1024px_31b_{16,64,475}d: of a process that takes one photo, occlusion included.
    out: a folder for the plot `expose-cost.png`, and for finished pieces, which are not measured again.
    """
    say = progress or silent
    figures: dict[str, float] = {}
    kept = None if out is None else Kept(out / "expose.jsonl")
    pieces: dict[str, Callable[[Progress], dict[str, float]]] = {
        f"{mask}-{scene}": lambda tell, m=mask, s=scene: speed(
            m, s, tell, None if out is None else out / f"expose-{m}-{s}.half"
        )
        for mask in MASKS
        for scene in SCENES
    }
    pieces["growth"] = growth
    pieces |= {f"memory-{depths}d": lambda tell, n=depths: memory(n, tell) for depths in MEMORY_DEPTHS}
    for number, (name, measure) in enumerate(pieces.items()):

        def tell(fraction: float, text: str, number: int = number, name: str = name) -> None:
            say((number + fraction) / len(pieces), f"{name}: {text}")

        figures |= _once(kept, name, lambda m=measure: m(tell))
    if out is not None:
        plot(figures, out / "expose-cost.png")
    say(1.0, "done")
    return figures


def _once(kept: Kept | None, name: str, measure: Callable[[], dict[str, float]]) -> dict[str, float]:
    """Figures of a piece that was finished before, by this code on this machine, or measured now."""
    key = _key(piece=name)
    found = None if kept is None else kept.get(key)
    if found is None:
        found = measure()
        if kept is not None:
            kept.put(key, found)
    return found


def _key(**parts: object) -> str:
    """A key of a measurement, which the benchmarks' own code decides too."""
    return key_of(machine=machine(), benchmarks=code_of(Path(__file__).parent), **parts)


def cameras() -> dict[str, Camera]:
    """The cameras that are compared: clear aperture, cubic mask, a random smooth relief."""
    clear = Camera.from_recipe(load_camera("paper-clear").recipe)
    cubic = Camera.from_recipe(load_camera("paper-cubic").recipe)
    return {"clear": clear, "cubic": cubic, "smooth": clear.with_height(smooth_relief())}


def rendered(scene: str, progress: Progress) -> View:
    """The view of a shipped scene at the size of the benchmark, from the cache if it was rendered before."""
    from edofsim.render import render

    loaded = load_scene(scene)
    frame = loaded.recipe.frame.model_copy(update={"width_px": SIZE, "height_px": SIZE})
    samples = loaded.recipe.render.model_copy(update={"samples": SAMPLES})
    recipe = loaded.recipe.model_copy(update={"frame": frame, "render": samples})
    return render(recipe, loaded.base, progress=progress)


def speed(mask: str, scene: str, say: Progress, kept: Path | None = None) -> dict[str, float]:
    """Low rank against brute force for one mask and one scene; kept: a file for what is half done."""
    view = rendered(scene, part(say, 0.0, 0.0))
    camera = cameras()[mask]
    figures = {
        f"unoccluded.{kind}.{scene}.{mask}" + (f".{tolerance}" if tolerance else ""): value
        for (kind, tolerance), value in against_brute(view, camera, say, kept=kept).items()
    }
    say(0.9, "with occlusion")

    def photo() -> None:
        capture(view, camera, Fidelity(method="low_rank", layers_db=50.0, rank_db=50.0), exposure=1.0)

    photo()
    figures[f"occluded.seconds.{scene}.{mask}"] = min(_timed(photo)[1] for _ in range(2))
    gc.collect()
    if kept is not None:
        kept.unlink(missing_ok=True)
    return figures


def against_brute(
    view: View,
    camera: Camera,
    say: Progress,
    depths: int = BRUTE_DEPTHS,
    kept: Path | None = None,
) -> dict[tuple[str, str], float]:
    """Figures by (kind, tolerance) as `run` names them, for brute force at so many depths; kept: see
    `_by_brute_force`."""
    which = seen(view)
    depth = view.inverse_depth[which]
    weights = channel_weights(camera, view.wavelengths)
    nodes = torch.linspace(float(depth.min()), float(depth.max()), depths, dtype=torch.float64)
    exposure = automatic_exposure(view.crop_margin(all_in_focus(view, weights.float())))
    truth, figures = _by_brute_force(view, camera, weights, nodes, say, kept)
    truth = truth * exposure
    brute_seconds, brute_psf_seconds = figures["seconds_brute", ""], figures["seconds_brute_psfs", ""]
    grid = Grid(*view.padded_shape, view.margin, camera.recipe.psf.window_px)
    shortest = float(view.wavelengths.min())
    groups = [joint_groups(weights.float()), band_groups(weights.float())]
    for tolerance in TOLERANCES:
        name = f"{tolerance:.0f}db"
        say(0.85, f"low rank at {tolerance:.0f} dB")
        few = choose_nodes(depth, view.coverage[which], camera, shortest, "low_rank", "auto", tolerance)
        psfs, psf_seconds = _timed(lambda few=few: _bank(camera, view.wavelengths, few))
        kernels = HeldKernels(psfs, few, view.wavelengths)
        factors, factor_seconds = _timed(lambda k=kernels, t=tolerance: factorise(k, groups, t))
        blur = blur_with(factors, weights.float())

        def photo(blur: Any = blur, few: Tensor = few) -> Tensor:
            return blur(light_of(view, few, which), grid)

        error = view.crop_margin(photo()).double() * exposure - truth
        seconds = _median_seconds(photo)
        all_brute, all_low = brute_seconds + brute_psf_seconds, seconds + psf_seconds + factor_seconds
        figures |= {
            ("speedup", name): brute_seconds / seconds,
            ("speedup_with_psfs", name): all_brute / all_low,
            ("psnr_db", name): -10 * math.log10(float(error.square().mean())),
            ("rank", name): float(sum(each.rank for each in factors)),
            ("nodes", name): float(few.numel()),
            ("seconds", name): seconds,
            ("seconds_psfs", name): psf_seconds,
            ("seconds_factors", name): factor_seconds,
        }
    return figures


@dataclass(frozen=True)
class _SomeNodes(Light):
    """Light of which only some depth nodes are looked at."""

    nodes: range = range(0)

    def occupied_nodes(self) -> list[int]:
        return [node for node in super().occupied_nodes() if node in self.nodes]


def _by_brute_force(
    view: View, camera: Camera, weights: Tensor, nodes: Tensor, say: Progress, kept: Path | None
) -> tuple[Tensor, dict[tuple[str, str], float]]:
    """The unexposed photo in float64, [channel, y, x], and what it took.

    Block by block of depths; kept: file from which an interrupted photo is gone on with.
    """
    light = light_of(view.to(dtype=torch.float64), nodes, seen(view))
    grid = Grid(*view.padded_shape, view.margin, camera.recipe.psf.window_px)
    key = _key(
        light=float(view.radiance.double().sum()),
        nodes=nodes.tolist(),
        camera=camera.recipe.model_dump_json(),
    )
    state: dict[str, Any] = {"key": key, "photo": 0.0, "seconds": 0.0, "psf_seconds": 0.0, "done": 0}
    if kept is not None and kept.is_file():
        before = torch.load(kept, weights_only=True)
        state = before if before.get("key") == key else state
    while state["done"] < nodes.numel():
        block = range(state["done"], min(state["done"] + BLOCK, nodes.numel()))
        say(0.05 + 0.8 * block.start / nodes.numel(), f"brute force, {block.start} of {nodes.numel()} depths")
        some = nodes[block.start : block.stop]
        psfs, psf_seconds = _timed(lambda some=some: _bank(camera, view.wavelengths, some))
        kernels = StreamedKernels(
            lambda one, psfs=psfs, some=some: psfs[torch.searchsorted(some, one)].double(),
            nodes,
            view.wavelengths,
            psfs.shape[-1],
            ahead=1,
        )
        blur = METHODS["brute"](kernels, weights, tolerance_db=math.inf)
        part = _SomeNodes(**vars(light), nodes=block)
        photo, seconds = _timed(lambda blur=blur, part=part: blur(part, grid))
        state = {
            "key": key,
            "photo": state["photo"] + photo,
            "seconds": state["seconds"] + seconds,
            "psf_seconds": state["psf_seconds"] + psf_seconds,
            "done": block.stop,
        }
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            with whole(kept) as temporary:
                torch.save(state, temporary)
    return view.crop_margin(state["photo"]), {
        ("seconds_brute", ""): state["seconds"],
        ("seconds_brute_psfs", ""): state["psf_seconds"],
        ("brute_depths", ""): float(len(light.occupied_nodes())),
    }


def growth(say: Progress) -> dict[str, float]:
    """How the time of a photo grows, each quantity alone: depth nodes, bands, pixels, tolerance."""
    camera = cameras()["cubic"]
    view = synthetic_view(256, 31)
    nodes = torch.linspace(0, 2, 129, dtype=torch.float64)
    psfs = _bank(camera, view.wavelengths, nodes)

    def seconds(view: View, step: int = 4, tolerance: float = 50.0, bands: int = 31) -> tuple[float, int]:
        groups = torch.tensor_split(torch.arange(31), bands)
        middle = torch.tensor([int(group[len(group) // 2]) for group in groups])
        kernels = HeldKernels(psfs[::step][:, middle], nodes[::step], view.wavelengths)
        weights = channel_weights(camera, view.wavelengths).float()
        factors = factorise(kernels, [joint_groups(weights), band_groups(weights)], tolerance)
        blur, grid = blur_with(factors, weights), Grid(*view.padded_shape, view.margin, kernels.window)
        which = seen(view)
        blur(light_of(view, kernels.nodes, which), grid)
        time = _median_seconds(lambda: blur(light_of(view, kernels.nodes, which), grid), 3 * REPEATS)
        return time, sum(each.rank for each in factors)

    tries: dict[str, dict[int, Callable[[], tuple[float, int]]]] = {
        "depths": {n: (lambda n=n: seconds(view, step=128 // n)) for n in (16, 32, 64, 128)},
        "bands": {n: (lambda n=n: seconds(merged_bands(view, n), bands=n)) for n in (4, 8, 16, 31)},
        "pixels": {n * n: (lambda n=n: seconds(synthetic_view(n, 31))) for n in (128, 256, 512)},
        "tolerance_db": {n: (lambda n=n: seconds(view, tolerance=n)) for n in (30, 40, 50, 60, 70)},
    }
    figures: dict[str, float] = {}
    for number, (name, of) in enumerate(tries.items()):
        say(number / len(tries), f"growth with {name}")
        found = {n: measure() for n, measure in of.items()}
        first = next(iter(found.values()))[0]
        figures |= {f"growth.{name}.{n}": time / first for n, (time, _) in found.items()}
        if name == "tolerance_db":
            figures |= {f"growth_rank.{n}": float(rank) for n, (_, rank) in found.items()}
    figures["growth.doubled_depths"] = figures["growth.depths.64"] / figures["growth.depths.32"]
    return figures


def memory(depths: int, say: Progress) -> dict[str, float]:
    """Peak memory of a photo of 1024 x 1024 pixels at so many depths, in a process of its own."""
    say(0.0, "a photo of 1024 x 1024 pixels")
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return {f"peak_memory_mib.1024px_31b_{depths}d": pool.apply(memory_of_a_photo, (depths,))}


def memory_of_a_photo(depths: int) -> float:
    """Peak memory of this process in MiB after one photo of 1024 x 1024 pixels and 31 bands.

    To be called in a process of its own.
    """
    camera = cameras()["clear"]
    view = synthetic_view(1024, 31, camera.pixel_angle)
    capture(view, camera, Fidelity(method="low_rank", layers=depths, rank_db=50.0))
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
    """Time against depth nodes, bands, pixels and rank, each relative to its first. Returns the path."""
    labels = {"depths": "depth nodes", "bands": "bands", "pixels": "pixels", "tolerance_db": "rank"}

    def paint() -> Figure:
        figure = new_figure(WIDE_IN, 2.8)
        grid = figure.subplots(1, len(labels))
        for axes, (name, label) in zip(grid, labels.items(), strict=True):
            points = {
                key.rsplit(".", 1)[1]: value
                for key, value in figures.items()
                if key.startswith(f"growth.{name}.")
            }
            ranks = {n: figures[f"growth_rank.{n}"] for n in points} if name == "tolerance_db" else {}
            pairs = sorted((ranks.get(n, float(n)), value) for n, value in points.items())
            axes.plot(*zip(*pairs, strict=True), "o-", color=BLUE)
            axes.set_xlabel(label)
            axes.set_ylabel("time, relative to the first")
            axes.set_ylim(bottom=0)
        return figure

    about = "Time of a photo against depth nodes, bands, pixels and rank, relative to the first."
    return Plot(paint, about, about).save(path)


def _bank(camera: Camera, wavelengths: Tensor, nodes: Tensor) -> Tensor:
    """PSFs computed anew: a bank that is at hand already would take no time."""
    from edofsim.optics import cache

    cache.forget()
    return psf_bank(camera, wavelengths, nodes).values


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def _median_seconds(work: Callable[[], Any], repeats: int = REPEATS) -> float:
    return statistics.median(_timed(work)[1] for _ in range(repeats))
