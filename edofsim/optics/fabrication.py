"""From the designed surface to the made one: wrapped, limited, quantised, and with height errors."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import InputError
from ..recipe.fabrication import Fabrication
from .materials import Material


def makes_squares(fabrication: Fabrication) -> bool:
    """Whether the made surface consists of flat squares of its pitch that the pupil has to resolve."""
    return fabrication.pitch_um is not None


def straight_through(exact: Tensor, rounded: Tensor) -> Tensor:
    """The value of `rounded` with the gradient of `exact`.

    exact: any shape [...].
    rounded: the same shape [...].
    """
    return exact + (rounded - exact).detach()


def wave_height(wavelength: float, material: Material) -> float:
    """Height [m] that delays `wavelength` [m] by one wave: lambda / (n - 1)."""
    return wavelength / (float(material.index(wavelength)) - 1)


def unscattered_fraction(wavelengths: Tensor, height_error: float, material: Material) -> Tensor:
    """Fraction of the light [band] that independent height errors leave where the design sends it.

    wavelengths: [band] in metres, float64.
    height_error: standard deviation in metres. exp(-s^2), s the standard deviation of the phase (Goodman,
        *Statistical Optics*, random phase screens).
    material: of the mask.
    """
    return (-(2 * math.pi * (material.index(wavelengths) - 1) * height_error / wavelengths).square()).exp()


def make(designed: Tensor, fabrication: Fabrication, material: Material, seed: int) -> Tensor:
    """The made surface [.., y, x] in metres from the designed one: `made_height` it, and `height_error`.

    designed: [..., y, x], metres.
    fabrication, material: the recipe's, of the mask.
    seed: of the errors.
    """
    surface = made_height(designed, fabrication, material)
    return surface + height_error(surface, fabrication, seed)


def made_height(designed: Tensor, fabrication: Fabrication, material: Material) -> Tensor:
    """The surface [.., y, x] in metres that is meant to be made of the designed one.

    designed: [..., y, x], metres.
    fabrication, material: the recipe's, of the mask.

    In this order: moved so that its lowest point is 0 (a piston changes no intensity), wrapped or limited,
    and quantised. All of it passes gradients straight through.

    Raises InputError where a design is deeper than the limit and no wavelength to wrap at is stated, and
    where not even one wave fits under the limit.
    """
    surface = designed
    if fabrication.height_limit_um is not None or fabrication.levels is not None:
        surface = surface - surface.detach().min()
    if fabrication.height_limit_um is not None:
        limit = fabrication.height_limit_um * 1e-6
        surface = _limit(surface, limit, fabrication, material, trainable=designed.requires_grad)
    if fabrication.levels is not None:
        surface = _quantise(surface, fabrication.levels, fabrication)
    return surface


def height_error(surface: Tensor, fabrication: Fabrication, seed: int) -> Tensor:
    """By how much [m] samples come out too high: by `height_scale`, and each by a Gaussian error.

    surface: [..., y, x], metres.
    fabrication: the recipe's.
    seed: of the errors.

    It is drawn on the CPU in float64, so that a seed means the same surface on every device and in every
    precision.
    """
    scaled = surface * (fabrication.height_scale - 1)
    if not (fabrication.height_noise_nm or fabrication.height_bias_nm):
        return scaled
    generator = torch.Generator().manual_seed(seed)
    error = torch.randn(surface.shape, generator=generator, dtype=torch.float64)
    noise = error * (fabrication.height_noise_nm * 1e-9) + fabrication.height_bias_nm * 1e-9
    return scaled + noise.to(surface)


def _limit(
    surface: Tensor, limit: float, fabrication: Fabrication, material: Material, trainable: bool
) -> Tensor:
    depth = float(surface.detach().max())
    if depth <= limit * (1 + 1e-9):
        return surface
    if fabrication.wrap_wavelength_nm is None:
        if trainable:
            return straight_through(surface, surface.clamp(0, limit))
        raise InputError(
            f"the mask is {depth * 1e6:.3g} um deep, fabrication.height_limit_um allows"
            f" {fabrication.height_limit_um:g}; state fabrication.wrap_wavelength_nm to wrap it, or design it"
            " flatter"
        )
    wave = wave_height(fabrication.wrap_wavelength_nm * 1e-9, material)
    waves = math.floor(limit / wave)
    if waves < 1:
        raise InputError(
            f"fabrication.height_limit_um = {fabrication.height_limit_um:g} is below one wave of"
            f" {fabrication.wrap_wavelength_nm:g} nm in {material.name} ({wave * 1e6:.3g} um), so the mask"
            " cannot be wrapped; raise the limit or wrap at a shorter wavelength"
        )
    return straight_through(surface, torch.remainder(surface, waves * wave))


def _quantise(surface: Tensor, levels: int, fabrication: Fabrication) -> Tensor:
    steps = levels - 1
    if fabrication.level_nm is not None:
        level = fabrication.level_nm * 1e-9
    else:
        assert fabrication.height_limit_um is not None  # the recipe asks for one of the two
        level = fabrication.height_limit_um * 1e-6 / steps
    return straight_through(surface, (surface / level).round().clamp(0, steps) * level)
