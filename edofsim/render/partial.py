"""Work that was interrupted: sums so far, in a file that is trusted only if its checksum is right."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import numpy as np
from safetensors.numpy import load, save

from ..core.json_values import Json
from .passes import LAUNCH_BYTES, Group, Sums

MAGIC = b"edofsim-sums-1\n"


def save_partial(path: Path, sums: Sums) -> None:
    """Write the sums; the file is complete or not there. Raises OSError, for instance on a full disk."""
    counters = json.dumps({**sums.counters(), "launch_bytes": LAUNCH_BYTES})
    data = save(sums.arrays(), metadata={"counters": counters})
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(MAGIC + hashlib.sha256(data).digest())
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


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
