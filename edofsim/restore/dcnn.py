"""The deblurring network of Akpinar et al. (their Sec. "Deblurring CNN")."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..errors import InputError
from .bfloat16 import convolved
from .blur_likelihood import STEP
from .borders import continued
from .distances import DepthConditioned
from .restorer import Restorer

KERNELS = 32
DILATIONS = (1, 2, 3, 2, 1)
LEAK = 0.01
PSFS_A_DEPTH = 2  # distances in each part that is distinguished
BELIEF = (0.027, 0.075)
"""How much a block's own likelihood counts, and the mean of its neighbours': what `paper-bank` learned."""
REFINED = 2  # pixels that the transposed convolutions see around them
LITTLE = 0.001
"""Share of what varies in a block that may be left out in use."""
AT_A_TIME = 16
"""Channels: convolutions compute as many together."""


class DCnn(DepthConditioned):
    """Dilated convolution blocks estimate what the photo does not have; it is added, then refined and
    clamped.

    A block is a 3x3 convolution, batch normalisation and a leaky ReLU. A 3x3 convolution gives three
    channels, which are added to the photo; two transposed 3x3 convolutions follow, and the clamp of Eq.
    `Clip`.

    kernels: of each block.
    dilations: of the blocks. The defaults are the paper's: 39,243 weights that see 25 pixels.
    distances: this many parts of the depth range. Of each the last convolution has three channels of its own,
        which are weighed by how likely it is at a place (see `distances`): one filter for all distances
        restores what is near badly.

    The paper does not say how the weights start. The transposed convolutions start as the identity, so
    that the untrained network returns about its input and its clamp is not saturated.
    """

    kind = "dcnn"
    psf_buffers = ("transfer", "_matrix", "_constant")

    def __init__(
        self, kernels: int = KERNELS, dilations: tuple[int, ...] = DILATIONS, distances: int = 0
    ) -> None:
        super().__init__()
        if kernels < 1 or not dilations or min(dilations) < 1 or distances < 0:
            raise ValueError(
                f"{kernels} kernels, dilations {dilations}, {distances} distances: kernels and dilations "
                "from 1 on, distances from 0 on"
            )
        self.kernels, self.dilations, self.distances = kernels, tuple(dilations), distances
        self.reach = sum(self.dilations) + 1  # of the residual
        self.radius = self.reach + REFINED
        if distances:
            self.psfs = "mean"
            self._ask_distances(PSFS_A_DEPTH * distances)
            self.radius += self.reach_of_distances
            self.multiple = STEP
        layers: list[nn.Module] = []
        channels = 3
        for dilation in self.dilations:
            layers += [
                nn.Conv2d(channels, kernels, 3, padding=dilation, dilation=dilation),
                nn.BatchNorm2d(kernels),
                nn.LeakyReLU(LEAK),
            ]
            channels = kernels
        layers.append(nn.Conv2d(channels, 3 * max(1, distances), 3, padding=1))
        self.residual = nn.Sequential(*layers)
        refine = [nn.ConvTranspose2d(3, 3, 3, padding=1) for _ in range(REFINED)]
        for layer in refine:
            nn.init.dirac_(layer.weight)
            assert layer.bias is not None
            nn.init.zeros_(layer.bias)
        self.refine = nn.Sequential(*refine)

    def settings(self) -> dict[str, object]:
        own: dict[str, object] = {}
        if (self.kernels, self.dilations) != (KERNELS, DILATIONS):
            own = {"kernels": self.kernels, "dilations": list(self.dilations)}
        return {**own, **({"distances": self.distances} if self.distances else {})}

    def set_psfs(self, psf: Tensor) -> None:
        self.set_distances(psf)

    def likely(self, photo: Tensor) -> Tensor | None:
        """How likely each part of the depth range is, [batch, distances, y, x]; None where it asks for none.

        photo: [batch, 3, y, x].
        """
        if not self.distances:
            return None
        with torch.no_grad(), torch.autocast(photo.device.type, enabled=False):
            return self.depth_probability(photo, BELIEF).unflatten(1, (self.distances, -1)).sum(2)

    @classmethod
    def grown(cls, network: Restorer, settings: Mapping[str, object] | None = None) -> DCnn:
        """A larger one that at first restores as a smaller one does (Net2Net: Chen et al., ICLR 2016).

        Blocks whose dilations the smaller one does not have hand on what they get, but for the leak; kernels
        that it does not have start at random, and nothing goes by them yet. Raises InputError for another
        network, and for one that is not smaller.
        """
        if not isinstance(network, DCnn):
            raise InputError(f"a {cls.kind!r} grows out of a smaller one, not out of a {network.kind!r}")
        # pyrefly: ignore[bad-argument-type] - those of its own class
        found = cls(**{**network.settings(), **(settings or {})})
        places = _places(network.dilations, found.dilations)
        if places is None or found.kernels < network.kernels or network.distances not in (0, found.distances):
            raise InputError(
                f"a D-CNN of {network.kernels} kernels, dilations {list(network.dilations)} and "
                f"{network.distances} distances does not fit into one of {found.kernels}, "
                f"{list(found.dilations)} and {found.distances}"
            )
        if network.distances:
            found.load_psf_state(network.psf_state())
        with torch.no_grad():
            for index in range(len(found.dilations)):
                _hand_on(found.residual[3 * index], found.residual[3 * index + 1], network.kernels)
            for old, new in enumerate(places):
                for part in (0, 1):
                    _copy_into(network.residual[3 * old + part], found.residual[3 * new + part])
            first, last = network.residual[-1], found.residual[-1]
            assert isinstance(first, nn.Conv2d) and isinstance(last, nn.Conv2d)
            for value, own in zip(last.parameters(), first.parameters(), strict=True):
                value.zero_()
                # what is given of distances is the same for all at first
                own = own.repeat(len(value) // len(own), *[1] * (own.ndim - 1))
                value[tuple(slice(size) for size in own.shape)] = own
            found.refine.load_state_dict(network.refine.state_dict())
        return found

    def forward(self, photo: Tensor) -> Tensor:
        """Photo [batch, 3, y, x], full scale 1, any size, to the sharp image of the same shape in [0, 1].

        photo: [batch, 3, y, x], full scale 1.

        In use a photo is continued beyond its border (see `borders`); in training black lies there.
        """
        sharp = self._sharp(photo, self.likely(photo)) if self.training else self.unclamped(photo)
        return sharp.clamp(0, 1)

    def unclamped(self, photo: Tensor, *, rounded: bool = False) -> Tensor:
        """As in use, without the clamp.

        photo: [batch, 3, y, x], full scale 1.
        rounded: whether its layers hand on bfloat16, where no gradient is asked for and the photo is float32:
            half the time, and an image that differs by 0.001 of full scale (root mean square).
        """
        reach = self.reach + REFINED
        beyond, likely = continued(photo, reach), self.likely(photo)
        if not any(layer.training for layer in self.residual if isinstance(layer, nn.BatchNorm2d)):
            beyond = beyond.contiguous(memory_format=torch.channels_last)
            rounded = rounded and photo.dtype == torch.float32 and not torch.is_grad_enabled()
            return self._by_fixed_statistics(beyond, likely, rounded)
        if likely is not None:
            likely = functional.pad(likely, (reach,) * 4, mode="replicate")
        rows, columns = (slice(reach, reach + size) for size in photo.shape[-2:])
        return self._sharp(beyond, likely)[..., rows, columns]

    def _sharp(self, photo: Tensor, likely: Tensor | None) -> Tensor:
        # the sum is kept in the photo's own precision: its grey levels are finer than bfloat16's
        sharp = photo + _weighed(self.residual(photo), likely).to(photo.dtype)
        with torch.autocast(photo.device.type, enabled=False):
            return self.refine(sharp)

    def _folded(self) -> list[tuple[Tensor, Tensor]]:
        """Weights and biases of all convolutions of the residual, each with the normalisation behind it,
        whose statistics are fixed. In use, channels that hardly vary are left out, and what they are in the
        mean is added to the biases of those that see them."""
        *blocks, last = self.residual
        layers = [*blocks[::3], last]
        found: list[tuple[Tensor, Tensor]] = []
        seen: tuple[Tensor, Tensor, Tensor] | None = None
        for index, convolution in enumerate(layers):
            assert isinstance(convolution, nn.Conv2d) and convolution.bias is not None
            weight, bias = convolution.weight, convolution.bias
            if seen is not None:
                kept, dropped, level = seen
                weight, bias = weight[:, kept], bias + weight[:, dropped].sum((2, 3)) @ level
            if convolution is not last:
                normalisation, following = blocks[3 * index + 1], layers[index + 1]
                assert isinstance(normalisation, nn.BatchNorm2d) and isinstance(following, nn.Conv2d)
                mean, variance = normalisation.running_mean, normalisation.running_var
                assert mean is not None and variance is not None
                factor = normalisation.weight * (variance + normalisation.eps).rsqrt()
                weight, bias = weight * factor[:, None, None, None], (bias - mean) * factor
                bias = bias + normalisation.bias
                if not torch.is_grad_enabled():
                    seen = _hardly_varying(normalisation, following)
                    weight, bias = weight[seen[0]], bias[seen[0]]
            found.append((weight, bias))
        return found

    def _by_fixed_statistics(self, beyond: Tensor, likely: Tensor | None, rounded: bool) -> Tensor:
        """The same of a photo that goes on for `radius` pixels, which become its border and are left out
        layer by layer. Each normalisation, whose statistics are fixed, is folded into the convolution
        before it: fewer passes over memory, the same image but for rounding.

        rounded: whether the layers hand on bfloat16. The first sees the photo as it is: its grey levels are
            finer than bfloat16's.
        """
        *convolutions, last = self._folded()
        seen = beyond
        for (weight, bias), dilation in zip(convolutions, self.dilations, strict=True):
            seen = convolved(seen, weight, bias, dilation)
            seen = functional.leaky_relu_(seen.bfloat16() if rounded else seen, LEAK)
        if likely is not None:
            likely = functional.pad(likely, (REFINED,) * 4, mode="replicate")
        residual = _weighed(convolved(seen, *last).to(beyond.dtype), likely)
        left = self.reach
        sharp = beyond[..., left:-left, left:-left] + residual
        with torch.autocast(beyond.device.type, enabled=False):
            for layer in self.refine:
                assert isinstance(layer, nn.ConvTranspose2d)
                sharp = functional.conv_transpose2d(sharp, layer.weight, layer.bias, padding=2)
        return sharp


def _hardly_varying(normalisation: nn.BatchNorm2d, following: nn.Conv2d) -> tuple[Tensor, Tensor, Tensor]:
    """(channels that vary, those that hardly do, the mean of these behind the leak). How much a channel
    varies is the deviation that its normalisation gives it, times the weights that it goes on with."""
    deviation, bias = normalisation.weight.abs(), normalisation.bias
    varies = deviation * following.weight.square().sum((0, 2, 3)).sqrt()
    least = varies.argsort()
    few = int((varies[least].cumsum(0) <= LITTLE * varies.sum()).sum())
    kept = -(-max(1, len(least) - few) // AT_A_TIME) * AT_A_TIME
    few = max(0, len(least) - kept)
    dropped = least[:few].sort().values
    deviation, bias = deviation[dropped].clamp_min(1e-12), bias[dropped]
    # of a normal distribution: E max(x, leak x) = leak b + (1 - leak) (b Phi(b / d) + d phi(b / d))
    place = bias / deviation
    above = bias * torch.special.ndtr(place) + deviation * (-place.square() / 2).exp() / math.sqrt(
        2 * math.pi
    )
    return least[few:].sort().values, dropped, LEAK * bias + (1 - LEAK) * above


def _weighed(residuals: Tensor, likely: Tensor | None) -> Tensor:
    """Residuals of each distance, [batch, distances * 3, y, x], by how likely it is: [batch, 3, y, x]."""
    if likely is None:
        return residuals
    each = residuals.unflatten(1, (likely.shape[1], 3))
    return (each * likely[:, :, None].to(each.dtype)).sum(1)


def _places(few: Sequence[int], many: Sequence[int]) -> list[int] | None:
    """Where the dilations of a smaller network stand among those of a larger one, the first as the first;
    None where they do not."""
    places: list[int] = []
    for dilation in few:
        first = places[-1] + 1 if places else 0
        if dilation not in many[first:]:
            return None
        places.append(list(many).index(dilation, first))
    return places if places[0] == 0 else None


def _hand_on(convolution: nn.Module, normalisation: nn.Module, kernels: int) -> None:
    """Make a block give its first `kernels` channels as it gets them, whatever else it gets."""
    assert isinstance(convolution, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d)
    assert convolution.bias is not None and normalisation.running_var is not None
    convolution.weight[:kernels] = 0
    middle = range(min(kernels, convolution.in_channels))
    convolution.weight[middle, middle, 1, 1] = 1
    convolution.bias.zero_()
    normalisation.running_var.fill_(1 - normalisation.eps)


def _copy_into(small: nn.Module, large: nn.Module) -> None:
    """The first values of each array of a layer."""
    own, into = small.state_dict(), large.state_dict()
    for name, value in own.items():
        into[name][tuple(slice(size) for size in value.shape)] = value
