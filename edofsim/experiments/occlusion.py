"""Ways to composite occlusion, judged by two slow references at depth edges of shipped scenes.

One crop a scene, where most of the scene's hard depth edges are; three masks; focus in front of both surfaces
of the edge, between them, and behind both. The paper's camera in the green of its three-colour model alone,
so that the references take minutes; or any camera with its own mask.

The first reference clips pupils by what the view holds: both sides see the same light, and what is compared
is occlusion alone. It is dark where the pupil sees a surface that the view does not have. The second is
Mitsuba's own thin lens: its rays meet every surface of the scene, but it knows no mask and no diffraction.
Two things keep any way from it: it is a mean over random rays, whose noise is known from its two halves; and
the view does not have surfaces that it sees. How much they matter is known by what clipped pupils reach,
which know nothing but the view.

What to expect: `hidden` is exact for two surfaces of which one is in focus. Where both are blurred it
averages coverage and light over the pupil apart, while rays know which go together; that error is a smooth
band along the edge, and goes where sub-apertures are composited one by one. The other ways know the visible
surfaces alone. `over` and `normalised` snap surfaces to layers: many layers of one slanted surface hide each
other, few blur it wrongly. Each is judged with the number of layers that is best for it, case by case.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import torch
import typer
from matplotlib.figure import Figure
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from .. import completion
from ..capture.prepare import channel_weights
from ..core.progress import Progress, part
from ..core.store import keep
from ..optics import Camera
from ..optics.camera import focus_distance
from ..options import CacheOption, Device, DeviceOption, cameras_option
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
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
from ..stability.white_wall import CAMERAS as WHITE_CAMERAS
from ..stability.white_wall import WAYS as WHITE_WAYS
from ..stability.white_wall import by_every_way
from .experiment import Findings, in_parts
from .kept import Kept, key_of
from .occlusion_cameras import (
    THIN_LENS,
    WINDOW,
    TestCameras,
    busiest_edge,
    focus_distances,
    test_cameras,
)
from .occlusion_ways import SNAPPED, WAYS, composites

SCENES = ("desk", "foliage", "bench")
SAMPLES = 64
GREEN = 1
"""Index of the band that is used."""
LENS_SAMPLES = 1024
"""A pixel, of the thin lens and of the view that is judged by it, which has other noise."""
BOUNDS = {"noise_db": "noise of the truth", "view_db": "clipped pupils"}
"""What stands between any way and the thin lens, by the name of its figures."""


@in_parts("scenes", lambda options: SCENES)
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
    camera: Annotated[
        str | None,
        cameras_option("Camera recipe or shipped name, in place of the paper's lens with three masks."),
    ] = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
) -> Findings:
    """Compare depth edges with slow references.

    Each way to composite is compared with pupils clipped ray by ray, over 64 x 64 pixels of a scene: through
    a clear aperture, a cubic and a smooth random mask, or --camera, with focus in front of the edge, between
    its surfaces and behind. The clear aperture is also compared with Mitsuba's thin lens, whose rays meet all
    surfaces.

    The same command resumes interrupted work.

    Figures: psnr_db.SCENE.MASK.FOCUS.{none,over,normalised,hidden,sub_apertures}, {near,far}_dpt.SCENE; MASK
    is the name of a --camera, and also `thin-lens`, a clear aperture without aberrations; `sub_apertures` is
    `hidden` through 4 x 4 of them. layers.SCENE.MASK.FOCUS.{over,normalised}: the number of layers, from 2
    on, with which that way is nearest to the truth, which its PSNR is of. noise_db.SCENE.thin-lens.FOCUS:
    PSNR that the noise of that truth leaves to a perfect photo; view_db.SCENE.thin-lens.FOCUS: PSNR of the
    photo by clipped pupils, which is dark where the view does not have a surface.
    white_percent.CAMERA.{known,guessed}.WAY: how far a white disc before a white wall is from white at the
    worst pixel, by whether the view holds what is behind the disc.
    """
    loaded = [load_scene(scene) for scene in scenes or SCENES]
    cameras = test_cameras(None if camera is None else load_camera(camera))
    kept = Kept(folder / "finished.jsonl")
    figures: dict[str, float] = {}
    outputs: dict[str, Path] = {}
    for number, source in enumerate(loaded):
        scene = source.recipe.name
        tell = part(progress, number / len(loaded), (number + 1) / len(loaded), scene)
        picture = outputs[f"picture of {scene}"] = folder / f"occlusion-{scene}.png"
        source = replace(source, recipe=cameras.framed(source.recipe))
        key = scene_key(source, cameras, str(device))
        found = kept.get(key)
        if found is None or not picture.is_file():
            found = of_scene(source, cameras, folder, cache, str(device), tell)
            kept.put(key, found)
        figures |= found
    columns, rows = table(figures)
    outputs["table"] = write_csv(folder / "occlusion.csv", [column.name for column in columns], rows)
    white = white_figures(cameras, kept)
    shown = [Table(columns, tuple(rows)), white_table(white)]
    return Findings(figures | white, shown=shown, outputs=outputs)


def white_figures(cameras: TestCameras, kept: Kept) -> dict[str, float]:
    """How far a white disc before a white wall is from white, in percent at the worst pixel, through the
    camera at hand, or through those of the hard case."""
    own = cameras.own
    found: dict[str, float] = {}
    for name, make in (WHITE_CAMERAS if own is None else {own.recipe.name: lambda: own}).items():
        camera = make()
        key = key_of(white=camera.key())
        known = kept.get(key)
        if known is None:
            known = {".".join(case): 100 * off for case, off in by_every_way(camera).items()}
            kept.put(key, known)
        found |= {f"white_percent.{name}.{what}": value for what, value in known.items()}
    return found


def white_table(figures: Mapping[str, float]) -> Table:
    """A row a camera and a view, with or without what is behind the disc."""
    ways = tuple(WHITE_WAYS)
    cases = dict.fromkeys(name.rsplit(".", 1)[0] for name in figures)
    rows = tuple(
        (
            case.split(".", 1)[1].rsplit(".", 1)[0],
            case.rsplit(".", 1)[1],
            *(figures[f"{case}.{w}"] for w in ways),
        )
        for case in cases
    )
    columns = (Column("camera"), Column("behind the disc"), *(Column(way, "%", 2) for way in ways))
    said = "A white disc at 0.6 m before a white wall at 3 m: the worst pixel's difference from white."
    return Table(columns, rows, said)


def table(figures: dict[str, float]) -> tuple[tuple[Column, ...], list[tuple[str | float, ...]]]:
    """Columns and rows (scene, mask, focus, PSNR of each way to composite, layers of `SNAPPED`, each of
    `BOUNDS` or NaN) of the figures."""
    columns = (
        *(Column(name) for name in ("scene", "mask", "focus")),
        *(Column(way, "dB", 2) for way in WAYS),
        *(Column(f"layers of {way}", "", 0) for way in SNAPPED),
        *(Column(name, "dB", 1) for name in BOUNDS.values()),
    )
    cases = dict.fromkeys(tuple(name.split(".")[1:4]) for name in figures if name.startswith("psnr_db."))
    rows: list[tuple[str | float, ...]] = []
    for case in cases:
        scores = [figures[".".join(("psnr_db", *case, way))] for way in WAYS]
        counts = [figures[".".join(("layers", *case, way))] for way in SNAPPED]
        bounds = [figures.get(".".join((name, *case)), math.nan) for name in BOUNDS]
        rows.append((*case, *scores, *counts, *bounds))
    return columns, rows


def scene_key(loaded: Loaded[SceneRecipe], cameras: TestCameras, device: str) -> str:
    """A key of everything that decides a scene's figures: the views, the cameras, and the code."""
    views = [view_key(three_bands(loaded, samples), loaded.base) for samples in (SAMPLES, LENS_SAMPLES)]
    angle = loaded.recipe.frame.pixel_angle
    keys = [cameras.at(name, 1.0, angle).key() for name in (*cameras.names, THIN_LENS)]
    return key_of(views=views, cameras=keys, device=device)


def of_scene(
    loaded: Loaded[SceneRecipe],
    cameras: TestCameras,
    folder: Path,
    cache: Path | None,
    device: str,
    say: Progress,
) -> dict[str, float]:
    """Figures of one scene, and its picture."""
    scene = loaded.recipe.name
    recipe = three_bands(loaded, SAMPLES)
    view = render(recipe, loaded.base, cache=cache, device=device, progress=part(say, 0.0, 0.2))
    view = of_band(view, GREEN)
    edge = busiest_edge(view, cameras.gaps(view.pixel_angle))
    model = build_scene(recipe, loaded.base)
    settings = {
        (mask, focus): cameras.at(mask, distance, view.pixel_angle)
        for mask in cameras.names
        for focus, distance in focus_distances(edge).items()
    }
    file = folder / f"occlusion-{scene}.safetensors"
    truths = references(file, view, model, settings, edge.where, device, part(say, 0.2, 0.7))
    say(0.7, "compositing")
    figures = {f"near_dpt.{scene}": edge.near, f"far_dpt.{scene}": edge.far}
    shown: dict[tuple[str, str], dict[str, Tensor]] = {}
    for (mask, focus), truth in zip(settings, truths, strict=True):
        judged = composites(view, edge.where, settings[mask, focus], truth)
        figures |= judged.figures(f"{scene}.{mask}.{focus}")
        shown[mask, focus] = {"reference": judged.truth, **judged.photos}
    smooth, tell = three_bands(loaded, LENS_SAMPLES), part(say, 0.7, 0.75)
    fine = render(smooth, loaded.base, cache=cache, device=device, progress=tell)
    green, depth = of_band(fine, GREEN), recipe.render.max_depth
    lenses = {
        (THIN_LENS, focus): cameras.at(THIN_LENS, distance, view.pixel_angle)
        for focus, distance in focus_distances(edge).items()
    }
    file = folder / f"occlusion-{scene}-{THIN_LENS}.safetensors"
    limits = references(file, green, model, lenses, edge.where, device, part(say, 0.75, 0.95))
    for (setting, camera), limit in zip(lenses.items(), limits, strict=True):
        halves = by_rays(model, fine, GREEN, edge.where, camera, depth, device, part(say, 0.95, 1.0))
        judged = composites(green, edge.where, camera, (halves[0] + halves[1]) / 2)
        case = f"{scene}.{'.'.join(setting)}"
        figures |= judged.figures(case)
        figures[f"noise_db.{case}"] = noise_db(*(half * judged.exposure for half in halves))
        figures[f"view_db.{case}"] = psnr(limit * judged.exposure, judged.truth)
        shown[setting] = {"reference": judged.truth, **judged.photos}
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


def of_band(view: View, band: int) -> View:
    """The view with one of its bands alone."""
    return view.with_light(view.radiance[[band]], view.wavelengths[[band]])


def noise_db(one: Tensor, other: Tensor) -> float:
    """PSNR that the noise of the mean of two images with independent noise leaves.

    one, other: [channel, y, x].
    """
    # the error of the mean is half of their difference
    return psnr(one, other) + 20 * math.log10(2)


def references(
    kept: Path,
    view: View,
    model: SceneModel,
    settings: dict[tuple[str, str], Camera],
    where: Crop,
    device: str,
    progress: Progress,
) -> list[Tensor]:
    """The reference photo of each take, from the file if it holds those of this very view and crop."""
    light = hashlib.sha256(view.radiance.cpu().numpy().tobytes()).hexdigest()
    cameras = {".".join(setting): camera.key() for setting, camera in settings.items()}
    said = key_of(view=light, where=asdict(where), cameras=cameras)
    if kept.is_file():
        with safe_open(kept, "pt") as file:
            if (file.metadata() or {}).get("of") == said:
                return [file.get_tensor(".".join(setting)) for setting in settings]
    truths = clipped_pupils(
        view, model, list(settings.values()), where, window_px=WINDOW, device=device, progress=progress
    )
    photos = {".".join(setting): truth.contiguous() for setting, truth in zip(settings, truths, strict=True)}
    keep(kept, lambda path: save_file(photos, path, {"of": said}))
    return truths


def three_bands(loaded: Loaded[SceneRecipe], samples: int) -> SceneRecipe:
    """The scene at 482, 546.5 and 611 nm: a band for each colour, near those of the paper."""
    bands = loaded.recipe.bands.model_copy(update={"start_nm": 482.0, "stop_nm": 611.0, "count": 3})
    coarse = loaded.recipe.render.model_copy(update={"samples": samples})
    return loaded.recipe.model_copy(update={"bands": bands, "render": coarse})


def crops_plot(shown: dict[tuple[str, str], dict[str, Tensor]]) -> Plot:
    """For each mask and focus the reference, and for each way the photo with its error below, times ten.

    shown: images [channel, y, x] by way, by mask and focus.
    """
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
