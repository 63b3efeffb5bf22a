"""Hard inputs of restoration: filters, losses and scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from edofsim.restore import wiener
from edofsim.restore.losses import gradient_prior, restoration_loss
from edofsim.restore.network import build_network
from edofsim.restore.scores import psnr, score
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import distance
from edofsim.stability.views import uniform

KINDS = ("dcnn", "local-unet", "filter-bank")
"""That gradients are taken of, untrained."""
PRECISIONS = (torch.float64, torch.float32)


def _name(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def box(side: int, window: int = 15) -> Tensor:
    """A square blur [3, y, x]: its transfer function has zeros."""
    psf = torch.zeros(3, window, window, dtype=torch.float64)
    first = window // 2 - side // 2
    psf[:, first : first + side, first : first + side] = 1 / side**2
    return psf


def beyond(image: Tensor, low: float, high: float) -> float:
    """How far an image leaves a range; NaN where it is not finite."""
    if not bool(torch.isfinite(image).all()):
        return float("nan")
    return float(torch.stack([low - image.min(), image.max() - high]).max().clamp_min(0))


def blurred(rows: int, columns: int, noise: float) -> tuple[Tensor, Tensor]:
    """A picture whose power falls as its frequency squared, and its photo through `box(5)` with noise:
    [3, y, x] each. Around the frame lie its mirror images, as the filter assumes."""
    generator = torch.Generator().manual_seed(8)
    frequency = torch.fft.fftfreq(rows, dtype=torch.float64)[:, None].square()
    frequency = (frequency + torch.fft.rfftfreq(columns, dtype=torch.float64).square()).sqrt()
    white = torch.fft.rfft2(torch.randn(3, rows, columns, dtype=torch.float64, generator=generator))
    sharp = torch.fft.irfft2(white / frequency.clamp_min(1 / max(rows, columns)), s=(rows, columns))
    sharp = 0.5 + 0.15 * sharp / sharp.std()
    around = sharp
    for axis in (-2, -1):
        first, last = around.narrow(axis, 0, 2), around.narrow(axis, around.shape[axis] - 2, 2)
        around = torch.cat([first.flip(axis), around, last.flip(axis)], axis)
    photo = torch.nn.functional.avg_pool2d(around[None], 5, 1)[0]
    return sharp, photo + noise * torch.randn(photo.shape, dtype=torch.float64, generator=generator)


def _deblurred(noise: float, bound: float) -> Callable[[], Iterator[Finding]]:
    """The filter lowers the error of a photo whose blur passes nothing at some frequencies."""

    def check() -> Iterator[Finding]:
        sharp, photo = blurred(96, 97, noise)
        before = float((photo - sharp).square().mean())
        for dtype in PRECISIONS:

            def left(dtype: torch.dtype = dtype) -> float:
                restored = wiener(photo.to(dtype), box(5).to(dtype), noise, 0).double()
                return float((restored - sharp).square().mean()) / before

            yield timed(f"Wiener, {_name(dtype)}, error left", bound, left)

    return check


def _filtered(make: Callable[[], Tensor], bound: float) -> Callable[[], Iterator[Finding]]:
    """A photo of one colour through the Wiener filter of a box blur stays what it is, in both precisions."""

    def check() -> Iterator[Finding]:
        image = make()
        double = wiener(image, box(5), 0.005)
        single = wiener(image.float(), box(5).float(), 0.005).double()
        for way, found in (("float64", double), ("float32", single)):
            yield timed(f"Wiener, {way}", bound, lambda f=found: apart(f, image))
        yield timed("Wiener, float32 against float64", 1e-4, lambda: distance(single, double), alike=True)

    return check


def _inverted(make: Callable[[], Tensor]) -> Callable[[], Iterator[Finding]]:
    """Without noise a blur that passes every frequency, here 1/8, 3/4, 1/8 along both axes, is undone, in a
    world that goes on as its mirror image."""

    def check() -> Iterator[Finding]:
        sharp = make()
        tap = torch.tensor([0.125, 0.75, 0.125], dtype=torch.float64)
        around = sharp
        for axis in (-2, -1):
            first, last = around.narrow(axis, 0, 1), around.narrow(axis, around.shape[axis] - 1, 1)
            around = torch.cat([first, around, last], axis)
        photo = torch.nn.functional.conv2d(around[:, None], (tap[:, None] * tap)[None, None])[:, 0]
        psf = torch.zeros(3, 15, 15, dtype=torch.float64)
        psf[:, 6:9, 6:9] = tap[:, None] * tap
        for dtype, bound in ((torch.float64, 1e-6), (torch.float32, 1e-4)):
            yield timed(
                f"Wiener, {_name(dtype)}",
                bound,
                lambda d=dtype: distance(wiener(photo.to(d), psf.to(d), 0.0, 0).double(), sharp),
            )

    return check


def apart(image: Tensor, truth: Tensor) -> float:
    """The largest difference in full scales; NaN where anything is not finite."""
    return float((image - truth).abs().max()) if bool(torch.isfinite(image).all()) else math.nan


def _batch_of_one() -> Iterator[Finding]:
    """Training statistics of a single image, and of a single pixel."""
    for kind in KINDS:
        for rows, columns in ((16, 16), (8, 8)):

            def slope(kind: str = kind, rows: int = rows, columns: int = columns) -> float:
                torch.manual_seed(0)
                network = build_network(kind).train()
                photo = uniform(1, 3, rows, columns).float()
                network(photo).square().mean().backward()
                grads = torch.cat([p.grad.reshape(-1) for p in network.parameters() if p.grad is not None])
                return 0.0 if bool(torch.isfinite(grads).all()) else math.nan

            yield timed(f"{kind}, {rows} x {columns}, gradient is finite", 0.0, slope, alike=True)


def _loss(make: Callable[[], tuple[Tensor, Tensor]]) -> Callable[[], Iterator[Finding]]:
    """The loss and its slope are finite, and float32 is as float64."""

    def check() -> Iterator[Finding]:
        found = []
        for dtype in PRECISIONS:
            restored, sharp = (image.clone().to(dtype) for image in make())
            restored.requires_grad_()
            loss = restoration_loss(restored, sharp)
            (slope,) = torch.autograd.grad(loss, restored)
            found.append((loss.detach().double()[None], slope.double()))
        for name, position in (("value", 0), ("gradient", 1)):
            yield timed(
                f"{name}, float32 against float64",
                1e-4,
                lambda k=position: distance(found[1][k], found[0][k]),
                alike=True,
            )

    return check


def _prior_of_constant() -> Iterator[Finding]:
    for dtype in PRECISIONS:
        flat = torch.full((1, 3, 8, 8), 0.4, dtype=dtype, requires_grad=True)

        def slope(flat: Tensor = flat) -> float:
            value = gradient_prior(flat, flat.detach())
            (by,) = torch.autograd.grad(value, flat)
            return float(value.detach().abs()) + 0 * float(by.sum())

        yield timed(f"value and gradient, {_name(dtype)}", 1e-3, slope)


def _equal_images() -> Iterator[Finding]:
    image = uniform(3, 12, 12)
    yield timed("PSNR", 0.0, lambda: 0.0 if psnr(image, image) == math.inf else 1.0)
    yield timed("SSIM", 1e-12, lambda: abs(score(image, image).ssim - 1))
    flat = torch.full((3, 12, 12), 0.5, dtype=torch.float64)
    yield timed("SSIM of constants", 1e-12, lambda: abs(score(flat, flat).ssim - 1))


def _black_against_white() -> Iterator[Finding]:
    black, white = torch.zeros(3, 12, 12), torch.ones(3, 12, 12)
    yield timed("PSNR", 1e-6, lambda: abs(psnr(black, white)))
    grey = torch.full((3, 12, 12), 0.1, dtype=torch.float64)
    yield timed("PSNR of a tenth", 1e-6, lambda: abs(psnr(grey, black.double()) - 20))


def _ones(*shape: int) -> Tensor:
    return torch.ones(*shape, dtype=torch.float64)


CASES: tuple[Case, ...] = (
    Case(
        "zeros of the MTF",
        "restoration",
        "a box blur passes nothing at some frequencies",
        "division by 0",
        "a good part of the error gone",
        _deblurred(0.005, 0.6),
    ),
    Case(
        "zeros of the MTF, no noise",
        "restoration",
        "the filter becomes the inverse",
        "division by 0",
        "a tenth of the error at most",
        _deblurred(0.0, 0.1),
    ),
    Case(
        "constant photo",
        "restoration",
        "no contrast to fit",
        "0 / 0 in the spectrum",
        "as it was",
        _filtered(lambda: 0.4 * _ones(3, 32, 33), 1e-6),
    ),
    Case(
        "black photo",
        "restoration",
        "no light",
        "0 / 0 in the spectrum",
        "black",
        _filtered(lambda: 0 * _ones(3, 32, 33), 0.0),
    ),
    Case(
        "photo smaller than the PSF",
        "restoration",
        "7 x 5 and a window of 15",
        "wrap-around",
        "the sharp picture",
        _inverted(lambda: uniform(3, 7, 5)),
    ),
    Case(
        "one lamp in a photo",
        "restoration",
        "1e4 on black",
        "ringing",
        "the lamp alone",
        _inverted(lambda: torch.nn.functional.pad(1e4 * _ones(3, 1, 1), (15, 16, 15, 16))),
    ),
    Case(
        "batch of one",
        "restoration",
        "batch normalisation over a single image",
        "variance 0",
        "finite slopes",
        _batch_of_one,
    ),
    Case(
        "loss of equal images",
        "restoration",
        "nothing to improve",
        "the slope of |0|",
        "finite slopes",
        _loss(lambda: (uniform(1, 3, 9, 9),) * 2),
    ),
    Case(
        "loss of constants",
        "restoration",
        "no gradients in either image",
        "|g|^gamma at 0",
        "finite slopes",
        _loss(lambda: (0.3 * _ones(1, 3, 9, 9), 0.7 * _ones(1, 3, 9, 9))),
    ),
    Case(
        "prior of a constant",
        "restoration",
        "|g|^gamma at 0 for gamma below 1",
        "an infinite slope",
        "0, finite slope",
        _prior_of_constant,
    ),
    Case("equal images", "restoration", "an error of 0", "log of 0", "infinite PSNR, SSIM 1", _equal_images),
    Case(
        "black against white",
        "restoration",
        "the largest error",
        "a negative PSNR",
        "0 dB",
        _black_against_white,
    ),
)
