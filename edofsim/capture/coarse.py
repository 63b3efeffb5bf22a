"""Coarser pixels, for what has no fine detail: light and images in squares of several pixels a side."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor
from torch.nn.functional import interpolate

from .convolution import Grid
from .light import Light


@dataclass(frozen=True)
class CoarsePixels:
    """side: pixels along each axis that are taken as one; 1 leaves everything as it is."""

    side: int

    def grid(self, rows: int, columns: int, margin: int, window: int) -> Grid:
        """Of a padded frame of fine pixels.

        window: of the PSFs in coarse ones.
        """
        return Grid(-(-rows // self.side), -(-columns // self.side), margin // self.side, window)

    def light(self, light: Light) -> Light:
        """The same light in coarse pixels, its mean over each: what lies beyond the last row and column
        counts for nothing."""
        side = self.side
        if side == 1:
            return light
        y, x = light.pixel // light.columns // side, light.pixel % light.columns // side
        fine = (light.rows - side * y).clamp_max(side) * (light.columns - side * x).clamp_max(side)
        rows, columns = -(-light.rows // side), -(-light.columns // side)
        return replace(
            light, rows=rows, columns=columns, pixel=y * columns + x, radiance=light.radiance / fine
        )

    def interpolated(self, image: Tensor, rows: int, columns: int) -> Tensor:
        """[channel, y, x] in coarse pixels to that of rows and columns of fine ones.

        image: [channel, y, x] in coarse pixels.
        rows, columns: of the fine image.
        """
        if self.side == 1:
            return image
        fine = interpolate(image[None], scale_factor=self.side, mode="bicubic", align_corners=False)[0]
        return fine[:, :rows, :columns]
