"""Linear images as PNG: one exposure for all pictures of a page, the transfer curve of sRGB."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..core.images import developed, png_bytes, srgb_encode
from ..errors import InputError

LARGEST_SIDE = 1024  # pixels; larger images are shown smaller, so that a page stays below some megabytes
NOT_A_NUMBER = (1.0, 0.0, 1.0)  # magenta: no photograph has it by chance


@dataclass(frozen=True)
class Box:
    """A frame drawn over a picture: position and size in pixels of the picture, and a short name."""

    x: float
    y: float
    width: float
    height: float
    name: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture of a page. `label` stands above it, `note` next to the label, `alt` is read out instead."""

    png: bytes
    width: int
    height: int
    label: str
    alt: str
    note: str = ""
    boxes: tuple[Box, ...] = ()

    @property
    def uri(self) -> str:
        return data_uri(self.png, "image/png")


def data_uri(content: bytes | str, media_type: str) -> str:
    raw = content.encode() if isinstance(content, str) else content
    return f"data:{media_type};base64,{base64.b64encode(raw).decode('ascii')}"


def display_gain(image: Tensor) -> float:
    """Factor that makes a dark image visible: its 99th percentile is brought to 0.9 where it is below 0.4.

    image: [3, y, x], linear.

    Never below 1: full scale of the sensor is white.
    """
    finite = image[torch.isfinite(image)].double().cpu().numpy()
    bright = float(np.percentile(finite, 99)) if finite.size else 0.0
    if not 0 < bright < 0.4:
        return 1.0
    return float(f"{min(0.9 / bright, 1e4):.2g}")


def clipped_fraction(image: Tensor, gain: float = 1.0) -> float:
    """Fraction of an image's values that are shown as white although they are above it.

    image: [3, y, x], linear.
    """
    return float((image * gain > 1).double().mean())


def picture(
    image: Tensor,
    label: str,
    alt: str,
    *,
    gain: float = 1.0,
    note: str = "",
    largest: int = LARGEST_SIDE,
    colours: Tensor | None = None,
) -> Picture:
    """A linear image [3, y, x] as a picture. Values that are not numbers turn magenta, as in no photograph.

    image: [3, y, x], linear.
    colours: matrix [3, 3] to linear sRGB, see `developed`; None for the image's own colours.

    Images longer than `largest` are averaged, in linear light, over whole blocks of pixels.
    """
    linear, block = _in_blocks(image.detach().cpu().float(), largest)
    if block > 1:
        note = f"{note}, shown at 1/{block} of its size".lstrip(", ")
    encoded = srgb_encode(developed(torch.nan_to_num(linear, nan=0.0), colours) * gain)
    bad = ~torch.isfinite(linear).all(0)
    encoded[:, bad] = torch.tensor(NOT_A_NUMBER)[:, None]
    pixels = (encoded * 255).round().to(torch.uint8).permute(1, 2, 0).contiguous().numpy()
    return Picture(png_bytes(pixels), pixels.shape[1], pixels.shape[0], label, alt, note)


def _in_blocks(image: Tensor, largest: int) -> tuple[Tensor, int]:
    """An image [channel, y, x] averaged over whole blocks of pixels, and their side."""
    block = math.ceil(max(image.shape[-2:]) / largest)
    if block == 1:
        return image, 1
    pooled = torch.nn.functional.avg_pool2d(image[None], block, ceil_mode=True, count_include_pad=False)
    return pooled[0], block


def depth_picture(inverse_depth: Tensor) -> tuple[Picture, float]:
    """Inverse depths [y, x] in 1/m for a page's script: red * 256 + green, 65535 the largest, blue where
    there is none; in the blocks that `picture` takes. And the largest.

    inverse_depth: [y, x], 1/m.
    """
    depth, _ = _in_blocks(inverse_depth.detach().cpu().float()[None], LARGEST_SIDE)
    known = torch.isfinite(depth[0])
    most = float(depth[0][known].max()) if bool(known.any()) else 0.0
    code = (torch.nan_to_num(depth[0]) / (most or 1.0) * 65535).round().clamp(0, 65535).long()
    pixels = torch.stack([code // 256, code % 256, 255 * (~known).long()], -1).to(torch.uint8).numpy()
    return Picture(png_bytes(pixels), pixels.shape[1], pixels.shape[0], "depth", ""), most


def picture_file(path: Path, label: str, alt: str, *, note: str = "") -> Picture:
    """A PNG file as a picture. Raises InputError where it cannot be read."""
    try:
        content = path.read_bytes()
        with Image.open(io.BytesIO(content)) as image:
            return Picture(content, image.width, image.height, label, alt, note)
    except (OSError, SyntaxError) as error:
        raise InputError(f"{path}: cannot be read as a picture ({error}); run the same again") from None


def with_boxes(shown: Picture, boxes: tuple[Box, ...], full_width: int) -> Picture:
    """The picture with frames that were measured in pixels of the full image, `full_width` wide."""
    scale = shown.width / full_width
    scaled = (Box(b.x * scale, b.y * scale, b.width * scale, b.height * scale, b.name) for b in boxes)
    return replace(shown, boxes=tuple(scaled))
