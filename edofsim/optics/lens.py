"""What an exact spherical surface does beyond the parabola that defocus is counted from."""

from __future__ import annotations

import math

from torch import Tensor

from .camera import Camera


def spherical_sag(camera: Camera, radius_squared: Tensor) -> Tensor:
    """Thickness [m] that the lens lacks beyond its parabola, float64, same shape as `radius_squared` [m^2].

    Akpinar et al., Eqs. `spherical` and `paraboliclens`: the exact sag R - sqrt(R^2 - q) minus its parabola
    q / 2R is q^2 / (2 R (R + sqrt(R^2 - q))^2), which is evaluated without subtracting large numbers. The
    parabola itself cancels against propagation and the incoming wave, and what is left of it is Psi
    (`defocus`). Zero for a lens whose recipe asks for the parabola.
    """
    if camera.recipe.lens.thickness == "parabolic":
        return radius_squared * 0
    curvature = camera.radius_of_curvature
    root = (curvature**2 - radius_squared).clamp_min(0).sqrt()
    return radius_squared**2 / (2 * curvature * (curvature + root) ** 2)


def lens_delay(camera: Camera, wavelength: float) -> float:
    """Phase [rad] for each metre of glass: 2 pi (n - 1) / lambda, Akpinar et al., Eq. `dtophi`."""
    return 2 * math.pi / wavelength * (float(camera.glass.index(wavelength)) - 1)


def spherical_slope(camera: Camera, wavelength: float, radii: Tensor) -> Tensor:
    """Slope of the phase of the `spherical_sag` along the radius [rad/m] at `radii` [m], float64."""
    if camera.recipe.lens.thickness == "parabolic":
        return radii * 0
    curvature = camera.radius_of_curvature
    exact = radii / (curvature**2 - radii**2).sqrt()
    return -lens_delay(camera, wavelength) * (exact - radii / curvature)
