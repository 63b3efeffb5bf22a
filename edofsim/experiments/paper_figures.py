"""Figures printed in Akpinar et al., "Learning Wavefront Coding for Extended Depth of Field Imaging"."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

METHODS = ("Cubic", "Elmalem et al.", "Sitzmann et al.", "Proposed")
METHOD_OF: Mapping[str, str] = MappingProxyType(
    {
        "paper-cubic+wiener": "Cubic",
        "rings-dcnn": "Elmalem et al.",
        "fourier-wiener": "Sitzmann et al.",
        "zernike-wiener": "Sitzmann et al.",
        "paper-dcnn": "Proposed",
    }
)
"""Which of our systems stands for which of the paper's."""

TABLE: Mapping[tuple[str, str], tuple[float, float, float, float]] = MappingProxyType(
    {
        ("Scene 1 (USAF chart)", "0.5m"): (14.82, 14.57, 15.16, 28.31),
        ("Scene 1 (USAF chart)", "0.8m"): (18.71, 27.75, 16.72, 31.44),
        ("Scene 1 (USAF chart)", "1m"): (19.10, 29.11, 18.43, 30.00),
        ("Scene 2 (Kodak)", "0.5m"): (20.18, 20.12, 25.45, 30.98),
        ("Scene 2 (Kodak)", "0.8m"): (21.27, 26.04, 27.64, 30.41),
        ("Scene 2 (Kodak)", "1m"): (21.30, 26.48, 29.28, 29.81),
        ("Scene 3 (Kodak)", "0.5m"): (18.95, 19.49, 24.67, 31.33),
        ("Scene 3 (Kodak)", "0.8m"): (19.98, 26.20, 27.43, 31.07),
        ("Scene 3 (Kodak)", "1m"): (20.05, 26.30, 29.20, 30.04),
        ("Average of Kodak's 24", "random"): (17.77, 21.13, 25.64, 26.26),
        ("Average of 100 of BSDS500", "random"): (19.29, 22.43, 25.08, 27.31),
    }
)
"""Table "Quantitative analysis of the DOF extension methods" (`tbl:PSNR`): PSNR in dB of `METHODS`."""

NOISE: Mapping[float, float] = MappingProxyType({0.005: 29.30, 0.009: 28.82, 0.015: 27.95, 0.020: 27.28})
"""Figure `fig:Noise`, one natural image at the green focus: PSNR in dB by sigma_s."""

FABRICATION: Mapping[float, float] = MappingProxyType({20.0: 29.31, 30.0: 29.30, 40.0: 28.07, 50.0: 25.76})
"""Figure `fig:NoiseHmap`, the same image: PSNR in dB by sigma_d in nm."""

DEPTHS_M = (0.5, 1.0, math.inf)
BROADBAND: Mapping[str, Mapping[float, float]] = MappingProxyType(
    {
        "Colorchart": MappingProxyType({0.5: 37.09, 1.0: 35.31, math.inf: 36.46}),
        "Butterfly": MappingProxyType({0.5: 36.55, 1.0: 35.12, math.inf: 35.77}),
    }
)
"""Figure `fig:TestImageMS`, two hyperspectral images: PSNR in dB by depth in metres."""
