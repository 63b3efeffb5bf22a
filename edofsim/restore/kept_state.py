"""What networks make of PSFs, kept for the next process: filters take a second to be solved for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from safetensors.torch import load_file, save_file
from torch import Tensor

from ..core.sources import code_of_rooms
from ..core.store import Store, user_folder
from ..optics import Camera
from ..optics.cache import identity
from ..recipe.kinds import NETWORKS
from .restorer import Restorer

ROOMS = ("core", "optics", "restore")
KEPT = 20
"""States that are kept, of some megabytes each; those used longest ago go first."""


def set_psfs(network: Restorer, made_for: Camera, axes: Sequence[Tensor], psfs: Callable[[], Tensor]) -> None:
    """`network.set_psfs(psfs())`, or what that led to before.

    made_for: the camera that the PSFs are of.
    axes: all else that decides them.
    psfs: makes them, [depth, 3, y, x].
    """
    said = {
        "code": code_of_rooms(*ROOMS),
        "network": [network.kind, NETWORKS.code_of(network.kind), network.settings()],
        "optics": identity(made_for),
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode())
    for values in (*axes, *network.state_dict().values()):
        digest.update(values.contiguous().numpy().tobytes() + b"|")
    own, key = network.psf_state(), digest.hexdigest()[:32]

    def read(path: Path) -> list[Tensor]:
        held = load_file(path)
        return [held[str(place)] for place in range(len(held))]

    kept = Store("{}.safetensors", read, _write, most_files=KEPT)
    known = kept.find(key, user_folder() / "filters")
    if known is not None and len(known) == len(list(_tensors(own))):
        network.load_psf_state(_filled(own, iter(known)))
        return
    network.set_psfs(psfs())
    kept.keep(key, list(_tensors(network.psf_state())), user_folder() / "filters")


def _write(tensors: list[Tensor], path: Path) -> None:
    save_file({str(place): each.contiguous() for place, each in enumerate(tensors)}, path)


def _tensors(state: object) -> Iterator[Tensor]:
    """Those of nested tuples, in their order."""
    if isinstance(state, Tensor):
        yield state
    elif isinstance(state, tuple):
        for each in state:
            yield from _tensors(each)


def _filled(state: object, tensors: Iterator[Tensor]) -> object:
    """The nested tuples with these in the places of theirs."""
    if isinstance(state, tuple):
        return tuple(_filled(each, tensors) for each in state)
    return next(tensors) if isinstance(state, Tensor) else state
