"""Pages of the experiments on optics alone: transfer functions, and the bandwidth of defocus."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from ..experiments import bandwidth, mtf
from ..optics import Camera
from .page import Column, Key, Keys, Page, Section, Table, Text
from .plot import DASHES, MUTED, NARROW_IN, SERIES, WIDE_IN, Plot, line_plot, new_figure
from .words import listed, number

CLASSIC = {"clear": "clear aperture", "levin": "coded aperture (Levin et al.)", "cubic": "cubic mask"}


def mtf_page(camera: Camera) -> Page:
    """Transfer functions of the classic masks and of a camera's own."""
    classic, own = mtf.classic_curves(), mtf.camera_curves(camera)
    nyquist = 0.5e-3 / camera.pixel
    named = [(CLASSIC[c.panel], c.label.replace("psi_", "Ψ = "), c.values.tolist()) for c in classic]
    ours = [(c.panel.replace("_", " "), c.label.replace("_", " "), c.values.tolist()) for c in own]
    flat = min(min(values[: int(nyquist // 2) + 1]) for title, _, values in ours)
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
        Section("Classic apertures", (_panels(named, nyquist, "the paper's lens as a parabola, 543 nm"),)),
        Section(camera.recipe.name, (_panels(ours, nyquist, f"{camera.recipe.name}, three depths"),)),
        Section("Means", (_means([*named, *ours], int(nyquist)),)),
    )
    return Page(
        "Modulation transfer",
        "How much contrast of each fineness the optics pass on, in focus and out of it.",
        sections,
        (Keys(keys), Text(about)),
        {"Camera": camera.recipe.name},
    )


def bandwidth_page(figures: Mapping[str, float]) -> Page:
    """The bandwidth of the defocus chirp beside the paper's curve."""
    rows = [(psi, bandwidth.bandwidth_ratio(psi), paper) for psi, paper in bandwidth.paper_curve()]
    psi = [row[0] for row in rows]
    difference = figures["ratio_difference_percent.psi_5_up"]
    keys = (
        Key(
            "from the paper's curve",
            number(difference, 2),
            "%",
            "largest difference for Ψ of 5 and more",
            True,
        ),
        Key("largest defocus", number(figures["psi_max"]), "rad", "of the paper's camera, 0.5 m to infinity"),
        Key("pupil sampling", number(figures["sampling_bound_um"]), "µm", "that it asks for at most"),
    )
    about = (
        "Defocus is a chirp across the pupil; its slope says which frequencies it has, and so how finely the "
        "mask must be sampled (Eq. MinSampling). Its edges add tails: the observed width is that of the band "
        f"which holds {bandwidth.ENERGY:.1%} of the energy."
    )
    curves = line_plot(
        [("the paper", psi, [r[2] for r in rows]), ("here", psi, [r[1] for r in rows])],
        x="defocus Ψ (rad)",
        y="observed over theoretical bandwidth",
        alt=f"Bandwidth over theory against defocus: both curves fall from {rows[0][1]:.1f} towards 1.",
        caption="Observed bandwidth as a multiple of 4Ψ/r.",
        log_y=True,
        width=WIDE_IN,
    )
    apart = line_plot(
        [("difference", psi, [(r[1] / r[2] - 1) * 100 for r in rows])],
        x="defocus Ψ (rad)",
        y="difference from the paper (%)",
        alt=f"Difference from the paper's curve, at most {difference:.1f} % from Ψ = 5 on.",
        caption="How far both are apart.",
        width=WIDE_IN,
    )
    return Page(
        "Bandwidth of defocus",
        "How finely a mask must be sampled for the depth range.",
        (Section("Curves", (curves, apart)),),
        (Keys(keys), Text(about)),
    )


def _panels(curves: Sequence[tuple[str, str, list[float]]], nyquist: float, what: str) -> Plot:
    """Curves (panel, label, values over the frequencies), one panel beside another."""
    titles = list(dict.fromkeys(title for title, _, _ in curves))
    frequencies = mtf.FREQUENCIES_PER_MM.tolist()

    def paint(narrow: bool = False) -> Figure:
        count = len(titles)
        figure = new_figure(NARROW_IN if narrow else WIDE_IN, 2.5 * count if narrow else 3.4)
        panels = figure.subplots(*((count, 1) if narrow else (1, count)), sharex=True, sharey=True)
        for place, (axes, title) in enumerate(zip(panels, titles, strict=True)):
            for i, (_, label, values) in enumerate(c for c in curves if c[0] == title):
                axes.plot(frequencies, values, color=SERIES[i], linestyle=DASHES[i], label=label)
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


def _means(curves: Sequence[tuple[str, str, list[float]]], nyquist: int) -> Table:
    rows = tuple(
        (
            title,
            label,
            sum(values[: nyquist + 1]) / (nyquist + 1),
            min(values[: nyquist // 2 + 1]),
        )
        for title, label, values in curves
    )
    columns = (
        Column("Aperture"),
        Column("At"),
        Column("mean up to Nyquist", "", 3),
        Column("least up to half of it", "", 3),
    )
    return Table(columns, rows, "Modulation transfer. 0 is what no restoration brings back.")
