"""A view: a rendered scene, independent of any camera optics.

A view is a list of fragments. A fragment is one surface seen in one pixel; a pixel on a depth edge has
several, and *hidden* fragments lie behind the visible ones, for a blur to uncover.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..core.json_values import Json


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
