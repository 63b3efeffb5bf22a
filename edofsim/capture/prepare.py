"""Depth nodes, PSFs and response of a camera for given views."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera, psf_bank, response, response_curves, sub_aperture_psfs
from ..optics.band_limited import band_limited_nodes
from ..optics.camera import defocus_per_dioptre
from ..optics.field import psfs_on_sensor
from ..optics.psf import BETWEEN
from .band_limit import BandLimit
from .kernels import HeldKernels, Kernels, StreamedKernels, depth_nodes

HELD_BYTES = 1 << 29
"""Largest PSF bank that is held in memory as a whole."""
BLUR_ERROR = 0.01
"""Error of a PSF between depths, as `band_limited_nodes` counts it, for a photo that keeps `FULL` dB."""
FULL = 70.0
SEEN_SHARE = 0.6
"""Least part of a channel's response that must lie within a view's bands."""


def blur_per_dioptre(camera: Camera) -> float:
    """Change of the geometric blur's diameter with inverse depth, in pixels times metres."""
    return 2 * camera.aperture_radius * camera.sensor_distance / camera.pixel


def choose_nodes(
    inverse_depth: Tensor,
    camera: Camera,
    shortest: float,
    layers: int | str,
    tolerance_db: float = 50.0,
) -> Tensor:
    """Depth nodes [node], ascending inverse depths in 1/m, for fragments [fragment].

    shortest: wavelength in metres whose defocus changes fastest.
    """
    return depth_nodes(inverse_depth, layers, defocus_per_dioptre(camera, shortest), tolerance_db)


def fewer_nodes(
    nodes: Tensor, camera: Camera, shortest: float, tolerance_db: float
) -> tuple[Tensor, BandLimit | None]:
    """In place of many nodes of `choose_nodes`, those from which band-limited PSFs at all depths between are
    known, and how light is blurred with them; the same nodes and None where they are no fewer."""
    per_dioptre = defocus_per_dioptre(camera, shortest)
    held = band_limited_nodes(float(nodes[0]), float(nodes[-1]), per_dioptre, BETWEEN)
    if len(held) >= len(nodes):
        return nodes, None
    if len(held) == 1:  # all light is there
        return held.to(nodes.device), None
    return held.to(nodes.device), BandLimit(per_dioptre, BLUR_ERROR * 10 ** ((FULL - tolerance_db) / 20))


def kernels_of(
    camera: Camera,
    wavelengths: Tensor,
    nodes: Tensor,
    window: int,
    *,
    field_step: float | None = None,
    cache: Path | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Kernels:
    """The camera's PSFs at depth nodes: held in memory where they fit, or where gradients must pass them.

    field_step: tangent from the camera's place in the field to those next to it, for what reaches its place
    on the sensor (see `field.psfs_on_sensor`); None: for what leaves its place in the scene."""

    def compute(depths: Tensor) -> Tensor:
        def psfs(seen_by: Camera) -> Tensor:
            how = {"cache": cache, "dtype": dtype, "device": device}
            return psf_bank(seen_by, wavelengths, depths, window_px=window, **how).values

        return psfs(camera) if field_step is None else psfs_on_sensor(camera, field_step, psfs)

    trained = camera.height_map is not None and camera.height_map.requires_grad
    size = nodes.numel() * wavelengths.numel() * window * window * torch.finfo(dtype).bits // 8
    if size <= HELD_BYTES or trained:
        return HeldKernels(compute(nodes), nodes, wavelengths)
    return StreamedKernels(compute, nodes, wavelengths, window)


def kernels_of_sub_apertures(
    camera: Camera,
    wavelengths: Tensor,
    nodes: Tensor,
    window: int,
    across: int,
    *,
    side: int = 1,
    coarsely: bool = False,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Iterator[HeldKernels]:
    """`kernels_of` shared out among `across` x `across` sub-apertures, each held in memory for its turn and
    nowhere else. side, coarsely: see `sub_aperture_psfs`."""
    how = {"window_px": window, "side": side, "coarsely": coarsely, "dtype": dtype, "device": device}
    for values in sub_aperture_psfs(camera, wavelengths, nodes, across, **how):
        yield HeldKernels(values, nodes, wavelengths)


def channel_weights(camera: Camera, wavelengths: Tensor) -> Tensor:
    """What each band adds to each channel: [channel, band], float64, rows summing to 1.

    Raises InputError where a channel's response lies mostly outside the bands: its image would be that of
    other light. One band alone is taken as monochromatic on purpose.
    """
    weights = response(camera, wavelengths)
    curves = response_curves(camera)
    if curves is None or wavelengths.numel() == 1:
        return weights
    at, values = curves
    low, high = float(wavelengths.min()), float(wavelengths.max())
    half = (high - low) / (wavelengths.numel() - 1) / 2
    inside = (at >= low - half) & (at <= high + half)
    share = values[:, inside].sum(1) / values.sum(1)
    lacking = [
        f"{s:.0%} of {name}"
        for name, s in zip(("red", "green", "blue"), share, strict=True)
        if s < SEEN_SHARE
    ]
    if lacking:
        raise InputError(
            f"the view's bands ({low * 1e9:.0f} to {high * 1e9:.0f} nm) hold only {' and '.join(lacking)} of "
            f"the sensor response {camera.recipe.sensor.response!r}, which spans {float(at[0]) * 1e9:.0f} to "
            f"{float(at[-1]) * 1e9:.0f} nm: render more bands, or choose another sensor.response"
        )
    return weights
