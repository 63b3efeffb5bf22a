"""Hard inputs of restoration: filters, networks, losses and scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from ..capture.planes import photograph
from ..optics import PAPER_COLOURS, psf_bank
from ..restore import wiener
from ..restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from ..restore.light import REACH
from ..restore.losses import gradient_prior, restoration_loss
from ..restore.network import apply_network, build_network
from ..restore.restorer import Restorer
from ..restore.scores import psnr, score
from .case import Case, Finding, timed
from .measures import READ_NOISE, distance
from .views import uniform

KINDS = ("dcnn", "local-unet", "filter-bank")
"""That gradients are taken of, untrained."""
PRECISIONS = (torch.float64, torch.float32)
SHIPPED = ("paper-dcnn", "paper-bank")
EVEN = 0.01
"""Of full scale, of one colour: as `flat colours` hold it."""
MIDDLE = (..., slice(24, -24), slice(24, -24))
"""Of a photo, where nothing beyond it is seen."""
LEFT = 0.25
"""Of the mean square error of a photo, after restoration."""
MIXED = 0.05
"""Of full scale: bfloat16 knows three digits, and a network has twenty layers."""
HUES = ((1, 1, 1), (1, 0.4, 0.4), (1, 1, 0.4), (0.4, 1, 0.4), (0.4, 1, 1), (0.4, 0.4, 1), (1, 0.4, 1))
LAMPS = (60.0, 1e4, 1e8, 1e12)  # times full scale


def _name(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def box(side: int, window: int = 15) -> Tensor:
    """A square blur [3, y, x]: its transfer function has zeros."""
    psf = torch.zeros(3, window, window, dtype=torch.float64)
    first = window // 2 - side // 2
    psf[:, first : first + side, first : first + side] = 1 / side**2
    return psf


def _beyond(image: Tensor, low: float, high: float) -> float:
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
                restored = wiener(photo.to(dtype), box(5).to(dtype), noise).double()
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
            yield timed(f"Wiener, {way}", bound, lambda f=found: _apart(f, image))
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
                lambda d=dtype: distance(wiener(photo.to(d), psf.to(d), 0.0).double(), sharp),
            )

    return check


def _even_photos(
    colour: tuple[float, float, float], rows: int, columns: int, bound: float
) -> Callable[[], Iterator[Finding]]:
    """A photo of one colour through the networks that ship: a blur leaves it as it is, up to full scale."""

    def check() -> Iterator[Finding]:
        image = torch.tensor(colour)[:, None, None].expand(3, rows, columns).contiguous()
        truth = image.double().clamp(0, 1)
        for checkpoint in map(load_checkpoint, SHIPPED):
            network = checkpoint.network
            with torch.inference_mode():
                single = apply_network(network, image).double()
                with torch.autocast("cpu", torch.bfloat16):
                    mixed = apply_network(network, image).double()
                double = apply_network(network.double(), image.double())
            name = checkpoint.name
            for way, found in (("float32", single), ("float64", double)):
                yield timed(f"{name}, {way}", bound, lambda f=found: _apart(f, truth))
            yield timed(f"{name}, mixed precision", MIXED, lambda f=mixed, d=double: _apart(f, d), alike=True)
            way = f"{name}, float32 against float64"
            yield timed(way, 1e-4, lambda f=single, d=double: _apart(f, d), alike=True)

    return check


def _apart(image: Tensor, truth: Tensor) -> float:
    """The largest difference in full scales; NaN where anything is not finite."""
    return float((image - truth).abs().max()) if bool(torch.isfinite(image).all()) else math.nan


def _restored() -> Iterator[Finding]:
    """Photographs through the optics and the network that were made together: what is left of the photo's
    error, mean square, and of what is more than 24 pixels from the border."""
    from skimage import data

    picture = torch.from_numpy(data.astronaut()).permute(2, 0, 1)[:, 20:276, 120:376].float() / 255
    for checkpoint in map(load_checkpoint, SHIPPED):
        camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
        for inverse_depth in (0.0, 1.0, 2.0):
            psf = psf_bank(camera, PAPER_COLOURS, [inverse_depth], window_px=64).values
            photo = photograph(picture[None], psf)[0]
            sharp = picture[:, 31:-32, 31:-32]
            noise = torch.randn(photo.shape, generator=torch.Generator().manual_seed(3))
            photo = photo + READ_NOISE * noise

            def left(
                network: Restorer = checkpoint.network, photo: Tensor = photo, sharp: Tensor = sharp
            ) -> float:
                found = apply_network(network, photo)
                error = (found - sharp)[MIDDLE].square().mean() / (photo - sharp)[MIDDLE].square().mean()
                return float(error)

            yield timed(f"{checkpoint.name}, {inverse_depth:g} /m, error left", LEFT, left)


def _lamp_far_away() -> Iterator[Finding]:
    """Shipped networks: a lamp changes nothing beyond their reach and that of what keeps the light."""
    _, photo = blurred(64, 576, 0.005)
    photo = photo.float()
    for checkpoint in map(load_checkpoint, SHIPPED):
        network = checkpoint.network
        assert network.radius is not None
        beyond = (..., slice(8 + network.radius + network.multiple + REACH, None))
        with torch.inference_mode():
            alone = apply_network(network, photo)
            for brightness in LAMPS:
                lit = photo.clone()
                lit[:, 32, 8] = brightness
                found = apply_network(network, lit)
                name = f"{checkpoint.name}, {brightness:g}"
                yield timed(name, 0.0, lambda found=found: _beyond(found, 0.0, 1.0))
                yield timed(
                    f"{name}, far away",
                    1e-4,
                    lambda a=found[beyond], b=alone[beyond]: float((a - b).abs().max()),
                )


def _flat_colours() -> Iterator[Finding]:
    """Shipped networks: the mean of each channel of flat colours, which look the same at every distance."""
    noise = 0.005 * torch.randn(3, 192, 192, generator=torch.Generator().manual_seed(9))
    for checkpoint in map(load_checkpoint, SHIPPED):
        for level in (0.02, 0.05, 0.2, 0.8, 1.0):
            for hue in HUES:
                colour = level * torch.tensor(hue)

                def wrong(network: Restorer = checkpoint.network, colour: Tensor = colour) -> float:
                    restored = apply_network(network, colour[:, None, None] + noise)
                    return float((restored.mean((-1, -2)) / colour - 1).abs().max())

                yield timed(f"{checkpoint.name}, {level:g} x {hue}", 0.02, wrong)


def _lamp_in_the_dark() -> Iterator[Finding]:
    """Shipped networks: a lamp, blurred, leaves its surroundings as dark as they are."""
    dark = 0.05
    sharp = torch.full((3, 192, 192), dark)
    around = torch.ones(192, 192, dtype=torch.bool)
    around[64:128, 64:128] = False
    for checkpoint in map(load_checkpoint, SHIPPED):
        for brightness in (1.0, 10.0, 100.0):
            sharp[:, 94:98, 94:98] = brightness
            photo = torch.nn.functional.avg_pool2d(sharp, 9, 1, 4, count_include_pad=False)
            for name, seen in (("", photo), (", clipped", photo.clamp_max(1))):

                def halo(network: Restorer = checkpoint.network, seen: Tensor = seen) -> float:
                    return float((apply_network(network, seen)[:, around] - dark).abs().max())

                yield timed(f"{checkpoint.name}, {brightness:g}{name}", 0.02, halo)


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
        "saturated photo",
        "restoration",
        "all at full scale",
        "a clamp without slope",
        "full scale",
        _even_photos((1.0, 1.0, 1.0), 24, 25, EVEN),
    ),
    Case(
        "beyond full scale",
        "restoration",
        "a photo of 1e3",
        "overflow in half precision",
        "full scale",
        _even_photos((1e3, 1e3, 1e3), 16, 16, EVEN),
    ),
    Case(
        "photographs",
        "restoration",
        "a portrait through mask and network that ship, near, far and between",
        "a network that does nothing, or not for these optics",
        "less than a quarter of the photo's error",
        _restored,
    ),
    Case(
        "flat colours",
        "restoration",
        "of any brightness, in six hues and grey",
        "too little light in the dark, other hues",
        "each channel's mean within 2 %",
        _flat_colours,
    ),
    Case(
        "a lamp in the dark",
        "restoration",
        "up to 100 in 16 pixels, blurred",
        "the lamp's light bleeds as a halo where the light of a photo is kept",
        "0.05 beyond 30 pixels, within 0.02",
        _lamp_in_the_dark,
    ),
    Case(
        "a lamp far away",
        "restoration",
        "up to 1e12 in one pixel",
        "rounding of the lamp all over the photo",
        "as without it",
        _lamp_far_away,
    ),
    Case(
        "dark photo",
        "restoration",
        "all at 0",
        "batch statistics of nothing",
        "dark",
        _even_photos((0.0, 0.0, 0.0), 24, 25, EVEN),
    ),
    Case(
        "photo of one pixel",
        "restoration",
        "1 x 1",
        "an axis of length 1",
        "its own colour",
        _even_photos((0.5, 0.3, 0.7), 1, 1, EVEN),
    ),
    Case(
        "photo of one row",
        "restoration",
        "1 x 31",
        "an axis of length 1",
        "its own colour",
        _even_photos((0.5, 0.3, 0.7), 1, 31, EVEN),
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
