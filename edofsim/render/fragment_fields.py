"""What a view holds, whichever kind of array holds it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from ..core.json_values import Json

Array = TypeVar("Array")


@dataclass(frozen=True)
class FragmentFields(Generic[Array]):
    """What `View` holds as tensors and `Fragments` as numpy arrays: fields by their names, see `View`."""

    height: int
    width: int
    margin: int
    pixel: Array
    coverage: Array
    inverse_depth: Array
    radiance: Array
    hidden: Array
    wavelengths: Array
    pixel_angle: float
    noise: float = 0.0
    metadata: Json = field(default_factory=dict)
    half_difference: Array | None = None
    axis: tuple[float, float] | None = None

    @property
    def padded_shape(self) -> tuple[int, int]:
        """(rows, columns) of the frame with its margin."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin
