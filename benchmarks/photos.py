"""What a photo costs: as plans take it, against four other ways, with the error that each buys; and its
memory.

All ways blur the light of one view, 31 bands, with the same threads, without occlusion, which others do not
have; the truth is the same sum at `TRUTH_NODES` depth nodes. They are

- gathered: as plans simulate photos: the bands of each channel in few groups with PSFs of few wavelengths;
- layered: the package's layers of every band, float32, one batch of transforms a layer;
- plain: what a competent user writes (`plain_photo`), with the nodes and PSFs of `layered`;
- brute: every band at each of 475 depths by itself in float64, as everybody writes first;
- paper: every depth of a picture in steps of 1 mm and three wavelengths by itself, float32, as the paper's 3D
  experiment does; its error is that of three wavelengths.

`gathered` and `layered` have the fewest groups, wavelengths and layers that meet the asked PSNR; that search
is in no time, nor is it a plan's in a run. Time is told with PSFs at hand, and with their making on every
side. Seconds are of the processors, which other work on the machine disturbs least.
`brute` and `paper` do the same work for each depth: some depths are timed, and stand for all that the
view has."""

from __future__ import annotations

import math
import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor

from benchmarks.brute import brute
from benchmarks.plain_photo import plain_photo
from edofsim.capture import Fidelity, capture
from edofsim.capture.convolution import Grid
from edofsim.capture.imaging import Axes, Imaging, imaging_of, spectrum_of
from edofsim.capture.light import light_of, seen
from edofsim.capture.photograph import all_in_focus
from edofsim.capture.prepare import channel_weights
from edofsim.capture.sensor import automatic_exposure
from edofsim.core.progress import Progress, part, silent
from edofsim.experiments.kept import Kept, code_of, key_of
from edofsim.experiments.occlusion_cameras import smooth_height_map
from edofsim.experiments.protocols import flattened, of_three_lines
from edofsim.optics import Camera, PsfField, psf_bank
from edofsim.recipe import load_camera, load_scene
from edofsim.record import machine, peak_memory_mib
from edofsim.render.view import View

T = TypeVar("T")
SCENES = ("desk", "hallway")
MASKS, FULL_MASKS = ("clear", "cubic"), ("clear", "cubic", "smooth")
TOLERANCES = (50.0, 40.0)
SIZE = 512
SAMPLES = 16
REPEATS = 3
LAYERS = (5, 7, 9, 11, 13, 17, 21, 25, 33)
GROUPS = ((1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 2), (3, 3), (4, 2), (4, 3), (6, 2))
"""(groups of bands a channel, wavelengths a group)."""
TRUTH_NODES = 65
BRUTE_DEPTHS = 475
"""As many as the paper's 3D scene has."""
TIMED_DEPTHS = 6
"""Of `brute` and `paper`."""
MEMORY = ((1024, 16), (2048, 16))
FULL_MEMORY = (*MEMORY, (1024, 64))
"""Photos whose memory is measured: pixels along a side, layers."""


def run(progress: Progress | None = None, out: Path | None = None, full: bool = False) -> dict[str, float]:
    """Figures, by scene (desk, hallway), mask (clear, cubic) and asked PSNR (50db, 40db), without occlusion:

    times_faster.strongest.SCENE.MASK.ASKED: seconds of the fastest other way that meets the PSNR over those
    of `gathered`, PSFs at hand; times_faster_with_psfs.strongest.(same): PSFs computed on both sides; both
    least first; {times_faster,times_faster_with_psfs}.{layered,plain,brute,paper}.(same): of each way;
    {seconds,seconds_psfs,psnr_db}.WAY.(same); {groups,wavelengths,layers}.(same): of `gathered`, and
    layers.layered.(same); depths.{brute,paper}.SCENE.MASK: what they sum over;
    whole.{seconds,seconds_layered,psnr_db}.SCENE.MASK.ASKED: a photo with hidden surfaces, PSFs included,
    with the same settings, of all bands, and how far the two are apart;
    peak_memory_mib.{1024,2048}px_31b_16d: of a process that takes one photo with hidden surfaces in two
    groups of bands a channel.
    out: a folder for finished pieces, which the same code does not measure again. full: also a smooth random
    mask, and 64 layers.
    """
    say = progress or silent
    figures: dict[str, float] = {}
    kept = None if out is None else Kept(out / "expose.jsonl")
    pieces: dict[str, Callable[[Progress], dict[str, float]]] = {
        f"{mask}-{scene}": lambda tell, m=mask, s=scene: of_scene(m, s, tell)
        for mask in (FULL_MASKS if full else MASKS)
        for scene in SCENES
    }
    pieces |= {
        f"memory-{size}px-{layers}d": lambda tell, s=size, n=layers: memory(s, n, tell)
        for size, layers in (FULL_MEMORY if full else MEMORY)
    }
    for number, (name, measure) in enumerate(pieces.items()):
        tell = part(say, number / len(pieces), (number + 1) / len(pieces), name)
        figures |= once(kept, name, lambda m=measure, t=tell: m(t))
    say(1.0, "done")
    first = [
        pair
        for kind in ("times_faster", "times_faster_with_psfs")
        for pair in sorted(
            (item for item in figures.items() if item[0].startswith(f"{kind}.strongest.")),
            key=lambda item: item[1],
        )
    ]
    return dict(first) | figures


def once(kept: Kept | None, name: str, measure: Callable[[], dict[str, float]]) -> dict[str, float]:
    """Figures of a piece that was finished before, by this code on this machine, or measured now."""
    key = key_of(machine=machine(), benchmarks=code_of(Path(__file__).parent), piece=name)
    found = None if kept is None else kept.get(key)
    if found is None:
        found = measure()
        if kept is not None:
            kept.put(key, found)
    return found


def cameras() -> dict[str, Camera]:
    """The cameras that are compared: clear aperture, cubic mask, a random smooth relief."""
    clear = Camera.from_recipe(load_camera("paper-clear").recipe)
    cubic = Camera.from_recipe(load_camera("paper-cubic").recipe)
    return {"clear": clear, "cubic": cubic, "smooth": clear.with_height(smooth_height_map())}


def rendered(scene: str, progress: Progress) -> View:
    """The view of a shipped scene at the size of the benchmark, from the cache if it was rendered before."""
    from edofsim.render import render

    loaded = load_scene(scene)
    frame = loaded.recipe.frame.model_copy(update={"width_px": SIZE, "height_px": SIZE})
    samples = loaded.recipe.render.model_copy(update={"samples": SAMPLES})
    recipe = loaded.recipe.model_copy(update={"frame": frame, "render": samples})
    return render(recipe, loaded.base, progress=progress)


def of_scene(mask: str, scene: str, say: Progress) -> dict[str, float]:
    """Figures of one mask and one scene."""
    view = rendered(scene, part(say, 0.0, 0.1))
    found = compare(view, cameras()[mask], part(say, 0.1, 1.0))
    return {
        f"{kind}.{scene}.{mask}" + (f".{asked}" if asked else ""): value
        for (kind, asked), value in found.items()
    }


@dataclass(frozen=True)
class Way:
    """A way to a photo: seconds with PSFs at hand; seconds that its PSFs take; its image, unexposed
    [channel, y, x] of the frame."""

    seconds: float
    seconds_psfs: float
    image: Tensor

    @property
    def all_seconds(self) -> float:
        return self.seconds + self.seconds_psfs


def compare(
    view: View, camera: Camera, say: Progress | None = None, layers: tuple[int, ...] = LAYERS
) -> dict[tuple[str, str], float]:
    """Figures by (kind, asked) as `run` names them. layers: numbers that are tried."""
    say = say or silent
    weights = channel_weights(camera, view.wavelengths).float()
    exposure = automatic_exposure(view.crop_margin(all_in_focus(view, weights)))
    say(0.0, "the truth")
    truth = by_layers(view, camera, Fidelity(layers=TRUTH_NODES), repeats=1).image

    def psnr_db(image: Tensor) -> float:
        error = float(((image - truth).double() * exposure).square().mean())
        return -10 * math.log10(max(error, 1e-30))

    say(0.2, "brute force and the paper's protocol")
    slow, brute_depths = by_brute_force(view, camera, torch.float64)
    flat = flattened(view, camera, encoded=False)
    lines = of_three_lines(camera)
    paper, paper_depths = by_brute_force(flat, lines, torch.float32, own_depths=True)
    exposed = by_layers(flat, lines, Fidelity(layers=TRUTH_NODES), repeats=1).image
    paper = replace(paper, image=exposed / exposure)
    figures: dict[tuple[str, str], float] = {
        ("depths.brute", ""): float(brute_depths),
        ("depths.paper", ""): float(paper_depths),
    }
    for number, asked_db in enumerate(TOLERANCES):
        asked = f"{asked_db:.0f}db"
        say(0.4 + 0.6 * number / len(TOLERANCES), f"{asked_db:.0f} dB")
        few = fewest_layers(view, camera, Fidelity(), asked_db, psnr_db, layers)
        gathered = cheapest(view, camera, asked_db, psnr_db, layers)
        every = by_layers(view, camera, few)
        ways = {
            "gathered": by_layers(view, camera, gathered),
            "layered": every,
            "plain": by_plain_layers(view, camera, few, every.seconds_psfs),
            "brute": slow,
            "paper": paper,
        }
        ours = ways["gathered"]
        figures |= {
            ("groups", asked): float(gathered.band_groups),
            ("wavelengths", asked): float(gathered.group_wavelengths),
            ("layers", asked): float(gathered.layers or 0),
            ("layers.layered", asked): float(few.layers or 0),
        }
        for name, way in ways.items():
            figures[f"seconds.{name}", asked] = way.seconds
            figures[f"seconds_psfs.{name}", asked] = way.seconds_psfs
            if name != "brute":  # whose depths are the truth's, as good as
                figures[f"psnr_db.{name}", asked] = psnr_db(way.image)
            if name != "gathered":
                figures[f"times_faster.{name}", asked] = way.seconds / ours.seconds
                figures[f"times_faster_with_psfs.{name}", asked] = way.all_seconds / ours.all_seconds
        rivals = [way for name, way in ways.items() if name in ("layered", "plain", "brute")]
        figures["times_faster.strongest", asked] = min(way.seconds for way in rivals) / ours.seconds
        figures["times_faster_with_psfs.strongest", asked] = (
            min(way.all_seconds for way in rivals) / ours.all_seconds
        )
        hidden = whole(view, camera, gathered, few)
        figures |= {(f"whole.{kind}", asked): value for kind, value in hidden.items()}
    return figures


def by_layers(view: View, camera: Camera, fidelity: Fidelity, repeats: int = REPEATS) -> Way:
    """Layers as the package blurs them, without occlusion."""
    fidelity = replace(fidelity, occlusion="none")
    axes = axes_of(view, camera, fidelity)
    imaging, seconds_psfs = median_of(lambda: new_imaging(camera, fidelity, axes), repeats)
    image, seconds = median_of(lambda: imaging.image(imaging.light(view)), repeats)
    return Way(seconds, seconds_psfs, image)


def new_imaging(camera: Camera, fidelity: Fidelity, axes: Axes) -> Imaging:
    """The optics of a fidelity, their PSFs computed anew: those that are at hand would take no time."""
    from edofsim.optics import cache

    cache.forget()
    return imaging_of(camera, fidelity, axes)


def axes_of(view: View, camera: Camera, fidelity: Fidelity) -> Axes:
    """What images of a view share, with as many depth nodes as a fidelity has layers."""
    depth = view.inverse_depth[seen(view)]
    ends = (float(depth.min()), float(depth.max()))
    nodes = torch.linspace(*ends, fidelity.layers or 1, dtype=torch.float64)
    return Axes(channel_weights(camera, view.wavelengths), view.wavelengths, spectrum_of(view), ends, nodes)


def fewest_layers(
    view: View,
    camera: Camera,
    fidelity: Fidelity,
    asked_db: float,
    psnr_db: Callable[[Tensor], float],
    layers: tuple[int, ...],
) -> Fidelity:
    """The fidelity with the fewest layers of those tried that meets a PSNR; the most where none does."""
    for count in layers:
        tried = replace(fidelity, layers=count)
        if psnr_db(by_layers(view, camera, tried, repeats=1).image) >= asked_db:
            return tried
    return replace(fidelity, layers=layers[-1])


def cheapest(
    view: View, camera: Camera, asked_db: float, psnr_db: Callable[[Tensor], float], layers: tuple[int, ...]
) -> Fidelity:
    """The groups of bands, wavelengths and layers that meet a PSNR in the least time, PSFs included."""
    found: list[tuple[float, Fidelity]] = []
    for groups, wavelengths in GROUPS:
        bands = Fidelity(band_groups=groups, group_wavelengths=wavelengths)
        if psnr_db(by_layers(view, camera, replace(bands, layers=layers[-1]), repeats=1).image) < asked_db:
            continue
        few = fewest_layers(view, camera, bands, asked_db, psnr_db, layers)
        found.append((by_layers(view, camera, few).all_seconds, few))
        if len(found) == 3:  # those that follow have more to do
            break
    if not found:
        return fewest_layers(view, camera, Fidelity(), asked_db, psnr_db, layers)
    return min(found, key=lambda each: each[0])[1]


def by_plain_layers(view: View, camera: Camera, fidelity: Fidelity, seconds_psfs: float) -> Way:
    """`plain_photo` with the nodes and PSFs of a fidelity, which take so many seconds."""
    axes = axes_of(view, camera, fidelity)
    psfs = psf_bank(camera, view.wavelengths, axes.nodes).values
    response, which = axes.response.float(), seen(view)

    def photo() -> Tensor:
        radiance = view.radiance.index_select(1, which)
        pixel, depth = view.pixel[which], view.inverse_depth[which].double()
        image = plain_photo(radiance, pixel, depth, view.padded_shape, axes.nodes, psfs, response)
        return view.crop_margin(image)

    image, seconds = median_of(photo, REPEATS)
    return Way(seconds, seconds_psfs, image)


def by_brute_force(
    view: View, camera: Camera, dtype: torch.dtype, own_depths: bool = False, timed_depths: int = TIMED_DEPTHS
) -> tuple[Way, int]:
    """Every band at every depth by itself, and how many depths the view has: `BRUTE_DEPTHS` between its
    nearest and farthest, or, with `own_depths`, exactly those of its surfaces.

    So many depths are blurred and timed, at equal steps; the seconds are those of all, the image theirs
    alone."""
    which = seen(view)
    depth = view.inverse_depth[which].double()
    if own_depths:
        nodes = torch.unique(depth)
    else:
        nodes = torch.linspace(float(depth.min()), float(depth.max()), BRUTE_DEPTHS, dtype=torch.float64)
    light = light_of(view.to(dtype=dtype), nodes, which)
    occupied = light.occupied_nodes()
    step = max(1, len(occupied) // timed_depths)
    some = occupied[::step][:timed_depths]
    grid = Grid(*view.padded_shape, view.margin, camera.recipe.psf.window_px)
    weights = channel_weights(camera, view.wavelengths).to(dtype)

    def bank() -> Tensor:
        from edofsim.optics import cache

        cache.forget()
        return psf_bank(camera, view.wavelengths, nodes[some]).values

    psfs, seconds_psfs = timed(bank)
    field = PsfField(psfs.to(dtype), nodes[some], view.wavelengths)
    # of the light at the nodes that are timed, none is between nodes
    at = [light.at_node(node) for node in some]
    flat = torch.cat([image.reshape(view.bands, -1) for image in at], 1)
    pixels = torch.arange(at[0][0].numel()).repeat(len(some))
    layers = replace(
        light,
        pixel=pixels,
        radiance=flat,
        share=torch.zeros(pixels.numel(), dtype=dtype),
        starts=tuple(at[0][0].numel() * k for k in range(len(some) + 1)),
    )
    photo, seconds = timed(lambda: brute(field, weights)(layers, grid))
    scale = len(occupied) / len(some)
    return Way(seconds * scale, seconds_psfs * scale, view.crop_margin(photo)), len(occupied)


def whole(view: View, camera: Camera, gathered: Fidelity, every: Fidelity) -> dict[str, float]:
    """A photo with hidden surfaces in groups of bands and in all: seconds of each, PSFs included, and the
    PSNR of one against the other."""
    from edofsim.optics import cache

    def photo(fidelity: Fidelity) -> tuple[Tensor, float]:
        cache.forget()
        return timed(lambda: capture(view, camera, replace(fidelity, occlusion="hidden")).clean)

    (few, seconds), (all_bands, seconds_layered) = photo(gathered), photo(every)
    error = float((few - all_bands).double().square().mean())
    return {
        "seconds": seconds,
        "seconds_layered": seconds_layered,
        "psnr_db": -10 * math.log10(max(error, 1e-30)),
    }


def memory(size: int, layers: int, say: Progress) -> dict[str, float]:
    """Peak memory of a photo of so many pixels squared in so many layers, in a process of its own."""
    say(0.0, f"a photo of {size} x {size} pixels")
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply(memory_of_a_photo, (size, layers))
    return {f"peak_memory_mib.{size}px_31b_{layers}d": found}


def memory_of_a_photo(size: int, layers: int) -> float:
    """Peak memory of this process in MiB after one photo of `size` x `size` pixels and 31 bands with what
    surfaces hide, in two groups of bands a channel.

    To be called in a process of its own.
    """
    camera = cameras()["clear"]
    fidelity = Fidelity(layers=layers, band_groups=2, group_wavelengths=2)
    capture(synthetic_view(size, 31, camera.pixel_angle), camera, fidelity)
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


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """A result and the processor seconds that it took."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def median_of(work: Callable[[], T], repeats: int) -> tuple[T, float]:
    """A result and the median of the seconds that it took."""
    found = [timed(work) for _ in range(repeats)]
    return found[-1][0], statistics.median(seconds for _, seconds in found)
