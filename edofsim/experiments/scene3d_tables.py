"""Tables of the deep scenes: scores, what each way to simulate concludes, and depth edges."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..report.page import Block, Column, Table
from ..report.words import DASH, number, percent
from ..restore.scores import Score
from .protocols import LENS_ALONE, OURS, PAPER, PAPER_DB, WAYS, Way
from .scene_scores import AWAY, NEAR_EDGES, WHOLE, Measured, SceneScore, mean


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
    averages = [mean_row(every, *place) for place in wanted]
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
        alone = mean_of(every, way.name, network, LENS_ALONE)
        restored, photo, filtered = (
            mean_of(every, way.name, network, image) for image in ("restored", "photo", "wiener")
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


def edges_table(measured: Measured, network: str) -> tuple[Block, ...]:
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


def all_edges_table(every: Sequence[Measured], network: str) -> Table:
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


def mean_of(every: Sequence[Measured], way: str, system: str, image: str) -> float:
    rows = (m.score(way, system, image) for m in every)
    return mean(row.psnr_db for row in rows if row is not None)


def mean_row(every: Sequence[Measured], way: str, system: str, image: str) -> Score | None:
    rows = [row for m in every if (row := m.score(way, system, image, WHOLE)) is not None]
    return average(rows) if rows else None


def average(rows: Sequence[SceneScore]) -> Score:
    return Score(mean(r.psnr_db for r in rows), mean(r.ssim for r in rows), sum(r.pixels for r in rows))


def _cell(row: SceneScore | None) -> str:
    return DASH if row is None else f"{number(row.psnr_db)}\n{number(row.ssim, 3)}"


def _signed(value: float) -> str:
    """A difference with its sign."""
    text = number(value, 2)
    return f"+{text}" if value > 0 and text.strip("0.") else text
