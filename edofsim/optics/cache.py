"""PSFs kept by what they are computed from: in memory, and on request in a folder."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..core.sources import code_of_rooms
from ..core.store import Store
from ..recipe.kinds import MASKS
from .camera import Camera
from .grid import bicubic_matrix, disc_amplitude, disc_coverage


def key(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    window_px: int,
    seed: int | None,
    dtype: torch.dtype,
) -> str:
    """SHA-256 of everything that PSFs depend on, the code that computes them included.

    camera, wavelengths, inverse_depths, window_px, seed, dtype: as of `psf_bank`, [band] and [depth].
    """
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
    said |= {"by_phase": camera.by_phase}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name, given in (("", camera.height_map), ("amplitude", camera.amplitude)):
        if given is not None:
            values = given.detach().cpu().contiguous().numpy().tobytes()
            digest.update(f"{name}{given.dtype}".encode() + values)
    for file in camera.mask.files():
        if (camera.base / file).is_file():
            digest.update((camera.base / file).read_bytes())
    digest.update(MASKS.code_of(camera.mask.kind).encode())
    return digest.hexdigest()


def find(key: str, folder: Path | None) -> Tensor | None:
    """PSFs [depth, band, y, x] of that key from memory or the folder, or None. A damaged file counts as
    none."""
    return BANKS.find(key, folder)


def keep(key: str, psfs: Tensor, folder: Path | None) -> None:
    """Remember PSFs on the CPU, and write them to the folder if there is one.

    psfs: [depth, band, y, x].
    key: what `key` gives.
    folder: for files; None: in memory alone.

    Raises ValueError for those that carry gradients: a cached graph would be that of an old parameter.
    """
    if psfs.requires_grad:
        raise ValueError("PSFs that carry gradients must not be cached")
    BANKS.keep(key, psfs, folder)


def forget() -> None:
    """Empty the memory, of pupils too: the next PSFs take as long as the first."""
    BANKS.forget()
    for known in (disc_coverage, disc_amplitude, bicubic_matrix):
        known.cache_clear()


BANKS: Store[Tensor] = Store(
    "{}.safetensors",
    lambda path: load_file(path)["psfs"],
    lambda psfs, path: save_file({"psfs": psfs.contiguous()}, path),
    size=lambda psfs: psfs.nbytes,
    memory_bytes=512 << 20,
)
