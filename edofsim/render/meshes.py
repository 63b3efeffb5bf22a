"""Objects of a scene as Mitsuba's meshes, and the engine's numbers of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..scene import solids
from ..scene.model import SceneObject

if TYPE_CHECKING:
    import mitsuba as mi

CARRIER = (0.0, 1.0, 0.5)
"""Reflectance of every BSDF in Mitsuba's three channels; see `translate`."""

ALIGNMENT = 64
"""Bytes."""

SPARES = 16
"""The engine's numbers of surfaces and of meshes end at a multiple of this many."""

MANY = 64
"""With more objects than this, those of one BSDF are one mesh: the engine follows every mesh by itself
when it makes a kernel, which takes longer than all else where there are thousands."""

Lamp: TypeAlias = "Mapping[str, object] | None"


def meshes_of(
    mi: ModuleType, objects: Sequence[SceneObject], bsdfs: Sequence[mi.BSDF], lamps: Sequence[Lamp]
) -> tuple[list[mi.Mesh], list[list[int]]]:
    """Mitsuba's meshes, and for each the numbers of its objects, whose faces follow one another in it.

    bsdfs: one an object.
    lamps: likewise, its emitter (a plugin dictionary) or None. Lamps are meshes of their own, in their order.
    """
    groups: dict[object, list[int]] = {}
    for number, (item, bsdf, lamp) in enumerate(zip(objects, bsdfs, lamps, strict=True)):
        alone = lamp is not None or len(objects) <= MANY
        kind = number if alone else (id(bsdf), item.mesh.uv is None, item.mesh.normals is None)
        groups.setdefault(kind, []).append(number)
    members = list(groups.values())
    meshes = []
    for numbers in members:
        item = objects[numbers[0]]
        if len(numbers) > 1:
            item = replace(item, mesh=solids.join([objects[number].mesh for number in numbers]))
        meshes.append(make_mesh(mi, item, bsdfs[numbers[0]], lamps[numbers[0]]))
    return meshes, members


def face_rows(objects: Sequence[SceneObject], members: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Where the faces of each mesh start in a table of all faces, and that table: the object's number of each
    face; int64 both.

    members: see `meshes_of`.
    """
    order = np.array([number for numbers in members for number in numbers], np.int64)
    counts = np.array([len(objects[number].mesh.faces) for number in order], np.int64)
    before = np.cumsum(counts) - counts
    first = np.cumsum([0] + [len(numbers) for numbers in members[:-1]])
    return before[first], np.repeat(order, counts)


def aligned(values: np.ndarray, kind: type[np.generic]) -> np.ndarray:
    """The values in one row, where a line of the processor's cache begins: the engine reads memory of NumPy's
    in place, and another kernel is compiled for what lies elsewhere.

    values: any shape [...].
    """
    memory = np.empty(values.size * np.dtype(kind).itemsize + ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    row = memory[start : start + memory.size - ALIGNMENT].view(kind)
    row[:] = values.ravel()
    return row


def make_mesh(mi: ModuleType, item: SceneObject, bsdf: mi.BSDF, lamp: Mapping[str, object] | None) -> mi.Mesh:
    """A Mitsuba mesh with its surface and, if it is a lamp, its emitter (a plugin dictionary)."""
    mesh = item.mesh
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    if lamp is not None:
        properties["mesh_emitter"] = mi.load_dict(lamp)
    if mesh.normals is None:
        properties["face_normals"] = True
    out = mi.Mesh(
        item.name,
        len(mesh.vertices),
        len(mesh.faces),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
        props=properties,
    )
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = aligned(mesh.vertices, np.float32)
    parameters["faces"] = aligned(mesh.faces, np.uint32)
    if mesh.normals is not None:
        parameters["vertex_normals"] = aligned(mesh.normals, np.float32)
    if mesh.uv is not None:
        parameters["vertex_texcoords"] = aligned(mesh.uv, np.float32)
    parameters.update()
    return out


def spares(mi: ModuleType, meshes: list[mi.Mesh]) -> tuple[object, ...]:
    """Surfaces and meshes that nothing uses, kept with the scene: with them the engine's numbers of each end
    at a multiple of SPARES. A kernel is compiled for one such number, and serves all scenes that have
    it."""
    plugin = {"type": "diffuse", "reflectance": {"type": "rawconstant", "value": list(CARRIER)}}
    spares: list[object] = [mi.load_dict(plugin)]
    while number_of(mi, mi.BSDFPtr(spares[-1])) % SPARES:
        spares.append(mi.load_dict(plugin))
    if meshes:
        spares.append(_spare_mesh(mi, meshes[0]))
        while number_of(mi, mi.ShapePtr(spares[-1])) % SPARES:
            spares.append(_spare_mesh(mi, meshes[0]))
    return tuple(spares)


def _spare_mesh(mi: ModuleType, like: mi.Mesh) -> mi.Mesh:
    """A triangle of the same kind as another mesh."""
    properties = mi.Properties()
    properties["mesh_bsdf"] = like.bsdf()
    properties["face_normals"] = like.has_face_normals()
    kinds = {
        "has_vertex_normals": like.has_vertex_normals(),
        "has_vertex_texcoords": like.has_vertex_texcoords(),
    }
    return mi.Mesh("spare", 3, 1, props=properties, **kinds)


def registry_table(
    mi: ModuleType, pointers: list[mi.ShapePtr | mi.EmitterPtr], entries: np.ndarray | None = None
) -> mi.UInt32:
    """A UInt32 table from the engine's number of a shape or emitter to its entry: its place in the list if
    none are given.

    entries: [shape], integers; None for the place in the list.
    """
    numbers = [number_of(mi, pointer) for pointer in pointers]
    table = np.zeros(max(numbers, default=0) + 1, np.uint32)
    table[numbers] = np.arange(len(numbers)) if entries is None else entries
    return mi.UInt32(table)


def number_of(mi: ModuleType, pointer: mi.ShapePtr | mi.EmitterPtr | mi.BSDFPtr) -> int:
    """The engine's number of what is pointed at."""
    import drjit as dr

    return int(dr.reinterpret_array(mi.UInt32, pointer)[0])
