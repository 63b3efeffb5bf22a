"""The loss against Eq. `Loss` written out pixel by pixel, and its slope where images are flat."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.restore.losses import LossWeights, gradient_prior, restoration_loss


def _images(
    seed: int = 0, size: int = 6, dtype: torch.dtype = torch.float64
) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return tuple(torch.rand(2, 3, size, size, generator=generator, dtype=dtype) for _ in range(2))


def test_the_prior_is_the_papers_sum() -> None:
    """Eq. `Regularization` with its loops; the rounding at zero is far below gradients of a tenth."""
    restored, sharp = _images()
    weights = LossWeights(alpha=0.5, beta=3.0, gamma=0.7)
    total = 0.0
    for t in range(2):
        for band in range(3):
            for p in range(6):
                for q in range(6):
                    for dp, dq in ((1, 0), (0, 1)):
                        if p - dp < 0 or q - dq < 0:
                            continue
                        true = abs(float(sharp[t, band, p, q] - sharp[t, band, p - dp, q - dq]))
                        ours = abs(float(restored[t, band, p, q] - restored[t, band, p - dp, q - dq]))
                        total += math.exp(-3.0 * true**0.7) * ours**0.7
    expected = total / restored.numel()
    assert float(gradient_prior(restored, sharp, weights)) == pytest.approx(expected, abs=2 * 1e-3**0.7)
    whole = float((restored - sharp).abs().mean()) + 0.5 * float(gradient_prior(restored, sharp, weights))
    assert float(restoration_loss(restored, sharp, weights)) == pytest.approx(whole, rel=1e-12)


def test_a_flat_image_has_no_prior_and_a_finite_slope() -> None:
    """With gamma < 1 the slope of |g|^gamma at 0 is infinite; a flat image must not stop the training."""
    flat = torch.full((1, 3, 8, 8), 0.25, requires_grad=True)
    prior = gradient_prior(flat, torch.full((1, 3, 8, 8), 0.5))
    prior.backward()
    assert float(prior.detach()) == 0
    assert torch.isfinite(flat.grad).all()


def test_gradients_agree_with_differences() -> None:
    restored, sharp = _images(1, 4)
    restored.requires_grad_()
    assert torch.autograd.gradcheck(lambda image: restoration_loss(image, sharp), (restored,))
    flat = torch.zeros(1, 3, 4, 4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda image: gradient_prior(image, sharp), (flat,), eps=1e-7, atol=1e-4)


def test_true_edges_are_spared() -> None:
    """The same restored edge costs less where the truth has one."""
    edge = torch.zeros(1, 3, 4, 4)
    edge[..., 2:] = 1
    assert gradient_prior(edge, edge) < 0.01 * gradient_prior(edge, torch.zeros_like(edge))
