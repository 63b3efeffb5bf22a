"""What every method is and gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

from torch import Tensor

from ..convolution import Grid
from ..kernels import Kernels
from ..light import Light, SmoothLight

Blur: TypeAlias = Callable[[Light | SmoothLight, Grid], Tensor]


class Method(Protocol):
    def __call__(self, kernels: Kernels, response: Tensor) -> Blur: ...
