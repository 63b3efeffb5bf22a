"""How wide the spectrum of a defocused pupil is, against the paper's figure, and the sampling that follows.

Akpinar et al., section "Optimum Signal Space Analysis": the chirp exp(j Psi s^2 / r^2), |s| <= r, has
frequencies up to w_z = 2 Psi / r by its slope (Eq. `Bandwidth`); its edges add tails. The paper plots the
observed bandwidth over 2 w_z without saying how it was observed. The width that holds 99.9 % of the energy of
the chirp sampled every 30 um on a pupil of 5 mm follows that curve closely at every Psi, and is used here.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import torch

from ..core.progress import Progress
from ..optics import PAPER_COLOURS, Camera, defocus, sampling_bound
from ..recipe.camera import CameraRecipe
from ..record import write_csv
from ..report import Key, Keys, Page, Plot, Section, Text, line_plot
from ..report.plot import WIDE_IN
from ..report.words import number
from .experiment import Findings, in_paper

RADIUS = 2.5e-3
PITCH = 30e-6
ENERGY = 0.999
TRANSFORM = 1 << 16
PAPER_NEAREST = 2.0  # 1/m


def occupied_bandwidth(psi: float) -> float:
    """Width [rad/m] of the band around 0 that holds 99.9 % of the energy of the chirp of `psi` [rad]."""
    samples = math.ceil(2 * RADIUS / PITCH)
    position = (torch.arange(samples, dtype=torch.float64) - (samples - 1) / 2) * (2 / samples)
    phase = psi * position**2
    spectrum = torch.fft.fft(torch.polar(torch.ones_like(phase), phase), TRANSFORM).abs() ** 2
    # symmetric: energy up to each frequency, counted from 0 upwards
    half = spectrum[: TRANSFORM // 2].clone()
    half[0] /= 2
    share = half.cumsum(0) / half.sum()
    index = int((share < ENERGY).sum())
    step = 2 * math.pi / (TRANSFORM * 2 * RADIUS / samples)
    return 2 * index * step


def bandwidth_ratio(psi: float) -> float:
    """`occupied_bandwidth` over the theoretical 2 w_z = 4 Psi / r."""
    return occupied_bandwidth(psi) * RADIUS / (4 * psi)


def paper_curve() -> list[tuple[float, float]]:
    """(Psi, ratio) of the paper's figure, without its first point, which is infinite."""
    path = resources.files("edofsim.optics") / "data" / "chirp_bandwidth.csv"
    rows = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    return [(float(row["psi"]), float(row["bandwidth_ratio"])) for row in rows if float(row["psi"]) > 0]


@in_paper(lambda paper: {})
def run(folder: Path, progress: Progress) -> Findings:
    """Compare defocus bandwidth with the paper.

    Paper, Fig. 6.

    Figures: ratio_difference_percent.{psi_5_up,all}, the largest difference from the paper's curve;
    psi_max, the largest |Psi| of the paper's camera for its three colours between 0.5 m and infinity;
    sampling_bound_um, the pupil sampling it asks for, Eq. MinSampling.
    """
    rows = [(psi, bandwidth_ratio(psi), paper) for psi, paper in paper_curve()]
    camera = Camera.from_recipe(CameraRecipe(name="paper"))
    psi = defocus(camera, PAPER_COLOURS[:, None], torch.tensor([0.0, PAPER_NEAREST]))
    largest = float(psi.abs().max())
    differences = {psi: abs(ratio / paper - 1) * 100 for psi, ratio, paper in rows}
    figures = {
        "ratio_difference_percent.psi_5_up": max(d for psi, d in differences.items() if psi >= 5),
        "ratio_difference_percent.all": max(differences.values()),
        "psi_max": largest,
        "sampling_bound_um": sampling_bound(camera, largest) * 1e6,
    }
    curves, header = _curves(rows), ("psi", "bandwidth_ratio", "bandwidth_ratio_paper")
    outputs = {
        "table": write_csv(folder / "bandwidth.csv", header, rows),
        "chart": curves.save(folder / "bandwidth.png"),
    }
    return Findings(figures, page(figures, rows, curves), outputs=outputs)


def page(figures: Mapping[str, float], rows: Sequence[tuple[float, float, float]], curves: Plot) -> Page:
    """The bandwidth of the defocus chirp next to the paper's curve."""
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
        f"which holds {ENERGY:.1%} of the energy."
    )
    apart = line_plot(
        [("difference", [r[0] for r in rows], [(r[1] / r[2] - 1) * 100 for r in rows])],
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


def _curves(rows: Sequence[tuple[float, float, float]]) -> Plot:
    psi = [row[0] for row in rows]
    return line_plot(
        [("the paper", psi, [r[2] for r in rows]), ("here", psi, [r[1] for r in rows])],
        x="defocus Ψ (rad)",
        y="observed over theoretical bandwidth",
        alt=f"Bandwidth over theory against defocus: both curves fall from {rows[0][1]:.1f} towards 1.",
        caption="Observed bandwidth as a multiple of 4Ψ/r.",
        log_y=True,
        width=WIDE_IN,
    )
