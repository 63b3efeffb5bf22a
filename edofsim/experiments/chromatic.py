"""What wavelength does to a camera's point spread functions: shape, depth of focus, place, symmetry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..optics import PAPER_COLOURS, focus_distance, psf_bank, response
from ..restore.linear import colour_error
from .systems import NEAREST_PER_M, EvaluatedSystem

DEPTHS_M = (0.5, 1.0, math.inf)
MAP_DEPTHS = 17
BANDS_M = torch.arange(420, 721, 10, dtype=torch.float64) * 1e-9


@dataclass(frozen=True)
class Chromatic:
    """Of a camera with its mask as designed, at the depths of `DEPTHS_M`.

    wavelengths: [band] metres.
    difference: [depth, band], relative L2 distance of each PSF from that of the nearest of the three colours
        of the training, ||h - h0|| / ||h0||.
    transfer, lens_transfer: [inverse depth, band], root mean square of the modulation transfer over the
        sensor's frequencies (by Parseval the root of the sum of squares of the PSF), with the mask and
        without.
    inverse_depths: [inverse depth] 1/m.
    focus: [band], inverse distance in 1/m that is sharp for the lens.
    centroid_um: [depth, band, 2], x to the right and y down on the sensor, from the axis.
    asymmetry: [depth, band, 2], half of sum |h - mirrored h|, mirrored left-right and top to bottom: 0 for a
        symmetric PSF, at most 1.
    linear_db: [depth, 2], PSNR of photographs restored by the best linear filter that knows the distance, in
        closed form (`restore.linear.colour_error`), for colours of one wavelength and of all bands, evenly
        lit.
    """

    wavelengths: Tensor
    difference: Tensor
    transfer: Tensor
    lens_transfer: Tensor
    inverse_depths: Tensor
    focus: Tensor
    centroid_um: Tensor
    asymmetry: Tensor
    linear_db: Tensor


def chromatic(system: EvaluatedSystem) -> Chromatic:
    """Measure a system's camera."""
    camera = system.camera
    inverse = [1 / depth for depth in DEPTHS_M]
    values = psf_bank(camera, BANDS_M, inverse).values.double()
    colours = psf_bank(camera, PAPER_COLOURS, inverse).values.double()
    nearest = (BANDS_M[:, None] - torch.as_tensor(PAPER_COLOURS, dtype=torch.float64)[None]).abs().argmin(1)
    known = colours[:, nearest]
    depths = torch.linspace(0, NEAREST_PER_M, MAP_DEPTHS, dtype=torch.float64)
    lens = camera.without_mask()
    seen = torch.einsum("cb,dbyx->dcyx", response(camera, BANDS_M).double(), values)
    errors = [colour_error(psf, groups=len(inverse)).mean(1) for psf in (colours, seen)]
    return Chromatic(
        BANDS_M,
        (values - known).flatten(2).norm(dim=2) / known.flatten(2).norm(dim=2),
        rms_transfer(psf_bank(camera, BANDS_M, depths).values),
        rms_transfer(psf_bank(lens, BANDS_M, depths).values),
        depths,
        1 / focus_distance(camera, BANDS_M),
        centroid(values) * camera.pixel * 1e6,
        asymmetry(values),
        -10 * torch.stack(errors, 1).log10(),
    )


def rms_transfer(psf: Tensor) -> Tensor:
    """Root mean square of the modulation transfer over the frequencies of the sensor, [.., y, x] to [..].

    psf: [..., y, x].
    """
    return psf.double().square().sum((-1, -2)).sqrt()


def centroid(psf: Tensor) -> Tensor:
    """Centre of the light in pixels from the centre pixel, [.., y, x] to [.., 2]: to the right, down.

    psf: [..., y, x].
    """
    inner = _centred(psf)
    size = inner.shape[-1]
    offset = torch.arange(size, dtype=psf.dtype) - size // 2
    total = inner.sum((-1, -2))
    across = (inner.sum(-2) * offset).sum(-1) / total
    down = (inner.sum(-1) * offset).sum(-1) / total
    return torch.stack([across, down], dim=-1)


def asymmetry(psf: Tensor) -> Tensor:
    """Half the sum of |h - mirrored h|, over the light, [.., y, x] to [.., 2]: left-right, top-bottom.

    psf: [..., y, x].
    """
    inner = _centred(psf)
    total = 2 * inner.sum((-1, -2))
    sides = [(inner - inner.flip(axis)).abs().sum((-1, -2)) / total for axis in (-1, -2)]
    return torch.stack(sides, dim=-1)


def _centred(psf: Tensor) -> Tensor:
    """As many pixels on each side of the centre pixel, n // 2: an even window has one more before it."""
    return psf[..., 1:, 1:] if psf.shape[-1] % 2 == 0 else psf
