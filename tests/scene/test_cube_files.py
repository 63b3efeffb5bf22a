"""Spectral cubes of other programs: the same cube from every format, order and way to state wavelengths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.io import savemat

from edofsim.core.decoded import read_picture
from edofsim.errors import InputError
from edofsim.recipe.sources import CubeFile
from edofsim.scene.cubes import stored_cube
from edofsim.scene.wavelengths import in_nm

h5py = pytest.importorskip("h5py")
envi = pytest.importorskip("spectral.io.envi")
FIFTY = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
UNITS = {"nm": 1.0, "um": 1e-3, "angstrom": 10.0, "m": 1e-9}
ENVI_UNITS = {"nm": "Nanometers", "um": "Micrometers", "angstrom": "Angstroms", "m": "Meters"}
FORMATS = ("mat", "mat73", "h5", "npy", "npy-first", "tif", "envi-bil", "envi-bip", "envi-bsq")


def write(folder: Path, cube: np.ndarray, nm: np.ndarray, kind: str, unit: str) -> dict[str, object]:
    """A cube [band, y, x] and its wavelengths in a file; what a recipe says of it."""
    image, waves = cube.transpose(1, 2, 0), nm * UNITS[unit]
    given: dict[str, object] = {"wavelength_unit": unit if unit == "angstrom" else None}
    match kind:
        case "mat":
            savemat(folder / "c.mat", {"rad": image, "wavelengths": waves})
            return {"path": "c.mat", **given}
        case "mat73":
            with h5py.File(folder / "c.mat", "w", userblock_size=512) as file:
                for name, values in (("rad", image.T), ("bands", waves[:, None])):
                    data = file.create_dataset(name, data=values)
                    data.attrs["MATLAB_class"] = np.bytes_("double")
            return {"path": "c.mat", "key": "rad", **given}
        case "h5":
            with h5py.File(folder / "c.h5", "w") as file:
                file["data/cube"], file["data/wavelength"] = image, waves
            return {"path": "c.h5", **given}
        case "npy" | "npy-first":
            np.save(folder / "c.npy", cube if kind.endswith("first") else image)
            return {"path": "c.npy", "wavelengths_nm": nm.tolist()}
        case "tif":
            tifffile.imwrite(folder / "c.tif", cube.astype(np.float32), photometric="minisblack")
            return {"path": "c.tif", "wavelengths_nm": nm.tolist()}
    about = {"wavelength": [f"{w:.9g}" for w in waves], "wavelength units": ENVI_UNITS[unit]}
    envi.save_image(
        str(folder / "c.hdr"), image.astype(np.float32), interleave=kind[-3:], metadata=about, force=True
    )
    return {"path": "c.hdr"}


@FIFTY
@given(
    kind=st.sampled_from(FORMATS),
    unit=st.sampled_from(sorted(UNITS)),
    bands=st.integers(3, 12),
    order=st.sampled_from(["up", "down", "mixed"]),
    seed=st.integers(0, 999),
)
def test_every_format_unit_and_order_gives_the_same_cube(
    tmp_path: Path, kind: str, unit: str, bands: int, order: str, seed: int
):
    rng = np.random.default_rng(seed)
    nm = np.sort(rng.choice(np.arange(380, 1000), bands, replace=False)).astype(float)  # unevenly spaced
    cube = rng.uniform(0, 1, (bands, 13, 14)).astype(np.float32)
    turned = {"up": np.arange(bands), "down": np.arange(bands)[::-1], "mixed": rng.permutation(bands)}[order]
    source = CubeFile(**write(tmp_path, cube[turned], nm[turned], kind, unit))
    got, found, said = stored_cube(source, tmp_path)
    np.testing.assert_allclose(found, nm, rtol=1e-6)
    np.testing.assert_allclose(got, cube, rtol=1e-6)
    assert "nm" in said


def folder_of(folder: Path, names: list[str]) -> None:
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    for i, name in enumerate(names):
        Image.fromarray(np.full((4, 5), i, np.uint8)).save(folder / name)


@FIFTY
@given(
    count=st.integers(2, 40),
    first=st.integers(0, 11),
    stem=st.sampled_from(["band_{}", "{}", "scene2_ms_{}", "B{}_x", "img-{:03d}"]),
    extra=st.sampled_from([None, "preview.png", "rgb.png", "mask.tif"]),
)
def test_bands_follow_the_numbers_in_their_names_and_what_is_no_band_is_left_out(
    tmp_path: Path, count: int, first: int, stem: str, extra: str | None
):
    names = [f"{stem.format(first + i)}.png" for i in range(count)]
    folder_of(tmp_path / "cube", names)
    if extra:
        Image.new("RGB", (9, 9), "red").save(tmp_path / "cube" / extra)
    source = CubeFile(path="cube", start_nm=400, step_nm=5)
    cube, nm, said = stored_cube(source, tmp_path)
    np.testing.assert_allclose(cube[:, 0, 0] * 255, np.arange(count))
    np.testing.assert_allclose(nm, 400 + 5 * np.arange(count))
    assert extra is None or extra in said


@FIFTY
@given(
    nm=st.lists(st.integers(380, 990), min_size=2, max_size=12, unique=True),
    style=st.sampled_from(["{}nm", "band_{}nm", "cube {} nm", "{:.3f}um"]),
)
def test_wavelengths_are_read_from_names(tmp_path: Path, nm: list[int], style: str):
    names = [style.format(w / 1000 if style.endswith("um") else w) + ".png" for w in nm]
    folder_of(tmp_path / "cube", names)
    cube, found, _ = stored_cube(CubeFile(path="cube"), tmp_path)
    np.testing.assert_allclose(found, np.sort(nm))
    np.testing.assert_allclose(cube[:, 0, 0] * 255, np.argsort(nm))


def test_wavelengths_of_no_sure_unit_are_asked_for():
    for values in ([4000.0, 7000.0], [0.01, 0.02], [50.0, 500.0]):
        with pytest.raises(InputError, match="wavelength_unit"):
            in_nm(np.array(values), None, "cube")


def test_what_envi_calls_bad_is_left_out_and_said(tmp_path: Path):
    cube = np.arange(4 * 3 * 5, dtype=np.float32).reshape(3, 5, 4)
    about = {"wavelength": [400, 500, 600, 700], "wavelength units": "nm", "bbl": [1, 0, 1, 1]}
    envi.save_image(str(tmp_path / "c.hdr"), cube, metadata=about)
    got, nm, said = stored_cube(CubeFile(path="c.hdr"), tmp_path)
    assert nm.tolist() == [400, 600, 700] and "1 bands" in said
    np.testing.assert_array_equal(got, cube.transpose(2, 0, 1)[[0, 2, 3]])


def test_cubes_that_claim_too_much_or_lack_their_file_are_refused(tmp_path: Path):
    (tmp_path / "c.hdr").write_text(
        "ENVI\nsamples = 60000\nlines = 60000\nbands = 31\nheader offset = 0\ndata type = 4\n"
        "interleave = bsq\nbyte order = 0\n"
    )
    with pytest.raises(InputError, match="no file of numbers next to it"):
        stored_cube(CubeFile(path="c.hdr"), tmp_path)
    (tmp_path / "c.raw").write_bytes(b"123")
    with pytest.raises(InputError, match="more than"):
        stored_cube(CubeFile(path="c.hdr"), tmp_path)
    (tmp_path / "c.xyz").write_bytes(b"123")
    with pytest.raises(InputError, match="of no kind that is read"):
        stored_cube(CubeFile(path="c.xyz"), tmp_path)
    folder_of(tmp_path / "cube", ["a1.png", "a2.png", "b1.png", "b2.png"])
    with pytest.raises(InputError, match="keep only the bands"):
        stored_cube(CubeFile(path="cube", start_nm=400, step_nm=10), tmp_path)


@pytest.mark.parametrize("read", ["cube", "picture"])
def test_tiffs_of_more_parts_than_bytes_are_refused_at_once(tmp_path: Path, read: str):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((8, 8), np.uint16), rowsperstrip=1)
    with tifffile.TiffFile(path) as file:
        rows = file.pages[0].tags["ImageLength"].valueoffset
    content = bytearray(path.read_bytes())
    content[rows : rows + 4] = (1_000_000).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(InputError, match="1000000 parts of a picture in"):
        if read == "cube":
            stored_cube(CubeFile(path="a.tif", start_nm=400, step_nm=10), tmp_path)
        else:
            read_picture(path, "picture")


def test_a_tiff_whose_page_holds_nothing_is_refused(tmp_path: Path):
    (tmp_path / "a.tif").write_bytes(b"II*\0" + bytes([8, 0, 0, 0]) + bytes(6))
    with pytest.raises(InputError, match="a page without a picture"):
        read_picture(tmp_path / "a.tif", "picture")
