"""All shipped scenes: they say what they are for, they build, and they hold what they promise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from edofsim.recipe.load import load_scene, shipped, shipped_folder
from edofsim.scene import build_scene
from edofsim.scene.family import members

NAMES = sorted(shipped(shipped_folder("scenes")))
BUILT = [name for name in NAMES if load_scene(name).recipe.source is None]


@lru_cache(maxsize=2)
def built(name: str):
    loaded = load_scene(name)
    return build_scene(loaded.recipe, loaded.base)


def depths(name: str) -> np.ndarray:
    """Median depth of each object that is no lamp, in metres."""
    return np.array([np.median(o.mesh.vertices[:, 2]) for o in built(name).objects if o.emission is None])


def test_every_kind_of_scene_is_there():
    promised = {"desk", "wall", "bench", "hallway", "foliage", "stilllife", "night", "charts", "clouds"}
    assert promised <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_each_states_its_purpose_and_has_its_files_name(name: str):
    recipe = load_scene(name).recipe
    assert recipe.name == name and len(recipe.purpose.split()) > 10


@pytest.mark.parametrize("name", BUILT)
def test_each_builds_and_fits_in_memory(name: str):
    model = built(name)
    triangles = sum(len(o.mesh.faces) for o in model.objects)
    texels = sum(
        o.surface.reflectance.image.size for o in model.objects if o.surface.reflectance.image is not None
    )
    assert triangles < 400_000 and texels < 80e6
    assert len({tuple(sorted(o.surface.bsdf.items())) for o in model.objects}) <= 16
    assert bool(model.dispersive) == (name == "stilllife")  # only that one needs a path of its own a band


def test_wall_is_one_depth_that_fills_the_frame_and_its_margin():
    recipe = load_scene("wall").recipe
    vertices = np.concatenate([o.mesh.vertices for o in built("wall").objects])
    assert np.ptp(vertices[:, 2]) == 0
    half = (recipe.frame.width_px / 2 + recipe.frame.margin_px) * recipe.frame.pixel_angle_mrad * 1e-3
    assert vertices[:, 0].max() >= half * vertices[0, 2] and vertices[:, 0].min() <= -half * vertices[0, 2]


def test_bench_has_the_papers_bus_at_half_a_metre_and_car_at_1_3():
    model = built("bench")
    for name, depth in (("bus", 0.5), ("car", 1.3)):
        nearest = min(o.mesh.vertices[:, 2].min() for o in model.objects if o.name.split("/")[0] == name)
        farthest = max(o.mesh.vertices[:, 2].max() for o in model.objects if o.name.split("/")[0] == name)
        assert nearest < depth + 0.02 and farthest > depth - 0.02 and farthest - nearest < 0.06


def test_hallway_runs_through_all_depths():
    walls = next(o for o in built("hallway").objects if o.name.endswith("/walls"))
    inverse = 1 / walls.mesh.vertices[:, 2]
    assert inverse.max() > 2 and inverse.min() < 0.25


def test_foliage_has_hundreds_of_thin_occluders():
    leaves = [o for o in built("foliage").objects if "/" not in o.name and len(o.mesh.faces) % 8 == 0]
    assert sum(len(o.mesh.faces) // 8 for o in leaves) > 1000


def test_stilllife_says_what_bends_each_wavelength_differently():
    model = built("stilllife")
    assert set(model.dispersive) == {"goblet", "crystal ball", "prism"}
    for item in model.objects:
        if item.name in model.dispersive:
            index = item.surface.per_band["int_ior"]
            assert index.shape == model.wavelengths.shape and (np.diff(index) < 0).all()


def test_night_has_lamps_of_a_hundred_thousand_to_one():
    model = built("night")
    lamps = [o.emission.mean() for o in model.objects if o.emission is not None]
    dark = model.environment.radiance.basis.mean()
    assert max(lamps) / dark >= 1e5


def test_charts_stand_at_five_depths_and_fill_about_the_same_angle():
    charts = [o for o in built("charts").objects if o.name.startswith("chart")]
    z = sorted(float(np.median(o.mesh.vertices[:, 2])) for o in charts)
    assert len(z) == 5 and z[0] <= 0.5 and z[-1] >= 4
    angles = [np.ptp(o.mesh.vertices[:, 0] / o.mesh.vertices[:, 2]) for o in charts]
    assert max(angles) / min(angles) < 1.6


def test_clouds_are_so_far_that_they_are_at_infinity():
    """Defocus of 1 / 20 km over the paper's aperture radius of 2.5 mm at 420 nm: pi r^2 / (lambda z)."""
    z = depths("clouds").min()
    assert np.pi * 2.5e-3**2 / (420e-9 * z) < 0.01


def test_the_training_family_gives_sound_scenes():
    """Twelve members: each builds, everything in front of the camera, and no two are alike."""
    recipe = load_scene("clutter").recipe
    chosen = members(recipe, 12)
    counts = [len(build_scene(one, shipped_folder("scenes")).objects) for one in chosen[:4]]
    assert min(counts) >= 6
    assert len({one.objects[0].depth_m for one in chosen}) == 12


def test_refractive_indices_of_the_glasses_are_the_published_ones():
    """n_d and Abbe number: Schott's data sheets; silica by Malitson."""
    from edofsim.scene.spectra import refractive_index

    lines = np.array([587.5618, 486.1327, 656.2725]) * 1e-9
    published = {
        "N-BK7": (1.51680, 64.17),
        "N-SF11": (1.78472, 25.68),
        "N-F2": (1.62005, 36.43),
        "fused-silica": (1.45846, 67.82),
    }
    for glass, (index, abbe) in published.items():
        d, f, c = refractive_index(glass, lines)
        assert d == pytest.approx(index, abs=2e-5) and (d - 1) / (f - c) == pytest.approx(abbe, abs=0.02)
