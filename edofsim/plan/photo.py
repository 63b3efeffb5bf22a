"""Which effects a photo of this view through this camera calls for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch

from ..optics import Camera
from ..render.view import View
from .effect import Decision, Plan

LAYER_STEP_PX = 6.0
"""Change of the geometric blur's diameter from one depth layer to the next, in pixels. PSFs in between are
interpolated; over the two dioptres of the paper's scene range its camera gets 12 layers."""
RAYLEIGH = 0.25
"""Waves of path difference that an image shows (Rayleigh's criterion)."""


def plan_photo(view: View, camera: Camera, overrule: Mapping[str, Any] | None = None) -> Plan:
    """Decide on the effects of a photo.

    overrule: settings of `expose` that the user insists on (`method`, `layers`, `occlusion`); None values
    are left to the plan.
    """
    insisted = {name: value for name, value in (overrule or {}).items() if value is not None}
    decisions = [
        _bands(view),
        _layers(view, camera, insisted),
        _occlusion(view, camera, insisted),
        _exact_lens(view, camera),
        _outside(view, camera),
        _noise(camera),
    ]
    settings = {name: value for decision in decisions for name, value in decision[1].items()}
    return Plan(tuple(decision[0] for decision in decisions), {**settings, **insisted})


Choice = tuple[Decision, dict[str, Any]]


def _bands(view: View) -> Choice:
    nm = view.wavelengths * 1e9
    span = f"{nm[0]:.0f} to {nm[-1]:.0f} nm"
    why = f"the view holds {view.bands} bands, {span}, and the lens and the DOE refract each differently"
    return Decision("bands", view.bands > 1, f"{view.bands} bands", why), {}


def _layers(view: View, camera: Camera, insisted: Mapping[str, Any]) -> Choice:
    near, far = float(view.inverse_depth.max()), float(view.inverse_depth.min())
    spread = (near - far) * _blur_per_dioptre(camera)
    layers = 1 if spread < 1e-3 else 2 + math.floor(spread / LAYER_STEP_PX)
    why = (
        "everything lies at one depth: one convolution a band is exact"
        if layers == 1
        else f"depths from {_metres(near)} to {_metres(far)} change the blur by {spread:.1f} pixels"
    )
    chosen = insisted.get("layers", layers)
    decision = Decision(
        "depth layers", layers > 1, f"{chosen} layer{'s'[: chosen > 1]}", why, "layers" in insisted
    )
    return decision, {"layers": layers}


def _occlusion(view: View, camera: Camera, insisted: Mapping[str, Any]) -> Choice:
    edges = _edge_pixels(view, 1 / _blur_per_dioptre(camera))
    hidden = int(view.hidden.sum())
    chosen = "none" if not edges else ("hidden" if hidden else "normalised")
    known = (
        f"{hidden} hidden fragments are known behind them"
        if hidden
        else f"what they hide is not known ({view.metadata.get('hidden', 'no hidden fragments in the view')})"
    )
    why = (
        f"{edges} pixels lie on depth edges; {known}" if edges else "no depth edges: nothing covers anything"
    )
    decision = Decision(
        "occlusion", edges > 0, insisted.get("occlusion", chosen), why, "occlusion" in insisted
    )
    return decision, {"occlusion": chosen}


def _edge_pixels(view: View, gap: float) -> int:
    """Pixels that see two surfaces, or whose neighbour below or to the right is nearer or farther by `gap`
    (1/m), where blurs begin to differ."""
    rows, columns = view.padded_shape
    seen = torch.bincount(view.pixel[~view.hidden], minlength=rows * columns).reshape(rows, columns)
    edge = seen > 1
    depth = view.mean_inverse_depth()
    edge[1:] |= (depth[1:] - depth[:-1]).abs() > gap
    edge[:, 1:] |= (depth[:, 1:] - depth[:, :-1]).abs() > gap
    return int(edge.sum())


def _exact_lens(view: View, camera: Camera) -> Choice:
    exact = camera.recipe.lens.thickness == "exact"
    r, radius = camera.aperture_radius, camera.radius_of_curvature
    beyond_parabola = radius - math.sqrt(radius**2 - r**2) - r**2 / (2 * radius)
    wavelength = float(view.wavelengths.double().mean())
    waves = (float(camera.glass.index(wavelength)) - 1) * beyond_parabola / wavelength
    why = (
        f"the sphere departs from its parabola by {waves:.2f} waves at the rim of the aperture, "
        f"{'above' if waves > RAYLEIGH else 'below'} Rayleigh's quarter"
    )
    return Decision("exact lens", waves > RAYLEIGH, "exact sag" if exact else "parabola", why, not exact), {}


def _outside(view: View, camera: Camera) -> Choice:
    reach = camera.recipe.psf.window_px // 2
    margin = round(view.margin * view.pixel_angle / camera.pixel_angle)  # a thumbnail has coarser pixels
    why = f"a PSF reaches {reach} pixels; the view holds {margin} beyond the frame"
    return Decision("light from outside the frame", True, f"{min(reach, margin)} px margin", why), {}


def _noise(camera: Camera) -> Choice:
    sigma = camera.read_noise
    why = (
        f"the recipe asks for Gaussian read noise of {sigma:g} of full scale"
        if sigma
        else "the recipe asks for none"
    )
    return Decision("sensor noise", sigma > 0, "Gaussian" if sigma else "none", why), {}


def _blur_per_dioptre(camera: Camera) -> float:
    """Change of the geometric blur's diameter with inverse depth, in pixels a dioptre."""
    return 2 * camera.aperture_radius * camera.sensor_distance / camera.pixel


def _metres(inverse_depth: float) -> str:
    return "infinity" if inverse_depth <= 0 else f"{1 / inverse_depth:.2f} m"
