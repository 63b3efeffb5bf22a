"""Lights of a scene: radiance from infinity, and lamps, which are objects that shine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..recipe.lights import (
    AnyLight,
    AreaLamp,
    Bulb,
    EnvironmentLight,
    EnvironmentMap,
    NeonTube,
    SkyLight,
)
from . import pictures, solids, spectra
from .model import BandTexture, Environment, SceneObject, TriangleMesh
from .surfaces import matt
from .textures import flat

SKY_SHAPE = (128, 256)


def build_lights(
    lights: Sequence[AnyLight], wavelengths: np.ndarray, base: Path
) -> tuple[Environment | None, list[SceneObject]]:
    """The environment (at most one) and the lamps of a recipe; files are relative to `base`.

    wavelengths: [band], metres.

    Raises InputError for a second environment, an unreadable map, and a lamp that aims at itself.
    """
    environment: Environment | None = None
    lamps: list[SceneObject] = []
    for index, light in enumerate(lights):
        if isinstance(light, AreaLamp | Bulb | NeonTube):
            lamps.append(_lamp(light, wavelengths, light.name or f"lamp-{index + 1}"))
            continue
        if environment is not None:
            raise InputError(
                f"lights[{index}] ({light.kind}): a scene has one light at infinity; take the other out"
            )
        if isinstance(light, EnvironmentLight):
            environment = constant_environment(light, wavelengths)
        elif isinstance(light, SkyLight):
            environment = sky(light, wavelengths)
        else:
            environment = environment_map(light, wavelengths, base)
    return environment, lamps


def constant_environment(light: EnvironmentLight, wavelengths: np.ndarray) -> Environment:
    """The same radiance from everywhere.

    wavelengths: [band], metres.
    """
    spectrum = light.radiance * spectra.illuminant(light.illuminant, wavelengths)
    return Environment(BandTexture(spectrum[None].astype(np.float32)))


def sky(light: SkyLight, wavelengths: np.ndarray) -> Environment:
    """A clear sky with haze: the horizon's light fades into the zenith's with height, and what the ground
    sends back fills the lower half. Three spectra, so that it is one picture of three coefficients.

    wavelengths: [band], metres.
    """
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


def environment_map(light: EnvironmentMap, wavelengths: np.ndarray, base: Path) -> Environment:
    """A picture of all directions: linear sRGB over the basis of Mallett and Yuksel, seen as the illuminant
    where it is white. Negative values, which some files hold, count as 0.

    wavelengths: [band], metres.

    Raises InputError for a picture that cannot be read or is not twice as wide as high.
    """
    image = pictures.read_hdr(base / light.path, f"environment map {light.path!r}")
    rows, columns = image.shape[:2]
    if not 1.5 < columns / rows < 2.6:
        raise InputError(
            f"environment map {light.path!r} has {columns} x {rows} pixels; a picture of all directions "
            "(equirectangular) is twice as wide as high"
        )
    image = np.roll(np.clip(image, 0, None), round(light.turn_deg / 360 * columns), axis=1)
    white = spectra.illuminant(light.illuminant, wavelengths)
    basis = light.scale * white * spectra.srgb_basis(wavelengths)
    return Environment(BandTexture(basis.astype(np.float32), image.astype(np.float32)))


def bulb(light: Bulb, wavelengths: np.ndarray, name: str) -> SceneObject:
    """A shining ball.

    wavelengths: [band], metres.
    """
    shape = solids.moved(solids.sphere(light.radius_mm * 1e-3, 48), shift=np.array(light.position_mm) * 1e-3)
    return _shining(name, shape, light.radiance * spectra.illuminant(light.illuminant, wavelengths))


def neon_tube(light: NeonTube, wavelengths: np.ndarray, name: str) -> SceneObject:
    """A shining tube along a curve.

    wavelengths: [band], metres.
    """
    path = solids.smooth_path(np.array(light.points_mm) * 1e-3, light.closed)
    shape = solids.tube(path, light.radius_mm * 1e-3, 12, light.closed)
    filtered = spectra.illuminant(light.illuminant, wavelengths) * spectra.reflectance(
        light.colour, wavelengths
    )
    return _shining(name, shape, light.radiance * filtered)


def _shining(name: str, shape: TriangleMesh, emission: np.ndarray) -> SceneObject:
    black = matt(flat(0.0, np.empty(len(emission))))
    return SceneObject(name, shape, black, emission.astype(np.float32))


def area_lamp(light: AreaLamp, wavelengths: np.ndarray, name: str) -> SceneObject:
    """A rectangle that shines from its front side, towards the target; its body is black.

    wavelengths: [band], metres.

    Raises InputError for a lamp that is where its target is.
    """
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
    return _shining(name, solids.moved(shape, rotation, position), emission)


def _lamp(light: AreaLamp | Bulb | NeonTube, wavelengths: np.ndarray, name: str) -> SceneObject:
    match light:
        case AreaLamp():
            return area_lamp(light, wavelengths, name)
        case Bulb():
            return bulb(light, wavelengths, name)
        case NeonTube():
            return neon_tube(light, wavelengths, name)
