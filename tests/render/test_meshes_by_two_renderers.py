"""Meshes of every format are those of trimesh by area, and look as Mitsuba renders them; of trimesh's own
making, and whatever of other packages is installed beside it."""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from benchmarks.meshes import chosen, judged

SUFFIXES = ("obj", "ply", "stl", "glb", "off")
SHAPES: dict[str, Callable[[np.random.Generator], trimesh.Trimesh]] = {
    "box": lambda draw: trimesh.creation.box(draw.uniform(0.3, 1, 3)),
    "ball": lambda draw: trimesh.creation.icosphere(int(draw.integers(1, 4))),
    "uv ball": lambda draw: trimesh.creation.uv_sphere(1.0, count=draw.integers(5, 30, 2).tolist()),
    "cylinder": lambda draw: trimesh.creation.cylinder(*draw.uniform(0.2, 1, 2)),
    "cone": lambda draw: trimesh.creation.cone(*draw.uniform(0.3, 1, 2)),
    "capsule": lambda draw: trimesh.creation.capsule(*draw.uniform(0.3, 1, 2)),
    "ring": lambda draw: trimesh.creation.torus(1.0, float(draw.uniform(0.1, 0.5))),
    "annulus": lambda draw: trimesh.creation.annulus(0.3, float(draw.uniform(0.5, 1)), 0.4),
    "axes": lambda draw: trimesh.creation.axis(),
    "soup": lambda draw: trimesh.creation.random_soup(40),
}


def check(folder: Path, seed: int) -> None:
    """A shape, or two, turned, moved and scaled."""
    np.random.seed(seed)  # noqa: NPY002 - trimesh's own draws
    draw = np.random.default_rng(seed)
    scene = trimesh.Scene()
    for kind in draw.choice(list(SHAPES), int(draw.integers(1, 3)), replace=False):
        pose = trimesh.transformations.random_rotation_matrix(draw.random(3))
        pose[:3, :3] *= draw.uniform(0.5, 2, 3) * draw.choice([-1, 1])
        pose[:3, 3] = draw.uniform(-0.5, 0.5, 3)
        scene.add_geometry(SHAPES[kind](draw), transform=pose)
    suffix = SUFFIXES[seed % len(SUFFIXES)]
    path = folder / f"m.{suffix}"
    (scene if suffix == "glb" else scene.to_mesh()).export(path)
    found = judged(path, path.name)
    assert not found.refused
    assert found.area == pytest.approx(1, abs=1e-5)
    assert found.ratio == pytest.approx(1, abs=0.01) and found.likeness > 0.99


@pytest.mark.parametrize("seed", range(5))
def test_a_mesh_of_every_format_looks_as_mitsuba_renders_it(seed: int, tmp_path: Path):
    check(tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5, 55))
def test_meshes_look_as_mitsuba_renders_them(seed: int, tmp_path: Path):
    check(tmp_path, seed)


@pytest.mark.slow
def test_meshes_of_installed_packages_look_as_mitsuba_renders_them():
    """None may be there; the site has a table of those of packages that bring many."""
    for path in chosen(Path(sysconfig.get_path("purelib")), 50):
        found = judged(path, path.name)
        assert found.refused or (abs(found.area - 1) < 1e-5 and found.likeness > 0.99), found
