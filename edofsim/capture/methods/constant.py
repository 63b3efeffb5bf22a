"""One depth: one convolution a band. Exact for a flat scene facing the camera, as in the paper's training."""

from __future__ import annotations

from torch import Tensor

from ..kernels import Kernels
from . import layered
from .base import Blur


def prepare(kernels: Kernels, response: Tensor) -> Blur:
    """The layered method with a single node, which all light is taken to lie at."""
    if kernels.nodes.numel() != 1:
        raise ValueError(f"the constant method has one depth, not {kernels.nodes.numel()}")
    return layered.prepare(kernels, response)
