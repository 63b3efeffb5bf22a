"""A scene as plain data: meshes, surfaces and lights sampled at the wavelengths of the view.

This is all that the renderer needs to know, and nothing in it belongs to one render engine. Positions
are metres in camera space: x right, y up, z the depth along the optical axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class TriangleMesh:
    """Triangles of one object.

    vertices: float32 [vertex, 3] in metres.
    faces: uint32 [face, 3].
    uv: float32 [vertex, 2] or None, (0, 0) the lower left corner of a texture.
    normals: float32 [vertex, 3] or None (then faces are flat). Faces are wound so that (b - a) x (c - a),
        taken by coordinates, points outward; lamps shine that way. Textures repeat outside [0, 1].
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None


@dataclass(frozen=True)
class BandTexture:
    """A quantity over bands that may vary over a surface: value(band, uv) = sum_j c_j(uv) basis[j, band].

    basis: float32 [n, band] with n <= 3.
    image: float32 [y, x, n] of coefficients (row 0 is the top), or None where the value is the same
        everywhere (then n = 1 and the coefficient is 1).
    """

    basis: np.ndarray
    image: np.ndarray | None = None


@dataclass(frozen=True)
class Surface:
    """How light leaves a surface: a Mitsuba BSDF (its plugin dictionary without the reflectance) and the
    reflectance, which every BSDF used here depends on affinely.

    reflectance_key names the plugin's parameter that the reflectance is (`reflectance`,
    `diffuse_reflectance`, `specular_reflectance`, `base_color`, `specular_transmittance`); empty where there
    is none, as for clear glass, whose light is split by its refractive index alone.

    per_band: other parameters of the plugin that change with wavelength, float64 [band] each, such as
        `int_ior` of dispersive glass. They steer the path itself, so beyond such a surface one path can't
        carry all bands; `SceneModel.dispersive` tells which objects have one.
    """

    bsdf: Mapping[str, object]
    reflectance_key: str
    reflectance: BandTexture
    two_sided: bool = True
    per_band: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneObject:
    """One object: its mesh, surface, and radiance if it is a lamp (float32 [band], W/m2/sr/nm)."""

    name: str
    mesh: TriangleMesh
    surface: Surface
    emission: np.ndarray | None = None


@dataclass(frozen=True)
class Environment:
    """Light from infinity. radiance.image is equirectangular (top row: straight up, +y; the centre column
    looks along +z, the view direction), or None for the same radiance from everywhere."""

    radiance: BandTexture


@dataclass(frozen=True)
class SceneModel:
    """A whole scene.

    wavelengths: float64 [band] in metres.
    path_length: what the scene's own file asks for, as `render.max_depth` counts, None where it asks for
        none.
    """

    name: str
    wavelengths: np.ndarray
    objects: tuple[SceneObject, ...]
    environment: Environment | None = None
    notes: Mapping[str, str] = field(default_factory=dict)
    path_length: int | None = None

    @property
    def dispersive(self) -> tuple[str, ...]:
        """Names of the objects whose surfaces bend each wavelength differently; empty for most scenes."""
        return tuple(o.name for o in self.objects if o.surface.per_band)
