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
    Column,
    Gallery,
    Key,
    Keys,
    Link,
    Links,
    Notes,
    Page,
    Section,
    Table,
    Text,
)
from ..report.pictures import Picture, display_gain, picture
from ..report.words import DASH, decibels, distance, number, percent
from ..restore.scores import DepthScore, Score
from .protocols import LENS_ALONE, OURS, PAPER, PAPER_DB, WAYS, Capture, System, Way
from .scene_scores import AWAY, NEAR_EDGES, WHOLE, Measured, SceneScore, SceneScores, mean, worst

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
            *_edges_table(measured, system.name),
            _paper_gallery(seen, system),
        ),
    )
    recipes = {seen.scene.path.name: seen.scene.text, **seen.lens.recipes}
    again = Section("Reproduce", tuple(Code(text, title) for title, text in recipes.items()))
    facts = _facts(measured, system.name)
    return replace(image_page(shown, recipe.purpose, facts, crops=crops, rest=(ways, again)), back=back)


def overview_page(
    outcome: SceneScores, networks: Sequence[str], links: Sequence[Link], command: str = ""
) -> Page:
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
            Section(f"Depth edges{of}", (_all_edges_table(every, network),)),
        ]
    sections.append(Section("Scenes", (Links(tuple(links)),)))
    return Page(
        "Deep scenes",
        "Scenes from half a metre to infinity, through the lens alone and through a learned mask and its "
        "network: what is gained, where, and how much of that depends on how the photo was simulated.",
        tuple(sections) if outcome.measured else (),
        tuple(head),
        {"Scenes": str(len(outcome.measured)), "Repeat": command} if command else {},
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


def card(measured: Measured, network: str, href: str, title: str, png: Path) -> Link:
    """A card that leads to a scene's page.

    png: the file with its `strip`, left out where it is missing.
    """
    restored, gain = _mean([measured], OURS, network, "restored"), measured.gain(OURS, network)
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
        Key(f"Restored by {network}, mean", number(_mean(every, OURS, network, "restored")), "dB",
            f"{counted(len(every), 'scene')}, ours", strong=True),
        Key("By the paper's protocol, mean", number(_mean(every, PAPER, network, "restored")), "dB",
            f"the paper on its one scene: {PAPER_DB}"),
        Key("Above the lens alone, mean", number(mean(m.gain(OURS, network) for m in every)), "dB", "ours"),
    ]  # fmt: skip
    if low is not None:
        worst_db = _mean([low], OURS, network, "restored")
        keys.append(Key("Worst scene", number(worst_db), "dB", low.scene))
    return keys


def scores_table(every: Sequence[Measured], network: str) -> Table:
    """A row a scene, and the mean."""
    wanted = [
        (OURS, network, LENS_ALONE),
        (OURS, network, "photo"),
        (OURS, network, "wiener"),
        (OURS, network, "restored"),
        (PAPER, network, LENS_ALONE),
        (PAPER, network, "restored"),
    ]
    names = ("Scene", "Lens alone", "Photo", "Wiener", "Restored")
    names += ("Gain over lens alone", "Gain over photo", "Gain over Wiener")
    names += ("Lens alone, paper's", "Restored, paper's", "Light error", "Mean level", "Render noise")
    columns = [Column(name) for name in (*names, "Layers against twice")]
    rivals = (LENS_ALONE, "photo", "wiener")

    def line(
        name: str, cells: Sequence[SceneScore | Score | None], gains: Sequence[float], facts: Sequence[float]
    ) -> tuple[str, ...]:
        light, level, noise, layers = facts
        shown = [DASH if c is None else f"{number(c.psnr_db)}\n{number(c.ssim, 3)}" for c in cells]
        percent = DASH if math.isnan(light) else f"{number(100 * light, 1)} %"
        of_truth = (percent, number(level, 2), number(noise, 0), number(layers, 0))
        return (name, *shown[:4], *(number(gain) for gain in gains), *shown[4:], *of_truth)

    def facts_of(measured: Measured) -> tuple[float, ...]:
        row, facts = measured.score(OURS, network, "restored"), measured.facts_of(network)
        of_row = (math.nan, math.nan) if row is None else (row.light_error, row.converged_db)
        return of_row[0], facts["mean"], facts["noise_db"], of_row[1]

    rows = []
    for m in every:
        gains, cells = m.gains(OURS, network), [m.score(*place) for place in wanted]
        rows.append(line(m.scene, cells, [gains.get(rival, math.nan) for rival in rivals], facts_of(m)))
    averages = [_mean_row(every, *place) for place in wanted]
    means = [mean(m.gains(OURS, network).get(rival, math.nan) for m in every) for rival in rivals]
    light, level = (mean(values) for values in list(zip(*map(facts_of, every), strict=True))[:2])
    rows.append(line("mean", averages, means, (light, level, math.nan, math.nan)))
    rows.append(("the paper's scene", *[DASH] * 8, f"{PAPER_DB}\n{DASH}", *[DASH] * 4))
    return Table(
        tuple(columns),
        tuple(rows),
        "PSNR in dB, below it SSIM; by our way to simulate, and by the paper's protocol. Gains: of what is "
        "restored, ours. Layers against twice: PSNR between the photo and that of twice as many depth "
        "layers, without noise. Light error: by what part of the truth's mean that of what is restored "
        "is off, ours, in the channel where it is most off; light that crosses the frame's border and lamps "
        "beyond full scale are in it. Mean level: of the truth, of full scale. Render noise: PSNR of the "
        "truth against another rendering of it; detail of that kind is blurred away and cannot be "
        "restored, so scores near it are limited by the rendering.",
    )


def ways_table(every: Sequence[Measured], network: str) -> Table:
    """A row a way: means over scenes, and how far its conclusion is from ours."""
    ours = {m.scene: m.gain(OURS, network) for m in every}
    rows = []
    for way in _ways(every, network):
        gains = {m.scene: m.gain(way.name, network) for m in every}
        off = {
            scene: gains[scene] - ours[scene] for scene in gains if math.isfinite(gains[scene] - ours[scene])
        }
        far = max(off, key=lambda scene: abs(off[scene]), default=None)
        near = [m.gain(way.name, network, NEAR_EDGES) for m in every]
        alone = _mean(every, way.name, network, LENS_ALONE)
        restored, photo, filtered = (
            _mean(every, way.name, network, image) for image in ("restored", "photo", "wiener")
        )
        largest = DASH if far is None or off[far] == 0 else f"{_signed(off[far])}\n{far}"
        rows.append(
            (
                way.title,
                *(number(cell) for cell in (alone, restored, mean(gains.values()))),
                _signed(mean(off.values())),
                *([largest] if len(every) > 1 else []),
                *(number(cell) for cell in (mean(near), photo, filtered)),
            )
        )
    names = ["Lens alone", "Restored", "Gain", "Gain minus ours"]
    names += ["Largest difference"] if len(every) > 1 else []
    names += ["Gain near edges", "Photo", "Wiener"]
    columns = [Column("Photo simulated by"), *(Column(name) for name in names)]
    what = "Means over the scenes. " if len(every) > 1 else ""
    return Table(
        tuple(columns),
        tuple(rows),
        f"{what}PSNR in dB against the all-in-focus image of the same way. Gain: restored above the lens "
        "alone, the conclusion that a simulation is made for. Near edges: within the blur radius of a depth "
        "edge.",
    )


def _ways(every: Sequence[Measured], network: str) -> list[Way]:
    """The ways that were measured."""
    return [way for way in WAYS if any(m.score(way.name, network, "restored") for m in every)]


def _edges_table(measured: Measured, network: str) -> tuple[Block, ...]:
    """Scores near and away from edges of one scene, each way; nothing without edges."""
    if measured.score(OURS, network, "restored", NEAR_EDGES) is None:
        return ()
    facts = measured.facts_of(network)
    columns = [Column("Photo simulated by")]
    for region in (NEAR_EDGES, AWAY):
        columns += [Column(f"{label}, {region}") for label in ("Lens alone", "Restored")]
    rows = []
    for way in _ways([measured], network):
        cells: list[SceneScore | None] = []
        for region in (NEAR_EDGES, AWAY):
            cells += [measured.score(way.name, network, LENS_ALONE, region)]
            cells += [measured.score(way.name, network, "restored", region)]
        rows.append((way.title, *(_cell(cell) for cell in cells)))
    caption = (
        f"PSNR in dB, below it SSIM. {percent(facts['edges'])} of the pixels lie within the blur "
        "radius of a depth edge, that of the lens without a mask."
    )
    return (Table(tuple(columns), tuple(rows), caption),)


def _all_edges_table(every: Sequence[Measured], network: str) -> Table:
    """A row a scene: near edges by the best way that knows visible surfaces alone, and with hidden ones."""
    columns = [Column("Scene"), Column("Pixels near edges")]
    columns += [Column(f"Lens alone, {region}") for region in ("near", "away")]
    columns += [Column(f"Restored, {region}") for region in ("near", "away")]
    columns += [Column("Restored, near, nothing hides"), Column("Restored, near, without hidden surfaces")]
    rows = []
    for m in every:
        places = [(OURS, network, LENS_ALONE, region) for region in (NEAR_EDGES, AWAY)]
        places += [(OURS, network, "restored", NEAR_EDGES), (OURS, network, "restored", AWAY)]
        places += [("none", network, "restored", NEAR_EDGES), ("normalised", network, "restored", NEAR_EDGES)]
        share = percent(m.facts_of(network)["edges"])
        rows.append((m.scene, share, *(_cell(m.score(*place)) for place in places)))
    return Table(
        tuple(columns),
        tuple(rows),
        "PSNR in dB, below it SSIM, of the pixels within the blur radius of a depth edge, and of the others. "
        "Without hidden surfaces: layers of what is seen, normalised.",
    )


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
        whole = _mean_row(every, OURS, network, name)
        ranges: dict[tuple[float, float], list[SceneScore]] = {}
        for m in every:
            place = (m.lens(network), "photo") if name == LENS_ALONE else (network, name)
            for row in m.rows:
                if (row.way, row.system, row.image, row.region) == (OURS, *place, "depth"):
                    ranges.setdefault((row.near_m, row.far_m), []).append(row)
        parts = tuple(DepthScore(*limits, _average(ranges[limits])) for limits in sorted(ranges))
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


def _mean(every: Sequence[Measured], way: str, system: str, image: str) -> float:
    rows = (m.score(way, system, image) for m in every)
    return mean(row.psnr_db for row in rows if row is not None)


def _mean_row(every: Sequence[Measured], way: str, system: str, image: str) -> Score | None:
    rows = [row for m in every if (row := m.score(way, system, image, WHOLE)) is not None]
    return _average(rows) if rows else None


def _average(rows: Sequence[SceneScore]) -> Score:
    return Score(mean(r.psnr_db for r in rows), mean(r.ssim for r in rows), sum(r.pixels for r in rows))


def _cell(row: SceneScore | None) -> str:
    return DASH if row is None else f"{number(row.psnr_db)}\n{number(row.ssim, 3)}"


def _signed(value: float) -> str:
    """A difference with its sign."""
    text = number(value, 2)
    return f"+{text}" if value > 0 and text.strip("0.") else text
