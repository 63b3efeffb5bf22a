"""Restorers of deepinv, which need no download, as entries: given one PSF, the mean over the depth range.

Their weights are the best of a few on every fourth photo of `tiny`. Beyond the border there are mirror
images; deepinv takes what it is given for one period.
"""

from __future__ import annotations

from collections.abc import Callable

import deepinv
import torch
from torch import Tensor

from ..core.images import mirrored

USES = ("psf", "depth range")
TRAINED_ON = "nothing; a weight chosen on five photos of `tiny`"
BEYOND_PX = 32
SMOOTHNESS, VARIATION = 1e-3, 3e-4
"""Weights of the Laplacian, and of the total variation."""
STEP, ROUNDS, INNER = 100.0, 20, 10
"""Of Douglas-Rachford splitting, and the denoiser's rounds in each of its own."""


def deepinv_wiener(photo: Tensor, psfs: Tensor, info: object) -> Tensor:
    """Wiener-Hunt deconvolution: least squares, with a penalty on the image's Laplacian.

    photo: [3, y, x], linear, full scale 1.
    psfs: [depth, 3, y, x].
    """
    return _restored(photo, psfs, deepinv.models.WienerDeconvolution(SMOOTHNESS, "laplacian"))


def deepinv_tv(photo: Tensor, psfs: Tensor, info: object) -> Tensor:
    """Least squares, with a penalty on the image's total variation, by Douglas-Rachford splitting.

    photo: [3, y, x], linear, full scale 1.
    psfs: [depth, 3, y, x].
    """
    how = {"lambda_reg": VARIATION, "stepsize": STEP, "max_iter": ROUNDS}
    prior, fidelity = deepinv.optim.TVPrior(n_it_max=INNER), deepinv.optim.L2()
    return _restored(photo, psfs, deepinv.optim.DRS(fidelity, prior=prior, **how))


def _restored(photo: Tensor, psfs: Tensor, model: Callable[..., Tensor]) -> Tensor:
    rows, columns = (mirrored(torch.arange(-BEYOND_PX, n + BEYOND_PX), n) for n in photo.shape[-2:])
    mean = psfs.mean(0)[None]  # a convolution of deepinv has its middle at n // 2, as PSFs have
    size = (len(photo), len(rows), len(columns))
    over = [max(0, have - room) for have, room in zip(mean.shape[-2:], size[-2:], strict=True)]
    top, left = ((n + 1) // 2 for n in over)
    part = mean[..., top : mean.shape[-2] - top, left : mean.shape[-1] - left]
    physics = deepinv.physics.BlurFFT(img_size=size, filter=part / part.sum((-2, -1), keepdim=True))
    with torch.no_grad():
        image = model(photo[:, rows[:, None], columns][None], physics)[0]
    return image[:, BEYOND_PX:-BEYOND_PX, BEYOND_PX:-BEYOND_PX]
