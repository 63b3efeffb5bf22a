"""Modulation transfer functions: the classic masks at three defoci, and a camera's own at three depths.

After two figures of Akpinar et al.: clear, coded and cubic pupil at 543 nm for three values of Psi (section
Problem Formulation), and the camera's mask at three depths in three colours (section Simulations).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from ..core.progress import Progress
from ..optics import Camera, defocus
from ..optics.lenses.plano_convex import PlanoConvexLens
from ..optics.masks import Mask
from ..optics.masks.clear import ClearMask
from ..optics.masks.coded import CodedMask
from ..optics.masks.cubic import CubicMask
from ..optics.mtf import mtf
from ..options import CameraOption
from ..recipe import load_camera
from ..recipe.camera import CameraRecipe
from ..record import write_csv
from ..report import Column, Key, Keys, Page, Plot, Section, Table, Text
from ..report.plot import DASHES, MUTED, NARROW_IN, SERIES, WIDE_IN, new_figure
from ..report.words import listed, number
from .experiment import Findings, in_paper

GREEN = 543e-9
PSIS = (0.0, 20.0, 40.0)
MASKS = {"clear": ClearMask(), "levin": CodedMask(), "cubic": CubicMask()}
COLOURS_NM = (611, 543, 482)
DEPTHS_M = (0.5, 1.3, math.inf)
LEAST_AXIS_PER_MM = 120
DISTANT_M = 100.0
"""A focus beyond is at infinity, as far as the depths that are shown are concerned."""


TITLES = {"clear": "clear aperture", "levin": "coded aperture (Levin et al.)", "cubic": "cubic mask"}


@dataclass(frozen=True)
class Curve:
    """One curve: its panel, what it is of, and its MTF [frequency]."""

    panel: str
    label: str
    values: Tensor

    @property
    def title(self) -> str:
        """What a reader calls its panel."""
        return TITLES.get(self.panel, self.panel.replace("_", " "))

    @property
    def name(self) -> str:
        """What a reader calls it."""
        return self.label.replace("psi_", "Ψ = ").replace("_", " ")

    def mean(self, nyquist: int) -> float:
        """Up to the sensor's Nyquist frequency, whole cycles per mm."""
        return float(self.values[: nyquist + 1].mean())

    def least(self, nyquist: int) -> float:
        """Smallest value up to half of it."""
        return float(self.values[: nyquist // 2 + 1].min())


def frequencies_of(camera: Camera) -> Tensor:
    """Whole cycles per mm up to the sensor's Nyquist frequency and at least `LEAST_AXIS_PER_MM`, float64."""
    last = max(LEAST_AXIS_PER_MM, math.ceil(nyquist_per_mm(camera) - 1e-9))
    return torch.arange(last + 1, dtype=torch.float64)


def nyquist_per_mm(camera: Camera) -> float:
    """The sensor's Nyquist frequency, cycles per mm."""
    return 0.5e-3 / camera.pixel


def depths_of(camera: Camera) -> tuple[float, ...]:
    """Distances in metres: half of the camera's focus, the focus, and infinity."""
    focus = camera.recipe.focus.distance_m
    return (1.0, 10.0, math.inf) if focus > DISTANT_M else (focus / 2, focus, math.inf)


def classic_curves(per_mm: Tensor) -> list[Curve]:
    """Clear, coded and cubic pupil for three values of Psi at 543 nm, with the paper's lens as a parabola.

    per_mm: [frequency], 1/mm on the sensor.
    """
    curves: list[Curve] = []
    for name, mask in MASKS.items():
        camera = _parabolic(mask)
        at_infinity = float(defocus(camera, GREEN, 0.0))
        per_dioptre = math.pi / GREEN * camera.aperture_radius**2
        depths = [(psi - at_infinity) / per_dioptre for psi in PSIS]
        values = mtf(camera, GREEN, depths, per_mm * 1e3)
        curves += [Curve(name, f"psi_{psi:g}", row) for psi, row in zip(PSIS, values, strict=True)]
    return curves


def camera_curves(camera: Camera, per_mm: Tensor, depths_m: Sequence[float]) -> list[Curve]:
    """The camera's own mask and lens at depths for its three colours.

    per_mm: [frequency], 1/mm on the sensor.
    """
    inverse_depths = [1 / depth for depth in depths_m]
    curves: list[Curve] = []
    for nm in COLOURS_NM:
        values = mtf(camera, nm * 1e-9, inverse_depths, per_mm * 1e3)
        labels = ("infinity" if math.isinf(depth) else f"{depth:g}_m" for depth in depths_m)
        curves += [Curve(f"{nm}_nm", label, row) for label, row in zip(labels, values, strict=True)]
    return curves


@in_paper(lambda paper: {})
def run(folder: Path, progress: Progress, camera: CameraOption = None) -> Findings:
    """Draw MTFs of masks against depth.

    Masks are clear, coded and cubic, and the camera's own (paper, Figs. 3 and 7). The camera is paper-learned
    at 0.5 m, 1.3 m and infinity, as in the paper; another one is shown at half of its focus, its focus and
    infinity. Frequencies go up to the sensor's Nyquist frequency at least.

    Figures: mean_mtf.PANEL.CURVE up to the sensor's Nyquist frequency; least_mtf.PANEL up to half of it,
    the smallest of its curves (0 is what no deconvolution brings back).
    """
    loaded = load_camera(camera or "paper-learned")
    optics = Camera.from_recipe(loaded.recipe, loaded.base)
    progress(0.0, "classic apertures")
    per_mm = frequencies_of(optics)
    classic = classic_curves(per_mm)
    progress(0.5, loaded.recipe.name)
    own = camera_curves(optics, per_mm, depths_of(optics) if camera else DEPTHS_M)
    curves, frequencies = [*classic, *own], per_mm.tolist()
    rows = (
        (c.panel, c.label, f, v) for c in curves for f, v in zip(frequencies, c.values.tolist(), strict=True)
    )
    nyquist = int(nyquist_per_mm(optics))
    figures = {f"mean_mtf.{c.panel}.{c.label}": c.mean(nyquist) for c in curves}
    for panel in dict.fromkeys(curve.panel for curve in curves):
        figures[f"least_mtf.{panel}"] = min(c.least(nyquist) for c in curves if c.panel == panel)
    plots = [
        _panels(classic, optics, "the paper's lens as a parabola, 543 nm"),
        _panels(own, optics, f"{loaded.recipe.name}, three depths"),
    ]
    outputs = {
        "table": write_csv(folder / "mtf.csv", ("panel", "curve", "frequency_per_mm", "mtf"), rows),
        "chart": plots[1].save(folder / "mtf.png"),
        "chart of classic apertures": plots[0].save(folder / "mtf-classic.png"),
    }
    shows = page(optics, classic, own, plots)
    return Findings(figures, shows, outputs=outputs, inputs={"camera": loaded.recipe.name})


def _parabolic(mask: Mask) -> Camera:
    lens = PlanoConvexLens(surface_profile="parabolic")
    return Camera.from_recipe(CameraRecipe(name="parabolic", lens=lens, mask=mask))


def page(camera: Camera, classic: Sequence[Curve], own: Sequence[Curve], plots: Sequence[Plot]) -> Page:
    """Transfer functions of the classic masks and of a camera's own.

    plots: of both.
    """
    nyquist = nyquist_per_mm(camera)
    flat = min(curve.least(int(nyquist)) for curve in own)
    keys = (
        Key("least transfer", number(flat, 3), "", f"of {camera.recipe.name}, up to half of Nyquist", True),
        Key("Nyquist frequency", number(nyquist), "cycles/mm", f"of {camera.pixel * 1e6:g} µm pixels"),
    )
    about = (
        "A transfer function without zeros that hardly changes with depth can be undone by one restoration "
        "for all depths. The clear aperture loses whole bands of frequencies out of focus, the coded one "
        "fewer; a cubic mask loses none, at the price of contrast everywhere."
    )
    sections = (
        Section("Classic apertures", (plots[0],)),
        Section(camera.recipe.name, (plots[1],)),
        Section("Means", (_means([*classic, *own], int(nyquist)),)),
    )
    return Page(
        "Modulation transfer",
        "How much contrast of each fineness the optics pass on, in focus and out of it.",
        sections,
        (Keys(keys), Text(about)),
        {"Camera": camera.recipe.name},
    )


def _panels(curves: Sequence[Curve], camera: Camera, what: str) -> Plot:
    """One panel next to another."""
    titles = list(dict.fromkeys(curve.title for curve in curves))
    frequencies, nyquist = frequencies_of(camera).tolist(), nyquist_per_mm(camera)

    def paint(narrow: bool = False) -> Figure:
        count = len(titles)
        figure = new_figure(NARROW_IN if narrow else WIDE_IN, 2.5 * count if narrow else 3.4)
        panels = figure.subplots(*((count, 1) if narrow else (1, count)), sharex=True, sharey=True)
        for place, (axes, title) in enumerate(zip(panels, titles, strict=True)):
            for i, c in enumerate(curve for curve in curves if curve.title == title):
                axes.plot(frequencies, c.values, color=SERIES[i], linestyle=DASHES[i], label=c.name)
            axes.axvline(nyquist, color=MUTED, linewidth=1, linestyle=(0, (2, 2)))
            axes.set_title(title, loc="left")
            axes.set_ylim(0, 1.02)
            axes.set_xlim(0, frequencies[-1])
            if narrow or place == 0:
                axes.set_ylabel("modulation transfer")
            if not narrow or place == count - 1:
                axes.set_xlabel("frequency on the sensor (cycles/mm)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return figure

    return Plot(
        paint,
        alt=f"Modulation transfer functions of {listed(titles)}: {what}.",
        caption=f"Modulation transfer: {what}. Dotted: the sensor's Nyquist frequency, {nyquist:.0f}/mm.",
        paint_narrow=functools.partial(paint, True),
    )


def _means(curves: Sequence[Curve], nyquist: int) -> Table:
    rows = tuple((c.title, c.name, c.mean(nyquist), c.least(nyquist)) for c in curves)
    columns = (
        Column("Aperture"),
        Column("At"),
        Column("mean up to Nyquist", "", 3),
        Column("least up to half of it", "", 3),
    )
    return Table(columns, rows, "Modulation transfer. 0 is what no restoration brings back.")
