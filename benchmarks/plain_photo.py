"""What a competent user writes: layers in float32, all bands of a layer in one batch of transforms, the
channels summed as spectra. It shares no code with the package, which it is compared with in time and in
image."""

from __future__ import annotations

import torch
from torch import Tensor


def plain_photo(
    radiance: Tensor,
    pixel: Tensor,
    inverse_depth: Tensor,
    shape: tuple[int, int],
    nodes: Tensor,
    psfs: Tensor,
    response: Tensor,
) -> Tensor:
    """Surfaces blurred by the PSFs of their depths, linearly between depth nodes: [channel, y, x] of the
    frame with its margin. Light that leaves it comes in at the other side, and must stay in the margin.

    radiance: [band, surface]; pixel: int64 [surface], row by row in a frame of `shape` (rows, columns);
    inverse_depth: [surface] in 1/m; nodes: [node] in 1/m, ascending, at least two, over all depths;
    psfs: [node, band, y, x], centred at pixel (y // 2, x // 2); response: [channel, band].
    """
    rows, columns = shape
    bands, window = len(radiance), psfs.shape[-1]
    upper = torch.searchsorted(nodes, inverse_depth.to(nodes)).clamp(1, len(nodes) - 1)
    share = (inverse_depth - nodes[upper - 1]) / (nodes[upper] - nodes[upper - 1])
    total = torch.zeros(len(response), rows, columns // 2 + 1, dtype=torch.complex64)
    for node in range(len(nodes)):
        weight = torch.where(upper == node, share, 0.0) + torch.where(upper == node + 1, 1 - share, 0.0)
        which = torch.nonzero(weight).squeeze(1)
        layer = torch.zeros(bands, rows * columns)
        layer.index_add_(1, pixel[which], radiance[:, which] * weight[which].float())
        spectrum = torch.fft.rfft2(layer.reshape(bands, rows, columns))
        spectrum *= torch.fft.rfft2(psfs[node], s=(rows, columns))
        total += torch.einsum("cb,byx->cyx", response.to(spectrum.dtype), spectrum)
    photo = torch.fft.irfft2(total, s=(rows, columns))
    return photo.roll((-(window // 2), -(window // 2)), (-2, -1))
