"""Scores of cameras: as figures, as a table, and as a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from ..record import write_csv
from ..report import Column, Table
from ..report.page import Cell
from ..restore.gains import RIVALS, gain_figures, gains
from .planes import RANDOM
from .protocols import LENS_ALONE

PHOTO, WIENER, ANY, OWN = "photo", "wiener", "any", "own"
WHAT = {
    PHOTO: "photo",
    LENS_ALONE: "lens alone",
    WIENER: "Wiener",
    ANY: "for any camera",
    OWN: "for this camera",
}
NOT_RESTORED = (PHOTO, LENS_ALONE)
Errors: TypeAlias = Mapping[str, Mapping[str, float]]
"""Standard errors of PSNRs in dB, by CAMERA.CONDITION and what was judged; of rendered scenes alone."""


def figures_of(
    scores: Mapping[str, Mapping[str, Mapping[str, float]]], errors: Errors | None = None
) -> dict[str, float]:
    """Flat, from PSNRs by camera, condition and what was judged."""
    figures = {
        f"psnr_db_se.{place}.{what}": error
        for place, each in (errors or {}).items()
        for what, error in each.items()
    }
    above: dict[str, list[float]] = {RANDOM: [], "deep": []}
    for camera, conditions in scores.items():
        for condition, values in conditions.items():
            place = f"{camera}.{condition}"
            figures |= {f"psnr_db.{place}.{what}": value for what, value in values.items()}
            for what in restored_in(values):
                figures |= gain_figures(gains(values, what), f"{place}.{what}")
            if (first := first_of(values)) is not None and WIENER in values:
                above[RANDOM if condition == RANDOM else "deep"].append(values[first] - values[WIENER])
                if OWN in values and first != OWN:
                    figures[f"gap_db.{place}"] = values[OWN] - values[first]
    for name, values in above.items():
        if values:
            figures[f"gain_db.mean.{name}.over_wiener"] = sum(values) / len(values)
    if together := [value for values in above.values() for value in values]:
        figures["gain_db.mean.over_wiener"] = sum(together) / len(together)
        figures["gain_db.least.over_wiener"] = min(together)
    gaps = [value for name, value in figures.items() if name.startswith("gap_db.")]
    return {**figures, **({"gap_db.greatest": max(gaps)} if gaps else {})}


def restored_in(values: Mapping[str, float]) -> list[str]:
    """What was restored, of all that was judged."""
    return [what for what in values if what not in NOT_RESTORED]


def first_of(values: Mapping[str, float]) -> str | None:
    """The first system that was judged, the network of the camera itself where there is no other."""
    others = [what for what in restored_in(values) if what not in (WIENER, OWN)]
    return others[0] if others else OWN if OWN in values else None


def table(
    scores: Mapping[str, Mapping[str, Mapping[str, float]]],
    every: Mapping[str, str],
    errors: Errors,
) -> Table:
    """A row for each camera and condition.

    every: cameras in words, by their names.
    """
    known = [values for conditions in scores.values() for values in conditions.values()]
    more = dict.fromkeys(what for values in known for what in values if what not in WHAT)
    shown = {what: said for what, said in WHAT.items() if any(what in values for values in known)}
    shown |= {what: what for what in more}
    columns = (
        Column("Camera"),
        Column("What it photographs"),
        *(Column(said, "dB", 2) for said in shown.values()),
        *(Column(f"Gain over {said}", "dB", 2) for said in RIVALS.values()),
        Column("PSNR's standard error", "dB", 3),
    )
    rows: list[tuple[Cell, ...]] = []
    for name, words in every.items():
        for condition, values in scores.get(name, {}).items():
            said = "pictures, random depths" if condition == RANDOM else condition
            above = gains(values, first_of(values) or WIENER)
            found = (values.get(what) for what in shown)
            error = max(errors.get(f"{name}.{condition}", {}).values(), default=None)
            rows.append((words, said, *found, *(above.get(rival) for rival in RIVALS), error))
    said = "Gains: of the first system, or of Wiener deconvolution where there is no other."
    return Table(columns, tuple(rows), said)


def write_gains(path: Path, scores: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Path:
    """A row for each camera, condition and image: PSNR, and gains of what is restored."""
    rows = []
    for camera, conditions in scores.items():
        for condition, values in conditions.items():
            for what, value in values.items():
                above = gains(values, what) if what in restored_in(values) else {}
                rows.append((camera, condition, what, value, *(above.get(rival, "") for rival in RIVALS)))
    header = ("camera", "condition", "image", "psnr_db", *(f"gain_db_over_{rival}" for rival in RIVALS))
    return write_csv(path, header, rows)
