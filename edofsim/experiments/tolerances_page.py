"""Figures and the page of cameras that are not made as designed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import torch

from ..optics import Camera
from ..report import Column, Key, Keys, Page, Plot, Section, Table, Text, line_plot
from ..report.page import Block
from ..report.plot import WIDE_IN
from ..report.words import decibels, number

Found: TypeAlias = Mapping[str, float]
"""Figures of one camera, by what and angle."""
PARTS = {"p10": 0.1, "p50": 0.5, "p90": 0.9}
SHOWN = 12
"""Errors in the page's table: those that matter most."""
ABOUT = (
    "Each camera has errors of its own, drawn with the recipe's standard deviations, and photographs one "
    "picture as a plane, in three wavelengths, with the PSFs of the place all over the frame. What restores "
    "knows the designed camera. Waves are the designed ones with their changes in first order. Where points "
    "land is not counted, edges of the pupil stay, and a change is that of light in focus."
)


def worst_of(found: Mapping[int, Found], count: int) -> list[int]:
    """Draws whose photos are worst, in the mean over the angles."""

    def mean(each: Found) -> float:
        photos = [value for name, value in each.items() if name.startswith("psnr_db.photo.")]
        return sum(photos) / len(photos)

    return sorted(found, key=lambda draw: mean(found[draw]))[:count]


def figures_of(
    designed: Found, found: Mapping[int, Found], exact: Mapping[int, Found], parts: Found
) -> dict[str, float]:
    """Flat: of the camera as designed, of draws, of draws by rays of their own, and waves by errors."""
    figures: dict[str, float] = {"draws": len(found)}
    for name in designed:
        values = torch.tensor([each[name] for each in found.values()], dtype=torch.float64)
        if name.startswith("seconds."):
            figures[name] = float(values.sum())
            continue
        figures[f"{name}.designed"] = designed[name]
        for label, part in PARTS.items():
            figures[f"{name}.{label}"] = float(values.quantile(part))
    total = sum(value**2 for value in parts.values()) or 1.0
    for name, value in sorted(parts.items(), key=lambda item: -item[1]):
        figures |= {f"waves_rms.{name}": value, f"share_percent.{name}": 100 * value**2 / total}
    if exact:
        off = {"photo_db": "psnr_db.photo.", "restored_db": "psnr_db.restored.", "mtf": "mtf."}
        for what, start in off.items():
            figures[f"exact.{what}"] = max(
                abs(each[name] - found[draw][name])
                for draw, each in exact.items()
                for name in each
                if name.startswith(start)
            )
        for what in ("change_waves", "missed_waves"):
            every = [
                value for each in exact.values() for name, value in each.items() if name.startswith(what)
            ]
            figures[f"exact.{what}"] = max(every)
    return figures


def _measures(figures: Found) -> list[str]:
    ending = ".designed"
    return [name[: -len(ending)] for name in figures if name.endswith(ending)]


def quantiles_table(figures: Found) -> list[Table | str]:
    """For a terminal: what parts of the cameras reach, and what matters most."""
    return [_quantiles(figures), _errors(figures, 6)]


def _quantiles(figures: Found) -> Table:
    columns = (Column("What"), Column("designed", "", 3), *(Column(label, "", 3) for label in PARTS))
    rows = tuple(
        (name, figures[f"{name}.designed"], *(figures[f"{name}.{label}"] for label in PARTS))
        for name in _measures(figures)
    )
    return Table(columns, rows, "10, 50 and 90 % of the cameras are below p10, p50 and p90.")


def _errors(figures: Found, count: int) -> Table:
    start = "waves_rms."
    names = [name[len(start) :] for name in figures if name.startswith(start)][:count]
    rows = tuple((name, figures[start + name], figures[f"share_percent.{name}"]) for name in names)
    columns = (Column("Error"), Column("root mean square", "waves", 4), Column("share", "%", 1))
    said = "By one standard deviation, over pupil and field, after focusing; numbers are those of surfaces."
    return Table(columns, rows, said)


def page(camera: Camera, figures: Found, found: Mapping[int, Found], restored_by: str, per_mm: float) -> Page:
    """restored_by: what restored, in words; per_mm: frequency of the MTFs."""
    photos = [name for name in _measures(figures) if name.startswith("psnr_db.")]
    keys = [
        Key(
            f"{what}, {angle}",
            f"{figures[f'{name}.p10']:.2f}",
            "dB",
            f"10 % of the cameras are below; designed {figures[f'{name}.designed']:.2f}",
            what == "restored",
        )
        for name in photos
        for _, what, angle in (name.split(".", 2),)
    ]
    facts = {
        "Cameras": f"{figures['draws']:.0f}",
        "Restored by": restored_by,
        "MTF at": f"{number(per_mm)} cycles/mm",
    }
    plots = _distributions(photos, figures, found)
    blocks: tuple[Block, ...] = (_quantiles(figures), *plots)
    sections = [
        Section("What the cameras reach", blocks),
        Section("What matters", (_errors(figures, SHOWN),)),
    ]
    if "exact.missed_waves" in figures:
        text = (
            "The worst cameras, by rays through their own lenses: the wave changes by up to "
            f"{number(figures['exact.change_waves'], 3)} waves root mean square, of which the first order "
            f"misses {number(figures['exact.missed_waves'], 2)}; photos differ by up to "
            f"{number(figures['exact.photo_db'], 2)} dB, MTFs by {number(figures['exact.mtf'], 2)}."
        )
        sections.append(Section("First order and rays", (Text(text),)))
    title = f"Tolerances of {camera.recipe.name}"
    return Page(
        title,
        "What cameras reach as they are made.",
        tuple(sections),
        (Keys(tuple(keys)), Text(ABOUT)),
        facts,
    )


def _distributions(names: Sequence[str], figures: Found, found: Mapping[int, Found]) -> list[Plot]:
    """The part of the cameras that is below each PSNR."""
    series = []
    for name in names:
        values = sorted(each[name] for each in found.values())
        parts = [100 * (k + 0.5) / len(values) for k in range(len(values))]
        series.append((name.removeprefix("psnr_db.").replace(".", ", ", 1), values, parts))
    ends = "; ".join(
        f"{name}: {decibels(figures[f'{name}.p10'])} to {decibels(figures[f'{name}.p90'])}" for name in names
    )
    return [
        line_plot(
            series,
            x="PSNR (dB)",
            y="cameras below (%)",
            alt=f"Part of the cameras below a PSNR; from 10 to 90 %: {ends}.",
            caption="Part of the cameras that are below a PSNR.",
            width=WIDE_IN,
        )
    ]
