"""Ways to composite occlusion, judged by two slow references at depth edges of shipped scenes.

One crop a scene, where most of the scene's hard depth edges are; three masks; focus in front of both surfaces
of the edge, between them, and behind both. The paper's camera in the green of its three-colour model alone,
so that the references take minutes.

The first reference clips pupils by what the view holds: both sides see the same light, and what is compared
is occlusion alone. It is dark where the pupil sees a surface that the view lacks. The second is Mitsuba's own
thin lens: its rays meet every surface of the scene, but it knows no mask and no diffraction. Two things keep
any way from it: it is a mean over random rays, whose noise is told from its two halves; and the view lacks
surfaces that it sees. How much they matter is told by what clipped pupils reach, which know nothing but the
view.

What to expect: `hidden` is exact for two surfaces of which one is in focus. Where both are blurred it
averages coverage and light over the pupil apart, while rays know which go together; that error is a smooth
band along the edge, and goes where sub-apertures are composited one by one. The other ways know the visible
surfaces alone. `over` and `normalised` snap surfaces to layers: many layers of one slanted surface hide each
other, few blur it wrongly. Each is judged with the number of layers that is best for it, case by case.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import torch
import typer
from matplotlib.figure import Figure
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from .. import completion
from ..capture.bands import chosen_bands
from ..capture.prepare import channel_weights
from ..core.progress import Progress, part
from ..core.store import keep
from ..errors import InputError
from ..optics import Camera
from ..optics.camera import focus_distance
from ..optics.lenses.plano_convex import PlanoConvexLens
from ..optics.masks.clear import ClearMask
from ..optics.masks.cubic import CubicMask
from ..options import CacheOption, Device, DeviceOption
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_scene
from ..recipe.camera import Focus, PsfSettings, Sensor
from ..record import write_csv
from ..reference import clipped_pupils, thin_lens
from ..reference.pinhole import Crop
from ..render import render
from ..render.keys import view_key
from ..render.view import View
from ..report import Column, Plot, Table
from ..report.plot import new_figure, picture_axes
from ..restore.scores import psnr
from ..scene import build_scene
from ..scene.model import SceneModel
from .experiment import Findings, in_parts
from .kept import Kept, key_of
from .occlusion_ways import SNAPPED, WAYS, composites

SCENES = ("desk", "foliage", "bench")
MASKS = ("clear", "cubic", "smooth")
FOCI = ("front", "between", "behind")
WINDOW = 64
"""Side of the PSFs, and the margin around the crop twice."""
SIZE = 64
SAMPLES = 64
GAPS = (0.25, 1.3)
"""Depth edges of so many dioptres count: blurs are then no wider than the window."""
GREEN = 1
"""Index of the band that is used."""
THIN_LENS = "thin-lens"
"""Stands in place of a mask: the clear aperture, judged by rays."""
LENS_SAMPLES = 1024
"""A pixel, of the thin lens and of the view that is judged by it, which has other noise."""
BOUNDS = {"noise_db": "noise of the truth", "view_db": "clipped pupils"}
"""What stands between any way and the thin lens, by the name of its figures."""


@dataclass(frozen=True)
class Edge:
    """A crop, and the inverse depths in 1/m of what is in front and behind at its depth edges."""

    where: Crop
    near: float
    far: float


def smooth_relief(samples: int = 238, width: float = 10.0, top: float = 1.135e-6, seed: int = 0) -> Tensor:
    """White noise under a Gaussian of `width` samples, from 0 to `top` metres: [n, n], float32.

    238 samples of 21 um and 1.135 um are those of the paper's mask (Fig. `MTF`).
    """
    noise = torch.randn(samples, samples, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    f = torch.fft.fftfreq(samples, dtype=torch.float64)
    window = torch.exp(-2 * (math.pi * width) ** 2 * (f[:, None] ** 2 + f**2))
    relief = torch.fft.ifft2(torch.fft.fft2(noise) * window).real
    return ((relief - relief.min()) / (relief.max() - relief.min()) * top).float()


@in_parts("scenes", lambda: SCENES)
def run(
    folder: Path,
    progress: Progress,
    scenes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE...]",
            help="Default: desk, foliage, bench.",
            autocompletion=completion.scenes,
        ),
    ] = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
) -> Findings:
    """Ways to composite depth edges against pupils clipped ray by ray: 64 x 64 pixels a scene, a clear
    aperture, a cubic and a smooth random mask, focus in front of the edge, between its surfaces, and behind;
    the clear aperture also against Mitsuba's thin lens, whose rays meet all surfaces.

    Interrupt it at any time: references and scenes that are finished are kept in --out.

    Figures: psnr_db.SCENE.MASK.FOCUS.{none,over,normalised,hidden,sub_apertures}, {near,far}_dpt.SCENE; MASK
    also `thin-lens`, a clear aperture without aberrations; `sub_apertures` is `hidden` through 4 x 4
    of them. layers.SCENE.MASK.FOCUS.{over,normalised}: the number of layers, from 2 on, with which that way
    is nearest to the truth, which its PSNR is of. noise_db.SCENE.thin-lens.FOCUS: PSNR that the noise of
    that truth leaves to a perfect photo; view_db.SCENE.thin-lens.FOCUS: PSNR of the photo by clipped pupils,
    which is dark where the view lacks a surface.
    """
    loaded = [load_scene(scene) for scene in scenes or SCENES]
    kept = Kept(folder / "finished.jsonl")
    figures: dict[str, float] = {}
    outputs: dict[str, Path] = {}
    for number, source in enumerate(loaded):
        scene = source.recipe.name
        tell = part(progress, number / len(loaded), (number + 1) / len(loaded), scene)
        picture = outputs[f"picture of {scene}"] = folder / f"occlusion-{scene}.png"
        key = scene_key(source, str(device))
        found = kept.get(key)
        if found is None or not picture.is_file():
            found = of_scene(source, folder, cache, str(device), tell)
            kept.put(key, found)
        figures |= found
    counts = tuple(f"layers of {way}" for way in SNAPPED)
    bounds = tuple(BOUNDS.values())
    header, rows = ("scene", "mask", "focus", *WAYS, *counts, *bounds), table(figures)
    outputs["table"] = write_csv(folder / "occlusion.csv", header, rows)
    columns = (
        *(Column(name) for name in header[:3]),
        *(Column(way, "dB", 2) for way in WAYS),
        *(Column(name, "", 0) for name in counts),
        *(Column(name, "dB", 1) for name in bounds),
    )
    return Findings(figures, shown=[Table(columns, tuple(rows))], outputs=outputs)


def table(figures: dict[str, float]) -> list[tuple[str | float, ...]]:
    """Rows (scene, mask, focus, PSNR of each way to composite, layers of `SNAPPED`, each of `BOUNDS` or NaN)
    of the figures."""
    cases = dict.fromkeys(tuple(name.split(".")[1:4]) for name in figures if name.startswith("psnr_db."))
    rows: list[tuple[str | float, ...]] = []
    for case in cases:
        scores = [figures[".".join(("psnr_db", *case, way))] for way in WAYS]
        counts = [figures[".".join(("layers", *case, way))] for way in SNAPPED]
        bounds = [figures.get(".".join((name, *case)), math.nan) for name in BOUNDS]
        rows.append((*case, *scores, *counts, *bounds))
    return rows


def scene_key(loaded: Loaded[SceneRecipe], device: str) -> str:
    """A key of everything that decides a scene's figures: the views, the cameras, and the code."""
    views = [view_key(three_bands(loaded, samples), loaded.base) for samples in (SAMPLES, LENS_SAMPLES)]
    cameras = [
        camera_key(camera_with(mask, 1.0, loaded.recipe.frame.pixel_angle)) for mask in (*MASKS, THIN_LENS)
    ]
    return key_of(views=views, cameras=cameras, device=device)


def camera_key(camera: Camera) -> str:
    """Of a camera's recipe and height map."""
    height = b"" if camera.height_map is None else camera.height_map.cpu().numpy().tobytes()
    return camera.recipe.model_dump_json() + hashlib.sha256(height).hexdigest()


def of_scene(
    loaded: Loaded[SceneRecipe], folder: Path, cache: Path | None, device: str, say: Progress
) -> dict[str, float]:
    """Figures of one scene, and its picture."""
    scene = loaded.recipe.name
    recipe = three_bands(loaded, SAMPLES)
    view = render(recipe, loaded.base, cache=cache, device=device, progress=part(say, 0.0, 0.2))
    view = chosen_bands(view, [GREEN])
    edge = busiest_edge(view)
    model = build_scene(recipe, loaded.base)
    takes = {
        (mask, focus): camera_with(mask, distance, view.pixel_angle)
        for mask in MASKS
        for focus, distance in focus_distances(edge).items()
    }
    truths = references(
        folder / f"occlusion-{scene}.safetensors",
        view,
        model,
        takes,
        edge.where,
        device,
        part(say, 0.2, 0.7),
    )
    say(0.7, "compositing")
    figures = {f"near_dpt.{scene}": edge.near, f"far_dpt.{scene}": edge.far}
    shown: dict[tuple[str, str], dict[str, Tensor]] = {}
    for (mask, focus), truth in zip(takes, truths, strict=True):
        judged = composites(view, edge.where, takes[mask, focus], truth)
        figures |= judged.figures(f"{scene}.{mask}.{focus}")
        shown[mask, focus] = {"reference": judged.truth, **judged.photos}
    fine = render(
        three_bands(loaded, LENS_SAMPLES),
        loaded.base,
        cache=cache,
        device=device,
        progress=part(say, 0.7, 0.75),
    )
    green, depth = chosen_bands(fine, [GREEN]), recipe.render.max_depth
    lenses = {
        (THIN_LENS, focus): camera_with(THIN_LENS, distance, view.pixel_angle)
        for focus, distance in focus_distances(edge).items()
    }
    limits = references(
        folder / f"occlusion-{scene}-{THIN_LENS}.safetensors",
        green,
        model,
        lenses,
        edge.where,
        device,
        part(say, 0.75, 0.95),
    )
    for (take, camera), limit in zip(lenses.items(), limits, strict=True):
        halves = by_rays(model, fine, GREEN, edge.where, camera, depth, device, part(say, 0.95, 1.0))
        judged = composites(green, edge.where, camera, (halves[0] + halves[1]) / 2)
        case = f"{scene}.{'.'.join(take)}"
        figures |= judged.figures(case)
        figures[f"noise_db.{case}"] = noise_db(*(half * judged.exposure for half in halves))
        figures[f"view_db.{case}"] = psnr(limit * judged.exposure, judged.truth)
        shown[take] = {"reference": judged.truth, **judged.photos}
    crops_plot(shown).save(folder / f"occlusion-{scene}.png")
    return figures


def by_rays(
    model: SceneModel,
    view: View,
    band: int,
    where: Crop,
    camera: Camera,
    max_depth: int,
    device: str = "auto",
    progress: Progress | None = None,
) -> tuple[Tensor, Tensor]:
    """A crop in one band of a view through the camera's lens without a mask, by rays: two images
    [channel, y, x] of half of the samples each, whose mean is the truth."""
    wavelength = view.wavelengths[band : band + 1]

    def half(seed: int) -> Tensor:
        image = thin_lens(
            model,
            view,
            where,
            aperture_radius=camera.aperture_radius,
            focus_distances=focus_distance(camera, wavelength).tolist(),
            samples=LENS_SAMPLES // 2,
            max_depth=max_depth,
            seed=seed,
            device=device,
            progress=part(progress, seed / 2, (seed + 1) / 2),
        )
        weights = channel_weights(camera, wavelength).to(image)
        return torch.einsum("cb,byx->cyx", weights, image[band : band + 1])

    return half(0), half(1)


def noise_db(one: Tensor, other: Tensor) -> float:
    """PSNR that the noise of the mean of two images with independent noise leaves."""
    # the error of the mean is half of their difference
    return psnr(one, other) + 20 * math.log10(2)


def references(
    kept: Path,
    view: View,
    model: SceneModel,
    takes: dict[tuple[str, str], Camera],
    where: Crop,
    device: str,
    progress: Progress,
) -> list[Tensor]:
    """The reference photo of each take, from the file if it holds those of this very view and crop."""
    light = hashlib.sha256(view.radiance.cpu().numpy().tobytes()).hexdigest()
    cameras = {".".join(take): camera_key(camera) for take, camera in takes.items()}
    said = key_of(view=light, where=asdict(where), cameras=cameras)
    if kept.is_file():
        with safe_open(kept, "pt") as file:
            if (file.metadata() or {}).get("of") == said:
                return [file.get_tensor(".".join(take)) for take in takes]
    truths = clipped_pupils(
        view, model, list(takes.values()), where, window_px=WINDOW, device=device, progress=progress
    )
    photos = {".".join(take): truth.contiguous() for take, truth in zip(takes, truths, strict=True)}
    keep(kept, lambda path: save_file(photos, path, {"of": said}))
    return truths


def three_bands(loaded: Loaded[SceneRecipe], samples: int) -> SceneRecipe:
    """The scene at 482, 546.5 and 611 nm: a band for each colour, near those of the paper."""
    bands = loaded.recipe.bands.model_copy(update={"start_nm": 482.0, "stop_nm": 611.0, "count": 3})
    coarse = loaded.recipe.render.model_copy(update={"samples": samples})
    return loaded.recipe.model_copy(update={"bands": bands, "render": coarse})


def busiest_edge(view: View) -> Edge:
    """The crop of `SIZE` pixels with the most depth edge in it, each pixel of edge counted by its jump of
    inverse depth, on a raster of half its size. Raises InputError for a view without such edges."""
    depth = view.crop_margin(view.mean_inverse_depth())
    # two pixels apart: a pixel on an edge has a depth between those of its neighbours
    pairs = ((depth[:-2, :-2], depth[2:, :-2]), (depth[:-2, :-2], depth[:-2, 2:]))
    jumps = torch.stack([(a - b).abs() for a, b in pairs])
    jumps = torch.where((jumps >= GAPS[0]) & (jumps <= GAPS[1]), jumps, torch.zeros_like(jumps))
    best, most = (0, 0), -1.0
    for top in range(0, view.height - SIZE + 1, SIZE // 2):
        for left in range(0, view.width - SIZE + 1, SIZE // 2):
            edge = float(jumps[:, top : top + SIZE, left : left + SIZE].sum())
            if edge > most:
                best, most = (top, left), edge
    inside = (slice(best[0], best[0] + SIZE), slice(best[1], best[1] + SIZE))
    near, far = (
        torch.cat([which(a, b)[inside][jump[inside] > 0] for (a, b), jump in zip(pairs, jumps, strict=True)])
        for which in (torch.maximum, torch.minimum)
    )
    if not near.numel():
        raise InputError(f"the view has no depth edge between {GAPS[0]:g} and {GAPS[1]:g} dioptres")
    return Edge(Crop(*best, SIZE, SIZE), float(near.median()), float(far.median()))


def focus_distances(edge: Edge) -> dict[str, float]:
    """Distances in metres a quarter of the gap in front of both surfaces, midway, and as far behind both."""
    gap = edge.near - edge.far
    places = {"front": edge.near + gap / 4, "between": edge.near - gap / 2, "behind": edge.far - gap / 4}
    return {name: 1 / max(place, 0.05) for name, place in places.items()}


def camera_with(
    mask: str, distance: float, pixel_angle: float, window: int = WINDOW, aperture_mm: float = 2.5
) -> Camera:
    """The paper's lens with pixels that see the view's angle at this focus, and a mask, or none for the
    `THIN_LENS`: as that, it is then without aberrations."""
    profile: Literal["parabolic", "spherical"] = "parabolic" if mask == THIN_LENS else "spherical"
    recipe = CameraRecipe(
        name=f"paper-{mask}",
        lens=PlanoConvexLens(aperture_radius_mm=aperture_mm, surface_profile=profile),
        focus=Focus(distance_m=distance),
        mask=CubicMask(alpha_rad=30.0) if mask == "cubic" else ClearMask(),
        sensor=Sensor(read_noise=0.0),
        psf=PsfSettings(window_px=window),
    )
    pixel = Camera.from_recipe(recipe).sensor_distance * pixel_angle * 1e6
    sensor = recipe.sensor.model_copy(update={"pixel_um": pixel})
    camera = Camera.from_recipe(recipe.model_copy(update={"sensor": sensor}))
    return camera.with_height(smooth_relief()) if mask == "smooth" else camera


def crops_plot(shown: dict[tuple[str, str], dict[str, Tensor]]) -> Plot:
    """For each mask and focus the reference, and for each way the photo with its error below, times ten."""
    columns = 1 + len(WAYS)

    def paint() -> Figure:
        figure = new_figure(1.3 * columns, 2.6 * len(shown))
        grid = figure.subplots(2 * len(shown), columns, squeeze=False)
        for number, ((mask, focus), images) in enumerate(shown.items()):
            truth = images["reference"]
            for column, (name, image) in enumerate(images.items()):
                above, below = grid[2 * number][column], grid[2 * number + 1][column]
                picture_axes(above, below)
                above.imshow(image.clamp(0, 1).pow(1 / 2.2).permute(1, 2, 0).numpy(), interpolation="nearest")
                above.set_title(name if column else f"{mask}, {focus}", fontsize=7)
                if column:
                    error = (0.5 + 10 * (image - truth)).clamp(0, 1)
                    below.imshow(error.permute(1, 2, 0).numpy(), interpolation="nearest")
                    below.set_title(f"{psnr(image, truth):.1f} dB, error x 10", fontsize=6)
                else:
                    below.set_visible(False)
        return figure

    return Plot(paint, "Depth edges composited each way.", "Below each photo its error, times ten.")
