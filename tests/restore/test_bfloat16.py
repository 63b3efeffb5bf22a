"""bfloat16 between the layers of a D-CNN in a filter bank: the same image on all processors, in less time."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from edofsim.restore import bfloat16
from edofsim.restore.bfloat16 import convolved
from edofsim.restore.checkpoint import load_checkpoint

FAST = (True, False) if bfloat16.multiplied_fast(torch.device("cpu")) else (False,)


def _photo() -> torch.Tensor:
    generator = torch.Generator().manual_seed(2)
    coarse = torch.rand(1, 3, 9, 12, generator=generator)
    sharp = functional.interpolate(coarse, size=(96, 120), mode="bicubic").clamp(0, 1)
    return sharp + 0.005 * torch.randn(sharp.shape, generator=generator)


@pytest.mark.parametrize("fast", FAST)
def test_products_are_exact_and_rounded_once(fast: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against float64 on the same rounded numbers; sums of float32 move a result across a step, rarely."""
    monkeypatch.setattr(bfloat16, "multiplied_fast", lambda device: fast)
    generator = torch.Generator().manual_seed(1)
    image = torch.rand(1, 32, 20, 24, generator=generator).bfloat16()
    weight, bias = torch.randn(16, 32, 3, 3, generator=generator), torch.randn(16, generator=generator)
    found = convolved(image, weight, bias, 2)
    exact = functional.conv2d(
        image.double(), weight.bfloat16().double(), bias.bfloat16().double(), dilation=2
    )
    assert found.dtype == torch.bfloat16
    assert float((found != exact.bfloat16()).double().mean()) < 1e-3
    assert float((found.double() - exact).abs().max() / exact.abs().max()) < 2**-8
    assert torch.equal(convolved(image.float(), weight, bias), functional.conv2d(image.float(), weight, bias))


def test_a_bank_gives_the_same_image_on_any_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousandth of full scale from what float32 gives, and far less between processors."""
    bank, photo = load_checkpoint("paper-bank").network.eval(), _photo()
    with torch.no_grad():
        found = []
        for fast in FAST:
            monkeypatch.setattr(bfloat16, "multiplied_fast", lambda device, fast=fast: fast)
            found.append(bank(photo))
        exact = bank.double()(photo.double())
    apart = float((found[-1] - exact).square().mean().sqrt())
    assert 1e-5 < apart < 1e-3
    for one in found[1:]:
        assert float((one - found[0]).square().mean().sqrt()) < apart / 5
        assert float((one - found[0]).abs().max()) < 2**-8


def test_where_gradients_are_asked_for_nothing_is_rounded() -> None:
    dcnn, photo = load_checkpoint("depth-dcnn").network.eval(), _photo()
    exact = dcnn.unclamped(photo)
    torch.testing.assert_close(dcnn.unclamped(photo, rounded=True), exact, rtol=0, atol=0)
    with torch.no_grad():
        # channels that hardly vary are left out here, too
        assert float((dcnn.unclamped(photo) - dcnn.unclamped(photo, rounded=True)).abs().max()) > 1e-4
