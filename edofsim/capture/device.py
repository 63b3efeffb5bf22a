"""Where tensors are computed."""

from __future__ import annotations

import torch

from ..errors import InputError


def torch_device(device: str) -> str:
    """The torch device for `auto`, `cpu` or `cuda`. Raises InputError for others, and for CUDA where there is
    none."""
    if device.partition(":")[0] not in ("auto", "cpu", "cuda"):
        raise InputError(f"device {device!r} is none of auto, cpu, cuda")
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise InputError("device cuda: PyTorch finds no CUDA device here; use --device cpu or auto")
    return ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else str(device)
