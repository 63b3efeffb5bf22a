"""A view: a rendered scene, independent of any camera optics.

A view is a list of fragments. A fragment is one surface seen in one pixel; a pixel on a depth edge has
several, and *hidden* fragments lie behind the visible ones, for a blur to uncover.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from ..core.json_values import Json
from ..errors import InputError


@dataclass(frozen=True)
class View:
    """Fragments of a frame, sorted by pixel and, within a pixel, from near to far.

    The frame has `height` x `width` pixels and is surrounded by `margin` further pixels on each side, from
    which blurred light enters it. `pixel` counts in the frame with its margin, row by row from the top left.

    pixel: int64 [fragment]
    coverage: [fragment], fraction of the pixel's samples that see the fragment. Visible fragments of a
        pixel sum to 1 (background at infinity is a fragment too). A hidden fragment's coverage is the
        fraction of the samples whose continued ray meets it.
    inverse_depth: [fragment], mean of 1/z over the fragment, in 1/m; 0 is infinity.
    radiance: [band, fragment], premultiplied by coverage, linear.
    hidden: bool [fragment]
    wavelengths: float64 [band], metres
    pixel_angle: tangent of the angle that one pixel sees, on the axis
    noise: estimated relative standard error of the band mean over the image; 0 if not from sampling
    """

    height: int
    width: int
    margin: int
    pixel: Tensor
    coverage: Tensor
    inverse_depth: Tensor
    radiance: Tensor
    hidden: Tensor
    wavelengths: Tensor
    pixel_angle: float
    noise: float = 0.0
    metadata: Json = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises InputError for shapes that do not fit each other; values are checked before a photo."""
        count, bands = self.pixel.numel(), self.wavelengths.numel()
        wanted = dict.fromkeys(("pixel", "coverage", "inverse_depth", "hidden"), (count,))
        wanted |= {"wavelengths": (bands,), "radiance": (bands, count)}
        problems = [
            f"a view of {count} fragments and {bands} bands needs {name} of shape {list(shape)}, not "
            f"{list(getattr(self, name).shape)}; View.flat makes one of images"
            for name, shape in wanted.items()
            if tuple(getattr(self, name).shape) != shape
        ]
        if min(self.height, self.width) < 1 or self.margin < 0:
            problems.append(
                f"a view cannot have {self.width} x {self.height} pixels and a margin of {self.margin}"
            )
        if not 0 < self.pixel_angle < math.inf:
            problems.append(f"a view's pixel_angle is finite and above 0, not {self.pixel_angle}")
        if problems:
            raise InputError(problems)

    @classmethod
    def flat(
        cls,
        radiance: Tensor | np.ndarray,
        inverse_depth: Tensor | np.ndarray | float,
        *,
        wavelengths: Tensor | np.ndarray | Sequence[float],
        pixel_angle: float,
        margin: int = 0,
        metadata: Json | None = None,
    ) -> View:
        """A view of one opaque fragment a pixel, and nothing behind.

        radiance: [band, y, x] of the frame with its margin, linear; inverse_depth: [y, x] in 1/m, or a number
        for all pixels; the others as in `View`. The view has the type and the device of the radiance, and
        shares its memory.
        Raises InputError for shapes that do not fit each other, a radiance that is not finite, and depths
        that are not in front of the lens.
        """
        light = torch.as_tensor(radiance)
        light = light if light.is_floating_point() else light.float()
        depth = torch.as_tensor(inverse_depth, dtype=light.dtype, device=light.device)
        if light.ndim != 3:
            raise InputError(f"radiance needs the shape [band, y, x], not {list(light.shape)}")
        _, rows, columns = light.shape
        if depth.ndim and depth.shape != light.shape[1:]:
            raise InputError(
                f"inverse_depth has the shape {list(depth.shape)}: give a number, or [y, x] as the radiance "
                f"has them, {[rows, columns]}"
            )
        if not 0 <= 2 * margin < min(rows, columns):
            raise InputError(f"a margin of {margin} pixels does not fit into {columns} x {rows}")
        if not bool(torch.isfinite(light.detach()).all()):
            raise InputError("radiance holds values that are NaN or infinite")
        if not bool(((depth >= 0) & (depth < math.inf)).all()):
            raise InputError(
                "inverse_depth holds values that are NaN, infinite or negative; it is 1/z in 1/m, and 0 for "
                "infinity"
            )
        count = rows * columns
        return cls(
            height=rows - 2 * margin,
            width=columns - 2 * margin,
            margin=margin,
            pixel=torch.arange(count, device=light.device),
            coverage=light.new_ones(count),
            inverse_depth=depth.expand(rows, columns).reshape(-1).clone(),
            radiance=light.reshape(-1, count),
            hidden=torch.zeros(count, dtype=torch.bool, device=light.device),
            wavelengths=torch.as_tensor(wavelengths, dtype=torch.float64, device=light.device),
            pixel_angle=pixel_angle,
            metadata=metadata or {},
        )

    @property
    def padded_shape(self) -> tuple[int, int]:
        """(rows, columns) of the frame with its margin."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin

    @property
    def bands(self) -> int:
        return int(self.radiance.shape[0])

    @property
    def one_each(self) -> bool:
        """Whether every pixel has one fragment, and it is seen: fragment i is pixel i then."""
        rows, columns = self.padded_shape
        if self.pixel.numel() != rows * columns or bool(self.hidden.any()):
            return False
        return bool((self.pixel == torch.arange(self.pixel.numel(), device=self.pixel.device)).all())

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> View:
        """The same view on another device; `dtype` applies to coverage, inverse depth and radiance."""
        return replace(
            self,
            pixel=self.pixel.to(device),
            hidden=self.hidden.to(device),
            wavelengths=self.wavelengths.to(device),
            coverage=self.coverage.to(device, dtype),
            inverse_depth=self.inverse_depth.to(device, dtype),
            radiance=self.radiance.to(device, dtype),
        )

    def crop_margin(self, image: Tensor) -> Tensor:
        """Cut the margin off an image of the padded frame: [..., y, x] to [..., height, width]."""
        m = self.margin
        return image[..., m : m + self.height, m : m + self.width]

    def all_in_focus(self) -> Tensor:
        """The pinhole image of the padded frame, [band, y, x]: the sum of each pixel's visible fragments."""
        rows, columns = self.padded_shape
        seen = ~self.hidden
        image = self.radiance.new_zeros(self.bands, rows * columns)
        image.index_add_(1, self.pixel[seen], self.radiance[:, seen])
        return image.reshape(self.bands, rows, columns)

    def mean_inverse_depth(self) -> Tensor:
        """Coverage-weighted inverse depth of what is seen, padded frame, [y, x], in 1/m."""
        rows, columns = self.padded_shape
        seen = ~self.hidden
        total = self.coverage.new_zeros(rows * columns)
        weight = torch.zeros_like(total)
        total.index_add_(0, self.pixel[seen], (self.coverage * self.inverse_depth)[seen])
        weight.index_add_(0, self.pixel[seen], self.coverage[seen])
        return (total / weight.clamp_min(torch.finfo(weight.dtype).tiny)).reshape(rows, columns)
