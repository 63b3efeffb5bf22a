"""Work that was interrupted: sums so far, in a file that is trusted only if its checksum is right."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
from safetensors.numpy import load, save

from ..core.files import write_bytes
from ..core.json_values import Json
from .passes import LAUNCH_BYTES, Group, Sums

MAGIC = b"edofsim-sums-3\n"


def save_partial(path: Path, sums: Sums) -> None:
    """Write the sums. Raises what `core.files.whole` raises, for instance on a full disk."""
    counters = json.dumps({**sums.counters(), "launch_bytes": LAUNCH_BYTES})
    data = save(sums.arrays(), metadata={"counters": counters})
    write_bytes(path, MAGIC + hashlib.sha256(data).digest() + data)


def load_partial(path: Path, groups: tuple[Group, ...], bands: int) -> Sums | None:
    """The sums to go on from; None if there are none, or none that fit."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    start = len(MAGIC) + hashlib.sha256().digest_size
    if (
        content[: len(MAGIC)] != MAGIC
        or hashlib.sha256(content[start:]).digest() != content[len(MAGIC) : start]
    ):
        return None
    data = content[start:]
    arrays: dict[str, np.ndarray] = {name: np.array(value) for name, value in load(data).items()}
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    counters = json.loads(header["__metadata__"]["counters"])
    expected = {name: value.shape for name, value in Sums.empty(groups, bands).arrays().items()}
    if counters.pop("launch_bytes") != LAUNCH_BYTES or {k: v.shape for k, v in arrays.items()} != expected:
        return None
    known: Json = {**arrays, **counters}
    return Sums(**known)
