"""The page of the paper's bench: a bus and a car, with and without the mask, as designed and as made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from ..experiments.bench_scene import MADE, OBJECTS
from ..experiments.protocols import LENS_ALONE, OURS, PAPER, System
from ..experiments.scene3d import WHOLE, Measured, Seen
from .crops import Crop, choose_crops
from .model import DepthRange
from .page import Block, Column, Gallery, Page, Section, Table, Text, write_page
from .pictures import display_gain, picture
from .scene3d_page import scene_page
from .words import DASH, number

__all__ = ["bench_scene_page", "object_crops", "write_page"]

ZOOM_PX = 96
SETUP = (
    "The paper photographed a bus at 0.5 m and a car at 1.3 m on a bench, with its DOE and without, the lens "
    "focused at 1.3 m in the green. This scene is built and rendered to be such a bench, so that there is a "
    "truth to score against, which the paper's photos lack."
)
MAKING = (
    "The mask as made has the errors that the paper measured on its device: a surface of 3 um pitch, 98 "
    "levels over 1.2 um, heights off by 44 nm on average with 49.5 nm of scatter."
)


def bench_scene_page(measured: Measured, seen: Seen, system: System, parts: Mapping[str, Tensor]) -> Page:
    """The bench through one network's mask. parts: pixels of each object, bool [y, x]."""
    crops = object_crops(seen, parts)
    page = scene_page(measured, seen, system, crops=crops)
    first = Section(
        "Two depths", (Text(SETUP), _table(measured, system.name), Text(_reading(measured, system.name)))
    )
    sections = [first, *page.sections]
    if (OURS, f"{system.name}-{MADE}") in seen.taken:
        sections.insert(-1, Section("The mask as made", _made(seen, system, crops)))
    return replace(page, title="The paper's bench", sections=tuple(sections))


def object_crops(seen: Seen, parts: Mapping[str, Tensor]) -> tuple[Crop, ...]:
    """The most textured square of each object that the frame shows."""
    truth = seen.taken[OURS, LENS_ALONE].truth
    depth = seen.view.crop_margin(seen.view.mean_inverse_depth())
    crops: list[Crop] = []
    for name, mask in parts.items():
        if mask.any():
            own = depth[mask]
            span = DepthRange(1 / float(own.max()), 1 / float(own.min()), name.capitalize())
            crops += choose_crops(torch.where(mask, depth, math.nan), truth, ZOOM_PX, [span])
    return tuple(crops)


def _table(measured: Measured, network: str) -> Table:
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


def _made(seen: Seen, system: System, crops: tuple[Crop, ...]) -> tuple[Block, ...]:
    """Restored with the mask as designed and as made, whole and enlarged."""
    designed = seen.taken[OURS, system.name]
    made = seen.taken[OURS, f"{system.name}-{MADE}"]
    gain = display_gain(designed.truth)
    images = {
        "Restored, as designed": designed.images["restored"],
        "Restored, as made": made.images["restored"],
        "Photo, as made": made.images["photo"].clamp(0, 1),
    }
    blocks: list[Block] = [Text(MAKING)]
    whole = tuple(picture(image, label, f"{label}: the bench.", gain=gain) for label, image in images.items())
    blocks.append(Gallery(whole, "All by our way to simulate, with the same exposure.", columns=3))
    for crop in crops:
        pictures = tuple(
            picture(crop.cut(image), label, f"{label}: the {crop.range.name.lower()}, enlarged.", gain=gain)
            for label, image in images.items()
        )
        blocks.append(Gallery(pictures, columns=3, pixels=True, title=crop.range.name))
    return tuple(blocks)
