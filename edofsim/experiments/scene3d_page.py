"""Pages of the deep scenes: one a scene and network, and one over all of them."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from PIL import Image

from ..core.images import developed, srgb_decode
from ..core.words import counted
from ..report.crops import Detail
from ..report.figures import ImageScore, score_plot
from ..report.images_page import Shown, image_page
from ..report.page import (
    Block,
    Code,
    Gallery,
    Key,
    Keys,
    Link,
    Links,
    Notes,
    Page,
    Section,
    Text,
)
from ..report.pictures import Picture, display_gain, picture
from ..report.words import decibels, distance, number, percent
from ..restore.scores import DepthScore
from .protocols import LENS_ALONE, OURS, PAPER, PAPER_DB, Capture, System
from .scene3d_tables import all_edges_table, average, edges_table, mean_of, mean_row, scores_table, ways_table
from .scene_scores import Measured, SceneScore, SceneScores, mean, worst

if TYPE_CHECKING:
    from .scene3d import Seen

IMAGES = ("photo", "restored", "wiener")
LABELS = {"photo": "Photo", "restored": "Restored", "wiener": "Wiener", LENS_ALONE: "Lens alone"}

ABOUT = (
    "Ours: linear light of all bands; each surface that a pixel sees has its own depth; surfaces behind "
    "edges are rendered and composited front to back, through 4 x 4 sub-apertures or as many as "
    "diffraction lets be distinguished. The paper's: a picture with one depth a pixel in steps of 1 mm, its "
    "8-bit sRGB values taken for the intensities of 611, 543 and 482 nm, each depth's part "
    "convolved with the PSF at that depth, nothing hiding anything. The ways between change one thing at a "
    "time. All masks have the height error that the paper tests with, 30 nm."
)
SCALE = (
    "Intensity scale: the exposure puts the 99.5th percentile of the all-in-focus image at 0.9 of full "
    "scale; PSNR is for full scale 1, with truth and images clipped to it. A picture half as bright scores "
    "6 dB more for the same relative error. Linear light is darker than its sRGB values, so its scores "
    "compare with each other but not with the paper's figure; those by the paper's protocol do."
)


def scene_page(
    measured: Measured,
    seen: Seen,
    system: System,
    back: Link | None = None,
    crops: tuple[Detail, ...] | None = None,
) -> Page:
    """One scene through the mask of one network: images and scores by our way, then every way to simulate.

    crops: parts to enlarge, in place of textured ones near, at focus and far.
    """
    ours, alone = seen.taken[OURS, system.name], seen.taken[OURS, seen.lens.alone.name]
    view, recipe = seen.view, seen.scene.recipe
    images = {name: ours.images[name] for name in IMAGES} | {LENS_ALONE: alone.images["photo"]}
    shown = Shown(
        title=recipe.name,
        camera=f"{seen.lens.name}, mask of {system.name}",
        images={"ideal": ours.truth, **{name: image.clamp(0, 1) for name, image in images.items()}},
        inverse_depth=view.crop_margin(view.mean_inverse_depth()),
        scores=_image_scores([measured], system.name),
        focus_m=system.camera.recipe.focus.distance_m,
        colours=ours.photo.colours,
        restored_by=system.name,
    )
    ways = Section(
        "Ways to simulate",
        (
            Text(ABOUT),
            ways_table([measured], system.name),
            *edges_table(measured, system.name),
            _paper_gallery(seen, system),
        ),
    )
    recipes = {seen.scene.path.name: seen.scene.text, **seen.lens.recipes}
    again = Section("Reproduce", tuple(Code(text, title) for title, text in recipes.items()))
    facts = _facts(measured, system.name)
    return replace(image_page(shown, recipe.purpose, facts, crops=crops, rest=(ways, again)), back=back)


def overview_page(outcome: SceneScores, networks: Sequence[str], links: Sequence[Link]) -> Page:
    """All scenes: scores, what a cheaper simulation would have concluded, scores by depth and near edges."""
    head: list[Block] = [Keys(tuple(key for network in networks for key in _keys(outcome, network)))]
    if outcome.problems:
        head.append(Notes(("Left out of what follows:", *outcome.problems)))
    sections: list[Section] = []
    for network in networks:
        of = f" ({network})" if len(networks) > 1 else ""
        every = outcome.measured
        sections += [
            Section(f"Scores{of}", (scores_table(every, network), Text(SCALE))),
            Section(f"Ways to simulate{of}", (Text(ABOUT), ways_table(every, network))),
            Section(f"By depth{of}", (_depth_plot(every, network),)),
            Section(f"Depth edges{of}", (all_edges_table(every, network),)),
        ]
    sections.append(Section("Scenes", (Links(tuple(links)),)))
    return Page(
        "Deep scenes",
        "Scenes from half a metre to infinity, through the lens alone and through a learned mask and its "
        "network: what is gained, where, and how much of that depends on how the photo was simulated.",
        tuple(sections) if outcome.measured else (),
        tuple(head),
    )


def strip(truth: torch.Tensor, alone: Capture, restored: torch.Tensor, name: str) -> Picture:
    """Truth, lens alone and restored side by side, small, for a card.

    truth, restored: [3, y, x].
    """
    colours = alone.photo.colours
    gain = display_gain(developed(truth, colours))
    images = [truth, alone.images["photo"].clamp(0, 1), restored.clamp(0, 1)]
    side = max(1, truth.shape[-1] // 170)
    small = [torch.nn.functional.avg_pool2d(each.cpu().float()[None], side)[0] for each in images]
    return picture(
        torch.cat(small, -1),
        name,
        f"{name}: all in focus, through the lens alone, and restored.",
        gain=gain,
        colours=colours,
    )


def cards(every: Sequence[Measured], networks: Sequence[str], folder: Path) -> list[Link]:
    """Cards of all scenes and networks that were measured, whose pages and pictures are in a folder."""
    found = []
    for m in every:
        for name in (name for name in networks if name not in m.problems):
            title = m.scene if len(networks) == 1 else f"{m.scene}, {name}"
            picture = folder / "scenes" / f"{m.scene}.png"
            found.append(card(m, name, f"scenes/{m.scene}-{name}.html", title, picture))
    return found


def card(measured: Measured, network: str, href: str, title: str, png: Path) -> Link:
    """A card that leads to a scene's page.

    png: the file with its `strip`, left out where it is missing.
    """
    restored, gain = mean_of([measured], OURS, network, "restored"), measured.gain(OURS, network)
    side = "above" if gain >= 0 else "below"
    text = f"{decibels(restored)} restored, {decibels(abs(gain))} {side} the lens alone"
    if not png.is_file():
        return Link(href, title, text)
    content = png.read_bytes()
    width, height = Image.open(io.BytesIO(content)).size
    alt = f"{measured.scene}: all in focus, through the lens alone, and restored."
    return Link(href, title, text, Picture(content, width, height, title, alt))


def _keys(outcome: SceneScores, network: str) -> list[Key]:
    every = outcome.measured
    low = worst(outcome, network)
    keys = [
        Key(f"Restored by {network}, mean", number(mean_of(every, OURS, network, "restored")), "dB",
            f"{counted(len(every), 'scene')}, ours", strong=True),
        Key("By the paper's protocol, mean", number(mean_of(every, PAPER, network, "restored")), "dB",
            f"the paper on its one scene: {PAPER_DB}"),
        Key("Above the lens alone, mean", number(mean(m.gain(OURS, network) for m in every)), "dB", "ours"),
    ]  # fmt: skip
    if low is not None:
        worst_db = mean_of([low], OURS, network, "restored")
        keys.append(Key("Worst scene", number(worst_db), "dB", low.scene))
    return keys


def _depth_plot(every: Sequence[Measured], network: str) -> Block:
    plot = score_plot(_image_scores(every, network), {**LABELS, "restored": f"Restored ({network})"})
    caption = (
        "Mean PSNR over the scenes that hold each depth range (bars), by our way; lines guide the eye. A "
        "camera of extended depth of field shows a level line."
    )
    return replace(plot, caption=caption)


def _image_scores(every: Sequence[Measured], network: str) -> dict[str, ImageScore]:
    """Scores by our way as the page of a run has them; means over several scenes."""
    found = {}
    for name in ("photo", "restored", "wiener", LENS_ALONE):
        whole = mean_row(every, OURS, network, name)
        ranges: dict[tuple[float, float], list[SceneScore]] = {}
        for m in every:
            place = (m.lens(network), "photo") if name == LENS_ALONE else (network, name)
            for row in m.rows:
                if (row.way, row.system, row.image, row.region) == (OURS, *place, "depth"):
                    ranges.setdefault((row.near_m, row.far_m), []).append(row)
        parts = tuple(DepthScore(*limits, average(ranges[limits])) for limits in sorted(ranges))
        if whole is not None:
            found[name] = ImageScore(whole, parts)
    return found


def _paper_gallery(seen: Seen, system: System) -> Gallery:
    """What the paper's protocol makes of the scene, its values shown as they are, without another curve."""
    taken, alone = seen.taken[PAPER, system.name], seen.taken[PAPER, seen.lens.alone.name]
    shown = {"Truth": taken.truth, "Lens alone": alone.images["photo"]}
    shown |= {LABELS[name]: taken.images[name] for name in IMAGES}
    pictures = tuple(
        _encoded_picture(image, label, f"{label} of {seen.scene.recipe.name} by the paper's protocol.")
        for label, image in shown.items()
    )
    return Gallery(
        pictures,
        "8-bit values as light: they are shown as they are, so the pictures look as the photograph would.",
        columns=3,
        title="By the paper's protocol",
    )


def _encoded_picture(image: torch.Tensor, label: str, alt: str) -> Picture:
    """A picture of values that are sRGB already."""
    return picture(srgb_decode(image.clamp(0, 1)), label, alt)


def _facts(measured: Measured, system: str) -> dict[str, str]:
    facts = measured.facts_of(system)
    farthest = facts["farthest_m"] if facts["farthest_m"] < 1e8 else math.inf
    noise = decibels(facts["noise_db"]) if math.isfinite(facts["noise_db"]) else "none"
    return {
        "Depths": f"{distance(facts['nearest_m'])} to {distance(farthest)}",
        "Bands": number(facts["bands"], 0),
        "Mean level": number(facts["mean"], 2),
        "Beyond full scale": percent(facts["clipped"]),
        "Near depth edges": percent(facts["edges"]),
        "Render noise": noise,
    }
