"""PSF banks kept by what they are computed from: in memory, and on request in a folder."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from ..core.sources import code_of_rooms
from ..core.store import Store
from ..recipe.kinds import MASKS
from .bank import PsfBank
from .camera import Camera
from .grid import PupilGrid, bicubic_matrix, disc_amplitude, disc_coverage
from .sampling import Sampling

TENSORS = {
    "values": "values",
    "rest": "truncated",
    "wavelengths": "wavelengths",
    "inverse_depths": "inverse_depths",
}
"""By name in the file, the field of `PsfBank`."""


def key(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    window_px: int,
    seed: int | None,
    dtype: torch.dtype,
) -> str:
    """SHA-256 of everything that a bank depends on, the code that computes it included."""
    said = {"optics": identity(camera), "window": window_px, "seed": seed, "dtype": str(dtype)}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for axis in (wavelengths, inverse_depths):
        digest.update(axis.numpy().tobytes() + b"|")
    return digest.hexdigest()


def identity(camera: Camera) -> str:
    """SHA-256 of all of a camera that its PSFs depend on: its recipe's values, glasses by their indices and
    not by their names, height maps and files by their content, and code, of other packages' optics too."""
    recipe = camera.recipe.model_dump(mode="json", include={"focus", "mask", "fabrication", "psf"})
    said = {"code": code_of_rooms("optics", "core"), "recipe": recipe, "pixel": camera.pixel}
    said |= {"lens": camera.lens.identity(), "material": camera.mask_material.formula, "field": camera.field}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
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
    return BANKS.find(key, folder)


def keep(key: str, bank: PsfBank, folder: Path | None) -> None:
    """Remember a bank on the CPU, and write it to the folder if there is one.

    Raises ValueError for a bank that carries gradients: a cached graph would be that of an old parameter.
    """
    if bank.values.requires_grad:
        raise ValueError("a PSF bank that carries gradients must not be cached")
    BANKS.keep(key, bank, folder)


def forget() -> None:
    """Empty the memory, of pupils too: the next PSFs take as long as the first."""
    BANKS.forget()
    for known in (disc_coverage, disc_amplitude, bicubic_matrix):
        known.cache_clear()


def _write(bank: PsfBank, path: Path) -> None:
    tensors = {name: getattr(bank, field).contiguous() for name, field in TENSORS.items()}
    s = bank.sampling
    about = [bank.transmission, s.grid.samples, s.grid.pitch, s.grid.radius]
    about += [s.largest_defocus, s.bound, s.replica_period, s.window]
    save_file(tensors, path, {"edofsim": json.dumps(about)})


def _read(path: Path) -> PsfBank:
    with safe_open(path, "pt") as file:
        transmission, samples, pitch, radius, *numbers = json.loads(file.metadata()["edofsim"])
        tensors = {field: file.get_tensor(name) for name, field in TENSORS.items()}
    sampling = Sampling(PupilGrid(samples, pitch, radius), *numbers)
    return PsfBank(**tensors, transmission=transmission, sampling=sampling)


BANKS: Store[PsfBank] = Store(
    "{}.safetensors", _read, _write, size=lambda bank: bank.values.nbytes, memory_bytes=512 << 20
)
