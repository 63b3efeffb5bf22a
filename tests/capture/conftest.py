"""Small PSF banks in closed form, and views made by hand."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from edofsim.optics import PsfField
from edofsim.render.view import View

FOCUS = 1.0


class Bench:
    """Makers of test material; float64 unless told otherwise."""

    @staticmethod
    def gaussian_psfs(nodes: Tensor, bands: int, window: int, growth: float = 4.0) -> Tensor:
        """Gaussians whose width grows with defocus and differs between bands: [node, band, y, x], sum 1."""
        axis = torch.arange(window, dtype=torch.float64) - window // 2
        width = 0.4 + growth * (nodes.double() - FOCUS).abs()[:, None] * (1 + 0.1 * torch.arange(bands))
        line = torch.exp(-((axis / width[..., None]) ** 2) / 2)
        line = line / line.sum(-1, keepdim=True)
        return line[..., :, None] * line[..., None, :]

    @classmethod
    def kernels(cls, nodes: Tensor, bands: int, window: int, growth: float = 4.0) -> PsfField:
        return PsfField(cls.gaussian_psfs(nodes, bands, window, growth), nodes, cls.wavelengths(bands))

    @staticmethod
    def wavelengths(bands: int) -> Tensor:
        return torch.linspace(420e-9, 720e-9, bands, dtype=torch.float64)

    @staticmethod
    def response(channels: int, bands: int) -> Tensor:
        weights = torch.rand(channels, bands, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
        return weights / weights.sum(1, keepdim=True)

    @classmethod
    def flat_view(
        cls, image: Tensor, inverse_depth: Tensor | float, margin: int, pixel_angle: float = 1.6e-4
    ) -> View:
        """One fragment a pixel: image [band, y, x] of the padded frame, inverse depth [y, x] or a number."""
        return View.flat(
            image,
            inverse_depth,
            wavelengths=cls.wavelengths(len(image)),
            pixel_angle=pixel_angle,
            margin=margin,
        )

    @classmethod
    def stacked_view(
        cls, sheets: list[tuple[Tensor, Tensor, Tensor]], margin: int, pixel_angle: float = 1.6e-4
    ) -> View:
        """Opaque sheets from near to far, all of them rendered behind each other.

        sheets: (coverage [y, x], inverse depth [y, x], radiance [band, y, x] not premultiplied) of the padded
        frame. What is not covered by the nearer sheets of a pixel is visible, the rest hidden.
        """
        rows, columns = sheets[0][0].shape
        left = torch.ones(rows * columns, dtype=sheets[0][0].dtype)
        parts = []
        for order, (coverage, depth, radiance) in enumerate(sheets):
            coverage, depth = coverage.reshape(-1), depth.reshape(-1)
            radiance = radiance.reshape(radiance.shape[0], -1)
            visible = torch.minimum(coverage, left)
            left = left - visible
            for amount, hidden in ((visible, False), (coverage - visible, True)):
                pixel = torch.nonzero(amount > 0).squeeze(1)
                parts.append(
                    (pixel, order, hidden, amount[pixel], depth[pixel], radiance[:, pixel] * amount[pixel])
                )
        pixel = torch.cat([p[0] for p in parts])
        key = pixel * (2 * len(sheets)) + torch.cat(
            [torch.full_like(p[0], 2 * p[1] + int(p[2])) for p in parts]
        )
        order = torch.argsort(key)
        return View(
            height=rows - 2 * margin,
            width=columns - 2 * margin,
            margin=margin,
            pixel=pixel[order],
            coverage=torch.cat([p[3] for p in parts])[order],
            inverse_depth=torch.cat([p[4] for p in parts])[order],
            radiance=torch.cat([p[5] for p in parts], 1)[:, order],
            hidden=torch.cat([torch.full_like(p[0], p[2], dtype=torch.bool) for p in parts])[order],
            wavelengths=cls.wavelengths(parts[0][5].shape[0]),
            pixel_angle=pixel_angle,
        )

    @staticmethod
    def texture(bands: int, rows: int, columns: int, seed: int = 0) -> Tensor:
        """Positive random radiance [band, y, x] with structure from one pixel to a dozen."""
        generator = torch.Generator().manual_seed(seed)
        image = 0
        for scale in (1, 4, 12):
            coarse = torch.rand(
                1, bands, -(-rows // scale), -(-columns // scale), dtype=torch.float64, generator=generator
            )
            image = image + torch.nn.functional.interpolate(coarse, scale_factor=scale)[0, :, :rows, :columns]
        return image / 3


@pytest.fixture
def bench() -> type[Bench]:
    return Bench
