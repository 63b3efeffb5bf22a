"""Networks by name, and how one is applied to a photo of any size."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ..errors import InputError
from ..recipe.kinds import NETWORKS
from .borders import ALONG_REACH
from .light import keep_light, with_other_glare, without_glare
from .restorer import Restorer


def network_class(kind: str) -> type[Restorer]:
    """The class of a kind of network. Raises InputError for an unknown kind."""
    found = NETWORKS[kind]
    if not (isinstance(found, type) and issubclass(found, Restorer)):
        raise InputError(f"the network {kind!r} of another package is no Restorer: {found}")
    return found


def build_network(kind: str, settings: Mapping[str, object] | None = None) -> Restorer:
    """An untrained network. Raises InputError for an unknown kind or settings that it does not take."""
    found = network_class(kind)
    try:
        return found(**dict(settings or {}))
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"network {kind!r} cannot be built from {dict(settings or {})}: {error}") from None


def weights_of(network: nn.Module) -> int:
    """Number of trained values."""
    return sum(parameter.numel() for parameter in network.parameters())


def apply_network(
    network: Restorer,
    image: Tensor,
    *,
    glare: Tensor | None = None,
    linear: Tensor | None = None,
    tile: int = 512,
) -> Tensor:
    """The restored image, [3, y, x] in [0, 1], of a photo [3, y, x] with full scale 1.

    Its lowest spatial frequencies are the photo's, see `light`.

    image: [3, y, x], full scale 1.
    glare: [3], the part of the light that is spread evenly over the photo, as the camera's mask is known to
        be made; None for none. A network for any camera is given the photo without it, another with as much
        as in its training, where that is known.
    linear: [3, y, x], what Wiener deconvolution makes of that, for one that `sees_linear`; None for the photo
        itself.

    Large photos go through in tiles of `tile` pixels, each with as much of its surroundings as the
    network sees (`radius`, None for all of it): memory stays bounded and the result is that of the whole
    photo. Computed on the image's device in the precision of the network's weights. Raises InputError for a
    photo that is not [3, y, x] or not finite.
    """
    if image.ndim != 3 or image.shape[0] != 3:
        raise InputError(f"the network restores photos of 3 channels [3, y, x], not {list(image.shape)}")
    if not torch.isfinite(image).all():
        raise InputError("the photo holds values that are not finite; nothing can be restored from it")
    network = network.eval().to(image.device)
    if network.any_camera and glare is not None:
        image, glare = without_glare(image, glare), None
    network, factor = network.brightened_for(image)
    precision = next((weights.dtype for weights in network.parameters()), image.dtype)
    photo = factor * image.to(precision)
    with torch.inference_mode():
        seen = photo
        if network.glare is not None:
            own = photo.new_zeros(3) if glare is None else glare.to(photo)
            seen = with_other_glare(photo, own, photo.new_tensor(network.glare))
        if network.sees_linear:
            seen = torch.cat([photo, photo if linear is None else factor * linear.to(photo)])
        restored = _restored(network, seen[None].contiguous(memory_format=torch.channels_last), tile)
        return (keep_light(photo, restored, glare) / factor).clamp(0, 1).to(image.dtype)


def _restored(network: Restorer, photo: Tensor, tile: int) -> Tensor:
    """What the network makes of a photo [1, channel, y, x], not clamped, [3, y, x]."""
    if network.radius is None:
        return network.unclamped(photo)[0]
    rows, columns = photo.shape[-2:]
    around = -(-(network.radius + ALONG_REACH) // network.multiple) * network.multiple
    tile = -(-tile // network.multiple) * network.multiple
    restored = photo.new_empty(3, rows, columns)
    for top in range(0, rows, tile):
        for left in range(0, columns, tile):
            above, before = max(0, top - around), max(0, left - around)
            part = photo[..., above : top + tile + around, before : left + tile + around]
            done = network.unclamped(part)[0, :, top - above :, left - before :]
            restored[:, top : top + tile, left : left + tile] = done[:, :tile, :tile]
    return restored
