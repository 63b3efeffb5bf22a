"""Factors of PSFs kept by what they are computed from: in memory, and on request in a folder."""

from __future__ import annotations

import hashlib
import json
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from ..optics.cache import write_whole
from .factors import Factors, Group
from .kernels import Kernels

VERSION = 2
"""Raised when the same PSFs would give other factors, so that those on disk are computed again."""
MEMORY_BYTES = 128 << 20
"""Largest sum of factors kept in memory; those used longest ago go first."""

_memory: OrderedDict[str, list[Factors]] = OrderedDict()
_GROUP = [each.name for each in fields(Group)]
_TENSORS = [each.name for each in fields(Factors) if each.name not in ("group", "predicted_db")]


def factors_for(
    kernels: Kernels, response: Tensor, tolerance_db: float, compute: Callable[[], list[Factors]]
) -> list[Factors]:
    """The factors of these PSFs for a response [channel, band] and a tolerance, computed if not known.

    PSFs without a key, such as those that carry gradients, are factored each time.
    """
    if kernels.key is None:
        return compute()
    said = [VERSION, kernels.key, str(response.dtype), response.tolist(), tolerance_db]
    key = hashlib.sha256(json.dumps(said).encode()).hexdigest()
    found = _memory.get(key)
    path = None if kernels.folder is None else kernels.folder / f"factors-{key}.safetensors"
    if found is None and path is not None:
        found = _read(path)
    if found is None:
        found = compute()
        if path is not None:
            _write(path, found)
    _remember(key, [_moved(each, "cpu") for each in found])
    return [_moved(each, response.device) for each in found]


def forget() -> None:
    """Empty the memory."""
    _memory.clear()


def _remember(key: str, factors: list[Factors]) -> None:
    _memory[key] = factors
    _memory.move_to_end(key)
    size = sum(_bytes(kept) for kept in _memory.values())
    while size > MEMORY_BYTES and len(_memory) > 1:
        size -= _bytes(_memory.popitem(last=False)[1])


def _bytes(factors: Sequence[Factors]) -> int:
    return sum(getattr(each, name).nbytes for each in factors for name in _TENSORS)


def _moved(factors: Factors, device: torch.device | str) -> Factors:
    group = Group(*(getattr(factors.group, name).to(device) for name in _GROUP))
    tensors = {name: getattr(factors, name).to(device) for name in _TENSORS}
    return Factors(group=group, predicted_db=factors.predicted_db, **tensors)


def _write(path: Path, factors: Sequence[Factors]) -> None:
    tensors = {}
    for number, each in enumerate(factors):
        # clones: groups share tensors, which the file format refuses
        tensors |= {f"{number} {name}": getattr(each, name).cpu().clone() for name in _TENSORS}
        tensors |= {f"{number} {name}": getattr(each.group, name).cpu().clone() for name in _GROUP}
    predicted = json.dumps([each.predicted_db for each in factors])
    write_whole(path, tensors, {"predicted_db": predicted})


def _read(path: Path) -> list[Factors] | None:
    """The factors of a file; None if there is none or it is damaged."""
    if not path.is_file():
        return None
    try:
        with safe_open(str(path), "pt") as file:
            predicted = json.loads(file.metadata()["predicted_db"])
            return [
                Factors(
                    group=Group(*(file.get_tensor(f"{number} {name}") for name in _GROUP)),
                    predicted_db=decibel,
                    **{name: file.get_tensor(f"{number} {name}") for name in _TENSORS},
                )
                for number, decibel in enumerate(predicted)
            ]
    except (OSError, ValueError, KeyError, TypeError, SafetensorError):
        return None
