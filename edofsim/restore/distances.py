"""Networks that are given how far each place of a photo is: how likely each distance is there.

That follows from the blur of the photo itself and the PSFs, in closed form (see `blur_likelihood`).
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from .blur_likelihood import BLOCK, STEP, block_transfer, explain, log_likelihood, spread
from .photograph_statistics import transfer_functions
from .restorer import Restorer


class DepthConditioned(Restorer):
    """A network that knows the PSFs of a camera at `depths` distances, and asks a photo which they are.

    transfer: real and imaginary part of the transfer functions of a block,
        [depths * 3, BLOCK, BLOCK // 2 + 1, 2], float16, in the checkpoint; not trained.
    """

    depths: int
    reach_of_distances = 2 * STEP + BLOCK // 2
    """Pixels that count for how far a place is: to the middles of the places around, of their neighbours, and
    to the end of a block."""
    transfer: Tensor
    _matrix: Tensor
    _constant: Tensor

    def _ask_distances(self, depths: int) -> None:
        """Register what is known of this many distances; until `set_distances` all are alike."""
        self.depths = depths
        self.register_buffer(
            "transfer", torch.zeros(depths * 3, BLOCK, BLOCK // 2 + 1, 2, dtype=torch.float16)
        )
        self.register_buffer("_matrix", torch.empty(0), persistent=False)
        self.register_buffer("_constant", torch.empty(0), persistent=False)
        self.register_load_state_dict_post_hook(_loaded)
        self.set_distances(torch.ones(depths, 3, 1, 1))

    def psf_depths(self, depth_range: tuple[float, float]) -> Tensor:
        """The middles of equal parts of the range."""
        low, high = depth_range
        return low + (high - low) * (torch.arange(self.depths, dtype=torch.float64) + 0.5) / self.depths

    @torch.no_grad()
    def set_distances(self, psf: Tensor) -> None:
        """psf: [depths, 3, y, x] at the `psf_depths` of a range, or [depths, channel, colour, y, x]."""
        size = BLOCK * -(-psf.shape[-1] // BLOCK)
        transfer = block_transfer(transfer_functions(psf, size))
        # a new one: others may still hold the old
        self.transfer = torch.view_as_real(transfer).flatten(0, -4).to(self.transfer)
        self._explain()

    def _explain(self) -> None:
        transfer = torch.view_as_complex(self.transfer.float().contiguous())
        colours = len(transfer) // (3 * self.depths)
        transfer = transfer.unflatten(0, (self.depths, 3) if colours == 1 else (self.depths, 3, 3))
        self._matrix, self._constant = explain(transfer)

    def depth_probability(self, photo: Tensor, belief: tuple[Tensor, Tensor] | tuple[float, float]) -> Tensor:
        """How likely each distance is at each pixel of a photo, far ones first, [batch, depth, y, x].

        photo: [batch, 3, y, x].
        belief: scalars []: how much a block's own likelihood counts, and the mean of its neighbours'.
        """
        rows, columns = photo.shape[-2:]
        sizes = [max(BLOCK, -(-n // STEP) * STEP) for n in (rows, columns)]
        padding = (0, sizes[1] - columns, 0, sizes[0] - rows)
        # a highlight outshines what else its block holds
        padded = functional.pad(photo.detach().clamp_max(1), padding, mode="replicate")
        own = log_likelihood(padded, self._matrix.to(photo), self._constant.to(photo))
        around = functional.avg_pool2d(own, 3, 1, 1, count_include_pad=False)
        likely = (belief[0] * own + belief[1] * around).softmax(1)
        return spread(likely)[..., :rows, :columns]


def _loaded(network: DepthConditioned, _: object) -> None:
    network._explain()
