"""Convolutions of bfloat16, float32 with 8 bits for 24: some processors multiply it twice as fast or more."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def multiplied_fast(device: torch.device) -> bool:
    """Whether a device multiplies bfloat16 by units of its own: elsewhere it is several times slower."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    checks = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")
    return device.type == "cpu" and any(getattr(torch.cpu, name, lambda: False)() for name in checks)


def convolved(image: Tensor, weight: Tensor, bias: Tensor, dilation: int = 1) -> Tensor:
    """A convolution with weights rounded to the image's numbers, the same on every processor but for the
    order of its sums.

    image: [batch, in, y, x]. Of bfloat16, products are exact and added in float32, and what comes out is
        rounded once, whether the processor multiplies bfloat16 or not.
    weight: [out, in, y, x].
    bias: [out].
    """
    weight, bias = weight.to(image.dtype), bias.to(image.dtype)
    if image.dtype == torch.bfloat16 and not multiplied_fast(image.device):
        image, weight, bias = image.float(), weight.float(), bias.float()
        return functional.conv2d(image, weight, bias, dilation=dilation).bfloat16()
    return functional.conv2d(image, weight, bias, dilation=dilation)
