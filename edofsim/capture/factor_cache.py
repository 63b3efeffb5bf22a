"""Factors of PSFs kept by what they are computed from: in memory, and on request in a folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from ..core.store import Store
from .factors import Factors, Group
from .kernels import Kernels

VERSION = 2
"""Raised when the same PSFs would give other factors, so that those on disk are computed again."""

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
    found = FACTORS.find(key, kernels.folder)
    if found is None:
        found = [_moved(each, "cpu") for each in compute()]
        FACTORS.keep(key, found, kernels.folder)
    return [_moved(each, response.device) for each in found]


def forget() -> None:
    """Empty the memory."""
    FACTORS.forget()


def _bytes(factors: Sequence[Factors]) -> int:
    return sum(getattr(each, name).nbytes for each in factors for name in _TENSORS)


def _moved(factors: Factors, device: torch.device | str) -> Factors:
    group = Group(*(getattr(factors.group, name).to(device) for name in _GROUP))
    tensors = {name: getattr(factors, name).to(device) for name in _TENSORS}
    return Factors(group=group, predicted_db=factors.predicted_db, **tensors)


def _write(factors: Sequence[Factors], path: Path) -> None:
    tensors: dict[str, Tensor] = {}
    for number, each in enumerate(factors):
        # clones: groups share tensors, which the file format refuses
        tensors |= {f"{number} {name}": getattr(each, name).clone() for name in _TENSORS}
        tensors |= {f"{number} {name}": getattr(each.group, name).clone() for name in _GROUP}
    save_file(tensors, path, {"predicted_db": json.dumps([each.predicted_db for each in factors])})


def _read(path: Path) -> list[Factors]:
    with safe_open(path, "pt") as file:
        return [
            Factors(
                group=Group(*(file.get_tensor(f"{number} {name}") for name in _GROUP)),
                predicted_db=decibel,
                **{name: file.get_tensor(f"{number} {name}") for name in _TENSORS},
            )
            for number, decibel in enumerate(json.loads(file.metadata()["predicted_db"]))
        ]


FACTORS: Store[list[Factors]] = Store(
    "factors-{}.safetensors", _read, _write, size=_bytes, memory_bytes=128 << 20
)
