"""A bank of filters for any camera: its network was trained over many, and is set for each new one.

The filters for the parts of a depth range, how likely each part is at a place, and how well each can be
restored at all follow from the PSFs and the sensor's noise (`condition`). What was trained knows none of the
cameras: it sees the photo, what the likely filters make of it, what one filter for the whole range makes of
it, and how much error each of these is expected to leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import torch
from torch import Tensor
from torch.nn import functional

from ..errors import InputError
from .blur_likelihood import BLOCK, block_transfer, explain
from .filter_bank import BEYOND, FilterBank, compressed
from .light import without_truncated
from .linear import NOISE, colour_error, local_filters
from .local_unet import Trunk
from .photograph_statistics import transfer_functions

if TYPE_CHECKING:
    from .restorer import Restorer

LEAST_NOISE = 5e-4  # a filter that takes a sensor for less makes patterns of rounding
MIDDLE_PSNR, PSNR_SCALE = 27.0, 10.0  # in dB: expected errors come to the network as numbers around 0
MIDDLE_NOISE = -2.3  # its logarithm to base 10
EXPECTED_PX = 48  # expected errors are of the middles of PSFs: what is farther out is lost
SHARES = (0.15, 0.5)
"""Of Wiener deconvolution in what is restored, where filters that know each distance are expected to reach
`LITTLE_PSNR` or more, in dB, and where less. The errors of both differ: on pictures and cameras for
validation their mean is better than either, and seldom worse than Wiener deconvolution."""
LITTLE_PSNR = 24.0
SEEN_SHARE = 0.15
"""The same of a network that sees Wiener deconvolution, chosen alike."""
PSFS_A_DEPTH = 3  # PSFs for each distance that is distinguished
BLIND = (1.0, 4.0)  # of the noise, for which there are filters for the whole range: dim photos have more
BRIGHTENED = 0.7
"""Of full scale: so much the brightest place of a dim photo has at most when it is brightened, to be restored
as the photo of a sensor with as much more noise. Filters for its own noise take its contrast for usual."""
LEAST_BRIGHTENED, MOST_BRIGHTENED = 4, 64
MORE_MAPS = 3  # expected error of the likely filters, that of one filter for all, the noise


@dataclass(frozen=True)
class Conditioning:
    """What a bank knows of a camera.

    filters: [(groups + blind) * 3 out, 3 in, support, support], the last for the whole range, see `BLIND`.
    matrix, constant: of `blur_likelihood.explain`.
    expected: [groups + 1], PSNRs that filters without bounds reach, as the network takes them.
    noise: its standard deviation.
    """

    filters: Tensor
    matrix: Tensor
    constant: Tensor
    expected: Tensor
    noise: float


class CameraBank(FilterBank):
    """A `FilterBank` whose network fits any camera. Until it is set for one, it takes photos for sharp ones.

    groups, support, distances, width, blocks, kernel: see `FilterBank`.
    linear: whether the U-Net sees what Wiener deconvolution makes of the photo: its photos have three more
        channels then, which hold that.
    """

    kind = "camera-bank"
    any_camera = True
    of_one_camera = (*FilterBank.of_one_camera, "colour_psfs")

    def __init__(
        self,
        groups: int = 16,
        support: int = 27,
        distances: int = 2,
        width: int = 24,
        blocks: tuple[int, ...] = (1, 2, 2),
        kernel: int = 5,
        linear: bool = False,
    ) -> None:
        super().__init__(groups, support, distances, width, blocks, kernel)
        self.sees_linear = linear
        self.images = 6 + 3 * len(BLIND) + 3 * linear
        self.trunk = Trunk(self.images, 3, width, blocks, kernel, side=groups + MORE_MAPS)
        # filters of a camera are no part of what was trained
        for name in ("filters", "transfer"):
            value = getattr(self, name)
            delattr(self, name)
            self.register_buffer(name, value, persistent=False)
        self.register_buffer("expected", torch.zeros(groups + 1), persistent=False)
        self.noise = NOISE
        self._given: tuple[Tensor, float] | None = None
        self._brightened: dict[int, CameraBank] = {}
        point = torch.zeros(3, 3, support, support)
        point[range(3), range(3), support // 2, support // 2] = 1
        self.filters = torch.cat([self.filters, *[point] * len(BLIND)])

    @classmethod
    def grown(cls, network: Restorer, settings: Mapping[str, object] | None = None) -> Self:
        """One with the weights of a `FilterBank`, or of one that is not given what Wiener deconvolution
        makes; at first it ignores what that was not given. Raises InputError for another network."""
        if not isinstance(network, FilterBank) or network.sees_linear or network.dcnn is not None:
            more = " with an auxiliary D-CNN" if isinstance(network, FilterBank) and network.dcnn else ""
            raise InputError(
                f"a {cls.kind!r} grows out of a 'filter-bank', not out of a {network.kind!r}{more}"
            )
        return super().grown(network, settings)

    def settings(self) -> dict[str, object]:
        return {**super().settings(), **({"linear": True} if self.sees_linear else {})}

    def psf_depths(self, depth_range: tuple[float, float]) -> Tensor:
        """`PSFS_A_DEPTH` for each distance that it tells apart: the middles of equal parts of the range."""
        low, high = depth_range
        count = PSFS_A_DEPTH * self.depths
        return low + (high - low) * (torch.arange(count, dtype=torch.float64) + 0.5) / count

    def set_psfs(self, psf: Tensor) -> None:
        self.load_psf_state(self.condition(psf, NOISE))

    def set_camera(self, psf: Tensor, noise: float) -> None:
        self.load_psf_state(self.condition(psf, noise))
        self._given = psf.to(torch.float16), noise
        self._brightened.clear()

    def camera_state(self) -> Sequence[Tensor]:
        if self._given is None:
            return ()
        psf, noise = self._given
        numbers = torch.tensor([self.noise, noise], dtype=torch.float64)
        return self.filters, self._matrix, self._constant, self.expected, psf, numbers

    def load_camera_state(self, known: Sequence[Tensor]) -> None:
        filters, matrix, constant, expected, psf, numbers = known
        own, noise = numbers.tolist()
        self.load_psf_state(Conditioning(filters, matrix, constant, expected, own))
        self._given = psf, noise
        self._brightened.clear()

    def brightened_for(self, photo: Tensor) -> tuple[Restorer, float]:
        factor = brightening(photo)
        if factor == 1 or self._given is None:
            return self, 1.0
        psf, noise = self._given
        if factor not in self._brightened:
            other = CameraBank(**self.settings())  # pyrefly: ignore[bad-argument-type] - its own
            other.load_state_dict(self.state_dict())
            other = other.eval().to(self.belief)
            other.load_psf_state(self.condition(psf.to(torch.float64), factor * max(noise, LEAST_NOISE)))
            self._brightened[factor] = other
        return self._brightened[factor], float(factor)

    @torch.no_grad()
    def condition(self, psf: Tensor, noise: float) -> Conditioning:
        """What follows from PSFs and the standard deviation of the noise, relative to full scale.

        psf: [depth, 3, y, x] at `psf_depths`: a filter is for all that lies within its part of the range,
            where the blur may change by pixels.

        Light that leaves their window is taken off a photo before, as much as in the mean over the range;
        what then is left has more contrast, and more noise.
        """
        psf, noise = without_truncated(psf, max(noise, LEAST_NOISE))
        size = BLOCK * -(-psf.shape[-1] // BLOCK)
        transfer = block_transfer(transfer_functions(psf, size))
        matrix, constant = explain(transfer.to(torch.complex64), PSFS_A_DEPTH)
        filters = torch.cat(
            [
                local_filters(psf, self.support, self.groups, noise),
                *(local_filters(psf, self.support, 1, share * noise) for share in BLIND),
            ]
        )
        middle = psf[..., *(_middle(n) for n in psf.shape[-2:])]
        known = colour_error(middle, noise, self.groups).mean(1).unflatten(0, (self.groups, -1)).mean(1)
        blind = colour_error(middle, noise).mean()
        psnr = -10 * torch.cat([known, blind[None]]).clamp_min(1e-6).log10()
        expected = ((psnr - MIDDLE_PSNR) / PSNR_SCALE).to(torch.float32)
        return Conditioning(filters.flatten(0, 1).to(torch.float32), matrix, constant, expected, noise)

    def load_psf_state(self, known: object) -> None:
        """Restore photos of that camera from now on.

        known: a `Conditioning`.
        """
        assert isinstance(known, Conditioning)
        where = self.belief.device
        self.filters, self.expected = known.filters.to(where), known.expected.to(where)
        self._matrix, self._constant = known.matrix.to(where), known.constant.to(where)
        self.noise = known.noise

    def linear_share(self) -> float:
        if self.sees_linear:
            return SEEN_SHARE
        reached = float(self.expected[:-1].mean()) * PSNR_SCALE + MIDDLE_PSNR
        return SHARES[reached < LITTLE_PSNR]

    def _restored(self, photo: Tensor) -> Tensor:
        photo, linear = self._within(photo).tensor_split([3], 1)
        with torch.autocast(photo.device.type, enabled=False):
            weights = self.weights(photo)
            filtered = self.filtered(photo)
            chosen = (filtered[:, : self.groups] * weights[:, :, None]).sum(1)
            blind = filtered[:, self.groups :].flatten(1, 2)
        images = torch.cat([photo, chosen, blind, linear], 1)
        seen = compressed(images).contiguous(memory_format=torch.channels_last)
        restored = self.trunk(seen, torch.cat([weights, self._maps(weights)], 1))
        return chosen.clamp(-BEYOND, 1 + BEYOND) + restored.to(photo.dtype)

    def _maps(self, weights: Tensor) -> Tensor:
        """[batch, 3, y, x], see `MORE_MAPS`."""
        likely = torch.einsum("bgyx,g->byx", weights, self.expected[:-1].to(weights))
        noise = torch.tensor(self.noise).log10() - MIDDLE_NOISE
        constants = torch.stack([self.expected[-1], noise.to(self.expected)]).to(weights)
        return torch.cat(
            [likely[:, None], constants[:, None, None].expand(len(weights), 2, *likely.shape[1:])], 1
        )


def brightening(photo: Tensor) -> int:
    """The largest power of 2 that leaves a photo [3, y, x] at `BRIGHTENED` or below, single pixels apart; 1
    where it is less than `LEAST_BRIGHTENED`.

    photo: [3, y, x], full scale 1.
    """
    brightest = float(functional.avg_pool2d(photo[None], 3, 1, 1).max())
    factor = 1
    while 2 * factor * brightest <= BRIGHTENED and factor < MOST_BRIGHTENED:
        factor *= 2
    return factor if factor >= LEAST_BRIGHTENED else 1


def _middle(size: int) -> slice:
    """The middle EXPECTED_PX of this many pixels, with the centre at half of them."""
    first = max(0, size // 2 - EXPECTED_PX // 2)
    return slice(first, first + min(size, EXPECTED_PX))
