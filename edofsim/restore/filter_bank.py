"""A network conditioned on the optics: it knows how each distance blurs, and asks each place how far it is.

For one distance the best linear restoration follows from the PSFs in closed form. A bank of such filters,
each for a part of the depth range, gives as many restorations of a photo; at each place one is nearly right.
Which one, the photo itself tells: `blur_likelihood` says how well the blur of each distance explains it. The
restorations are weighed by that, and a U-Net of NAFNet's blocks, which knows the weights, mends what a linear
filter leaves. Filters before a network: Yanny et al., Optica 9, 96, 2022 (MultiWienerNet), there for places
with PSFs of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..errors import InputError, first_line
from .blur_likelihood import STEP
from .borders import continued
from .dcnn import DCnn
from .distances import DepthConditioned
from .linear import local_error, local_filters
from .local_unet import Trunk
from .restorer import Restorer

BEYOND = 0.25
"""What a filter leaves so far beyond the range from 0 to 1 is around something brighter than full scale."""

BRIGHTEST = 100.0
"""Times full scale: a transform would spread the rounding of a brighter pixel over all of the photo."""

DESIGNED_PX = 19
"""Pixels across, at most, of the filters that a mask is designed for: the time grows with the sixth power."""

TILE = 120
"""Pixels across of what a filter is applied to at a time, or four times its support where that is more."""

# how much a block's own likelihood counts, and the mean of its neighbours': blocks overlap, and photographs
# are no Gaussian processes
BELIEF = (0.01, 0.05)


class FilterBank(DepthConditioned):
    """Weighs `groups` linear restorations of a photo by how likely their distances are, adds what they do not
    have.

    support: width of the filters in pixels, odd.
    distances: this many for each filter are given apart.
    width, blocks, kernel: of the U-Net, see `LocalUNet`.
    colour_psfs: whether filters and distances follow from what each channel sees of each colour.
    dcnn: settings of the auxiliary `DCnn`, which is not trained with it; None for none. Untaught, it returns
        the photo.

    filters: [groups * 3 out, 3 in, support, support], not trained (`set_filters`).
    """

    kind = "filter-bank"
    psfs = "mean"
    psf_buffers = ("filters", "transfer", "_matrix", "_constant")
    of_one_camera: ClassVar[Sequence[str]] = ("dcnn",)
    """Settings that another bank does not take over when it grows out of one."""

    def __init__(
        self,
        groups: int = 16,
        support: int = 27,
        distances: int = 2,
        width: int = 24,
        blocks: tuple[int, ...] = (1, 2, 2),
        kernel: int = 5,
        dcnn: Mapping[str, object] | None = None,
        colour_psfs: bool = False,
    ) -> None:
        super().__init__()
        if groups < 1 or distances < 1 or support < 1 or support % 2 == 0:
            raise ValueError(f"{groups} groups, {distances} distances, {support} pixels: at least 1, and odd")
        self.groups, self.support, self.colour_psfs = groups, support, colour_psfs
        self.belief = nn.Parameter(torch.tensor(BELIEF).log())
        # pyrefly: ignore[bad-argument-type] - those of its own class
        self.dcnn = None if dcnn is None else DCnn(**dcnn).eval().requires_grad_(False)
        # it gives what filters do not have; with an auxiliary D-CNN it sees its image, too, and says how much
        # it counts
        images, given = (6, 3) if self.dcnn is None else (9, 4)
        self.trunk = Trunk(images, given, width, blocks, kernel, side=groups)
        self._tile = max(TILE, 4 * support)
        self.border = max(support // 2, 0 if self.dcnn is None else self.dcnn.reach)
        self.multiple = max(self.trunk.multiple, STEP)
        seen = 0 if self.dcnn is None else self.dcnn.radius or 0
        self.radius = self.trunk.radius + max(support // 2, self.reach_of_distances, seen)
        # channels last asks for four axes
        self.register_buffer("filters", torch.zeros(groups * 3, 3, support, support))
        self._transferred: tuple[Tensor, Tensor] | None = None
        self._ask_distances(groups * distances)
        if self.dcnn is not None and self.dcnn.distances and self.dcnn.depths != self.depths:
            raise ValueError(
                f"a D-CNN given {self.dcnn.depths} distances, next to filters given {self.depths}"
            )
        point = torch.zeros(groups, 3, 3, support, support)
        point[:, range(3), range(3), support // 2, support // 2] = 1
        self.set_filters(point, torch.ones(self.depths, 3, 1, 1))

    def settings(self) -> dict[str, object]:
        own = {"groups": self.groups, "support": self.support, "distances": self.depths // self.groups}
        dcnn = {} if self.dcnn is None else {"dcnn": self.dcnn.settings()}
        colours = {"colour_psfs": True} if self.colour_psfs else {}
        return {**own, **self.trunk.settings(), **dcnn, **colours}

    @classmethod
    def grown(cls, network: Restorer, settings: Mapping[str, object] | None = None) -> Self:
        """One with the U-Net of another bank, and more blocks or wider filters than that, which at first are
        the identity and not solved for. An auxiliary network is not taken along: it knows one mask. Raises
        InputError for another network, and where the U-Nets do not fit."""
        if not isinstance(network, FilterBank):
            raise InputError(f"a {cls.kind!r} grows out of a 'filter-bank', not out of a {network.kind!r}")
        own = {name: value for name, value in network.settings().items() if name not in cls.of_one_camera}
        try:
            # pyrefly: ignore[bad-argument-type] - those of its own class
            found = cls(**{**own, **(settings or {})})
            found.trunk.load_state_dict(found.trunk.grown(network.trunk))
        except (TypeError, ValueError, RuntimeError) as error:
            raise InputError(f"it does not fit: {first_line(error)}") from None
        found.belief.data.copy_(network.belief)
        return found

    def with_auxiliary(self, network: Restorer) -> Self:
        """The same with a copy of a D-CNN as auxiliary network. Until it is trained, it gives the mean of
        both images where it had none. Raises InputError for another network, and for one that is given other
        distances."""
        if not isinstance(network, DCnn):
            raise InputError(f"the auxiliary network of a {self.kind!r} is a 'dcnn', not a {network.kind!r}")
        try:
            # pyrefly: ignore[bad-argument-type] - those of its own class
            found = type(self)(**{**self.settings(), "dcnn": network.settings()})
        except (TypeError, ValueError) as error:
            raise InputError(f"this D-CNN does not fit this {self.kind!r}: {error}") from None
        own = {name: value for name, value in self.state_dict().items() if not name.startswith("dcnn.")}
        grown = {f"trunk.{name}": value for name, value in found.trunk.grown(self.trunk).items()}
        dcnn = {f"dcnn.{name}": value for name, value in network.state_dict().items()}
        found.load_state_dict({**own, **grown, **dcnn})
        return found.train(self.training)

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        if self.dcnn is not None:
            self.dcnn.eval()
        return self

    def set_psfs(self, psf: Tensor) -> None:
        self.set_filters(local_filters(psf, self.support, self.groups), psf)
        if self.dcnn is not None and self.dcnn.distances:
            self.dcnn.set_psfs(psf)

    def psf_state(self) -> object:
        return super().psf_state(), None if self.dcnn is None else self.dcnn.psf_state()

    def load_psf_state(self, known: object) -> None:
        assert isinstance(known, tuple)
        own, of_dcnn = known
        super().load_psf_state(own)
        if self.dcnn is not None:
            self.dcnn.load_psf_state(of_dcnn)

    def linear_error(self, psf: Tensor, filters: int) -> Tensor:
        return local_error(psf, support=min(self.support, DESIGNED_PX), groups=filters)

    @torch.no_grad()
    def set_filters(self, filters: Tensor, psf: Tensor) -> None:
        """filters: [groups, 3 out, 3 in, support, support], as a convolution of torch takes them.
        psf: [depths, 3, y, x] or [depths, channel, colour, y, x], at the `psf_depths` of a range; each filter
            is for as many of them, in turn.
        """
        self.filters = filters.flatten(0, 1).to(self.filters)  # new ones: others may still hold the old
        self.set_distances(psf)

    def _explain(self) -> None:
        self._transferred = None  # filters that are loaded are other ones in the same place
        super()._explain()

    def forward(self, photo: Tensor) -> Tensor:
        """Photo [batch, 3, y, x], full scale 1, to the sharp image. Clamped to [0, 1] except in training.

        photo: [batch, 3, y, x], full scale 1.

        In use a photo is continued beyond its border (see `borders`); in training its outermost `border`
        pixels, which filters cannot know, should not be judged.
        """
        if self.training:
            return self._restored(self._with_dcnn(photo, 0))
        return self.unclamped(photo).clamp(0, 1)

    def unclamped(self, photo: Tensor) -> Tensor:
        """As in use, without the clamp.

        photo: [batch, 3, y, x], full scale 1.
        """
        # as many pixels as keep the places of the likelihood where they are
        reach = STEP * -(-(self.support // 2) // STEP)
        sharp = self._restored(self._with_dcnn(photo, reach))
        return sharp[..., reach : reach + photo.shape[-2], reach : reach + photo.shape[-1]]

    def _with_dcnn(self, photo: Tensor, reach: int) -> Tensor:
        """The photo continued by this many pixels; in three more channels, as restored by the D-CNN."""
        beyond = continued(photo, reach) if reach else photo
        if self.dcnn is None:
            return beyond
        with torch.no_grad(), torch.autocast(photo.device.type, enabled=False):
            # of a lamp far beyond full scale it would make a halo: it has no logarithm (`compressed`)
            image = self.dcnn.unclamped(photo.clamp_max(1 + BEYOND), rounded=True).to(photo.dtype)
        return torch.cat([beyond, functional.pad(image, (reach,) * 4, mode="replicate")], 1)

    def _restored(self, photo: Tensor) -> Tensor:
        photo, other = self._within(photo).tensor_split([3], 1)
        with torch.autocast(photo.device.type, enabled=False):
            weights = self.weights(photo)
            chosen = (self.filtered(photo) * weights[:, :, None]).sum(1)
        seen = compressed(torch.cat([photo, chosen, other], 1)).contiguous(memory_format=torch.channels_last)
        lacking, share = self.trunk(seen, weights).to(photo.dtype).tensor_split([3], 1)
        sharp = chosen.clamp(-BEYOND, 1 + BEYOND) + lacking
        return sharp if self.dcnn is None else sharp.lerp(other.clamp(-BEYOND, 1 + BEYOND), share.sigmoid())

    def _within(self, photo: Tensor) -> Tensor:
        return photo.clamp(-BRIGHTEST, BRIGHTEST)

    def filtered(self, photo: Tensor) -> Tensor:
        """The photo through every filter, [batch, group, 3, y, x]; its border pixels continue it.

        photo: [batch, 3, y, x].

        Overlap-save, in tiles whose transforms stay in a processor's cache.
        """
        reach, tile = self.support // 2, self._tile
        step = tile - self.support + 1
        rows, columns = photo.shape[-2:]
        down, across = -(-rows // step), -(-columns // step)
        beyond = (reach, reach + across * step - columns, reach, reach + down * step - rows)
        tiles = functional.pad(photo, beyond, mode="replicate").unfold(-2, tile, step).unfold(-2, tile, step)
        seen = torch.fft.rfft2(tiles)[:, :, None]  # [batch, colour, 1, down, across, y, x]
        found = []
        for transfer in self._filters_transfer():
            spectrum = seen[:, 0] * transfer[:, 0, None, None]
            for colour in (1, 2):
                spectrum.addcmul_(seen[:, colour], transfer[:, colour, None, None])
            inside = torch.fft.ifft(spectrum, dim=-2)[..., :step, :]
            inside = torch.fft.irfft(inside, n=tile)[..., :step].transpose(-3, -2)
            found.append(inside.flatten(-4, -3).flatten(-2)[..., :rows, :columns])
        return torch.stack(found, 1)

    def _filters_transfer(self) -> Tensor:
        """Of the filters for one tile, [group, 3 out, 3 in, y, x]."""
        if self._transferred is None or self._transferred[0] is not self.filters:
            # a convolution of torch does not turn its kernel round: neither does the conjugate
            transfer = torch.fft.rfft2(self.filters, s=(self._tile, self._tile)).conj().resolve_conj()
            self._transferred = self.filters, transfer.unflatten(0, (-1, 3))
        return self._transferred[1]

    def weights(self, photo: Tensor) -> Tensor:
        """How much each restoration counts at each pixel, [batch, group, y, x]; they add up to 1.

        photo: [batch, channel, y, x].
        """
        first, second = self.belief.exp()
        depths = self.depth_probability(photo, (first, second))
        return depths.unflatten(1, (self.groups, -1)).sum(2)


def compressed(image: Tensor) -> Tensor:
    """Values far beyond the range from 0 to 1 by their logarithm, so that a network takes them; others as
    they are.

    image: any shape [...].
    """
    within = image.clamp(-BEYOND, 1 + BEYOND)
    excess = image - within
    return within + excess.sign() * excess.abs().log1p()
