"""Broken restorations, scores and checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from importlib import import_module

import torch
from hard_cases import networks, restoration
from torch import Tensor

from edofsim.restore import checkpoint, network, scores
from edofsim.restore.restorer import Restorer

from .mutant import Mutant, after, scaled, swapped

filtering = import_module("edofsim.restore.wiener")  # the package holds a function of that name
RESTORING = ("restoration",)


def _restored(change: Callable[[Tensor], Tensor]) -> Callable[[], AbstractContextManager[object]]:
    return lambda: after(networks, "apply_network", change)


def _untouched(net: Restorer, image: Tensor, **options: object) -> Tensor:
    return image.clamp(0, 1)


def _training_statistics() -> AbstractContextManager[object]:
    inner = network._restored

    def restored(net: Restorer, photo: Tensor, tile: int) -> Tensor:
        return inner(net.train(), photo, tile)

    return swapped(network, "_restored", restored)


def _light_not_kept(photo: Tensor, restored: Tensor, glare: Tensor | None = None) -> Tensor:
    return restored


def _untouched_by_filter(image: Tensor, psf: Tensor, noise: float, beyond_px: int | None = None) -> Tensor:
    return image


def _untrained(found: checkpoint.Checkpoint) -> checkpoint.Checkpoint:
    torch.manual_seed(0)
    with torch.no_grad():
        for weights in found.network.parameters():
            weights.copy_(weights[torch.randperm(len(weights))] if weights.ndim else weights)
    return found


def _unmirrored(image: Tensor, reach: int) -> tuple[Tensor, tuple[int, int]]:
    times = 2 + 2 * reach // min(image.shape[-2:])
    rows, columns = image.shape[-2:]
    return image.repeat(1, times, times), ((times // 2) * rows, (times // 2) * columns)


def _as_it_is(values: Tensor) -> Tensor:
    return values


def _less_alike(found: Tensor | None) -> Tensor | None:
    return None if found is None else 0.99 * found


def _noise_of(times: float) -> AbstractContextManager[object]:
    inner = restoration.wiener

    def wiener(image: Tensor, psf: Tensor, noise: float, beyond_px: int | None = None) -> Tensor:
        return inner(image, psf, noise * times + 0.01, beyond_px)

    return swapped(restoration, "wiener", wiener)


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "photo unchanged",
        "a network gives back what it got",
        RESTORING,
        lambda: swapped(networks, "apply_network", _untouched),
    ),
    Mutant("wrong channels", "red is restored as blue", RESTORING, _restored(lambda x: x.flip(0))),
    Mutant("restored one pixel off", "to the right", RESTORING, _restored(lambda x: x.roll(1, -1))),
    Mutant("restored 3 % darker", "in all channels", RESTORING, _restored(lambda x: 0.97 * x)),
    Mutant("restored in 4 bits", "15 steps", RESTORING, _restored(lambda x: (15 * x).round() / 15)),
    Mutant(
        "statistics of training", "batch normalisation by the photo itself", RESTORING, _training_statistics
    ),
    Mutant(
        "light not kept",
        "the lowest frequencies are the network's",
        RESTORING,
        lambda: swapped(network, "keep_light", _light_not_kept),
    ),
    Mutant(
        "weights out of order",
        "outputs of each layer exchanged",
        RESTORING,
        lambda: after(networks, "load_checkpoint", _untrained),
    ),
    Mutant(
        "filter unchanged",
        "the Wiener filter gives back what it got",
        RESTORING,
        lambda: swapped(restoration, "wiener", _untouched_by_filter),
    ),
    Mutant("filter 1 % down", "its light", RESTORING, lambda: scaled(restoration, "wiener", 0.99)),
    Mutant("filter of much noise", "told ten times as much", RESTORING, lambda: _noise_of(10.0)),
    Mutant(
        "filter without mirrors",
        "a photo goes on as its other side",
        RESTORING,
        lambda: swapped(filtering, "_reflected", _unmirrored),
    ),
    Mutant(
        "PSNR of amplitudes",
        "20 log in place of 10 log",
        RESTORING,
        lambda: scaled(restoration, "psnr", 2.0),
    ),
    Mutant(
        "SSIM 1 % down",
        "of equal images too",
        RESTORING,
        lambda: after(scores, "ssim_map", _less_alike),
    ),
    Mutant(
        "denormals kept",
        "in checkpoints",
        ("training",),
        lambda: swapped(checkpoint, "without_denormals", _as_it_is),
    ),
)
