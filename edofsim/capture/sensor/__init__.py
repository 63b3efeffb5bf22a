"""From light on the sensor to numbers: exposure, and the sensor's effects, one kind a file.

Full scale is 1. All effects are one list: those of the recipe's own keys, in the order of a sensor (mosaic,
shot noise, read noise, saturation, quantisation), and those of `sensor.effects`, each right before the one
that it names, or at the end, in the order in which they are listed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ...optics import Camera
from ..fidelity import Fidelity, simplified
from .base import SensorEffect, Signal
from .mosaic import Mosaic
from .quantisation import Quantisation
from .read_noise import ReadNoise
from .saturation import Saturation
from .shot_noise import ShotNoise

WHITE_PERCENTILE = 99.5
WHITE_LEVEL = 0.9
"""Automatic exposure puts the 99.5th percentile of the ideal image, over all channels, at 0.9."""
METERED = 4
"""Side in pixels of what the exposure of a rendered view is metered over."""
ROOM = 1e-3
"""Part of a precision's range that exposed images may fill: sums over pixels must fit into it too."""
MIDDLE_GREY = 0.18
"""Of full scale: where an exposure puts the median of a photo."""
LEFT_OUT_BY: Mapping[str, str] = {
    "bayer-mosaic": "mosaic",
    "shot-noise": "shot_noise",
    "read-noise": "read_noise",
    "saturation": "saturation",
    "quantisation": "quantisation",
}
"""Fields of `Fidelity` that leave effects out, by kind."""

__all__ = ["SensorEffect", "Signal", "automatic_exposure", "noise_deviation", "record", "sensor_effects"]


def automatic_exposure(ideal: Tensor, *, noisy: bool = False) -> float:
    """Factor from radiance to full scale for an ideal image [..., y, x]; 1 where the image is black.

    ideal: [..., y, x], linear.
    noisy: the image has noise of its own, as a view's that is rendered (`View.noise`). Noise would raise the
        percentile, by 8 % of the exposure at 16 samples a pixel, so it is taken of means over 4 x 4 pixels.

    It is smaller where a photo of so little light, or a highlight so bright, would not fit into the image's
    precision.
    """
    values = ideal.detach()
    if noisy:
        values = avg_pool2d(values.reshape(-1, 1, *values.shape[-2:]), METERED, ceil_mode=True)
    values = values.flatten()
    index = min(values.numel() - 1, round(WHITE_PERCENTILE / 100 * (values.numel() - 1)))
    white = float(torch.kthvalue(values, index + 1).values)  # torch.quantile refuses large images
    if not white > 0:
        return 1.0
    room = ROOM * torch.finfo(values.dtype).max / max(float(ideal.max()), 1.0)
    return min(WHITE_LEVEL / white, room)


def sensor_effects(camera: Camera, fidelity: Fidelity | None = None) -> tuple[SensorEffect, ...]:
    """What the camera's sensor does, in order, without what a fidelity leaves out.

    camera: the recipe's sensor.
    fidelity: None leaves nothing out.
    """
    fidelity = fidelity or Fidelity()
    sensor = simplified(camera, fidelity).recipe.sensor
    found: list[SensorEffect] = []
    if sensor.bayer:
        found.append(Mosaic(pattern=sensor.bayer))
    if sensor.full_well_electrons:
        found.append(ShotNoise(full_well_electrons=sensor.full_well_electrons))
    if sensor.read_noise:
        found.append(ReadNoise(deviation=sensor.read_noise))
    if sensor.saturation:
        found.append(Saturation())
    if sensor.bits:
        found.append(Quantisation(bits=sensor.bits))
    for effect in sensor.effects:
        assert isinstance(effect, SensorEffect)  # what the registry holds
        kinds = [each.kind for each in found]
        found.insert(kinds.index(effect.before) if effect.before in kinds else len(found), effect)
    return tuple(
        effect
        for effect in found
        if getattr(fidelity, LEFT_OUT_BY.get(effect.kind, ""), True)
        and effect.kind not in fidelity.without_sensor
    )


def noise_deviation(camera: Camera, light: Tensor | None = None) -> float:
    """Standard deviation of all noise of the camera's sensor, root mean square over exposed light, such as a
    photo or its levels; without it, of middle grey.

    light: any shape [...], exposed, full scale 1.
    camera: the recipe's sensor.
    """
    level = torch.tensor(MIDDLE_GREY) if light is None else light
    variances = [effect.variance(level.double()).mean() for effect in sensor_effects(camera)]
    return math.sqrt(sum(float(variance) for variance in variances))


def record(clean: Tensor, effects: Sequence[SensorEffect], seed: int) -> Tensor:
    """What the sensor makes of noise-free exposed images [..., channel, y, x]; same shape.

    clean: [..., channel, y, x], exposed, without noise.
    effects: what `sensor_effects` gives.
    seed: of the noise, the same on every device.
    """
    generator = torch.Generator().manual_seed(seed)
    signal = Signal(clean)
    for effect in effects:
        signal = effect.act(signal, generator)
    return signal.image
