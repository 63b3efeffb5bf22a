"""From a camera's colours to sRGB: the light of a scene, and the matrix that a raw developer would apply."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.json_values import Json
from ..core.tables import kept_tables
from ..recipe.scene import SceneRecipe
from ..scene.lights import build_lights
from ..scene.model import Environment, SceneObject
from ..scene.spectra import illuminant, observer, rows_of

if TYPE_CHECKING:
    from .fragments import Fragments
    from .view import View

LIGHT = "light spectrum"
"""Key in a view's metadata: the spectrum of the light on the scene, one number a band, mean 1."""
LEAST_BANDS = 8
"""Fewer bands hold no colours that a screen could show: their channels are shown as they are."""
PLACES = 256
"""Places of a view at which the light is summed."""


def lit(view: Fragments, recipe: SceneRecipe, base: Path) -> Fragments:
    """The view with the spectrum of its light in the metadata, where the recipe has lights.

    Raises InputError for an environment map that cannot be read.
    """
    if LIGHT in view.metadata or not recipe.lights:
        return view
    environment, lamps = build_lights(recipe.lights, view.wavelengths, base)
    spectrum = scene_light(environment, lamps, _places(view))
    return replace(view, metadata={**view.metadata, **light_entry(spectrum)})


def light_entry(spectrum: np.ndarray) -> Json:
    """The entry of a view's metadata for the spectrum [band] of its light; empty for no light.

    spectrum: [band].
    """
    mean = float(np.mean(spectrum))
    return {LIGHT: [float(f"{value:.6g}") for value in spectrum / mean]} if mean > 0 else {}


def light_of(view: View | Fragments) -> np.ndarray | None:
    """The spectrum [band] of the light on a view's scene, mean 1; None where it is not known."""
    values = view.metadata.get(LIGHT)
    return np.array(values, float) if isinstance(values, list) and len(values) == view.bands else None


def scene_light(environment: Environment | None, lamps: list[SceneObject], places: np.ndarray) -> np.ndarray:
    """Irradiance on surfaces that face the camera (normal -z) at `places` [place, 3] in metres, summed over
    them, float64 [band]. Nothing casts a shadow, and no light is reflected.

    places: [place, 3], metres.
    """
    total: np.ndarray | float = 0.0
    if environment is not None:
        basis, image = environment.radiance.basis.astype(float), environment.radiance.image
        if image is not None:
            weights = _facing_back(len(image), image.shape[1])
            basis = np.einsum("yx,yxn->n", weights / weights.sum(), image.astype(float)) @ basis
        total = np.pi * len(places) * np.atleast_2d(basis).sum(0)
    for lamp in lamps:
        if lamp.emission is not None:
            corners = lamp.mesh.vertices.astype(float)[lamp.mesh.faces]
            total = total + lamp.emission.astype(float) * _seen_of(corners, places)
    return np.asarray(total)


def _facing_back(rows: int, columns: int) -> np.ndarray:
    """What the directions of an equirectangular picture add to a surface that faces -z, [y, x]."""
    polar = (np.arange(rows) + 0.5) / rows * np.pi
    azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    return np.outer(np.sin(polar) ** 2, -np.cos(azimuth)).clip(0)


def _seen_of(corners: np.ndarray, places: np.ndarray) -> float:
    """Projected solid angle of the fronts of triangles [face, 3, 3] from surfaces facing -z, summed over
    places, sr. Each triangle counts as a point at its centre."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area, centre, total = np.linalg.norm(normal, axis=1), corners.mean(1), 0.0
    for place in places:
        away = place - centre
        # a place on the lamp itself would see more than half of all directions
        squared = np.maximum((away**2).sum(1), area)
        total += float(((normal * away).sum(1).clip(0) * away[:, 2].clip(0) / squared**2).sum())
    return total


def _places(view: Fragments) -> np.ndarray:
    """Where `PLACES` visible fragments at finite depths lie, [place, 3] in metres, x to the right, y up."""
    which = np.flatnonzero(~view.hidden & (view.inverse_depth > 1e-3))
    which = which[:: max(1, len(which) // PLACES)]
    if not len(which):
        return np.array([[0.0, 0.0, 1.0]])
    rows, columns = view.padded_shape
    y, x = np.divmod(view.pixel[which], columns)
    depth = 1 / view.inverse_depth[which].astype(float)
    scale = view.pixel_angle * depth
    return np.stack([(x - (columns - 1) / 2) * scale, ((rows - 1) / 2 - y) * scale, depth], axis=1)


def colour_matrix(
    response: np.ndarray, wavelengths: np.ndarray, light: np.ndarray | None = None
) -> np.ndarray | None:
    """Matrix [3, 3] from a sensor's red, green, blue to linear sRGB; None where bands hold no colours.

    response: [3, band], of the sensor.
    wavelengths: [band], metres.
    light: [band], spectrum of the light on the scene; None for D65.

    White balance first: a white surface in this light has equal channels, and none is made darker. Then the
    matrix that keeps white and fits, by least squares, the 99 measured reflectances of CIE 224:2017 under the
    light, as the observer of CIE 1931 sees them, adapted to D65 (Bradford).
    """
    values = (response, wavelengths) if light is None else (response, wavelengths, light)
    found = _matrix(*(np.ascontiguousarray(each, np.float64).tobytes() for each in values))
    return None if found is None else found.copy()


@lru_cache(maxsize=64)
def _matrix(response: bytes, wavelengths: bytes, light: bytes | None = None) -> np.ndarray | None:
    metres = np.frombuffer(wavelengths)
    sensor = np.frombuffer(response).reshape(3, -1)
    nm = metres * 1e9
    if len(nm) < LEAST_BANDS or nm.min() < 300 or nm.max() > 830:
        return None
    falling = illuminant("D65", metres) if light is None else np.frombuffer(light)
    tables = kept_tables("colours to fit a camera to", _tables)
    nm_of, *samples = tables["samples"]
    reflected = np.stack([np.interp(nm, nm_of, sample) for sample in samples]) * falling
    eye_nm, *curves = observer()
    eye = np.stack([np.interp(nm, eye_nm, curve) for curve in curves])
    white, seen_white = eye @ falling, sensor @ falling
    if (white <= 0).any() or (seen_white <= 0).any():
        return None
    to_srgb, cones = tables["XYZ to sRGB"], tables["Bradford"]
    ratio = (cones @ np.linalg.solve(to_srgb, np.ones(3))) / (cones @ (white / white[1]))
    adapted = to_srgb @ np.linalg.inv(cones) @ (ratio[:, None] * cones)
    wanted = reflected @ eye.T / white[1] @ adapted.T
    balanced = reflected @ sensor.T / seen_white
    # each row of the matrix sums to 1, so that white stays white
    basis = balanced[:, :2] - balanced[:, 2:]
    rows = np.linalg.lstsq(basis, wanted - balanced[:, 2:], rcond=None)[0].T
    matrix = np.column_stack([rows, 1 - rows.sum(1)])
    return matrix * (seen_white.max() / seen_white)


def _tables() -> dict[str, np.ndarray]:
    from colour import CHROMATIC_ADAPTATION_TRANSFORMS, RGB_COLOURSPACES, SpectralShape
    from colour.quality.cfi2017 import load_TCS_CIE2017

    return {
        "samples": rows_of(load_TCS_CIE2017(SpectralShape(380, 780, 5))),
        "XYZ to sRGB": np.asarray(RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB),
        "Bradford": np.asarray(CHROMATIC_ADAPTATION_TRANSFORMS["Bradford"]),
    }
