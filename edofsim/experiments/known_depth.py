"""What is in a photo of a plane: the linear restoration that is given the depth and the mask as it was made.

It sees all of the photo and all colours. Where a system that is given nothing has less, its mask is not why:
the photo holds more. A network that knows more of pictures than second moments may have more.
"""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch import Tensor

from ..core.images import mirrored
from ..restore.light import without_glare
from ..restore.photograph_statistics import COLOUR_CORRELATION, power_spectrum, transfer_functions
from .systems import truncated_share


def at_known_depth(photo: Tensor, psf: Tensor, noise: float) -> Tensor:
    """A photo [3, y, x] of a plane through PSFs [3, w, w], restored within [0, 1].

    photo: [3, y, x], full scale 1.
    psf: [3, w, w].

    At each frequency the filter is W = X R^-1, R the covariance of the photo's colours there and X the
    scene's with them, for the statistics of photographs (see `restore.linear.colour_error`). Mirror images
    continue the photo.
    """
    rows, columns = photo.shape[-2:]
    size = next_fast_len(max(rows, columns) + psf.shape[-1], real=True)
    top, left = (size - rows) // 2, (size - columns) // 2
    place = torch.arange(size)
    y, x = mirrored(place - top, rows), mirrored(place - left, columns)
    light = without_glare(photo, truncated_share(psf)).double()
    level = light.mean((-1, -2), keepdim=True)
    within = psf.double() / psf.sum((-1, -2), keepdim=True)
    transfer = transfer_functions(within[None], size)[0].movedim(0, -1)
    scene = power_spectrum(size, within)[..., None, None] * torch.tensor(COLOUR_CORRELATION).to(within)
    with_sharp = scene * transfer.conj()[..., None, :]
    covariance = transfer[..., :, None] * with_sharp + noise**2 * torch.eye(3).to(within)
    seen = torch.fft.rfft2((light - level)[:, y][:, :, x]).movedim(0, -1)
    sharp = (with_sharp @ torch.linalg.solve(covariance, seen)[..., None])[..., 0].movedim(-1, 0)
    restored = torch.fft.irfft2(sharp, s=(size, size))[:, top : top + rows, left : left + columns]
    return (restored + level).clamp(0, 1).to(photo)
