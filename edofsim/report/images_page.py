"""Images of a scene on a page: side by side, enlarged, by depth, with their scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from ..core.images import developed
from ..core.threads import in_threads
from ..restore.gains import gains, gains_in_words
from ..restore.scores import Score, TruthNoise, image_psnr
from .crops import DepthRange, Detail, choose_crops, near_focus_far
from .figures import ImageScore, depth_plot, score_plot
from .page import (
    Block,
    Column,
    Compare,
    Gallery,
    Key,
    Keys,
    Notes,
    Page,
    Section,
    SideBySide,
    Table,
    Text,
    Values,
)  # fmt: skip
from .pictures import (
    Box,
    Picture,
    clipped_fraction,
    depth_picture,
    display_gain,
    picture,
    with_boxes,
)
from .words import DASH, decibels, depth_range, distance, number, percent

CROP_PX = 72
LETTERS = "ABC"


@dataclass(frozen=True)
class Shown:
    """Images of one scene, linear, [3, y, x], full scale 1.

    title: name of the scene.
    camera: its name.
    images: by name, in the order in which they are shown: `ideal`, `photo`, and `restored`, `wiener` and
        `lens_alone` where there are such.
    inverse_depth: [y, x] in 1/m; 0 is infinity.
    scores: by image, in the order of the table.
    noises: what scores are without, by image.
    focus_m: distance in focus without a mask.
    colours: [3, 3], matrix to linear sRGB that images are shown by; None: as they are.
    restored_by: what restored.
    """

    title: str
    camera: str
    images: Mapping[str, Tensor]
    inverse_depth: Tensor
    scores: Mapping[str, ImageScore] = field(default_factory=dict)
    noises: Mapping[str, TruthNoise] = field(default_factory=dict)
    focus_m: float | None = None
    colours: Tensor | None = None
    restored_by: str = ""

    @cached_property
    def gain(self) -> float:
        """How many times pictures are brightened."""
        return display_gain(developed(self.images["ideal"], self.colours))

    def label(self, name: str) -> str:
        """What a reader calls an image or a row of the scores."""
        by = f" ({self.restored_by})" if name == "restored" and self.restored_by else ""
        return name.replace("_", " ").capitalize() + by


def image_page(
    shown: Shown,
    purpose: str,
    facts: Mapping[str, str],
    *,
    crops: tuple[Detail, ...] | None = None,
    notes: Sequence[str] = (),
    focus: tuple[Block, ...] = (),
    rest: Sequence[Section] = (),
) -> Page:
    """The page of a scene.

    crops: parts to enlarge, in place of textured ones near, at focus and far.
    notes: what must not be missed.
    focus: blocks on other distances in focus.
    rest: sections behind those of the images.
    """
    chosen = crops is None
    if crops is None:
        ranges = sorted({(d.near_m, d.far_m) for s in shown.scores.values() for d in s.by_depth})
        wanted = near_focus_far(shown.inverse_depth, [DepthRange(*r) for r in ranges], shown.focus_m)
        crops = choose_crops(shown.inverse_depth, shown.images["ideal"], CROP_PX, wanted)
    sections = [
        Section("Images", _images(shown, crops)),
        Section("Focus", focus),
        Section("Near and far" if len(crops) > 1 else "Enlarged", _crops(shown, crops, chosen)),
        Section("Depth and scores", _depth(shown)),
        *rest,
    ]
    rows, columns = shown.inverse_depth.shape
    return Page(
        title=shown.title,
        purpose=purpose,
        facts={"Camera": shown.camera, "Size": f"{columns} × {rows} px", **facts},
        head=_head(shown, notes),
        sections=tuple(section for section in sections if section.blocks),
    )


def verdict(scores: Mapping[str, ImageScore]) -> str:
    """What restoring gained, in one sentence; empty without a score of the restored image."""
    return gains_in_words(gains({name: score.whole.psnr_db for name, score in scores.items()}))


def _pictures(shown: Shown) -> dict[str, Picture]:
    what = {
        "ideal": "all in focus, without noise",
        "photo": f"as the sensor of {shown.camera} records it",
        "restored": "computed from the photo",
        "wiener": "computed from the same photo by Wiener deconvolution",
        "lens_alone": "through the lens without a mask",
    }
    images = shown.images

    def one(name: str) -> Picture:
        label = shown.label(name)
        score = shown.scores.get(name)
        note = decibels(score.whole.psnr_db) if score else ""
        said = f"{label}: {shown.title}, {what[name]}."
        return picture(images[name], label, said, gain=shown.gain, note=note, colours=shown.colours)

    return dict(zip(images, in_threads(one, list(images), torch.device("cpu")), strict=True))


def _images(shown: Shown, crops: tuple[Detail, ...]) -> tuple[Block, ...]:
    width = shown.inverse_depth.shape[-1]
    boxes = tuple(Box(c.x, c.y, c.size, c.size, LETTERS[i]) for i, c in enumerate(crops))
    pictures = _pictures(shown)
    framed = {**pictures, "ideal": with_boxes(pictures["ideal"], boxes, width)}
    how = "The sensor's own colours (raw)"
    if shown.colours is not None:
        how = "White-balanced to the scene's light and converted to sRGB by a 3 × 3 matrix"
    gain = shown.gain
    exposure = "as exposed" if gain == 1 else f"brightened {gain:g} times for display"
    white = ", ".join(
        f"{shown.label(name)} {percent(clipped_fraction(developed(image, shown.colours), gain))}"
        for name, image in shown.images.items()
    )
    caption = (
        f"{how}; {exposure}, alike for all images. Values brighter than the screen's white: {white}. "
        + ("The frames in the ideal image mark the parts enlarged below." if crops else "")
    )
    right = "restored" if "restored" in shown.images else "ideal"
    return (
        Compare("images-all", shown.label("photo"), shown.label(right),
                "Drag the divider, or move it with the arrow keys; choose any two images above."),
        Gallery(tuple(framed.values()), caption, columns=2, name="images-all",
                values=_values(shown)),
    )  # fmt: skip


def _values(shown: Shown) -> Values:
    """What the pointer reads: the sensor's values, whatever colours are shown."""
    depth = depth_picture(shown.inverse_depth)
    if shown.colours is None:
        return Values(shown.gain, *depth)
    inverse = torch.linalg.inv(shown.colours).flatten().tolist()
    return Values(shown.gain, *depth, to_sensor=tuple(round(value, 6) for value in inverse))


def _crops(shown: Shown, crops: tuple[Detail, ...], chosen: bool) -> tuple[Block, ...]:
    galleries = []
    images = shown.images
    for i, crop in enumerate(crops):
        truth = crop.cut(shown.images["ideal"])
        pictures = []
        for name, image in images.items():
            part = crop.cut(image)
            noise = crop.cut_noise(shown.noises.get(name, "none"))
            note = "" if name == "ideal" else decibels(image_psnr(part, truth, noise=noise))
            alt = f"{shown.label(name)}, enlarged part {LETTERS[i]} at {distance(crop.depth_m)}."
            how = {"gain": shown.gain, "note": note, "colours": shown.colours}
            pictures.append(picture(part, shown.label(name), alt, **how))
        title = f"{LETTERS[i]} · {crop.range.name}: {_around(crop)}"
        caption = (
            f"Pixels {crop.x} to {crop.x + crop.size - 1} across, {crop.y} to {crop.y + crop.size - 1} down."
        )
        galleries.append(Gallery(tuple(pictures), caption, len(pictures), pixels=True, title=title))
    what = "The most textured square"
    if not chosen:
        what = "Parts of the objects"
    elif len(crops) > 1:
        what += "s at the nearest depths, around focus and at the farthest depths"
    note = Text(f"{what}, enlarged without smoothing; PSNR of the square itself.")
    return (note, *galleries) if galleries else ()


def _around(crop: Detail) -> str:
    return f"about {distance(crop.depth_m)}" if math.isfinite(crop.depth_m) else "infinity"


def _depth(shown: Shown) -> tuple[Block, ...]:
    plots: list[Block] = [depth_plot(shown.inverse_depth, shown.focus_m)]
    labels = {name: shown.label(name) for name in shown.scores}
    ranges = sorted({(d.near_m, d.far_m) for s in shown.scores.values() for d in s.by_depth})
    if ranges:
        finite = shown.inverse_depth[torch.isfinite(shown.inverse_depth)]
        nearest = 1 / float(finite.max()) if finite.numel() and float(finite.max()) > 0 else 0.0
        plots.append(score_plot(shown.scores, labels, shown.focus_m, nearest))
    table = _score_table(shown, ranges)
    return (SideBySide(tuple(plots)), *((table,) if table else ()))


def _score_table(shown: Shown, ranges: list[tuple[float, float]]) -> Table | None:
    if not shown.scores:
        return None
    names = list(shown.scores)
    pixels = shown.inverse_depth.numel()

    def row(title: str, found: Sequence[Score | None]) -> tuple[str, ...]:
        count = next((s.pixels for s in found if s is not None), 0)
        share = percent(count / pixels)
        cells = (f"{number(s.psnr_db)}\n{number(s.ssim, 3)}" if s is not None else DASH for s in found)
        return (f"{title}\n{share}", *cells)

    rows = [row("Whole image", [shown.scores[n].whole for n in names])]
    by_range = {n: {(d.near_m, d.far_m): d.score for d in shown.scores[n].by_depth} for n in names}
    rows += [row(depth_range(*r), [by_range[n].get(r) for n in names]) for r in ranges]
    return Table(
        columns=(Column("Depth"), *(Column(shown.label(n)) for n in names)),
        rows=tuple(rows),
        caption="Against the ideal image, both clipped to full scale 1: PSNR in dB, below it SSIM. Below "
        "each range, its part of the pixels.",
    )


def _head(shown: Shown, said: Sequence[str]) -> tuple[Block, ...]:
    """Scores of the whole images, the verdict, and what must not be missed."""
    keys = tuple(
        Key(
            shown.label(name),
            number(score.whole.psnr_db),
            "dB",
            f"{_uncertain(score.whole)}SSIM {number(score.whole.ssim, 3)}",
            strong=name == "restored",
        )
        for name, score in shown.scores.items()
    )
    sentence = verdict(shown.scores)
    notes = (*said, *_broken(shown))
    return (
        *((Keys(keys),) if keys else ()),
        *((Text(sentence),) if sentence else ()),
        *((Notes(notes),) if notes else ()),
    )


def _uncertain(score: Score) -> str:
    """The standard error of a PSNR, where it has one that two decimals show."""
    return f"± {number(score.psnr_db_se, 2)} dB, " if score.psnr_db_se >= 0.005 else ""


def _broken(shown: Shown) -> list[str]:
    """Values that are no numbers are shown, and said."""
    found = []
    for name, image in shown.images.items():
        count = int((~torch.isfinite(image)).any(0).sum())
        if count:
            found.append(
                f"{shown.label(name)}: {count} pixels hold values that are not numbers; shown in magenta."
            )
    return found
