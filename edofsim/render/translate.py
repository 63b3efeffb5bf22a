"""A SceneModel turned into a Mitsuba scene and the tables that hold its spectra.

Mitsuba gets every BSDF with the same *carrier* as reflectance, 0 in the first colour channel and 1 in the
second. For a BSDF that is affine in its reflectance, f(band) = f0 + rho(band) (f1 - f0), whatever the number
of bands; rho comes from tables of our own, looked up by the object that a ray met. The third channel carries
1/2 and shows whether a BSDF *is* affine. In the same way lamps shine with radiance 1 in Mitsuba, and their
spectra are a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..core.json_values import Json
from ..errors import InputError
from ..scene.model import BandTexture, SceneModel, SceneObject, Surface
from .closed import is_closed
from .meshes import CARRIER, aligned, face_rows, meshes_of, registry_table, spares

if TYPE_CHECKING:
    import mitsuba as mi

ROWS = 3
"""A spectrum is at most this many coefficients times as many basis spectra."""

FIELDS = 8
BASIS, TEXTURE, WIDTH, HEIGHT, REPEATS, CLOSED, INDEX = range(7)
"""What the table of objects says of each, as uint32: row of its basis, first texel, size (0: no texture),
whether its texture coordinates leave the unit square, whether its mesh encloses a volume, and 1 + the row of
its refractive index if that changes with wavelength (else 0)."""


FEW_LIGHT_ROWS = 8
"""This many rows of light spectra are constants of the kernel, which is faster than to look them up: a lookup
loads a packet of bands for every ray, a constant is loaded once for all. Surfaces have too many for it."""

SMOOTH_SKY = 4.0
"""A sky whose brightest direction shines at most this many times its mean is found by the surfaces' own
sampling: light samples that look for it are better spent on a lamp. Among many lamps they are not: most are
far."""


FewLights: TypeAlias = "tuple[tuple[mi.UInt32, list[list[mi.Float]]], ...]"


@dataclass(frozen=True)
class Stage:
    """A scene ready to be traced. Buffers are Dr.Jit arrays of the engine that is active.

    spectra: Float, [row * stride + band], ROWS rows a basis.
    texels: Float, 4 a texel.
    objects: UInt32, FIELDS an object.
    object_of, light_of: UInt32, registry id of a shape / emitter to its row.
    face_rows: UInt32, the object's row of each face where several objects are one mesh (then object_of gives
        the first face of each shape), else None.
    lights: as `objects`, in the order of Mitsuba's emitters.
    has_textures: whether any texel is ever looked up.
    disperses: whether any index changes with wavelength.
    few_lights: (row of a basis, its rows of Floats [row][band]) for each basis of the lights if these are
        few, else None.
    spares: see `meshes.spares`.
    """

    scene: mi.Scene
    spectra: mi.Float
    texels: mi.Float
    objects: mi.UInt32
    object_of: mi.UInt32
    face_rows: mi.UInt32 | None
    lights: mi.UInt32
    light_of: mi.UInt32
    environment: int
    bands: int
    stride: int
    has_textures: bool
    disperses: bool
    has_sky_image: bool
    few_lights: FewLights | None
    spares: tuple[object, ...]

    def in_world(self, ray: mi.Ray3f) -> mi.Ray3f:
        """A ray of camera space in the scene's world: they are the same."""
        return ray

    def depth_of(self, point: mi.Point3f) -> mi.Float:
        """Depth along the axis of a point of the scene's world."""
        return point.z


class _Tables:
    """Spectra and texels that are already stored, each once."""

    def __init__(self, bands: int) -> None:
        self.bands = bands
        self.stride = -(-bands // 8) * 8 if bands > 4 else 4
        self.spectra: list[np.ndarray] = []
        self.texels: list[np.ndarray] = []
        self._rows: dict[bytes, int] = {}
        self._places: dict[int, tuple[int, np.ndarray]] = {}
        self._texel_count = 0

    def row(self, basis: np.ndarray) -> int:
        """Row of a basis [n, band], n <= ROWS."""
        basis = np.ascontiguousarray(basis, np.float32)
        key = basis.tobytes()
        if key not in self._rows:
            self._rows[key] = ROWS * len(self.spectra)
            padded = np.zeros((ROWS, self.stride), np.float32)
            padded[: len(basis), : self.bands] = basis
            self.spectra.append(padded)
        return self._rows[key]

    def place(self, image: np.ndarray) -> int:
        """First texel of an image of coefficients [y, x, n]."""
        if id(image) not in self._places:
            padded = np.zeros((*image.shape[:2], 4), np.float32)
            padded[..., : image.shape[2]] = image
            self._places[id(image)] = (self._texel_count, image)
            self.texels.append(padded.reshape(-1))
            self._texel_count += image.shape[0] * image.shape[1]
        return self._places[id(image)][0]

    def object(self, item: SceneObject) -> np.ndarray:
        """The fields of an object."""
        uv = item.mesh.uv
        repeats = uv is not None and bool((uv < -1e-6).any() or (uv > 1 + 1e-6).any())
        fields = self.entry(item.surface.reflectance, repeats, is_closed(item.mesh))
        if item.surface.per_band:
            fields[INDEX] = 1 + self.row(np.asarray(item.surface.per_band["int_ior"])[None])
        return fields

    def entry(self, value: BandTexture, repeats: bool = False, closed: bool = False) -> np.ndarray:
        """The fields of one object or light."""
        fields = np.zeros(FIELDS, np.uint32)
        fields[BASIS] = self.row(value.basis)
        fields[REPEATS], fields[CLOSED] = repeats, closed
        if value.image is not None:
            fields[TEXTURE] = self.place(value.image)
            fields[HEIGHT], fields[WIDTH] = value.image.shape[:2]
        return fields


def build_stage(mi: ModuleType, model: SceneModel) -> Stage:
    """Load a scene into the active engine.

    mi: the mitsuba module with its variant set.

    Raises InputError for a BSDF that Mitsuba refuses, or whose light is not affine in its reflectance, and
    for spectra or textures of the wrong shape.
    """
    import drjit as dr

    _check(model)
    bands = len(model.wavelengths)
    tables = _Tables(bands)
    bsdfs = _Bsdfs(mi)
    weights = _light_weights(model)
    plugins = [bsdfs.instance(item) for item in model.objects]
    lit = zip(model.objects, weights, strict=False)
    lamps = [None if item.emission is None else _lamp(weight) for item, weight in lit]
    meshes, members = meshes_of(mi, model.objects, plugins, lamps)
    contents: dict[str, object] = {"type": "scene"}
    contents |= {f"object-{numbers[0]:06d}": mesh for mesh, numbers in zip(meshes, members, strict=True)}
    lights = [
        tables.entry(BandTexture(np.asarray(item.emission)[None]))
        for item in model.objects
        if item.emission is not None
    ]
    objects = [tables.object(item) for item in model.objects]
    if model.environment is not None:
        radiance = model.environment.radiance
        contents["sky"] = _environment(mi, radiance, weights[-1])
        lights.append(tables.entry(radiance))
    scene = mi.load_dict(contents, optimize=False)
    emitters = [emitter for mesh in meshes if (emitter := mesh.emitter()) is not None]
    if model.environment is not None:
        emitters.append(scene.environment())
    shapes = [mi.ShapePtr(mesh) for mesh in meshes]
    first, rows = face_rows(model.objects, members)
    together = len(meshes) < len(model.objects)
    texels = np.concatenate(tables.texels) if tables.texels else np.zeros(4, np.float32)
    stage = Stage(
        scene=scene,
        spectra=mi.Float(aligned(np.concatenate(tables.spectra), np.float32)),
        texels=mi.Float(aligned(texels, np.float32)),
        objects=mi.UInt32(aligned(np.concatenate(objects), np.uint32)),
        object_of=registry_table(mi, shapes, first if together else None),
        face_rows=mi.UInt32(aligned(rows, np.uint32)) if together else None,
        lights=mi.UInt32(aligned(np.concatenate(lights) if lights else np.zeros(FIELDS), np.uint32)),
        light_of=registry_table(mi, [mi.EmitterPtr(emitter) for emitter in emitters]),
        environment=len(lights) - 1 if model.environment is not None else -1,
        bands=bands,
        stride=tables.stride,
        disperses=bool(model.dispersive),
        has_textures=any(item.surface.reflectance.image is not None for item in model.objects),
        has_sky_image=model.environment is not None and model.environment.radiance.image is not None,
        few_lights=_few_lights(mi, lights, np.concatenate(tables.spectra), bands),
        spares=spares(mi, meshes),
    )
    dr.eval(stage.spectra, stage.texels, stage.objects, stage.object_of, stage.lights, stage.light_of)
    return stage


def _lamp(weight: float) -> dict[str, object]:
    """The emitter of a lamp: radiance 1, chosen with that probability (unnormalised)."""
    radiance = {"type": "rgb", "value": [1.0, 1.0, 1.0]}
    return {"type": "area", "radiance": radiance, "sampling_weight": weight}


def _few_lights(
    mi: ModuleType, lights: list[np.ndarray], spectra: np.ndarray, bands: int
) -> FewLights | None:
    """The lights' bases as constants, or None if these are too many. spectra: float32 [row, stride]."""
    import drjit as dr

    bases = sorted({int(fields[BASIS]) for fields in lights})
    # Rows behind a basis' last one are zero: they add nothing
    used = {base: [j for j in range(ROWS) if j == 0 or spectra[base + j].any()] for base in bases}
    if sum(map(len, used.values())) > FEW_LIGHT_ROWS:
        return None

    def constants(row: np.ndarray) -> list[mi.Float]:
        return [dr.opaque(mi.Float, float(value)) for value in row[:bands]]

    return tuple(
        (dr.opaque(mi.UInt32, base), [constants(spectra[base + j]) for j in used[base]]) for base in bases
    )


def _check(model: SceneModel) -> None:
    bands = len(model.wavelengths)
    problems = []

    def look(what: str, value: BandTexture) -> None:
        basis = np.asarray(value.basis)
        if basis.ndim != 2 or basis.shape[1] != bands or not 1 <= len(basis) <= ROWS:
            problems.append(
                f"{what}: its spectra have shape {list(basis.shape)}; needed is [1 to {ROWS}, {bands}]"
            )
        elif value.image is None and len(basis) != 1:
            problems.append(f"{what}: {len(basis)} spectra need an image that says how much of each")
        elif value.image is not None and (value.image.ndim != 3 or value.image.shape[2] != len(basis)):
            problems.append(
                f"{what}: its image has shape {list(value.image.shape)}; needed is [y, x, {len(basis)}]"
            )

    for item in model.objects:
        look(item.name, item.surface.reflectance)
        if item.emission is not None and np.shape(item.emission) != (bands,):
            problems.append(
                f"{item.name}: its radiance has shape {list(np.shape(item.emission))}, not [{bands}]"
            )
        if item.surface.per_band and (
            set(item.surface.per_band) != {"int_ior"} or item.surface.bsdf.get("type") != "dielectric"
        ):
            problems.append(
                f"{item.name}: only the refractive index (int_ior) of a smooth dielectric may differ by band"
            )
        if item.surface.reflectance.image is not None and item.mesh.uv is None:
            problems.append(f"{item.name}: it has a texture, but its mesh has no texture coordinates")
    if model.environment is not None:
        look("the environment", model.environment.radiance)
    if problems:
        raise InputError(problems)


class _Bsdfs:
    """BSDF plugins: one for all objects whose settings are equal, so that the engine compiles and calls
    few."""

    def __init__(self, mi: ModuleType) -> None:
        self._mi = mi
        self._known: dict[str, mi.BSDF] = {}

    def instance(self, item: SceneObject) -> mi.BSDF:
        surface = item.surface
        key = repr((_sorted(plugin_with(surface, {})), surface.two_sided))
        if key not in self._known:
            carrier = {"type": "rawconstant", "value": list(CARRIER)}
            try:
                bsdf = self._mi.load_dict(plugin_with(surface, carrier))
            except (RuntimeError, ValueError, TypeError) as error:
                raise InputError(
                    f"{item.name}: Mitsuba refuses its surface: {str(error).splitlines()[0]}"
                ) from error
            error = affinity_error(self._mi, bsdf)
            if not error < 1e-3:
                raise InputError(
                    f"{item.name}: light from its surface ({surface.bsdf.get('type')}) is not affine in its "
                    f"{surface.reflectance_key} (off by {error:.2g}), so that bands cannot share a path; "
                    f"leave "
                    "out tints and nonlinear = true"
                )
            self._known[key] = bsdf
        return self._known[key]


def _sorted(settings: object) -> object:
    if isinstance(settings, Mapping):
        return sorted((key, _sorted(value)) for key, value in settings.items())
    return settings


def plugin_with(surface: Surface, reflectance: Mapping[str, object]) -> Json:
    """Mitsuba's dictionary of a surface with some reflectance plugin in its place.

    A reflectance key with dots leads into nested BSDFs (`nested.reflectance`); an empty key: none at all.
    """
    plugin = _copied(surface.bsdf)
    plugin |= {key: float(np.mean(values)) for key, values in surface.per_band.items()}
    if surface.reflectance_key:
        *path, last = surface.reflectance_key.split(".")
        place = plugin
        for step in path:
            place = place[step]
        place[last] = reflectance
    return {"type": "twosided", "bsdf": plugin} if surface.two_sided else plugin


def _copied(settings: Mapping[str, object]) -> Json:
    return {key: _copied(value) if isinstance(value, Mapping) else value for key, value in settings.items()}


def affinity_error(mi: ModuleType, bsdf: mi.BSDF, count: int = 512) -> float:
    """How far f(1/2) is from (f(0) + f(1)) / 2 over random directions, relative to the largest f."""
    import drjit as dr

    rng = np.random.default_rng(1)
    towards = rng.normal(size=(2, 3, count)).astype(np.float32)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    towards[:, 2] = np.abs(towards[:, 2])
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(*map(mi.Float, towards[0]))
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.n = mi.Normal3f(0, 0, 1)
    si.t = mi.Float(1.0)
    si.uv = mi.Point2f(0.5, 0.5)
    zero, one, half = (
        np.array(c) for c in bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*map(mi.Float, towards[1])))
    )
    largest = float(np.max(np.abs(one), initial=0.0))
    return 0.0 if largest == 0 else float(np.max(np.abs(half - (zero + one) / 2)) / largest)


def _environment(mi: ModuleType, radiance: BandTexture, weight: float) -> dict[str, object]:
    """Light from infinity: the plugin only has to sample directions well, so it gets the mean over bands."""
    if radiance.image is None:
        return {
            "type": "constant",
            "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]},
            "sampling_weight": weight,
        }
    mean = _brightness(radiance)
    mean = mean + 1e-3 * mean.mean() + 1e-12  # no direction that shines in some band may have probability 0
    # Mitsuba's map runs the other way round: its first column is ours at the right.
    picture = np.repeat(mean[:, ::-1, None], 3, axis=2).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture)), "sampling_weight": weight}


def _brightness(radiance: BandTexture) -> np.ndarray:
    """Mean over the bands of a sky, [y, x]."""
    image = np.ones((1, 1, 1)) if radiance.image is None else np.asarray(radiance.image)
    return np.clip(image @ np.asarray(radiance.basis).mean(axis=1), 0, None)


def _light_weights(model: SceneModel) -> list[float]:
    """Probability (unnormalised) of choosing each light: four fifths by what it sends to the middle of the
    typical object, one fifth alike, so that none is starved; a smooth sky never, where one lamp sends half of
    what all do (SMOOTH_SKY). One an object (0 for no lamp), the sky last."""
    middles = np.array([item.mesh.vertices.mean(axis=0) for item in model.objects if item.emission is None])
    sent = np.zeros(len(model.objects) + 1)
    for number, item in enumerate(model.objects):
        if item.emission is None:
            continue
        corners = item.mesh.vertices[item.mesh.faces.astype(np.int64)].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(normals, axis=1).sum()
        away = middles - item.mesh.vertices.mean(axis=0) if len(middles) else np.ones((1, 3))
        sent[number] = np.mean(item.emission) * np.median(area / np.maximum((away**2).sum(axis=1), area))
    lit = np.array([item.emission is not None for item in model.objects] + [False])
    if model.environment is not None:
        brightness = _brightness(model.environment.radiance)
        height = np.sin((np.arange(len(brightness)) + 0.5) / len(brightness) * np.pi)[:, None]
        mean = np.average(brightness, weights=np.broadcast_to(height, brightness.shape))
        alone = not lit.any() or sent.max() < 0.5 * sent.sum()
        lit[-1] = alone or brightness.max() > SMOOTH_SKY * mean
        sent[-1] = np.pi * mean * lit[-1]
    total = sent.sum()
    if not total > 0:
        return [float(is_light) for is_light in lit]
    return list(np.where(lit, 0.8 * sent / total + 0.2 / max(lit.sum(), 1), 0.0))
