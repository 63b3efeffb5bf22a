"""Wiener deconvolution: the linear restoration that the networks are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..core.images import mirrored
from ..errors import InputError
from .borders import continued
from .photograph_statistics import FALL

BEYOND_PX = 4
"""The filter is given so much of what may lie beyond a photo, see `borders`, before mirror images go on.
Those alone leave lines on borders that bright things lie beyond. Farther out the slope predicts little, and
the filter of a lens without a mask, which raises some frequencies a lot, makes more of the guess."""


def wiener(
    image: Tensor,
    psf: Tensor,
    noise: float | Tensor,
    beyond_px: int | None = None,
    shares: Tensor | None = None,
    fall: float = FALL,
) -> Tensor:
    """The linear filter with the least mean square error for an unknown depth.

    image: [.., channel, y, x] linear.
    psf: [channel, y, x], or [depth, channel, y, x] where the depth is one of several; light that a PSF does
        not have of 1 is veiling glare; its centre is index n // 2.
    noise: scalar [] or [channel]: standard deviation relative to full scale.
    beyond_px: pixels that the image is continued by beyond its border, before its mirror images go on; None
        for `BEYOND_PX`.
    shares: [depth], how likely each depth is, with the sum 1, see `optics.nodes.node_shares`; None where all
        are alike.
    fall: power of the frequency with which the scene's spectrum falls.

    Returns the image's shape.

    With H the transfer function, S the power spectrum of the scene and N that of the noise,
    W = E[H*] S / (E[|H|^2] S + N): the classical filter (Goodman, *Introduction to Fourier Optics*, sec. 8)
    with the mean PSF above, and below the line what depth adds to it. S falls with a power of the
    frequency, as natural images do (Field, JOSA A 4, 1987); its level is read off the photo.

    Raises InputError where channels differ or the noise is negative.
    """
    stack = psf if psf.ndim == 4 else psf[None]
    _check(image, stack, noise)
    photo = _Continued.of(image, stack.shape[-2:], beyond_px)
    mean, power = _transfer(stack, *photo.shape, shares)
    return photo.filtered(mean.conj() / (power + _noise_to_signal(photo, power, noise, fall)))


def wiener_by_depth(
    image: Tensor,
    psfs: Tensor,
    inverse_depths: Tensor,
    depth_map: Tensor,
    noise: float | Tensor,
    beyond_px: int | None = None,
) -> Tensor:
    """Wiener deconvolution where the depth of each pixel is known.

    Each node of depth has a filter of its own, W = H* S / (|H|^2 S + N), and its image counts by the hat
    weights of the pixels' depths between the nodes. One image is held at a time, however many nodes there
    are; those that no pixel is near are left out. What a blur mixes at depth edges comes back as rings there.

    image: [channel, y, x], linear.
    psfs: [depth, channel, y, x] at the nodes; see `wiener`.
    inverse_depths: of the nodes, [depth], 1/m, ascending, see `optics.nodes.nodes_between`.
    depth_map: inverse depth of what each pixel shows, [y, x], 1/m; beyond the nodes the nearest one counts.
    noise: scalar [] or [channel]: standard deviation relative to full scale.
    beyond_px: see `wiener`.

    Returns [channel, y, x]. Raises InputError as `wiener`, and for depths that do not fit.
    """
    _check(image, psfs, noise)
    nodes = inverse_depths.to(image.device, torch.float64)
    if nodes.shape != psfs.shape[:1] or bool((nodes.diff() <= 0).any()):
        raise InputError(
            f"Wiener filter by depth: PSFs {list(psfs.shape)} and inverse depths {list(nodes.shape)} do not "
            "fit; give one inverse depth for each, ascending"
        )
    if depth_map.shape != image.shape[-2:] or not bool(torch.isfinite(depth_map).all()):
        raise InputError(
            f"Wiener filter by depth: a depth map {list(depth_map.shape)} does not fit an image "
            f"{list(image.shape)}; give one finite inverse depth a pixel"
        )
    place = _between(depth_map.to(nodes), nodes)
    photo = _Continued.of(image, psfs.shape[-2:], beyond_px)
    near = [float(_hat(place, node).mean()) for node in range(len(nodes))]
    # the level of the scene's spectrum is that of the whole photo
    power = _transfer(psfs, *photo.shape, torch.tensor(near))[1]
    ratio = _noise_to_signal(photo, power, noise, FALL)
    found = torch.zeros_like(image)
    for node, (psf, share) in enumerate(zip(psfs, near, strict=True)):
        if share > 0:
            transfer, power = _transfer(psf[None], *photo.shape)
            found += _hat(place, node).to(image) * photo.filtered(transfer.conj() / (power + ratio))
    return found


def _between(depth_map: Tensor, nodes: Tensor) -> Tensor:
    """Where each pixel lies among the nodes, a number from 0 to that of the last, [y, x]."""
    if len(nodes) == 1:
        return torch.zeros_like(depth_map)
    last = torch.searchsorted(nodes, depth_map.contiguous()).clamp(1, len(nodes) - 1)
    step = (depth_map - nodes[last - 1]) / (nodes[last] - nodes[last - 1])
    return last - 1 + step.clamp(0, 1)


def _hat(place: Tensor, node: int) -> Tensor:
    return (1 - (place - node).abs()).clamp_min(0)


def _check(image: Tensor, stack: Tensor, noise: float | Tensor) -> None:
    if stack.ndim != 4 or image.ndim < 3 or stack.shape[1] != image.shape[-3]:
        raise InputError(
            f"Wiener filter: an image {list(image.shape)} and PSFs {list(stack.shape)} do not fit; "
            "give [channel, y, x] and [depth, channel, y, x] with the same channels"
        )
    if not noise >= 0:
        raise InputError(f"Wiener filter: noise must be at least 0, not {noise}")


@dataclass(frozen=True)
class _Continued:
    """A photo with what may lie beyond its border, as one period. spectrum: its transform without its mean
    level [.., channel, 1, 1]; shape: of the period; cut: rows and columns of the photo in what is filtered.
    """

    spectrum: Tensor
    level: Tensor
    shape: tuple[int, int]
    cut: tuple[slice, slice]

    @classmethod
    def of(cls, image: Tensor, psf_shape: Sequence[int], beyond_px: int | None) -> _Continued:
        beyond_px = BEYOND_PX if beyond_px is None else beyond_px
        padded, corner = _reflected(continued(image, beyond_px), max(psf_shape))
        level = padded.mean((-2, -1), keepdim=True)
        # the PSFs' centre is not at their first pixel
        first = [start + beyond_px - size // 2 for start, size in zip(corner, psf_shape, strict=True)]
        rows, columns = (slice(n, n + size) for n, size in zip(first, image.shape[-2:], strict=True))
        shape = padded.shape[-2], padded.shape[-1]
        return cls(torch.fft.rfft2(padded - level), level, shape, (rows, columns))

    def filtered(self, transfer: Tensor) -> Tensor:
        """The photo through a filter [channel, y, x // 2 + 1]. Its mean level passes whole: what leaves a
        PSF's window is veiling glare over all of the photo."""
        return (torch.fft.irfft2(self.spectrum * transfer, s=self.shape) + self.level)[..., *self.cut]


def _reflected(image: Tensor, reach: int) -> tuple[Tensor, tuple[int, int]]:
    """The image and its mirror images, at least `reach` pixels on each side, as one period of a periodic
    image without a jump; and where the image begins in it."""
    rows, columns = (n * 2 * -(-(n + 2 * reach) // (2 * n)) for n in image.shape[-2:])
    top, left = (rows - image.shape[-2]) // 2, (columns - image.shape[-1]) // 2
    y = mirrored(torch.arange(-top, rows - top, device=image.device), image.shape[-2])
    x = mirrored(torch.arange(-left, columns - left, device=image.device), image.shape[-1])
    return image[..., y[:, None], x[None, :]], (top, left)


def _transfer(stack: Tensor, rows: int, columns: int, shares: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Means over the depths of PSFs [depth, channel, y, x]: of their transfer functions, about their first
    pixel, and of the squares of these; both [channel, rows, columns // 2 + 1]. shares: as in `wiener`. Depth
    by depth, as a stack of transfer functions would not fit into a processor's cache."""
    shape = (stack.shape[1], rows, columns // 2 + 1)
    mean = torch.zeros(shape, dtype=torch.promote_types(stack.dtype, torch.complex64), device=stack.device)
    power = torch.zeros(shape, dtype=stack.dtype, device=stack.device)
    weights, total = ([1.0] * len(stack), len(stack)) if shares is None else (shares.tolist(), 1)
    for psf, weight in zip(stack, weights, strict=True):
        if weight > 0:
            transfer = torch.fft.fft(torch.fft.rfft(psf, columns), rows, dim=-2)
            mean.add_(transfer, alpha=weight)
            power.add_(transfer.real.square() + transfer.imag.square(), alpha=weight)
    return mean / total, power / total


def _noise_to_signal(photo: _Continued, power: Tensor, noise: float | Tensor, fall: float) -> Tensor:
    """N / S, [channel, y, x // 2 + 1], for S = c / f^fall.

    c is what the photo itself says where the optics pass it on: the mean of (|Y|^2 - N) f^fall / E|H|^2 over
    the frequencies with E|H|^2 above a tenth of its largest value, which end where the choice matters.
    """
    rows, columns = photo.shape
    fy = torch.fft.fftfreq(rows, dtype=power.dtype, device=power.device)[:, None]
    fx = torch.fft.rfftfreq(columns, dtype=power.dtype, device=power.device)[None, :]
    squared = fy.square() + fx.square()
    falls = squared if fall == 2 else squared ** (fall / 2)
    floor = max(noise**2, torch.finfo(power.dtype).eps) * rows * columns
    passed = power > 0.1 * power.amax((-2, -1), keepdim=True)
    signal = (photo.spectrum.abs().square() - floor) * falls / power.clamp_min(torch.finfo(power.dtype).tiny)
    c = torch.where(passed, signal, 0).sum((-2, -1), keepdim=True) / passed.sum((-2, -1), keepdim=True)
    # an image without contrast has no signal to fit: any positive floor leaves its level untouched
    return floor * falls / c.clamp_min(1e-3 * floor * falls.mean())
