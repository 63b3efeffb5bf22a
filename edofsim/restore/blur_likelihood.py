"""How well the blur of each distance explains a photo, in closed form.

Through a mask that codes distance, the three colours of an edge are blurred each in its own way. To second
moments a small block of a photo at one distance is a Gaussian process: at every frequency its colours have
the covariance a S H H' + s^2, with H the transfer functions at that distance, S the spectrum of photographs
and their likeness in all colours, a the contrast of the block and s its noise. Neither a nor s is known: the
likelihood is taken at those that explain the block best. After Levin et al., ACM TOG 26, 2007, and Trouve et
al., Applied Optics 52, 2013, who tell distances apart by one channel, and by three.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from .photograph_statistics import colour_spectra, power_spectrum

BLOCK = 32  # pixels across
STEP = 16  # pixels from block to block
LOWEST = 3  # cycles a block: what is coarser leaks from the block's surroundings, and no blur changes it
CONTRASTS = (2e2, 1.5e3, 1e4, 8e4, 6e5)  # a / s^2, from a faint texture to strong edges without noise
FLOOR = 1e-7  # of the variance of noise: what 8-bit values leave of it


def block_transfer(transfer: Tensor) -> Tensor:
    """Every n-th frequency of transfer functions [depth, channel, n * BLOCK, ..]: those of a block.

    transfer: [depth, channel, n * BLOCK, ...], complex.
    """
    step = transfer.shape[-2] // BLOCK
    return transfer[..., ::step, ::step]


def explain(transfer: Tensor, between: int = 1) -> tuple[Tensor, Tensor]:
    """(matrix [contrast * depth, feature], constant [contrast, depth]) that `log_likelihood` needs.

    transfer: complex [depth * between, 3, BLOCK, BLOCK // 2 + 1], see `block_transfer`, or of three colours
        in each channel; this many neighbours stand for one distance, and their covariance is the mean.

    The likelihood's exponent is a sum over frequencies of the inverse covariance times the cross-spectra of
    the colours: a product of a matrix with the features of a block.
    """
    used = _used(transfer.device)
    noise = torch.eye(3, dtype=torch.float64, device=transfer.device)
    signal = colour_spectra(transfer.to(torch.complex128))[0] * power_spectrum(BLOCK, noise)
    signal = signal[..., used].movedim(-1, 1).unflatten(0, (-1, between)).mean(1)
    covariance = torch.stack([contrast * signal + noise for contrast in CONTRASTS])
    inverse = torch.linalg.inv(covariance)
    matrix = _real(inverse, twice=True).flatten(2).flatten(0, 1)
    constant = torch.linalg.slogdet(covariance)[1].sum(-1)
    return matrix.to(torch.float32), constant.to(torch.float32)


def log_likelihood(photo: Tensor, matrix: Tensor, constant: Tensor) -> Tensor:
    """The logarithm of the likelihood of each distance, [batch, depth, row, column], but for a constant.

    photo: [batch, 3, y, x], both sizes multiples of STEP and at least BLOCK; place (i, j) stands for the
        block of which pixel (STEP i, STEP j) is the first.
    matrix: [contrast * depth, feature], from `explain`.
    constant: [contrast, depth], from `explain`.
    """
    used, window = _used(photo.device), torch.hann_window(BLOCK, periodic=False, device=photo.device)
    window = window[:, None] * window
    window = (window / window.square().sum().sqrt()).to(photo.dtype)
    blocks = photo.unfold(-2, BLOCK, STEP).unfold(-2, BLOCK, STEP)  # [batch, 3, row, column, BLOCK, BLOCK]
    blocks = (blocks - blocks.mean((-1, -2), keepdim=True)) * window
    spectrum = torch.fft.rfft2(blocks)[..., used].movedim(1, -1)  # [batch, row, column, frequency, 3]
    features = _real(spectrum[..., :, None] * spectrum[..., None, :].conj()).flatten(3)
    count = 3 * int(used.sum())
    power = (features @ matrix.T).unflatten(-1, constant.shape) + count * FLOOR
    return (-count * power.log() - constant).amax(-2).movedim(-1, 1)


def _used(device: torch.device) -> Tensor:
    """The frequencies that count, bool [BLOCK, BLOCK // 2 + 1]."""
    fy = torch.fft.fftfreq(BLOCK, device=device)[:, None]
    fx = torch.fft.rfftfreq(BLOCK, device=device)
    return fy.square() + fx.square() > (LOWEST / BLOCK) ** 2


def _real(hermitian: Tensor, *, twice: bool = False) -> Tensor:
    """The 9 real numbers of Hermitian 3 x 3 matrices [.., 3, 3]; those off the diagonal twice, so that the
    product of one that is doubled with one that is not is the trace of the matrices' product."""
    first, second = torch.triu_indices(3, 3, 1)
    diagonal = hermitian.diagonal(dim1=-2, dim2=-1).real
    off = hermitian[..., first, second] * (2 if twice else 1)
    return torch.cat([diagonal, off.real, off.imag], -1)


def spread(values: Tensor) -> Tensor:
    """Values at the places of `log_likelihood`, [batch, n, row, column], at each pixel of its photo.

    values: [batch, n, row, column].
    """
    inside = functional.interpolate(values, scale_factor=STEP, mode="bilinear", align_corners=False)
    edge = (BLOCK - STEP) // 2  # of the photo, outside the middles of the outermost blocks
    return functional.pad(inside, (edge,) * 4, mode="replicate")
