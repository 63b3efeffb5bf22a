"""One call from a photo to a sharp image, whichever way."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import torch
from torch import Tensor

from ..capture.sensor import noise_deviation
from ..optics import Camera, channel_psfs, response
from ..optics.field import Frame
from ..optics.nodes import node_shares, nodes_between
from .checkpoint import Checkpoint
from .conditioning import conditioned_on, refusal
from .highlights import without_highlights
from .light import without_glare, without_truncated
from .network import apply_network
from .places import Method, restored_by_place, step_of
from .restorer import Restorer
from .wiener import wiener

PLACE_BANDS = 12
"""At most, of the PSFs that each place in the field is restored by."""
HIGHLIGHT_NODES = 17
"""Distances that highlights are looked for at, at most; between two of them there is one more."""
HIGHLIGHT_PX = 256
"""Window of the PSFs of highlights, at most."""


def restore(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    checkpoint: Checkpoint | None = None,
    psfs: Tensor | None = None,
    glare: Tensor | None = None,
    truncated: Tensor | None = None,
    frame: Frame | None = None,
    by_place: bool = True,
    highlights: bool = True,
) -> tuple[Tensor, Method]:
    """The sharp image of a photo, without highlights beyond full scale, and what made it.

    image: [channel, y, x] linear, full scale 1.
    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    psfs: [depth, channel, y, x], known ones in place of the camera's; `channel_psfs` at the inverse depths,
        which are nodes then; None where they are still to be made.
    glare: [channel], light that a mask made otherwise spreads evenly over the photo, in addition to what the
        camera's own PSFs do not have.
    truncated: [channel], the part that leaves the windows of the PSFs, where that is known
        (`Photo.truncated`), None for that of the camera's PSFs at the middle of the depths.
    frame: where the photo looks, None: about the optical axis; through a lens that varies over the field each
        place is restored by its own PSFs, after the photo is brought to the light of the axis.
    by_place: False for the PSFs of the one place in the field that the camera looks at.
    highlights: False to restore the photo with its highlights.
    camera: whose PSFs and noise count.
    checkpoint: None for Wiener deconvolution.

    Without a checkpoint, Wiener deconvolution for the wavelengths [band] in metres and all that lies between
    the least and the largest of the inverse depths [depth] in 1/m, each equally likely; `nodes_between` says
    at which it is looked at. A filter bank is conditioned on the wavelengths, see `conditioning`; where a
    network for any camera cannot restore, Wiener deconvolution does, and `Method.reason` says why.
    """
    varies = camera.lens.varies and by_place
    given = Frame.about(image.shape[-2], image.shape[-1], camera) if frame is None else frame
    lamps = 0
    if highlights and len(image) == 3:
        place, known = given if varies else None, psfs is not None
        image, lamps = _within_full_scale(image, camera, wavelengths, inverse_depths, known, place)
    how = {"checkpoint": checkpoint, "glare": glare, "truncated": truncated}
    if not varies:
        sharp, method = _restored_here(image, camera, wavelengths, inverse_depths, psfs=psfs, **how)
        return sharp, replace(method, highlights=lamps)
    nodes = (
        inverse_depths if psfs is not None else nodes_between(camera, wavelengths, *inverse_depths.aminmax())
    )

    few, weights = _fewer_bands(wavelengths, response(camera, wavelengths))

    def one(part: Tensor, there: Camera) -> tuple[Tensor, Method]:
        own = channel_psfs(there, few, nodes, weights=weights)
        return _restored_here(part, there, wavelengths, nodes, psfs=own, **how)

    sharp, method = restored_by_place(image, camera, given, step_of(camera, given, wavelengths, nodes), one)
    return sharp, replace(method, highlights=lamps)


def _within_full_scale(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    nodes: bool,
    frame: Frame | None,
) -> tuple[Tensor, int]:
    """The photo without what highlights have beyond full scale, and their number.

    nodes: whether the inverse depths stand for all between them.
    frame: where the photo looks, through a lens that varies over the field; None for the camera's own place.
    """

    def psfs_of(there: Camera) -> Tensor:
        few, weights = _fewer_bands(wavelengths, response(there, wavelengths))
        known = inverse_depths.double()
        known = known if nodes else nodes_between(there, few, *known.aminmax())
        step = -(-len(known) // HIGHLIGHT_NODES)
        known = torch.cat([known[:-1:step], known[-1:]])
        depths = torch.cat([known, (known[1:] + known[:-1]) / 2]).sort().values
        window = min(HIGHLIGHT_PX, there.recipe.psf.window_px)
        return channel_psfs(there, few, depths, weights=weights, window_px=window)

    @cache
    def everywhere() -> Tensor:
        return psfs_of(camera)

    def psfs(row: float, column: float) -> Tensor:
        return everywhere() if frame is None else psfs_of(camera.seen_at(frame.field(row, column)))

    return without_highlights(image, psfs, noise_deviation(camera))


def _fewer_bands(wavelengths: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Neighbours of bands as one: mean wavelengths, and their weights [channel, band]."""
    at_once = -(-len(wavelengths) // PLACE_BANDS)
    parts = torch.arange(len(wavelengths)).split(at_once)
    light = weights.sum(0) + 1e-12
    means = [float((light[some] @ wavelengths.to(light)[some]) / light[some].sum()) for some in parts]
    shares = torch.stack([weights[:, some].sum(1) for some in parts], 1)
    return torch.tensor(means, dtype=torch.float64), shares


def _restored_here(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    checkpoint: Checkpoint | None,
    psfs: Tensor | None,
    glare: Tensor | None,
    truncated: Tensor | None,
) -> tuple[Tensor, Method]:
    """`restore` of a photo that the camera's place in the field has all the PSFs of."""
    glare = torch.zeros(len(image)) if glare is None else glare
    why = None if checkpoint is None else refusal(checkpoint, camera)
    if checkpoint is None or why is not None:
        psf, shares = _standing(camera, wavelengths, inverse_depths, psfs)
        linear = wiener(without_glare(image, glare), psf.to(image), noise_deviation(camera), shares=shares)
        return linear, Method("Wiener", why or "")
    network = conditioned_on(checkpoint, camera, wavelengths, inverse_depths)
    if truncated is None:
        middle = torch.stack(inverse_depths.double().aminmax()).mean()
        lens = channel_psfs(camera, wavelengths, middle[None])
        truncated = 1 - lens.sum((-1, -2))[0]
    glare = 1 - (1 - glare) * (1 - truncated.to(glare))
    if not network.any_camera:
        return apply_network(network, image, glare=glare), Method(checkpoint.name)
    psf, shares = _standing(camera, wavelengths, inverse_depths, psfs)
    noise = noise_deviation(camera)
    return for_any_camera(network, image, psf.to(image), noise, glare, shares), Method(checkpoint.name)


def _standing(
    camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, psfs: Tensor | None
) -> tuple[Tensor, Tensor]:
    """PSFs [depth, channel, y, x] that stand for the range of inverse depths, and for how much of it each."""
    if psfs is not None:
        return psfs, node_shares(inverse_depths)
    nodes = nodes_between(camera, wavelengths, *inverse_depths.aminmax())
    return channel_psfs(camera, wavelengths, nodes), node_shares(nodes)


def for_any_camera(
    network: Restorer,
    image: Tensor,
    psf: Tensor,
    noise: float,
    glare: Tensor,
    shares: Tensor | None = None,
) -> Tensor:
    """What a network for any camera makes of a photo, with its share of Wiener deconvolution, in [0, 1].

    image: [channel, y, x].
    psf: [depth, channel, y, x], of `deconvolved`.
    noise: of `deconvolved`.
    glare: [channel], all that is spread evenly over the photo.
    shares: [depth], of `deconvolved`; None for all alike.
    network: one for any camera, set for this one.
    """
    light = without_glare(image, glare)
    linear = deconvolved(light, psf, noise, shares)
    return apply_network(network, light, linear=linear).lerp(linear.clamp(0, 1), network.linear_share())


def deconvolved(photo: Tensor, psf: Tensor, noise: float, shares: Tensor | None = None) -> Tensor:
    """Wiener deconvolution of photos [.., channel, y, x] without glare by PSFs [depth, channel, y, x].

    photo: [..., channel, y, x].
    psf: [depth, channel, y, x].
    noise: standard deviation before the glare was taken off.
    shares: [depth], how likely each depth is, with the sum 1; None where all are alike.
    """
    return wiener(photo, *without_truncated(psf, noise, shares), shares=shares)
