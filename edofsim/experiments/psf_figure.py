"""PSFs and MTFs of a camera as a picture and as OpenEXR, and a picture of every kind of mask."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from ..core.images import write_exr
from ..core.progress import Progress, silent
from ..optics import Camera, PsfField, best_focus_distance, focus_distance, psf_bank
from ..optics.grid import PupilGrid
from ..optics.lenses.measured import MeasuredLens
from ..optics.masks import Mask, catalogue, mask_amplitude
from ..optics.measured.bank import left_by_mixing
from ..optics.mtf import mtf, strehl
from ..optics.pupil import aperture, transmission
from ..recipe.camera import CameraRecipe
from ..record import write_csv
from ..report import Plot
from ..report.plot import DASHES, SERIES, new_figure, picture_axes

COLOURS_NM = (611.0, 543.0, 482.0)
DEPTHS_M = (0.5, 0.7, 1.0, 1.5, 3.0, math.inf)
PICTURE = 251
"""Samples across the pupil in pictures of masks."""
DARKEST = 1e-4
"""PSFs are drawn as the square root of their values, black below this part of the peak."""


def run(
    camera: Camera,
    out: Path,
    *,
    wavelengths_nm: Sequence[float] = COLOURS_NM,
    depths_m: Sequence[float] = DEPTHS_M,
    device: str = "cpu",
    progress: Progress = silent,
) -> tuple[dict[str, float], dict[str, Path]]:
    """Write `psf.png`, `psf.exr`, `mtf.exr` and `psf.csv` into `out`; return the figures and the files.

    The EXR files hold a channel for each depth and wavelength, `0.5m.543nm`: the PSF as `psf_bank` gives
    it, and the modulus of its two-dimensional transfer function, pixel included, frequency 0 in the middle.
    Figures: truncated_percent.DEPTH.WAVELENGTH, light outside the window; strehl.DEPTH.WAVELENGTH;
    focus_m.paraxial and focus_m.best, what is sharp to rays near the axis and to the whole aperture without
    its mask; transmission_percent, light that the mask lets through.
    """
    wavelengths = torch.tensor(list(wavelengths_nm), dtype=torch.float64) * 1e-9
    inverse_depths = torch.tensor([1 / depth for depth in depths_m], dtype=torch.float64)
    progress(0.0, "point spread functions")
    bank = psf_bank(camera, wavelengths, inverse_depths, device=device)
    bank = replace(bank, source=bank.values.cpu())
    columns = []
    for number, wavelength in enumerate(wavelengths):
        progress(0.3 + 0.3 * number / len(wavelengths), "Strehl ratios")
        if not camera.lens.measured:
            columns.append(strehl(camera, wavelength[None], inverse_depths))
    ratios = torch.cat(columns, 1) if columns else torch.full_like(bank.truncated, math.nan)
    names = [[f"{metres_name(depth)}.{nm:g}nm" for nm in wavelengths_nm] for depth in depths_m]
    transfer = torch.fft.fftshift(torch.fft.fft2(bank.values).abs(), dim=(-2, -1))
    rows = [
        (name, float(bank.truncated[d, b]), float(ratios[d, b]), float(bank.values[d, b].max()))
        for d, row in enumerate(names)
        for b, name in enumerate(row)
    ]
    progress(0.6, "pictures")
    outputs = {
        "PSFs (EXR)": write_psfs(out / "psf.exr", names, bank.values, camera),
        "MTFs (EXR)": write_psfs(out / "mtf.exr", names, transfer, camera),
        "table": write_csv(out / "psf.csv", ("psf", "truncated", "strehl", "peak_pixel"), rows),
        "picture": psfs_plot(camera, bank, list(wavelengths_nm), list(depths_m)).save(out / "psf.png"),
    }
    figures = {f"truncated_percent.{name}": truncated * 100 for name, truncated, _, _ in rows}
    figures |= {f"strehl.{name}": ratio for name, _, ratio, _ in rows if not math.isnan(ratio)}
    at = camera.recipe.focus.wavelength_nm * 1e-9
    if isinstance(camera.lens, MeasuredLens):
        figures |= {f"mixing_percent.{axis}": off for axis, off in left_by_mixing(camera.lens.bank()).items()}
        return figures, outputs
    sharp = {"paraxial": float(focus_distance(camera, at)), "best": best_focus_distance(camera, at)}
    figures |= {f"focus_m.{plane}": metres for plane, metres in sharp.items() if 0 < metres < math.inf}
    return figures | {"transmission_percent": transmission(camera) * 100}, outputs


def gallery(out: Path, progress: Progress = silent) -> Path:
    """Write `masks.png`: every kind of mask with its defaults, its PSF near and far. Returns the path."""
    entries = catalogue()

    def paint() -> Figure:
        figure = new_figure(1.9 * 4, 1.9 * len(entries))
        axes = figure.subplots(len(entries), 4, squeeze=False)
        for number, (row, entry) in enumerate(zip(axes, entries, strict=True)):
            progress(number / len(entries), entry.kind)
            camera = Camera.from_recipe(CameraRecipe(name="gallery", mask=entry.example))
            draw_mask(row[0], camera, entry.example)
            row[0].set_ylabel(entry.kind, fontsize=9)
            bank = psf_bank(camera, [543e-9], [2.0, 1 / 1.3, 0.0], window_px=64)
            for axis, image, depth in zip(
                row[1:], bank.values[:, 0], ("0.5 m", "1.3 m", "infinity"), strict=True
            ):
                draw_psf(axis, image)
                axis.set_title(depth, fontsize=7)
        return figure

    about = "Every kind of mask next to its PSF at 0.5 m, 1.3 m and infinity."
    return Plot(paint, about, about).save(out / "masks.png")


def draw_mask(axis: Axes, camera: Camera, mask: Mask) -> None:
    """Draw a mask in its pupil, seen from the sensor: its height map in um, or what it lets through."""
    grid = PupilGrid(PICTURE, 2 * camera.aperture_radius / PICTURE, camera.aperture_radius)
    regions = aperture(camera, grid).regions
    amplitude, light = mask_amplitude(mask, grid)
    height_map = sum(part * height for part, height in regions if height is not None)
    picture_axes(axis)
    if isinstance(height_map, Tensor) and float(height_map.abs().max()) > 0:
        shown = torch.where(light > 0.5, height_map - height_map[light > 0.5].min(), torch.nan)
        image = axis.imshow((shown * 1e6).numpy(), cmap="viridis")
        bar = axis.figure.colorbar(image, ax=axis, shrink=0.8)
        bar.ax.tick_params(labelsize=6)
        bar.ax.set_title("um", fontsize=6)
    else:
        axis.imshow(amplitude.numpy(), cmap="gray", vmin=0, vmax=1)


def psfs_plot(camera: Camera, bank: PsfField, wavelengths_nm: list[float], depths_m: list[float]) -> Plot:
    """The mask, each PSF over wavelength and depth, and MTFs along four directions."""

    def paint() -> Figure:
        columns = len(depths_m) + 1
        figure = new_figure(1.9 * columns, 2.0 * (len(wavelengths_nm) + 1))
        axes = figure.subplots(len(wavelengths_nm) + 1, columns, squeeze=False)
        for b, nm in enumerate(wavelengths_nm):
            picture_axes(axes[b][0])
            axes[b][0].axis("off")
            for d, depth in enumerate(depths_m):
                axis = axes[b][d + 1]
                draw_psf(axis, bank.values[d, b])
                if b == 0:
                    axis.set_title(metres_name(depth), fontsize=9)
                if d == 0:
                    axis.set_ylabel(f"{nm:g} nm", fontsize=9)
                axis.set_xlabel(f"{float(bank.truncated[d, b]) * 100:.2g} % outside", fontsize=6)
        if not camera.lens.measured:
            draw_mask(axes[0][0], camera, camera.mask)
        axes[0][0].axis("on")
        axes[0][0].set_title(f"{camera.recipe.name}: mask", fontsize=8)
        if len(wavelengths_nm) > 1:
            width = bank.values.shape[-1] * camera.pixel * 1e3
            said = f"windows are\n{width:.3g} mm wide,\nbrightness is the\nsquare root"
            axes[1][0].text(0, 0.5, said, fontsize=7)
        frequencies = torch.linspace(0, 0.5 / camera.pixel, 65, dtype=torch.float64)
        middle = wavelengths_nm[len(wavelengths_nm) // 2]
        for axis, direction in zip(axes[-1], (0, 90, 45, 135), strict=False):
            curves = mtf(camera, middle * 1e-9, bank.inverse_depths, frequencies, angle_deg=direction)
            for index, (depth, curve) in enumerate(zip(depths_m, curves, strict=True)):
                again = index // len(SERIES)  # the same colours with other dashes
                look = {
                    "color": SERIES[index % len(SERIES)],
                    "linestyle": DASHES[(index + again) % len(DASHES)],
                }
                at = (frequencies * 1e-3).numpy()
                axis.plot(at, curve.numpy(), linewidth=1, label=metres_name(depth), **look)
            axis.set_title(f"MTF at {middle:g} nm, {direction} deg", fontsize=7)
            axis.set(ylim=(0, 1), xlim=(0, float(frequencies[-1]) * 1e-3))
            axis.set_xlabel("cycles/mm", fontsize=7)
        axes[-1][0].legend(fontsize=5)
        for axis in axes[-1][4:]:
            axis.axis("off")
        return figure

    about = f"The mask of {camera.recipe.name}, its PSFs by depth and wavelength, and its MTFs."
    return Plot(paint, about, about)


def draw_psf(axis: Axes, psf: Tensor) -> None:
    """Draw a PSF [y, x] by the square root of its values.

    psf: [y, x].
    """
    picture_axes(axis)
    shown = (psf / psf.max()).clamp_min(DARKEST).sqrt().numpy()
    axis.imshow(shown, cmap="magma", vmin=math.sqrt(DARKEST), vmax=1)


def metres_name(depth: float) -> str:
    """Of a depth, in names of channels and figures."""
    return "infinity" if math.isinf(depth) else f"{depth:g}m"


def write_psfs(path: Path, names: list[list[str]], images: Tensor, camera: Camera) -> Path:
    """Write images [depth, band, y, x] as EXR, a channel for each name, with the camera they are of.

    images: [depth, band, y, x].
    """
    channels = {
        name: np.ascontiguousarray(images[d, b].cpu().numpy(), dtype=np.float32)
        for d, row in enumerate(names)
        for b, name in enumerate(row)
    }
    header: dict[str, object] = {
        "camera": camera.recipe.model_dump_json(),
        "pixel_um": camera.pixel * 1e6,
        "transmission": transmission(camera),
    }
    return write_exr(path, channels, header)
