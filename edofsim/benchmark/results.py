"""Rows of scores as tables: means with intervals, differences, a page, CSV and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure

from ..core.json_values import Json
from ..core.sources import PACKAGE, code_of
from ..experiments.cost_page import name_points
from ..record import write_csv
from ..report.page import Cell, Column, Notes, Page, Section, Table, Text
from ..report.plot import NARROW_IN, WIDE_IN, Plot, new_figure
from .definition import Benchmark
from .entries import Entry
from .score import WHOLE, Row
from .statistics import Interval, differences, interval

MEASURES = ("psnr_db", "ssim", "flip")
WORST = 5
SAID = (
    "Means over scenes, each the mean of its photos. Below each is its 95 % interval from 2,000 resamples of "
    "scenes and noise seeds. A failure is scored as a black image. PSNR and SSIM leave out the noise of the "
    "rendering, except for folders of images, from which it cannot be separated. FLIP includes it."
)


class Results:
    """All rows, by entry and region."""

    def __init__(self, entries: Sequence[Entry], rows: Sequence[Row]) -> None:
        self.entries, self.rows = entries, rows
        self.scenes = sorted({row.scene for row in rows})
        self.noises = sorted({row.noise for row in rows})
        self.regions = list(dict.fromkeys(row.region for row in rows))
        self.regions.sort(key=lambda name: (name.split()[0] != WHOLE, name.split()[0], _start(name)))

    def values(
        self, entry: str, region: str = WHOLE, measure: str = "psnr_db", family: str = ""
    ) -> np.ndarray:
        """[scene, noise seed], NaN where there is none."""
        found = np.full((len(self.scenes), len(self.noises)), np.nan)
        for row in self.rows:
            if (row.entry, row.region) == (entry, region) and family in ("", row.family):
                value = getattr(row, measure)
                place = self.scenes.index(row.scene), self.noises.index(row.noise)
                found[place] = value if np.isfinite(value) else np.nan
        return found

    def failures(self, entry: str) -> list[str]:
        """A sentence for each photo that an entry failed."""
        mine = [row for row in self.rows if row.entry == entry and row.region == WHOLE and row.failure]
        return [f"{entry}, {row.scene}, noise {row.noise}: {row.failure}" for row in mine]

    def figures(self) -> dict[str, float]:
        """{psnr_db,ssim,flip}.ENTRY.REGION with .low and .high, by_family.FAMILY.ENTRY,
        difference_db.ENTRY.ENTRY with .low and .high, and of each entry failures, seconds, peak_mib,
        gmacs, parameters."""
        found: dict[str, float] = {"scenes": len(self.scenes), "photos": len(self.scenes) * len(self.noises)}
        for entry in self.entries:
            for region in self.regions:
                for measure in MEASURES:
                    name = f"{measure}.{entry.name}.{region.replace(' ', '_')}"
                    found |= _ends(name, interval(self.values(entry.name, region, measure)))
            for family in sorted({row.family for row in self.rows}):
                mean = interval(self.values(entry.name, family=family)).mean
                found[f"psnr_db.{entry.name}.family.{family}"] = mean
            mine = [row for row in self.rows if row.entry == entry.name and row.region == WHOLE]
            found[f"failures.{entry.name}"] = len(self.failures(entry.name))
            for each in ("seconds", "peak_mib", "gmacs"):
                known = [value for row in mine if not np.isnan(value := getattr(row, each))]
                found[f"{each}.{entry.name}"] = median(known or [np.nan])
            if entry.parameters is not None:
                found[f"parameters.{entry.name}"] = entry.parameters
        for (one, other), each in self.paired().items():
            found |= _ends(f"difference_db.{one}.{other}", each)
        return found

    def paired(self) -> dict[tuple[str, str], Interval]:
        """How much each entry is above each other that restored the same scenes, PSNR in dB."""
        return differences({entry.name: self.values(entry.name) for entry in self.entries})

    def table(self) -> Table:
        """Best first."""
        columns = [
            Column("Entry"),
            Column("Track"),
            Column("PSNR", "dB", 2, "largest"),
            Column("SSIM", "", 3, "largest"),
        ]
        columns += [Column("FLIP", "", 3, "smallest"), Column("Failures", "", 0), Column("Time", "s", 2)]
        columns += [Column("Peak memory", "MiB", 0)]
        columns += [Column("Parameters", "", 0), Column("GMACs", "", 2), Column("Given")]
        figures = self.figures()
        rows: list[tuple[Cell, ...]] = []
        for entry in sorted(
            self.entries, key=lambda e: -np.nan_to_num(figures[f"psnr_db.{e.name}.{WHOLE}"], nan=-99)
        ):
            ends = [figures[f"psnr_db.{entry.name}.{WHOLE}.{end}"] for end in ("low", "high")]
            name = f"{entry.name}\n{ends[0]:.2f} to {ends[1]:.2f} dB"
            scores = [figures[f"{measure}.{entry.name}.{WHOLE}"] for measure in MEASURES]
            more = [figures[f"{each}.{entry.name}"] for each in ("failures", "seconds", "peak_mib")]
            uses = ", ".join(entry.uses) or "nothing"
            rows.append(
                (name, entry.track, *scores, *more, entry.parameters, figures[f"gmacs.{entry.name}"], uses)
            )
        return Table(tuple(columns), tuple(rows))

    def where(self) -> Table:
        """By region and family."""
        families = sorted({row.family for row in self.rows})
        columns = (Column("PSNR / dB"), *(Column(e.name, "", 2, "") for e in self.entries))
        rows = [(r, *(interval(self.values(e.name, r)).mean for e in self.entries)) for r in self.regions]
        rows += [(f, *(interval(self.values(e.name, family=f)).mean for e in self.entries)) for f in families]
        return Table(columns, tuple(rows))

    def differences_table(self) -> Table:
        columns = (
            Column("Entry"),
            Column("above"),
            Column("by", "dB", 2),
            Column("95 %", "dB"),
            Column("Sure"),
        )
        rows = [
            (one, other, each.mean, f"{each.low:.2f} to {each.high:.2f}", each.low > 0 or each.high < 0)
            for (one, other), each in self.paired().items()
        ]
        return Table(columns, tuple(rows))

    def worst(self) -> Table:
        """The photos that each entry did worst on."""
        columns = (
            Column("Entry"),
            Column("Scene"),
            Column("Noise", "", 0),
            Column("PSNR", "dB", 2),
            Column("Failure"),
        )
        rows: list[tuple[Cell, ...]] = []
        for entry in self.entries:
            mine = [row for row in self.rows if row.entry == entry.name and row.region == WHOLE]
            mine.sort(key=lambda row: np.nan_to_num(row.psnr_db, nan=-99))
            rows += [(entry.name, r.scene, r.noise, r.psnr_db, r.failure) for r in mine[:WORST]]
        return Table(columns, tuple(rows))

    def scatter(self) -> Plot:
        """Quality against time."""
        figures = self.figures()

        points = [
            (figures[f"seconds.{entry.name}"], figures[f"psnr_db.{entry.name}.{WHOLE}"], entry.name)
            for entry in self.entries
        ]

        def paint(inches: float = WIDE_IN) -> Figure:
            figure = new_figure(inches, 4.2)
            axes = figure.subplots()
            axes.plot([x for x, _, _ in points], [y for _, y, _ in points], "o", linestyle="")
            axes.set_xscale("log")
            axes.margins(0.12)
            axes.set_xlabel("processor time per photo (s)")
            axes.set_ylabel("PSNR (dB)")
            name_points(axes, points)
            return figure

        said = "PSNR of each entry against its processor time per photo."
        return Plot(paint, said, "Quality against time.", paint_narrow=partial(paint, NARROW_IN))


def page_of(results: Results, benchmark: Benchmark) -> Page:
    """The page of all entries."""
    failed = [line for entry in results.entries for line in results.failures(entry.name)]
    sections = (
        Section("Entries", (results.table(), Text(SAID), results.scatter())),
        Section("By depth, edges and family", (results.where(),)),
        Section(
            "Differences",
            (results.differences_table(), Text("Paired by photo. Sure: the interval does not include 0.")),
        ),
        Section("Worst photos", (results.worst(),)),
    )
    head = (Notes(tuple(failed)),) if failed else ()
    identity = benchmark.identity  # in full in benchmark.json
    facts = {
        "Scenes": str(len(results.scenes)),
        "Photos per scene": str(len(results.noises)),
        "Version": identity["name"],
        "Definition": identity["definition"][:16],
        "Data": identity["data"][:16],
    }
    return Page(f"Benchmark {benchmark.recipe.name}", benchmark.recipe.purpose, sections, head, facts)


def write_rows(path: Path, rows: Sequence[Row]) -> Path:
    """Every row as CSV."""
    return write_csv(path, [each.name for each in fields(Row)], [astuple(row) for row in rows])


def submission(results: Results, benchmark: Benchmark) -> Json:
    """What says on what, and by which code, the figures were taken."""
    said: list[Mapping[str, object]] = [
        {"name": e.name, "track": e.track, "uses": e.uses, "trained_on": e.trained_on, "digest": e.digest}
        for e in results.entries
    ]
    return {"benchmark": benchmark.identity, "code": code_of(PACKAGE), "entries": said}


def _ends(name: str, found: Interval) -> dict[str, float]:
    return {name: found.mean, f"{name}.low": found.low, f"{name}.high": found.high}


def _start(region: str) -> float:
    return float(region.split()[1].split("-")[0]) if " " in region else 0.0
