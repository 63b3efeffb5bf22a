"""PSF banks kept by what they are computed from: in memory, and on request in a folder."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import torch
from filelock import FileLock
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from ..recipe.kinds import MASKS
from .bank import PsfBank
from .camera import Camera
from .grid import PupilGrid, bicubic_matrix, disc_amplitude, disc_coverage
from .sampling import Sampling

LOG = logging.getLogger(__name__)

VERSION = 4
"""Raised when the same inputs would give other numbers, so that banks on disk are computed again."""
MEMORY_BYTES = 512 << 20
"""Largest sum of banks kept in memory; those used longest ago go first."""

_memory: OrderedDict[str, PsfBank] = OrderedDict()


def key(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    window_px: int,
    seed: int | None,
    dtype: torch.dtype,
) -> str:
    """SHA-256 of everything that a bank depends on: glasses by their indices, not by their names, and height
    maps by their content."""
    recipe = camera.recipe.model_dump(mode="json", include={"focus", "mask", "fabrication", "psf"})
    said = {"version": VERSION, "recipe": recipe, "pixel": camera.pixel}
    said |= {"lens": camera.lens.identity(), "material": camera.mask_material.formula}
    said |= {"window": window_px, "seed": seed}
    digest = hashlib.sha256(json.dumps({**said, "dtype": str(dtype)}, sort_keys=True).encode())
    for axis in (wavelengths, inverse_depths):
        digest.update(axis.numpy().tobytes() + b"|")
    height = camera.height_map
    if height is not None:
        digest.update(str(height.dtype).encode() + height.detach().cpu().contiguous().numpy().tobytes())
    for file in camera.mask.files():
        if (camera.base / file).is_file():
            digest.update((camera.base / file).read_bytes())
    digest.update(MASKS.code_of(camera.mask.kind).encode())
    return digest.hexdigest()


def find(key: str, folder: Path | None) -> PsfBank | None:
    """The bank of that key from memory or the folder, or None. A damaged file counts as none."""
    bank = _memory.get(key)
    if bank is not None:
        _memory.move_to_end(key)
        return bank
    bank = _read(folder / f"{key}.safetensors") if folder is not None else None
    if bank is not None:
        _remember(key, bank)
    return bank


def keep(key: str, bank: PsfBank, folder: Path | None) -> None:
    """Remember a bank on the CPU, and write it to the folder if there is one.

    Raises ValueError for a bank that carries gradients: a cached graph would be that of an old parameter.
    """
    if bank.values.requires_grad:
        raise ValueError("a PSF bank that carries gradients must not be cached")
    _remember(key, bank)
    if folder is not None:
        _write(folder / f"{key}.safetensors", bank)


def forget() -> None:
    """Empty the memory, of pupils too: the next PSFs take as long as the first."""
    _memory.clear()
    for known in (disc_coverage, disc_amplitude, bicubic_matrix):
        known.cache_clear()


def _remember(key: str, bank: PsfBank) -> None:
    _memory[key] = bank
    size = sum(kept.values.nbytes for kept in _memory.values())
    while size > MEMORY_BYTES:
        _, oldest = _memory.popitem(last=False)
        size -= oldest.values.nbytes


def _write(path: Path, bank: PsfBank) -> None:
    tensors = {
        name: getattr(bank, name).contiguous() for name in ("values", "rest", "wavelengths", "inverse_depths")
    }
    s = bank.sampling
    about = [bank.transmission, s.grid.samples, s.grid.pitch, s.grid.radius]
    about += [s.largest_defocus, s.bound, s.replica_period, s.window]
    write_whole(path, tensors, {"edofsim": json.dumps(about)})


def write_whole(path: Path, tensors: Mapping[str, Tensor], about: Mapping[str, str]) -> None:
    """A file of named tensors, complete or not there. Where it cannot be written, work goes on without it."""
    name = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{path}.lock"):
            handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
            os.close(handle)
            save_file(dict(tensors), name, dict(about))
            os.replace(name, path)
    except (OSError, SafetensorError) as error:
        LOG.warning("%s is not kept for next time: %s", path, error)
        if name is not None:
            with suppress(OSError):
                os.unlink(name)


def _read(path: Path) -> PsfBank | None:
    if not path.is_file():
        return None
    try:
        with safe_open(str(path), "pt") as file:
            transmission, samples, pitch, radius, *numbers = json.loads(file.metadata()["edofsim"])
            tensors = {
                name: file.get_tensor(name) for name in ("values", "rest", "wavelengths", "inverse_depths")
            }
    except (OSError, ValueError, KeyError, TypeError, SafetensorError):
        return None
    sampling = Sampling(PupilGrid(samples, pitch, radius), *numbers)
    return PsfBank(**tensors, transmission=transmission, sampling=sampling)
