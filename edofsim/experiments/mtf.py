"""Modulation transfer functions: the classic masks at three defoci, and a camera's own at three depths.

After two figures of Akpinar et al.: clear, coded and cubic pupil at 543 nm for three values of Psi (section
Problem Formulation), and the camera's mask at three depths in three colours (section Simulations).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..optics import Camera, defocus
from ..optics.masks import Mask
from ..optics.masks.clear import ClearMask
from ..optics.masks.coded import CodedMask
from ..optics.masks.cubic import CubicMask
from ..optics.mtf import mtf
from ..recipe.camera import CameraRecipe, Lens
from .drawing import DASHES, OKABE_ITO, new_figure, save, write_csv

GREEN = 543e-9
PSIS = (0.0, 20.0, 40.0)
MASKS = {"clear": ClearMask(), "levin": CodedMask(), "cubic": CubicMask()}
COLOURS_NM = (611, 543, 482)
DEPTHS_M = (0.5, 1.3, math.inf)
FREQUENCIES_PER_MM = torch.arange(0.0, 121.0, dtype=torch.float64)


@dataclass(frozen=True)
class Curve:
    """One curve: its panel, what it is of, and its MTF [frequency]."""

    panel: str
    label: str
    values: Tensor


def classic_curves() -> list[Curve]:
    """Clear, coded and cubic pupil for three values of Psi at 543 nm, with the paper's lens as a parabola."""
    curves = []
    for name, mask in MASKS.items():
        camera = _parabolic(mask)
        at_infinity = float(defocus(camera, GREEN, 0.0))
        per_dioptre = math.pi / GREEN * camera.aperture_radius**2
        depths = [(psi - at_infinity) / per_dioptre for psi in PSIS]
        values = mtf(camera, GREEN, depths, FREQUENCIES_PER_MM * 1e3)
        curves += [Curve(name, f"psi_{psi:g}", row) for psi, row in zip(PSIS, values, strict=True)]
    return curves


def camera_curves(camera: Camera) -> list[Curve]:
    """The camera's own mask and lens at three depths for its three colours."""
    inverse_depths = [1 / depth for depth in DEPTHS_M]
    curves = []
    for nm in COLOURS_NM:
        values = mtf(camera, nm * 1e-9, inverse_depths, FREQUENCIES_PER_MM * 1e3)
        labels = ("infinity" if math.isinf(depth) else f"{depth:g}_m" for depth in DEPTHS_M)
        curves += [Curve(f"{nm}_nm", label, row) for label, row in zip(labels, values, strict=True)]
    return curves


def run(out: Path, camera: Camera) -> dict[str, float]:
    """Write `mtf.csv` and `mtf.png` into `out`; return the figures.

    mean_mtf.PANEL.CURVE: mean from 0 to the sensor's Nyquist frequency; least_mtf.PANEL: the smallest value
    up to half of it over the panel's curves (0 is what no deconvolution brings back).
    """
    curves = [*classic_curves(), *camera_curves(camera)]
    header = ("panel", "curve", "frequency_per_mm", "mtf")
    frequencies = FREQUENCIES_PER_MM.tolist()
    write_csv(
        out / "mtf.csv",
        header,
        (
            (c.panel, c.label, f, v)
            for c in curves
            for f, v in zip(frequencies, c.values.tolist(), strict=True)
        ),
    )
    _draw(curves, camera, out / "mtf.png")
    nyquist = int(0.5e-3 / camera.pixel)
    figures = {f"mean_mtf.{c.panel}.{c.label}": float(c.values[: nyquist + 1].mean()) for c in curves}
    for panel in dict.fromkeys(curve.panel for curve in curves):
        figures[f"least_mtf.{panel}"] = min(
            float(c.values[: nyquist // 2 + 1].min()) for c in curves if c.panel == panel
        )
    return figures


def _parabolic(mask: Mask) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="parabolic", lens=Lens(thickness="parabolic"), mask=mask))


def _draw(curves: list[Curve], camera: Camera, path: Path) -> None:
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    figure, axes = new_figure(2, 3)
    nyquist = 0.5e-3 / camera.pixel
    frequencies = FREQUENCIES_PER_MM.numpy()
    for axis, panel in zip([axis for row in axes for axis in row], panels, strict=True):
        for index, curve in enumerate(c for c in curves if c.panel == panel):
            label = curve.label.replace("psi_", "Psi = ").replace("_", " ")
            look = {"linestyle": DASHES[index], "color": OKABE_ITO[index], "linewidth": 1.2}
            axis.plot(frequencies, curve.values.numpy(), label=label, **look)
        axis.axvline(nyquist, color="0.6", linewidth=0.8)
        axis.text(nyquist, 0.98, " sensor's Nyquist", fontsize=6, color="0.4", va="top")
        own = panel.endswith("_nm")
        name = f"{camera.recipe.name}, {panel.replace('_', ' ')}" if own else f"{panel}, 543 nm"
        axis.set_title(name, fontsize=9)
        axis.set(
            xlabel="frequency (cycles/mm)", ylabel="MTF", ylim=(0, 1), xlim=(0, float(FREQUENCIES_PER_MM[-1]))
        )
        axis.legend(fontsize=7)
    save(figure, path)
