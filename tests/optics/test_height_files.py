"""Height maps of other programs: every format with its unit, byte orders, NaN outside the pupil."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.io import savemat

from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.height import designed_map
from edofsim.recipe.camera import CameraRecipe

N, PITCH_UM, RADIUS = 60, 84.0, 2.5e-3
METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
FIFTY = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
AXIS = (np.arange(N) - (N - 1) / 2) * PITCH_UM * 1e-6


def height_map(seed: int) -> np.ndarray:
    """A smooth surface below a micrometre, in metres."""
    a, b, c = np.random.default_rng(seed).uniform(-3, 3, 3)
    u, v = AXIS[None] / RADIUS, AXIS[:, None] / RADIUS
    return 0.4e-6 * (1 + np.sin(a * u + b * v + c * u * v))


def camera(folder: Path, name: str, **mask: object) -> Camera:
    about = {"kind": "height-map", "file": name, "pitch_um": PITCH_UM, **mask}
    return Camera.from_recipe(CameraRecipe(name="c", mask=about), folder)


def write(path: Path, numbers: np.ndarray) -> None:
    match path.suffix:
        case ".npy":
            np.save(path, numbers.astype(">f4"))
        case ".csv":
            np.savetxt(path, numbers, delimiter=",", fmt="%.9g")
        case ".tif":
            tifffile.imwrite(path, numbers.astype(np.float32))
        case ".mat":
            savemat(path, {"h": numbers})


@FIFTY
@given(
    suffix=st.sampled_from([".npy", ".csv", ".tif", ".mat"]),
    unit=st.sampled_from(sorted(METRES)),
    border=st.booleans(),
    seed=st.integers(0, 999),
)
def test_every_format_and_unit_gives_the_same_surface_within_the_pupil(
    tmp_path: Path, suffix: str, unit: str, border: bool, seed: int
):
    """A .npy is in metres unless a unit is stated; NaN outside the pupil, as interferometers write, are
    legal."""
    height = height_map(seed)
    within = np.hypot(AXIS[None], AXIS[:, None]) <= RADIUS
    numbers = np.where(within | (not border), height, np.nan) / METRES[unit]
    write(tmp_path / f"h{suffix}", numbers)
    found = designed_map(camera(tmp_path, f"h{suffix}", unit=unit))
    assert found is not None
    np.testing.assert_allclose(found[0].numpy()[within], height[within], rtol=1e-5)
    assert np.isfinite(found[0].numpy()).all()


def test_whole_numbers_of_a_png_count_in_the_unit_that_is_stated(tmp_path: Path):
    counts = np.round(height_map(1) * 1e9).astype(np.uint16)
    Image.fromarray(counts).save(tmp_path / "h.png")
    for unit in ("nm", 1e-9):
        found = designed_map(camera(tmp_path, "h.png", unit=unit))
        assert found is not None
        np.testing.assert_allclose(found[0].numpy(), counts * 1e-9)


@pytest.mark.parametrize("suffix", [".csv", ".tif", ".mat"])
def test_the_unit_is_asked_for(tmp_path: Path, suffix: str):
    write(tmp_path / f"h{suffix}", height_map(0))
    with pytest.raises(InputError, match="does not say its unit"):
        designed_map(camera(tmp_path, f"h{suffix}"))


@FIFTY
@given(seed=st.integers(0, 999), noise=st.floats(0.01, 0.1))
def test_millimetres_and_metres_are_told_apart_by_what_is_stated(tmp_path: Path, seed: int, noise: float):
    """Rough heights of 0.01 to 0.1 um in millimetres: as metres they would step by tens of waves."""
    rough = np.abs(np.random.default_rng(seed).normal(0, noise * 1e-6, (N, N)))
    np.save(tmp_path / "h.npy", rough * 1e3)
    with pytest.raises(InputError, match="mask.unit"):
        designed_map(camera(tmp_path, "h.npy"))
    found = designed_map(camera(tmp_path, "h.npy", unit="mm"))
    assert found is not None
    np.testing.assert_allclose(found[0].numpy(), rough)
    stated = designed_map(camera(tmp_path, "h.npy", unit="m"))
    assert stated is not None
    np.testing.assert_allclose(stated[0].numpy(), rough * 1e3)


def test_a_hole_within_the_pupil_is_refused_with_its_place(tmp_path: Path):
    height = height_map(0)
    height[30, 25] = np.nan
    np.save(tmp_path / "h.npy", height)
    with pytest.raises(InputError, match="row 30, column 25"):
        designed_map(camera(tmp_path, "h.npy"))


@pytest.mark.parametrize("name", ["h.npy", "h.mat", "h.safetensors", "h.dat"])
def test_no_advice_of_another_library_is_passed_on(tmp_path: Path, name: str):
    (tmp_path / name).write_bytes(b"no numbers \xff")
    with pytest.raises(InputError) as caught:
        designed_map(camera(tmp_path, name, **({} if name.endswith((".npy", "tensors")) else {"unit": "um"})))
    assert "pickle" not in str(caught.value) and name in str(caught.value)
