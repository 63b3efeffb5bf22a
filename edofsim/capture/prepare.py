"""Depth nodes and response of a camera for given views."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera, response, response_curves
from ..optics.band_limited import band_limited_nodes
from ..optics.camera import defocus_per_dioptre
from ..optics.psf import INTERPOLATION_ERROR
from .band_limit import BandLimit

DEFOCUS_STEP = 2.5
"""Change of the paper's Psi (Eq. `defocus`) at the shortest wavelength from one node to the next, in radians,
for 50 dB when the number of layers is left to us. Linear interpolation between PSFs errs with its square."""
BLUR_ERROR = 0.01
"""Error of a PSF between depths, as `band_limited_nodes` counts it, for a photo that keeps `FULL` dB."""
FULL = 70.0
SEEN_SHARE = 0.6
"""Least part of a channel's response that must lie within a view's bands."""


def blur_per_dioptre(camera: Camera) -> float:
    """Change of the geometric blur's diameter with inverse depth, in pixels times metres."""
    return 2 * camera.aperture_radius * camera.sensor_distance / camera.pixel


def fewer_nodes(
    nodes: Tensor, camera: Camera, shortest: float, tolerance_db: float
) -> tuple[Tensor, BandLimit | None]:
    """In place of many nodes of `depth_nodes`, those from which band-limited PSFs at all depths between are
    known, and how light is blurred with them; the same nodes and None where they are no fewer.

    nodes: [node], 1/m.
    camera: its aperture.
    shortest: wavelength, metres.
    tolerance_db: PSNR that the photo is to have.
    """
    per_dioptre = defocus_per_dioptre(camera, shortest)
    held = band_limited_nodes(float(nodes[0]), float(nodes[-1]), per_dioptre, INTERPOLATION_ERROR)
    if len(held) >= len(nodes):
        return nodes, None
    if len(held) == 1:  # all light is there
        return held.to(nodes.device), None
    return held.to(nodes.device), BandLimit(per_dioptre, BLUR_ERROR * 10 ** ((FULL - tolerance_db) / 20))


def depth_nodes(
    inverse_depth: Tensor, layers: int | str, defocus_per_dioptre: float, tolerance_db: float = 50.0
) -> Tensor:
    """Depth nodes for fragments: [node], ascending, equally spaced in inverse depth over what they span.

    inverse_depth: [fragment] in 1/m.
    layers: how many, or "auto" for steps of `DEFOCUS_STEP`, smaller for a higher tolerance.
    defocus_per_dioptre: change of Psi with inverse depth at the shortest wavelength, rad m.
    tolerance_db: PSNR that "auto" aims at.

    A scene with no more depths than layers gets exactly its depths: nothing is interpolated then. Raises
    InputError for fewer than one layer.
    """
    if layers != "auto" and (not isinstance(layers, int) or layers < 1):
        raise InputError(f'{layers!r} depth layers: give a whole number of at least 1, or "auto"')
    values = inverse_depth.detach().double()
    if values.numel() == 0:
        return values.new_zeros(1)
    low, high = (float(end) for end in values.aminmax())
    if low == high:
        return values[:1].clone()
    if layers == "auto":
        step = DEFOCUS_STEP * 10 ** ((50 - tolerance_db) / 40)
        layers = 2 + math.floor((high - low) * defocus_per_dioptre / step)
    # a smooth depth map has as many depths as pixels: a few from all over it tell, without sorting all
    sample = torch.unique(values[:: max(1, values.numel() // (4 * layers))])
    if sample.numel() <= layers:
        distinct = torch.unique(values)
        if distinct.numel() <= layers:
            return distinct
    if layers == 1:
        return values.new_tensor([(low + high) / 2])
    return torch.linspace(low, high, layers, dtype=torch.float64, device=values.device)


def channel_weights(camera: Camera, wavelengths: Tensor) -> Tensor:
    """What each band adds to each channel: [channel, band], float64, rows summing to 1.

    wavelengths: [band], metres.
    camera: the recipe's sensor says which response.

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
