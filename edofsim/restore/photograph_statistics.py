"""What photographs have in common: how strong their details are, how alike in all colours, and that spectra
are smooth.

Linear filters, and the likelihood of a blur, need no more than these second moments. Measured on the
photographs of BSDS500's training part and of Sun and Hays, 8-bit values taken as intensities.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

COARSEST_PX = 300.0  # below this frequency the spectrum of photographs is taken as level
FALL = 2.5  # their power spectrum falls with this power of the frequency,
POWER = 2.7e-4  # and this is its size at one cycle a pixel, full scale 1
# correlation of differences between neighbouring pixels
COLOUR_CORRELATION = ((1.0, 0.985, 0.972), (0.985, 1.0, 0.985), (0.972, 0.985, 1.0))


def power_spectrum(size: int, like: Tensor) -> Tensor:
    """Power spectrum of photographs on the half plane of frequencies, [y, x // 2 + 1], for a transform whose
    inverse divides by the number of pixels. After Field, JOSA A 4, 1987: a power of the frequency.

    like: any shape [...]: whose type and device the spectrum has.
    size: pixels along a side.
    """
    fy = torch.fft.fftfreq(size, device=like.device)[:, None]
    fx = torch.fft.rfftfreq(size, device=like.device)[None, :]
    return (POWER * (fy.square() + fx.square() + COARSEST_PX**-2) ** (-FALL / 2)).to(like.dtype)


def transfer_functions(psf: Tensor, size: int) -> Tensor:
    """Transfer functions of PSFs, [depth, channel, size, size // 2 + 1], with a colour axis as theirs.

    psf: [depth, channel, y, x], or of what each channel sees of each colour, [depth, channel, colour, y, x].
    size: period in pixels, at least the PSFs'.

    Light beyond the PSFs' window is veiling glare, the same all over a photo: its mean passes whole.
    """
    window = psf.shape[-1]
    padded = functional.pad(psf, (0, size - window, 0, size - window))
    transfer = torch.fft.rfft2(torch.roll(padded, (-(window // 2), -(window // 2)), (-2, -1)))
    mean = torch.zeros(transfer.shape[-2:], dtype=torch.bool, device=psf.device)
    mean[0, 0] = True
    whole = torch.ones(1) if psf.ndim == 4 else torch.eye(psf.shape[1])
    return torch.where(mean, whole.to(transfer)[..., None, None], transfer)


def smoothest_spectra(wavelengths: Tensor, weights: Tensor) -> Tensor:
    """Linear map [band, channel] from what the channels see to the spectrum that changes least from band to
    band: what has no colour is even, and blue light falls towards red.

    wavelengths: [band], ascending or descending, in any unit.
    weights: [channel, band], the sum of each channel 1.
    """
    bands, channels = len(wavelengths), len(weights)
    steps = wavelengths.double().diff().abs()
    change = torch.eye(bands, dtype=torch.float64).diff(dim=0) / (steps / steps.mean()).sqrt()[:, None]
    seen = weights.double()
    # of spectra with these colours, by Lagrange's multipliers; channels that see alike have no inverse
    system = torch.zeros(bands + channels, bands + channels, dtype=torch.float64)
    system[:bands, :bands] = change.mT @ change
    system[:bands, bands:], system[bands:, :bands] = seen.mT, seen
    return torch.linalg.pinv(system, hermitian=True)[:bands, bands:]


def colour_weights(wavelengths: Tensor, weights: Tensor) -> Tensor:
    """What each channel sees of each colour at each band, [channel * colour, band], where spectra are the
    smoothest: weights of PSFs [depth, channel * colour, y, x].

    wavelengths: [band].
    weights: [channel, band], the sum of each channel 1.
    """
    spectra = smoothest_spectra(wavelengths, weights)
    return (weights[:, None] * spectra.mT.to(weights)).flatten(0, 1)


def colour_spectra(transfer: Tensor) -> tuple[Tensor, Tensor]:
    """Cross-spectra over the power spectrum of photographs: of a photo's channels, [depth, channel, channel,
    y, x], and of the scene's colours with them, [depth, colour, channel, y, x].

    transfer: complex [depth, channel, y, x] or [depth, channel, colour, y, x], of `transfer_functions`.
    """
    alike = torch.tensor(COLOUR_CORRELATION).to(transfer)
    if transfer.ndim == 4:
        alike = alike[..., None, None]
        return transfer[:, :, None] * transfer[:, None].conj() * alike, transfer[:, None].conj() * alike
    seen = torch.einsum("ce,daeyx->dcayx", alike, transfer.conj())
    return torch.einsum("dacyx,dcbyx->dabyx", transfer, seen), seen
