"""A lens over its field: spots, PSFs and MTFs by field and depth, field curvature, distortion, illumination
and lateral colour, as pictures and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from ..core.progress import Progress, silent
from ..optics import Camera, psf_bank
from ..optics.field import relative_light
from ..optics.lenses.prescription import MM, PrescriptionLens
from ..optics.mtf import tangential_sagittal
from ..optics.prescription.spots import foci, heights, spots
from ..record import write_csv
from ..report import Plot
from ..report.plot import BLUE, DASHES, GREEN, ORANGE, SERIES, new_figure, picture_axes
from .psf_figure import draw_psf, metres_name, write_psfs

CORNER_PX = 320
"""Pixels from the middle of 512 x 384 to its corner: the field that is looked at where none is given."""
PARTS = (0.0, 0.5, 0.7, 1.0)
"""Of the way there."""
CURVE = 9
"""Places in the field that curves are drawn through."""
DEPTHS = 9
"""Of curves against depth."""
HALF_NYQUIST = 0.25
"""Cycles a pixel."""
FREQUENCIES = (0.125, 0.25, 0.5)
"""Of curves over the field, cycles a pixel."""
DIRECTIONS = ("tangential", "sagittal")
"""Along the field, which is upwards, and across it."""


@dataclass(frozen=True)
class Asked:
    """What is looked at: angles off the axis, upwards; wavelengths, of which the middle one of the list is
    that of MTFs; depths, that in focus among them; and the frequency of MTFs against depth."""

    camera: Camera
    fields_deg: tuple[float, ...]
    wavelengths_nm: tuple[float, ...]
    depths_m: tuple[float, ...]
    per_mm: float

    @property
    def middle(self) -> float:
        """The middle wavelength [m]."""
        return self.wavelengths_nm[len(self.wavelengths_nm) // 2] * 1e-9

    @property
    def curve_deg(self) -> list[float]:
        """Places that curves are drawn through."""
        return np.linspace(0, max(self.fields_deg) or 1.0, CURVE).tolist()

    def at(self, degrees: float) -> Camera:
        """The camera for points so far above the axis."""
        return self.camera.at_field((0.0, _tangent(degrees)))

    def mtf(self, degrees: float, inverse_depths: Sequence[float], per_mm: Sequence[float]) -> Tensor:
        """[direction, depth, frequency], tangential first."""
        frequencies = [1e3 * each for each in per_mm]
        return tangential_sagittal(self.at(degrees), self.middle, inverse_depths, frequencies)


@dataclass(frozen=True)
class Panel:
    """Curves on one pair of axes.

    lines: (x, y, name, colour, number of dashes).
    """

    title: str
    across: str
    lines: Sequence[tuple[Sequence[float], Sequence[float], str, str, int]]
    zero: bool = False


def usual_fields(camera: Camera) -> tuple[float, ...]:
    """Angles [deg] off the axis: parts of the way to the corner of 512 x 384 pixels."""
    corner = CORNER_PX * camera.pixel_angle
    return tuple(float(f"{math.degrees(math.atan(part * corner)):.3g}") for part in PARTS)


def run(
    camera: Camera,
    out: Path,
    *,
    fields_deg: Sequence[float],
    wavelengths_nm: Sequence[float],
    depths_m: Sequence[float],
    per_mm: float | None = None,
    device: str = "cpu",
    progress: Progress = silent,
) -> tuple[dict[str, float], dict[str, Path]]:
    """Write what a lens that varies does over its field into `out`; return the figures and the files.

    camera: whose lens varies.
    fields_deg, wavelengths_nm: as in `Asked`.
    depths_m: in addition to that in focus; curves against depth go from the least to the largest.
    per_mm: frequency of MTFs against depth, cycles/mm; None for half of what the pixels resolve.

    `psf_field.exr` holds a channel for each place, depth and wavelength, `10deg.0.5m.543nm`. `mtf_field.csv`
    is of the distance in focus, `mtf_depth.csv` of `per_mm`; the pixel is left out of both. Of a lens by its
    surfaces, `field.csv` and `spots.csv` hold what rays say. Figures, all by angle: illumination_percent,
    mtf.tangential and mtf.sagittal at the frequency, in focus; of rays, distortion_percent,
    focus_um.tangential and focus_um.sagittal (how far behind the sensor), lateral_colour_um (from the
    shortest wavelength to the longest), spot_um (root mean square, in focus).
    Raises InputError for a place that no light comes from.
    """
    per_mm = HALF_NYQUIST / camera.pixel * 1e-3 if per_mm is None else per_mm
    depths = sorted({*depths_m, camera.recipe.focus.distance_m})
    asked = Asked(camera, tuple(fields_deg), tuple(wavelengths_nm), tuple(depths), per_mm)
    outputs: dict[str, Path] = {}
    progress(0.0, "PSFs over the field")
    _psfs(asked, out, outputs, device)
    progress(0.2, "MTFs over the field")
    panels = [_illumination(asked)]
    figures = {f"illumination_percent.{d:g}deg": 100 * relative_light(asked.at(d)) for d in asked.fields_deg}
    panels.append(_mtf_over_field(asked, out, outputs))
    progress(0.5, "MTFs against depth")
    panels.append(_mtf_against_depth(asked, out, outputs))
    focus = 1 / camera.recipe.focus.distance_m
    for degrees in asked.fields_deg:
        for name, value in zip(DIRECTIONS, asked.mtf(degrees, [focus], [per_mm]), strict=True):
            figures[f"mtf.{name}.{degrees:g}deg"] = float(value)
    if isinstance(camera.lens, PrescriptionLens):
        progress(0.8, "rays")
        panels += _rays(asked, camera.lens, out, outputs, figures)
        _spots(asked, camera.lens, out, outputs, figures)
    outputs["curves over the field"] = _curves(camera.recipe.name, panels).save(out / "field.png")
    return figures, outputs


def _psfs(asked: Asked, out: Path, outputs: dict[str, Path], device: str) -> None:
    wavelengths = torch.tensor(asked.wavelengths_nm, dtype=torch.float64) * 1e-9
    inverse = torch.tensor([1 / depth for depth in asked.depths_m], dtype=torch.float64)
    banks = (psf_bank(asked.at(each), wavelengths, inverse, device=device) for each in asked.fields_deg)
    values = torch.cat([bank.values.cpu() for bank in banks])
    names = [
        [f"{degrees:g}deg.{metres_name(depth)}.{nm:g}nm" for nm in asked.wavelengths_nm]
        for degrees in asked.fields_deg
        for depth in asked.depths_m
    ]
    path = write_psfs(out / "psf_field.exr", names, values, asked.camera)
    outputs["PSFs over the field (EXR)"] = path

    def paint() -> Figure:
        rows, columns = len(asked.fields_deg), len(asked.depths_m)
        figure = new_figure(1.6 * columns + 0.5, 1.7 * rows)
        axes = figure.subplots(rows, columns, squeeze=False)
        seen = values[:, len(asked.wavelengths_nm) // 2].unflatten(0, (rows, columns))
        for row, degrees, psfs in zip(axes, asked.fields_deg, seen, strict=True):
            row[0].set_ylabel(f"{degrees:g} deg", fontsize=9)
            for axis, depth, psf in zip(row, asked.depths_m, psfs, strict=True):
                draw_psf(axis, psf)
                axis.set_title(metres_name(depth), fontsize=8)
        return figure

    about = f"PSFs of {asked.camera.recipe.name} at {asked.middle * 1e9:g} nm by field and depth."
    outputs["PSFs over the field"] = Plot(paint, about, about).save(out / "psf_field.png")


def _illumination(asked: Asked) -> Panel:
    light = [100 * relative_light(asked.at(degrees)) for degrees in asked.curve_deg]
    return Panel("light on the sensor / %", "field / deg", [(asked.curve_deg, light, "", BLUE, 0)], zero=True)


def _mtf_over_field(asked: Asked, out: Path, outputs: dict[str, Path]) -> Panel:
    frequencies = [part / asked.camera.pixel * 1e-3 for part in FREQUENCIES]
    focus = [1 / asked.camera.recipe.focus.distance_m]
    found = torch.stack([asked.mtf(degrees, focus, frequencies)[:, 0] for degrees in asked.curve_deg])
    rows = [
        (degrees, per_mm, *found[place, :, number].tolist())
        for place, degrees in enumerate(asked.curve_deg)
        for number, per_mm in enumerate(frequencies)
    ]
    header = ("field_deg", "cycles_per_mm", "tangential", "sagittal")
    outputs["MTFs over the field"] = write_csv(out / "mtf_field.csv", header, rows)
    lines = [
        (asked.curve_deg, found[:, side, number].tolist(), f"{per_mm:.3g}/mm {name[0]}", SERIES[number], side)
        for number, per_mm in enumerate(frequencies)
        for side, name in enumerate(DIRECTIONS)
    ]
    return Panel("MTF in focus", "field / deg", lines, zero=True)


def _mtf_against_depth(asked: Asked, out: Path, outputs: dict[str, Path]) -> Panel:
    ends = (1 / max(asked.depths_m), 1 / min(asked.depths_m))
    inverse = np.linspace(*ends, DEPTHS if ends[0] < ends[1] else 1).tolist()
    found = [asked.mtf(degrees, inverse, [asked.per_mm])[..., 0] for degrees in asked.fields_deg]
    rows = [
        (degrees, each, *value)
        for degrees, values in zip(asked.fields_deg, found, strict=True)
        for each, value in zip(inverse, values.T.tolist(), strict=True)
    ]
    header = ("field_deg", "inverse_depth_per_m", "tangential", "sagittal")
    outputs["MTFs against depth"] = write_csv(out / "mtf_depth.csv", header, rows)
    lines = [
        (inverse, values[side].tolist(), f"{degrees:g} deg {name[0]}", SERIES[number % len(SERIES)], side)
        for number, (degrees, values) in enumerate(zip(asked.fields_deg, found, strict=True))
        for side, name in enumerate(DIRECTIONS)
    ]
    return Panel(f"MTF at {asked.per_mm:.3g} cycles/mm", "inverse depth / (1/m)", lines, zero=True)


def _rays(
    asked: Asked, lens: PrescriptionLens, out: Path, outputs: dict[str, Path], figures: dict[str, float]
) -> list[Panel]:
    """Field curvature, distortion and lateral colour, from where the camera is focused."""
    degrees = sorted({*asked.fields_deg, *asked.curve_deg})
    held, distance = lens.held(), asked.camera.recipe.focus.distance_m / MM
    tangents = torch.tensor([_tangent(each) for each in degrees], dtype=torch.float64)
    wavelengths = torch.tensor(asked.wavelengths_nm, dtype=torch.float64) * 1e-9
    curved = [1e3 * each for each in foci(held, tangents, asked.middle, distance)]
    distortion = 100 * torch.nan_to_num(lens.landing(tangents) / tangents - 1)
    landed = heights(held, tangents, wavelengths, distance)
    colour = 1e3 * (landed - landed[:, [len(wavelengths) // 2]])
    columns = [distortion, *curved, *colour.T]
    header = ["field_deg", "distortion_percent", "focus_tangential_um", "focus_sagittal_um"]
    header += [f"lateral_colour_{nm:g}nm_um" for nm in asked.wavelengths_nm]
    rows = [(each, *row) for each, row in zip(degrees, torch.stack(columns, -1).tolist(), strict=True)]
    outputs["rays over the field"] = write_csv(out / "field.csv", header, rows)
    order = wavelengths.argsort()
    for each in asked.fields_deg:
        row = degrees.index(each)
        figures[f"distortion_percent.{each:g}deg"] = float(distortion[row])
        for name, focus in zip(DIRECTIONS, curved, strict=True):
            figures[f"focus_um.{name}.{each:g}deg"] = float(focus[row])
        figures[f"lateral_colour_um.{each:g}deg"] = float(colour[row, order[-1]] - colour[row, order[0]])
    names = [
        (degrees, focus.tolist(), name, (BLUE, ORANGE)[side], side)
        for side, (name, focus) in enumerate(zip(DIRECTIONS, curved, strict=True))
    ]
    bands = [
        (degrees, values.tolist(), f"{nm:g} nm", SERIES[band % len(SERIES)], 0)
        for band, (nm, values) in enumerate(zip(asked.wavelengths_nm, colour.T, strict=True))
    ]
    return [
        Panel("focus behind the sensor / um", "field / deg", names),
        Panel("distortion / %", "field / deg", [(degrees, distortion.tolist(), "", GREEN, 0)]),
        Panel("lateral colour / um", "field / deg", bands),
    ]


def _spots(
    asked: Asked, lens: PrescriptionLens, out: Path, outputs: dict[str, Path], figures: dict[str, float]
) -> None:
    held = lens.held()
    wavelengths = torch.tensor(asked.wavelengths_nm, dtype=torch.float64) * 1e-9
    seen = {
        (degrees, depth): spots(held, _tangent(degrees), wavelengths, depth / MM)
        for degrees in asked.fields_deg
        for depth in asked.depths_m
    }
    rows = [
        (degrees, depth, nm, spot.rms * 1e3)
        for (degrees, depth), bands in seen.items()
        for nm, spot in zip(asked.wavelengths_nm, bands, strict=True)
    ]
    outputs["sizes of spots"] = write_csv(out / "spots.csv", ("field_deg", "depth_m", "nm", "rms_um"), rows)
    at = torch.tensor([asked.middle], dtype=torch.float64)
    for degrees in asked.fields_deg:
        focus = asked.camera.recipe.focus.distance_m / MM
        figures[f"spot_um.{degrees:g}deg"] = spots(held, _tangent(degrees), at, focus)[0].rms * 1e3
    half = asked.camera.recipe.psf.window_px * asked.camera.pixel / MM / 2

    def paint() -> Figure:
        rows, columns = len(asked.fields_deg), len(asked.depths_m)
        figure = new_figure(1.6 * columns + 0.5, 1.7 * rows)
        axes = figure.subplots(rows, columns, squeeze=False)
        for axis, ((degrees, depth), bands) in zip(axes.flat, seen.items(), strict=True):
            picture_axes(axis)
            for band, spot in enumerate(bands):
                axis.plot(spot.x, spot.y, ".", markersize=0.6, color=SERIES[band % len(SERIES)])
            axis.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
            axis.set_title(metres_name(depth), fontsize=8)
            if depth == asked.depths_m[0]:
                axis.set_ylabel(f"{degrees:g} deg", fontsize=9)
        return figure

    about = (
        f"Where rays land, by field and depth, in windows as wide as those of the PSFs: {2 * half:.3g} mm."
    )
    outputs["spots"] = Plot(paint, about, about).save(out / "spots.png")


def _curves(name: str, panels: Sequence[Panel]) -> Plot:
    def paint() -> Figure:
        rows = math.ceil(len(panels) / 3)
        figure = new_figure(10.6, 3.0 * rows)
        axes = figure.subplots(rows, 3, squeeze=False).flat
        for axis, panel in zip(axes, panels, strict=False):
            for x, y, label, colour, dash in panel.lines:
                axis.plot(x, y, color=colour, linestyle=DASHES[dash], linewidth=1.3, label=label or None)
            axis.set_title(panel.title)
            axis.set_xlabel(panel.across)
            if panel.zero:
                axis.set_ylim(0, None)
            if panel.lines[0][2]:
                axis.legend(fontsize=6)
        return figure

    about = (
        f"{name} over its field: light, MTFs (t: along the field, s: across it), foci, distortion, colour."
    )
    return Plot(paint, about, about)


def _tangent(degrees: float) -> float:
    return math.tan(math.radians(degrees))
