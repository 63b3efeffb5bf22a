"""How wide the spectrum of a defocused pupil is, against the paper's figure, and the sampling that follows.

Akpinar et al., section "Optimum Signal Space Analysis": the chirp exp(j Psi s^2 / r^2), |s| <= r, has
frequencies up to w_z = 2 Psi / r by its slope (Eq. `Bandwidth`); its edges add tails. The paper plots the
observed bandwidth over 2 w_z without saying how it was observed. The width that holds 99.9 % of the energy of
the chirp sampled every 30 um on a pupil of 5 mm follows that curve closely at every Psi, and is used here.
"""

from __future__ import annotations

import csv
import math
from importlib import resources
from pathlib import Path

import torch

from ..optics import PAPER_COLOURS, Camera, defocus, sampling_bound
from ..recipe.camera import CameraRecipe
from .drawing import OKABE_ITO, new_figure, save, write_csv

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


def run(out: Path) -> dict[str, float]:
    """Write `bandwidth.csv` and `bandwidth.png` into `out`; return the figures.

    ratio_difference_percent.psi_5_up: the largest difference from the paper's curve for Psi >= 5;
    psi_max: the largest |Psi| of the paper's camera for its three colours between 0.5 m and infinity;
    sampling_bound_um: the pupil sampling it asks for, Eq. `MinSampling`.
    """
    rows = [(psi, bandwidth_ratio(psi), paper) for psi, paper in paper_curve()]
    write_csv(out / "bandwidth.csv", ("psi", "bandwidth_ratio", "bandwidth_ratio_paper"), rows)
    _draw(rows, out / "bandwidth.png")
    camera = Camera.from_recipe(CameraRecipe(name="paper"))
    psi = defocus(camera, PAPER_COLOURS[:, None], torch.tensor([0.0, PAPER_NEAREST]))
    largest = float(psi.abs().max())
    differences = {psi: abs(ratio / paper - 1) * 100 for psi, ratio, paper in rows}
    return {
        "ratio_difference_percent.psi_5_up": max(d for psi, d in differences.items() if psi >= 5),
        "ratio_difference_percent.all": max(differences.values()),
        "psi_max": largest,
        "sampling_bound_um": sampling_bound(camera, largest) * 1e6,
    }


def _draw(rows: list[tuple[float, float, float]], path: Path) -> None:
    figure, [[left, right]] = new_figure(1, 2)
    psi = [row[0] for row in rows]
    left.plot(psi, [row[2] for row in rows], color=OKABE_ITO[1], linewidth=3, alpha=0.5, label="paper")
    left.plot(psi, [row[1] for row in rows], color=OKABE_ITO[0], linewidth=1, label="here")
    left.set(xlabel="defocus Psi (rad)", ylabel="bandwidth / 2 w_z", ylim=(0, 10), xlim=(0, 100))
    left.legend(fontsize=8)
    right.plot(psi, [(row[1] / row[2] - 1) * 100 for row in rows], color=OKABE_ITO[0], linewidth=1)
    right.set(xlabel="defocus Psi (rad)", ylabel="difference (%)", xlim=(0, 100))
    save(figure, path)
