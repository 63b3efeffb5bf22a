"""The paper's bench, a bus at 0.5 m and a car at 1.3 m: lens alone, the mask as designed, the mask as made.

Akpinar et al., section "Experimental Results": a real photo with the DOE and one without it, the lens focused
at 1.3 m in the green. Here the scene is built and rendered, so that there is a truth to score against; the
mask as made has their device's errors: 98 levels, heights off by 44 nm on average, 49.5 nm of scatter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..capture import save_image
from ..capture.framing import framed
from ..core.images import developed
from ..core.progress import Progress, part
from ..errors import InputError
from ..optics import Camera
from ..options import CacheOption, CameraOption, NetworksOption, QuickOption, SeedOption
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
from ..recipe.fabrication import Fabrication
from ..record import writable_folder
from ..render import render
from ..render.view import View
from ..report import (
    Column,
    DepthRange,
    Detail,
    Gallery,
    Page,
    Section,
    Table,
    Text,
    choose_crops,
    picture,
    write_page,
)
from ..report.page import Block
from ..report.pictures import display_gain
from ..report.words import DASH, number
from ..scene import build_scene
from . import scene3d
from .experiment import Findings, in_paper
from .failures import Failures
from .kept import Kept
from .protocols import LENS_ALONE, OURS, PAPER, WAYS, System, lenses_of
from .scene3d import Seen
from .scene3d_page import scene_page
from .scene_scores import WHOLE, Measured, SceneScores, write_table
from .systems import fabrication_seed

SCENE = "bench"
OBJECTS = ("bus", "car")
MADE = "made"

ZOOM_PX = 96
SETUP = (
    "The paper photographed a bus at 0.5 m and a car at 1.3 m on a bench, with its DOE and without, the lens "
    "focused at 1.3 m in the green. This scene is built and rendered to be such a bench, so that there is a "
    "truth to score against, which the paper's photos do not have."
)
MAKING = (
    "The mask as made has the errors that the paper measured on its device: a surface of 3 um pitch, 98 "
    "levels over 1.2 um, heights off by 44 nm on average with 49.5 nm of scatter."
)


@in_paper(lambda paper: {"quick": not paper.full, "seed": paper.seed, "cache": paper.cache})
def run(
    folder: Path,
    progress: Progress,
    networks: NetworksOption = None,
    camera: CameraOption = None,
    quick: QuickOption = False,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Restore the paper's bench scene.

    A bus at 0.5 m and a car at 1.3 m: lens alone, photo and restored, with the mask as designed and as the
    paper's device was made (paper, Fig. 14). --quick leaves the made mask out, whose PSFs
    take minutes.

    Figures: {psnr_db,ssim}.WAY.{lens_alone,NETWORK,NETWORK.photo,NETWORK.wiener}, each also with .bus and
    .car; NETWORK-made with the mask as made; WAY: paper, sub_apertures (ours).
    """
    sources, failures = scene3d.sources_of(networks)
    names = [source.name for source in sources]
    pictures = writable_folder(folder / "scenes")
    files = {name: folder / f"bench-scene{'' if len(names) == 1 else f'-{name}'}.html" for name in names}
    scene = load_scene(SCENE)
    camera_recipe = load_camera(camera or scene.recipe.camera, None if camera else scene.base)
    recipe = scene3d.scored_version(scene.recipe, quick=quick)
    kept = Kept(folder / "finished.jsonl")
    lenses, wrong = lenses_of(camera_recipe, sources)
    failures.found |= wrong.found
    failures.check(0)
    if len(lenses) > 1:
        raise InputError(f"{', '.join(names)}: not all of one lens; evaluate them one by one, in two --out")
    recipe = framed(recipe, lenses[0].alone.camera)
    key = scene3d.key_of([recipe], scene.base, lenses, sources, seed)
    measured = scene3d.remembered(kept, key)
    if measured is None:
        view = render(recipe, scene.base, cache=cache, progress=part(progress, 0.0, 0.4))
        lens = lenses[0]
        if not quick:
            made = tuple(as_made(system, seed) for system in lens.systems)
            lens = replace(lens, systems=(*lens.systems, *made))
        parts = object_pixels(scene, view)
        ways, rest = (WAYS[0], WAYS[-1]), part(progress, 0.4, 1.0)
        measured, taken, edges = scene3d.measure(
            SCENE, view, lens.every, ways=ways, parts=parts, seed=seed, progress=rest
        )
        Failures(dict(measured.problems)).check(0)
        seen = Seen(scene, lens, view, taken, edges)
        for system in lens.every:
            ours = taken[OURS, system.name]
            for image, values in ours.images.items():
                save_image(pictures / f"{system.name}-{image}.png", values, ours.photo.colours)
            if system.name in files:
                write_page(files[system.name], page(measured, seen, system, parts))
        alone = taken[OURS, LENS_ALONE]
        save_image(pictures / "ideal.png", alone.truth, alone.photo.colours)
        kept.put(key, asdict(measured))
    outputs = {"scores": write_table(folder / "bench-scene.csv", SceneScores((measured,)))}
    outputs |= {"pictures": pictures, **{f"page of {name}": path for name, path in files.items()}}
    shown = [scores_table(measured, name) for name in names]
    return Findings(figures(measured), shown=shown, outputs=outputs, inputs={"networks": names})


def as_made(system: System, seed: int = 0) -> System:
    """The system with its mask as the paper's device was made."""
    fabrication = Fabrication(preset="paper-device", seed=fabrication_seed(seed))
    recipe = system.camera.recipe.model_copy(update={"fabrication": fabrication})
    camera = Camera.from_recipe(recipe, system.camera.base)
    return replace(system, name=f"{system.name}-{MADE}", camera=camera, designed=system.camera)


def object_pixels(scene: Loaded[SceneRecipe], view: View) -> dict[str, Tensor]:
    """Where each of `OBJECTS` is seen in the frame, bool [y, x]: inside the outline's box, at its depths."""
    model = build_scene(scene.recipe, scene.base)
    depth = view.crop_margin(view.mean_inverse_depth())
    found = {}
    for name in OBJECTS:
        own = [thing.mesh.vertices for thing in model.objects if thing.name.split("/")[0] == name]
        vertices = np.concatenate(own).astype(np.float64)
        x, y = vertices[:, 0] / vertices[:, 2], vertices[:, 1] / vertices[:, 2]
        columns = x / view.pixel_angle + view.width / 2
        rows = view.height / 2 - y / view.pixel_angle
        mask = torch.zeros(view.height, view.width, dtype=torch.bool)
        mask[_span(rows, view.height), _span(columns, view.width)] = True
        near, far = vertices[:, 2].min(), vertices[:, 2].max()
        found[name] = mask & (depth <= 1 / near * 1.001) & (depth >= 1 / far * 0.999)
    return found


def _span(values: np.ndarray, size: int) -> slice:
    return slice(int(np.clip(values.min(), 0, size)), int(np.clip(np.ceil(values.max()), 0, size)))


def figures(measured: Measured) -> dict[str, float]:
    """Flat: psnr_db and ssim .WAY.IMAGE, and .WAY.IMAGE.OBJECT; IMAGE as in `scene3d.figures`, the mask as
    made called NETWORK-made; WAY is `paper` or `sub_apertures` (ours)."""
    found = {}
    for row in measured.rows:
        if row.region not in (WHOLE, *OBJECTS):
            continue
        image = row.system if row.image == "restored" else f"{row.system}.{row.image}"
        image = row.system if row.system == LENS_ALONE else image
        where = "" if row.region == WHOLE else f".{row.region}"
        found[f"psnr_db.{row.way}.{image}{where}"] = row.psnr_db
        found[f"ssim.{row.way}.{image}{where}"] = row.ssim
    return found


def page(measured: Measured, seen: Seen, system: System, parts: Mapping[str, Tensor]) -> Page:
    """The bench through one network's mask.

    parts: pixels of each object, bool [y, x].
    """
    crops = object_crops(seen, parts)
    whole = scene_page(measured, seen, system, crops=crops)
    said = Text(_reading(measured, system.name))
    first = Section("Two depths", (Text(SETUP), scores_table(measured, system.name), said))
    sections = [first, *whole.sections]
    if (OURS, f"{system.name}-{MADE}") in seen.taken:
        sections.insert(-1, Section("The mask as made", _made(seen, system, crops)))
    return replace(whole, title="The paper's bench", sections=tuple(sections))


def object_crops(seen: Seen, parts: Mapping[str, Tensor]) -> tuple[Detail, ...]:
    """The most textured square of each object that the frame shows.

    parts: masks [y, x], bool, by object.
    """
    truth = seen.taken[OURS, LENS_ALONE].truth
    depth = seen.view.crop_margin(seen.view.mean_inverse_depth())
    crops: list[Detail] = []
    for name, mask in parts.items():
        if mask.any():
            own = depth[mask]
            span = DepthRange(1 / float(own.max()), 1 / float(own.min()), name.capitalize())
            crops += choose_crops(torch.where(mask, depth, math.nan), truth, ZOOM_PX, [span])
    return tuple(crops)


def scores_table(measured: Measured, network: str) -> Table:
    """A row an image; whole, bus and car, by our way and by the paper's."""
    images = [("Lens alone", LENS_ALONE, "photo")]
    for name, system in ((network, network), (f"{network}, mask as made", f"{network}-{MADE}")):
        if measured.score(OURS, system, "photo") is not None:
            images += [(f"Photo, {name}", system, "photo"), (f"Wiener, {name}", system, "wiener")]
            images += [(f"Restored, {name}", system, "restored")]
    columns = [Column("Image")]
    places = []
    for way, title in ((OURS, "ours"), (PAPER, "the paper's")):
        for region in (WHOLE, *OBJECTS):
            columns.append(Column(f"{region.capitalize()}, {title}"))
            places.append((way, region))
    rows = []
    for label, system, image in images:
        found = [measured.score(way, system, image, region) for way, region in places]
        rows.append(
            (label, *(DASH if r is None else f"{number(r.psnr_db)}\n{number(r.ssim, 3)}" for r in found))
        )
    return Table(
        tuple(columns),
        tuple(rows),
        "PSNR in dB, below it SSIM, of the whole picture and of each object's pixels; the photo simulated by "
        "our way and by the paper's protocol.",
    )


def _reading(measured: Measured, network: str) -> str:
    """What the mask gains on each object, in a sentence."""
    gains = {name: measured.gain(OURS, network, name) for name in OBJECTS}
    said = [f"{number(gain)} dB on the {name}" for name, gain in gains.items() if math.isfinite(gain)]
    return f"Restored above the lens alone: {' and '.join(said)}." if said else ""


def _made(seen: Seen, system: System, crops: tuple[Detail, ...]) -> tuple[Block, ...]:
    """Restored with the mask as designed and as made, whole and enlarged."""
    designed = seen.taken[OURS, system.name]
    made = seen.taken[OURS, f"{system.name}-{MADE}"]
    colours = designed.photo.colours
    gain = display_gain(developed(designed.truth, colours))
    images = {
        "Restored, as designed": designed.images["restored"],
        "Restored, as made": made.images["restored"],
        "Photo, as made": made.images["photo"].clamp(0, 1),
    }
    blocks: list[Block] = [Text(MAKING)]
    whole = tuple(
        picture(image, label, f"{label}: the bench.", gain=gain, colours=colours)
        for label, image in images.items()
    )
    blocks.append(Gallery(whole, "All by our way to simulate, with the same exposure.", columns=3))
    for crop in crops:
        pictures = tuple(
            picture(
                crop.cut(image),
                label,
                f"{label}: the {crop.range.name.lower()}, enlarged.",
                gain=gain,
                colours=colours,
            )
            for label, image in images.items()
        )
        blocks.append(Gallery(pictures, columns=3, pixels=True, title=crop.range.name))
    return tuple(blocks)
