"""Mitsuba scenes that many bands on one path cannot carry, through Mitsuba's own spectral path integrators.

Frame, fragments, hidden surfaces, passes and sums are the same as for other views; only radiance comes from
another place. A spectral variant carries four wavelengths a path, here the centres of four bands: what would
be random is chosen, and every band is seen by every sample. So 31 bands take eight paths a sample.
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..recipe.scene import SceneRecipe
from ..scene.foreign import PINHOLES, MitsubaSource, camera_space
from ..scene.foreign.nodes import Node, all_nodes
from ..scene.foreign.parts import resolved
from ..scene.foreign.read import read_nodes
from ..scene.foreign.xml import parameters
from ..scene.model import TriangleMesh
from .closed import is_closed
from .engine import reading_files
from .keys import says_path_length
from .meshes import registry_table
from .translate import CLOSED, FIELDS

if TYPE_CHECKING:
    import mitsuba as mi

    from .rays import Lens, Samples

LOG = logging.getLogger(__name__)

WAVELENGTHS_A_PATH = 4
VOLUMES = ("VolumetricPathIntegrator", "VolpathMisIntegratorImpl")
SENSORS = {"PerspectiveCamera": PINHOLES[0], "ThinLensCamera": PINHOLES[1]}
INTEGRATORS = ("PathIntegrator", *VOLUMES, "DirectIntegrator")
"""Integrators that a scene may choose; any other is replaced by Mitsuba's `path`."""


@dataclass(frozen=True)
class ForeignStage:
    """A scene of Mitsuba's, ready to be traced in a spectral variant.

    scene, integrator: Mitsuba's.
    wavelengths: float64 [band] in m.
    to_camera: float64 [4, 4], from the scene's world to camera space in metres.
    objects, object_of, face_rows: see `translate.Stage`.
    """

    scene: mi.Scene
    integrator: mi.SamplingIntegrator
    wavelengths: np.ndarray
    to_camera: np.ndarray
    objects: mi.UInt32
    object_of: mi.UInt32
    face_rows: None = None

    @property
    def bands(self) -> int:
        return len(self.wavelengths)

    def in_world(self, ray: mi.Ray3f) -> mi.Ray3f:
        """A ray of camera space in the scene's world."""
        import drjit as dr
        import mitsuba as mi

        back = np.linalg.inv(self.to_camera)

        def turned(v: mi.Point3f | mi.Vector3f) -> list[mi.Float]:
            return [sum(float(back[i, j]) * v[j] for j in range(3)) for i in range(3)]

        origin = [moved + float(back[i, 3]) for i, moved in enumerate(turned(ray.o))]
        return mi.Ray3f(mi.Point3f(*origin), dr.normalize(mi.Vector3f(*turned(ray.d))))

    def depth_of(self, point: mi.Point3f) -> mi.Float:
        """Depth along the axis in metres of a point of the world."""
        x, y, z, shift = (float(value) for value in self.to_camera[2])
        return point.x * x + point.y * y + point.z * z + shift


def load_foreign(mi: ModuleType, recipe: SceneRecipe, base: Path) -> ForeignStage:
    """Load the Mitsuba scene that a recipe names into the active spectral variant.

    Raises InputError for files that are missing or outside the scene's folder, for a scene that Mitsuba
    refuses, and for lights in the recipe, which cannot be added to such a scene.
    """
    source = recipe.source
    assert isinstance(source, MitsubaSource)
    if recipe.lights:
        raise InputError(
            f"{recipe.name}: {source.path} is rendered by Mitsuba itself, which takes no [[lights]]; put "
            f"the light "
            "into the scene's file"
        )
    path = Path(base) / source.path
    _check_files(read_nodes(path, source.allow_outside), path, source)
    try:
        with reading_files():
            if path.suffix.lower() == ".json":
                contents = _absolute(mi, json.loads(path.read_text(encoding="utf-8")), path.parent)
                scene = mi.load_dict(contents, optimize=False)
            else:
                known = parameters(path, source.allow_outside)
                scene = mi.load_file(str(path), optimize=False, **known)
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"{path}: Mitsuba refuses the scene: {str(error).strip()[:300]}") from error
    pose, sensor = np.eye(4), PINHOLES[0]
    if scene.sensors():
        pose = np.array(scene.sensors()[0].world_transform().matrix, np.float64).reshape(4, 4)
        sensor = SENSORS.get(scene.sensors()[0].class_name(), scene.sensors()[0].class_name())
    to_camera = camera_space(pose, sensor, source.units_m)
    integrator = scene.integrator()
    if integrator is None or integrator.class_name() not in INTEGRATORS:
        kind = "none" if integrator is None else integrator.class_name()
        LOG.warning("%s: its integrator (%s) gives no radiance of paths; `path` takes its place", path, kind)
        integrator = mi.load_dict({"type": "path", "max_depth": -1})
    if says_path_length(recipe):
        kind = "volpath" if integrator.class_name() in VOLUMES else "path"
        integrator = mi.load_dict({"type": kind, "max_depth": recipe.render.max_depth})
    shapes = list(scene.shapes())
    table = np.zeros((max(1, len(shapes)), FIELDS), np.uint32)
    for number, shape in enumerate(shapes):
        table[number, CLOSED] = _closed(shape)
    rows = registry_table(mi, [mi.ShapePtr(shape) for shape in shapes])
    return ForeignStage(
        scene, integrator, recipe.bands.wavelengths(), to_camera, mi.UInt32(table.ravel()), rows
    )


def _closed(shape: mi.Shape) -> bool:
    if not shape.is_mesh():
        return shape.class_name() == "Sphere"
    vertices = np.array(shape.vertex_positions_buffer(), np.float32).reshape(-1, 3)
    return is_closed(TriangleMesh(vertices, np.array(shape.faces_buffer(), np.uint32).reshape(-1, 3)))


def _check_files(root: Node, path: Path, source: MitsubaSource) -> None:
    """Every file that the scene names must lie in its folder, unless the recipe trusts it."""
    for node in all_nodes(root):
        for key in node.values:
            if key.endswith("filename"):
                what = f"{path.name}: {node.type}"
                resolved(path.parent, str(node.values[key]), source.allow_outside, what)


def _absolute(mi: ModuleType, data: object, folder: Path) -> object:
    """The dictionary of `load_dict` from JSON: file names made absolute, 4 x 4 lists made transforms."""
    if isinstance(data, list) and np.shape(data) == (4, 4):
        return mi.ScalarTransform4f(np.array(data, np.float64))
    if isinstance(data, dict):
        named = {key: _absolute(mi, value, folder) for key, value in data.items()}
        if isinstance(filename := named.get("filename"), str):
            named["filename"] = str((folder / filename).resolve())
        return named
    return data


def trace(
    stage: ForeignStage, lens: Lens, samples: Samples, gap: float, max_depth: int
) -> tuple[mi.ArrayXf, mi.Float, mi.Bool]:
    """As `paths.trace`, by the scene's integrator, which has its own max_depth.

    Mitsuba's samplers count on from a seed for a whole launch, so here random numbers follow from the launch
    as well; launches are cut alike on every machine.
    """
    import drjit as dr
    import mitsuba as mi

    from .rays import behind, camera_rays
    from .sampling import combined

    rays = camera_rays(lens, samples)
    ray, exists = stage.in_world(rays.ray), dr.full(mi.Bool, True, samples.size)
    if samples.layer > 0:
        ray, exists, _ = behind(stage, ray, rays.limits, dr.opaque(mi.Float, gap))
    first = stage.scene.ray_intersect_preliminary(ray, coherent=True, active=exists)
    depth = stage.depth_of(ray(first.t))
    inverse_depth = dr.select(exists & first.is_valid(), dr.rcp(depth), 0.0)
    start = combined(mi.UInt32(samples.seed), mi.UInt32(samples.number * 8 + samples.layer))
    seed = int(combined(start, dr.sum(samples.pixels))[0])
    nanometres = stage.wavelengths * 1e9
    radiance: list[mi.Float] = []
    for group in range(0, stage.bands, WAVELENGTHS_A_PATH):
        centres = [float(nanometres[min(group + k, stage.bands - 1)]) for k in range(WAVELENGTHS_A_PATH)]
        sampler = mi.load_dict({"type": "independent"})
        # The same numbers for all bands: their noise is alike, and spectra stay smooth.
        sampler.seed(seed, samples.size)
        differential = mi.RayDifferential3f(ray)
        differential.wavelengths = type(ray.wavelengths)(*(dr.opaque(mi.Float, nm) for nm in centres))
        values, _, _ = stage.integrator.sample(stage.scene, sampler, differential, active=exists)
        radiance += [values[k] for k in range(min(WAVELENGTHS_A_PATH, stage.bands - group))]
        dr.eval(radiance)
    return mi.ArrayXf(radiance), inverse_depth, exists
