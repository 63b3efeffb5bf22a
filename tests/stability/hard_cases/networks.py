"""Photos that are hard to restore, through the networks that ship."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from edofsim.capture.planes import capture_planes
from edofsim.optics import PAPER_COLOURS, psf_bank
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.filter_bank import FilterBank
from edofsim.restore.light import REACH
from edofsim.restore.network import apply_network
from edofsim.restore.restorer import Restorer
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import READ_NOISE

from .restoration import apart, beyond, blurred

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
BFLOAT16_STEP = 2**-8
"""Between bfloat16 numbers just below 1."""
LAMPS = (60.0, 1e4, 1e8, 1e12)  # times full scale


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
                yield timed(f"{name}, {way}", bound, lambda f=found: apart(f, truth))
            yield timed(f"{name}, mixed precision", MIXED, lambda f=mixed, d=double: apart(f, d), alike=True)
            way = f"{name}, float32 against float64"
            yield timed(way, 1e-4, lambda f=single, d=double: apart(f, d), alike=True)

    return check


def _restored() -> Iterator[Finding]:
    """Photographs through the optics and the network that were made together: what is left of the photo's
    error, mean square, and of what is more than 24 pixels from the border."""
    from skimage import data

    picture = torch.from_numpy(data.astronaut()).permute(2, 0, 1)[:, 20:276, 120:376].float() / 255
    for checkpoint in map(load_checkpoint, SHIPPED):
        camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
        for inverse_depth in (0.0, 1.0, 2.0):
            psf = psf_bank(camera, PAPER_COLOURS, [inverse_depth], window_px=64).values
            photo = capture_planes(picture[None], psf)[0]
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
    """Shipped networks: a lamp changes nothing beyond their reach and that of what keeps the light, but for
    bfloat16's rounding where layers hand that on. Glare's mean over the photo moves by as little as 1e-6."""
    _, image = blurred(16, 480, 0.005)
    for checkpoint in map(load_checkpoint, SHIPPED):
        network = checkpoint.network
        assert network.radius is not None
        far_away = (..., slice(8 + network.radius + network.multiple + REACH, None))
        steps = BFLOAT16_STEP if isinstance(network, FilterBank) else 1e-4
        for numbers, bound, lamps in ((torch.float32, steps, LAMPS), (torch.float64, 1e-5, LAMPS[::3])):
            network, photo = network.to(numbers), image.to(numbers)
            with torch.inference_mode():
                alone = apply_network(network, photo)
                for brightness in lamps:
                    lit = photo.clone()
                    lit[:, 8, 8] = brightness
                    found = apply_network(network, lit)
                    name = f"{checkpoint.name}, {numbers}, {brightness:g}"
                    yield timed(name, 0.0, lambda found=found: beyond(found, 0.0, 1.0))
                    yield timed(
                        f"{name}, far away",
                        bound,
                        lambda a=found[far_away], b=alone[far_away]: float((a - b).abs().max()),
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


CASES: tuple[Case, ...] = (
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
)
