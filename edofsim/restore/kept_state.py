"""What networks make of PSFs, kept for the next process: filters take a second to be solved for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..core.sources import code_of_rooms
from ..core.store import Store, user_folder
from ..optics import Camera
from ..optics.cache import identity
from ..recipe.kinds import NETWORKS
from .restorer import Restorer

ROOMS = ("core", "optics", "restore")
KEPT = 60
"""States that are kept, of some megabytes each; those used longest ago go first."""
LARGEST_BYTES = 64 << 20
"""Of a state that is kept."""


def set_psfs(network: Restorer, made_for: Camera, axes: Sequence[Tensor], psfs: Callable[[], Tensor]) -> None:
    """`network.set_psfs(psfs())`, or what that led to before.

    made_for: the camera that the PSFs are of.
    axes: all else that decides them.
    psfs: makes them, [depth, 3, y, x].
    """
    own = network.psf_state()

    def state() -> Sequence[Tensor]:
        now = network.psf_state()
        # what is no tensor is not kept: it has to be what it was
        return tuple(_tensors(now)) if _outline(now) == _outline(own) else ()

    _set(
        (network, made_for, axes),
        lambda: network.set_psfs(psfs()),
        state,
        lambda known: network.load_psf_state(_filled(own, iter(known))),
    )


def set_camera(
    network: Restorer, camera: Camera, axes: Sequence[Tensor], psfs: Callable[[], Tensor], noise: float
) -> None:
    """`network.set_camera(psfs(), noise)` alike."""
    _set(
        (network, camera, (*axes, torch.tensor([noise], dtype=torch.float64))),
        lambda: network.set_camera(psfs(), noise),
        network.camera_state,
        network.load_camera_state,
    )


def _set(
    decided_by: tuple[Restorer, Camera, Sequence[Tensor]],
    make: Callable[[], None],
    state: Callable[[], Sequence[Tensor]],
    load: Callable[[Sequence[Tensor]], None],
) -> None:
    network, camera, axes = decided_by
    said = {
        "code": code_of_rooms(*ROOMS),
        "network": [network.kind, NETWORKS.code_of(network.kind), network.settings()],
        "optics": identity(camera),
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode())
    for values in (*axes, *network.state_dict().values()):
        digest.update(values.contiguous().numpy().tobytes() + b"|")
    kept = Store("{}.safetensors", _read, _write, most_files=KEPT)
    key, folder = digest.hexdigest()[:32], user_folder() / "filters"
    known = kept.find(key, folder)
    if known is not None:
        load(known)
        return
    make()
    found = [each.contiguous() for each in state()]
    if not found:
        return
    load(found)  # as the next process does, to the last bit
    if sum(each.nbytes for each in found) <= LARGEST_BYTES:
        kept.keep(key, found, folder)


def _read(path: Path) -> Sequence[Tensor]:
    held = load_file(path)
    return [held[str(place)] for place in range(len(held))]


def _write(tensors: Sequence[Tensor], path: Path) -> None:
    save_file({str(place): each.contiguous() for place, each in enumerate(tensors)}, path)


def _tensors(state: object) -> Iterator[Tensor]:
    """Those of nested tuples, in their order."""
    if isinstance(state, Tensor):
        yield state
    elif isinstance(state, tuple):
        for each in state:
            yield from _tensors(each)


def _outline(state: object) -> object:
    """The nested tuples without the tensors' values."""
    if isinstance(state, tuple):
        return tuple(map(_outline, state))
    return Tensor if isinstance(state, Tensor) else state


def _filled(state: object, tensors: Iterator[Tensor]) -> object:
    """The nested tuples with these in the places of theirs."""
    if isinstance(state, tuple):
        return tuple(_filled(each, tensors) for each in state)
    return next(tensors) if isinstance(state, Tensor) else state
