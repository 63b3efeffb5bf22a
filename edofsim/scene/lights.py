"""Lights of a scene: radiance from infinity, and lamps, which are objects that shine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..recipe.objects import AnyLight, AreaLamp, EnvironmentLight, SkyLight
from . import solids, spectra
from .model import BandTexture, Environment, SceneObject
from .surfaces import matt
from .textures import flat

SKY_SHAPE = (128, 256)


def build_lights(
    lights: Sequence[AnyLight], wavelengths: np.ndarray
) -> tuple[Environment | None, list[SceneObject]]:
    """The environment (at most one) and the lamps of a recipe.

    Raises InputError for a second environment and for a lamp that aims at itself.
    """
    environment: Environment | None = None
    lamps: list[SceneObject] = []
    for index, light in enumerate(lights):
        if isinstance(light, AreaLamp):
            lamps.append(area_lamp(light, wavelengths, light.name or f"lamp-{index + 1}"))
            continue
        if environment is not None:
            raise InputError(
                f"lights[{index}] ({light.kind}): a scene has one light at infinity; take the other out"
            )
        environment = (
            constant_environment(light, wavelengths)
            if isinstance(light, EnvironmentLight)
            else sky(light, wavelengths)
        )
    return environment, lamps


def constant_environment(light: EnvironmentLight, wavelengths: np.ndarray) -> Environment:
    """The same radiance from everywhere."""
    spectrum = light.radiance * spectra.illuminant(light.illuminant, wavelengths)
    return Environment(BandTexture(spectrum[None].astype(np.float32)))


def sky(light: SkyLight, wavelengths: np.ndarray) -> Environment:
    """A clear sky with haze: the horizon's light fades into the zenith's with height, and what the ground
    sends back fills the lower half. Three spectra, so that it is one picture of three coefficients."""
    horizon = spectra.daylight(light.horizon_cct_k, wavelengths)
    zenith = spectra.daylight(light.zenith_cct_k, wavelengths)
    ground = horizon * spectra.reflectance(light.ground_reflectance, wavelengths)
    visible = np.arange(400.0, 701.0, 5.0)  # the same scale for any bands
    lit = spectra.daylight(light.horizon_cct_k, visible * 1e-9)
    ground /= spectra.luminance(lit * spectra.reflectance(light.ground_reflectance, visible * 1e-9), visible)
    rows = SKY_SHAPE[0]
    height = np.cos((np.arange(rows) + 0.5) / rows * np.pi)  # sine of the elevation, +1 straight up
    overhead = 1 - np.exp(-3 * np.clip(height, 0, None))
    overhead = overhead / (1 - np.exp(-3))
    # the horizon is a band of a few degrees, so that no bright line is cut off by a row of pixels
    below = np.clip(-height / 0.15, 0, 1)
    above = 1 - below
    weights = [above * (1 - overhead), above * overhead * light.zenith, below * light.ground]
    image = np.broadcast_to(light.radiance * np.stack(weights, axis=1)[:, None, :], (*SKY_SHAPE, 3))
    basis = np.stack([horizon, zenith, ground])
    return Environment(BandTexture(basis.astype(np.float32), np.ascontiguousarray(image, np.float32)))


def area_lamp(light: AreaLamp, wavelengths: np.ndarray, name: str) -> SceneObject:
    """A rectangle that shines from its front side, towards the target; its body is black."""
    position, target = np.array(light.position_mm) * 1e-3, np.array(light.target_mm) * 1e-3
    direction = target - position
    distance = np.linalg.norm(direction)
    if distance == 0:
        raise InputError(f"{name}: position_mm and target_mm are the same; the lamp has no direction")
    forward = direction / distance
    helper = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    # a panel's front is -z, so that -z turns into the direction
    z = -forward
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    shape = solids.panel(light.size_mm[0] * 1e-3, light.size_mm[1] * 1e-3)
    emission = light.radiance * spectra.illuminant(light.illuminant, wavelengths)
    return SceneObject(
        name,
        solids.moved(shape, rotation, position),
        matt(flat(0.0, wavelengths)),
        emission.astype(np.float32),
    )
