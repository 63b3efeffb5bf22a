"""Numbers that are no colours: the same array from every format, holes among them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.io import savemat

from edofsim.core import measurements
from edofsim.core.measurements import READER, read_numbers
from edofsim.errors import InputError

h5py = pytest.importorskip("h5py")
FIFTY = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
HOLES = (np.nan, np.inf, -np.inf, -1.0, 0.0)
KINDS = ("npy", "npz", "mat", "h5", "mat73", "tif", "exr", "pfm", "csv", "txt", "big-endian", "fortran")


def write(folder: Path, values: np.ndarray, kind: str) -> tuple[str, str | None]:
    """The name of a file that holds float32 numbers, and its key."""
    path = folder / f"z.{kind}"
    match kind:
        case "npy" | "big-endian" | "fortran":
            path = folder / "z.npy"
            kinds = {"big-endian": values.astype(">f4"), "fortran": np.asfortranarray(values)}
            np.save(path, kinds.get(kind, values))
        case "npz":
            np.savez(path, depth=values, other=values + 1)
            return path.name, "depth"
        case "mat":
            savemat(path, {"scene": {"depth": values}})
            return path.name, "scene.depth"
        case "h5":
            with h5py.File(path, "w") as file:
                file["scene/depth"] = values
            return path.name, "scene/depth"
        case "mat73":
            path = folder / "z73.mat"
            with h5py.File(path, "w", userblock_size=512) as file:
                data = file.create_dataset("depth", data=values.T)
                data.attrs["MATLAB_class"] = np.bytes_("single")
            with path.open("r+b") as file:
                file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        case "tif":
            tifffile.imwrite(path, values)
        case "exr":
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            OpenEXR.File(header, {"Z": values, "R": values + 1, "G": values, "B": values}).write(str(path))
        case "pfm":
            size = f"{values.shape[1]} {values.shape[0]}"
            path.write_bytes(f"Pf\n{size}\n-1.0\n".encode() + values[::-1].astype("<f4").tobytes())
        case "csv" | "txt":
            np.savetxt(path, values, fmt="%.9g", delimiter="," if kind == "csv" else " ")
    return path.name, None


@FIFTY
@given(
    kind=st.sampled_from(KINDS),
    rows=st.integers(2, 6),
    columns=st.integers(2, 6),
    holes=st.lists(st.sampled_from(HOLES), max_size=4),
    seed=st.integers(0, 999),
)
def test_every_format_gives_the_same_numbers_and_the_same_holes(
    tmp_path: Path, kind: str, rows: int, columns: int, holes: list[float], seed: int
):
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.2, 9, (rows, columns)).astype(np.float32)
    values.flat[rng.permutation(values.size)[: len(holes)]] = holes[: values.size]
    name, key = write(tmp_path, values, kind)
    got = read_numbers(name, key, tmp_path, "depth map")
    np.testing.assert_array_equal(got.astype(np.float32), values)


@FIFTY
@given(
    names=st.lists(
        st.sampled_from(["R", "G", "B", "A", "ViewLayer.Combined.R", "normal.X", "id"]),
        unique=True,
        max_size=5,
    ),
    depth=st.sampled_from(["Z", "ViewLayer.Depth.Z", "Depth.V", "depth", "RenderLayer.Depth.Z"]),
    keyed=st.booleans(),
)
def test_of_an_exr_the_depth_is_found_or_named(tmp_path: Path, names: list[str], depth: str, keyed: bool):
    planes = {name: np.full((3, 4), i + 1, np.float32) for i, name in enumerate(names)}
    planes[depth] = np.full((3, 4), 99, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    got = read_numbers("a.exr", depth if keyed else None, tmp_path, "depth map")
    assert (got == 99).all()


def test_an_exr_without_a_depth_lists_its_channels(tmp_path: Path):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.full((3, 4), i, np.float32) for i, name in enumerate("RGB")}
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match="say which with key"):
        read_numbers("a.exr", None, tmp_path, "depth map")


def test_a_picture_in_colours_is_no_measurement(tmp_path: Path):
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (4, 4, 3), dtype=np.uint8)).save(
        tmp_path / "a.png"
    )
    with pytest.raises(InputError, match="picture in colours"):
        read_numbers("a.png", None, tmp_path, "depth map")


def test_gdals_missing_values_are_holes(tmp_path: Path):
    values = np.array([[1.0, -9999.0], [2.0, 3.0]], np.float32)
    tifffile.imwrite(tmp_path / "a.tif", values, extratags=[(42113, "s", 0, "-9999", True)])
    got = read_numbers("a.tif", None, tmp_path, "depth map")
    np.testing.assert_array_equal(got, np.where(values < 0, np.nan, values))


@pytest.mark.parametrize("how", ["link", "external", "virtual"])
def test_hdf5_never_reads_another_file(tmp_path: Path, how: str):
    (tmp_path / "secret.bin").write_bytes(np.arange(16.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["z"] = np.ones((4, 4))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if how == "link":
            file["z"] = h5py.ExternalLink("other.h5", "/z")
        elif how == "external":
            place = [(str(tmp_path / "secret.bin"), 0, 128)]
            file.create_dataset("z", (4, 4), "<f8", external=place)
        else:
            layout = h5py.VirtualLayout((4, 4), "<f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "z", (4, 4))
            file.create_virtual_dataset("z", layout)
    with pytest.raises(InputError, match="another file"):
        read_numbers("a.h5", "z", tmp_path, "depth map")


def test_an_hdf5_bomb_is_refused_before_it_unpacks(tmp_path: Path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("z", (1 << 16, 1 << 16), "f4", chunks=(1024, 1024), compression="gzip")
    assert (tmp_path / "a.h5").stat().st_size < 1 << 20
    with pytest.raises(InputError, match="more than"):
        read_numbers("a.h5", None, tmp_path, "depth map")


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.csv", "1,2\n3\n", "line 2: has 1 numbers, the first row 2"),
        ("a.csv", "1,2\n3,x\n", "line 2: is no row of numbers"),
        ("a.csv", "", "holds no numbers"),
        ("a.npy", "1,2\n", "no file of NumPy's"),
        ("a.h5", "no", "cannot be read as HDF5"),
    ],
)
def test_damaged_files_are_named_without_another_librarys_advice(
    tmp_path: Path, name: str, content: str, complaint: str
):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_numbers(name, None, tmp_path, "map")
    assert "allow_pickle" not in str(caught.value)


def test_texts_have_the_separators_of_other_countries(tmp_path: Path):
    (tmp_path / "a.csv").write_text("# heights\n0,5;1,25\n2;\n")
    got = read_numbers("a.csv", None, tmp_path, "map")
    np.testing.assert_array_equal(got, [[0.5, 1.25], [2, np.nan]])


def test_mat_files_are_read_by_one_process_that_may_end_at_any_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crash is the file's fault, a process that was ended in the meantime is not."""
    savemat(tmp_path / "a.mat", {"a": np.ones((2, 3))})

    def read() -> np.ndarray:
        return measurements.read_numbers("a.mat", None, tmp_path, "depths")

    assert read().shape == (2, 3)
    tries = measurements._reader(os.getpid())
    assert read().shape == (2, 3) and measurements._reader(os.getpid()) is tries
    tries.kill()
    tries.wait()
    assert read().shape == (2, 3)
    measurements._reader.cache_clear()
    script = tmp_path / "reader.py"
    with monkeypatch.context() as patch:
        patch.setattr(measurements, "READER", script)
        script.write_text("import os\ninput()\nos.abort()")
        with pytest.raises(InputError, match="a damaged MAT file"):
            read()
        # what an earlier file did to it is not this one's fault
        code = READER.read_text().replace("in sys.stdin", "in [input()]")
        script.write_text(code + "    input()\n    import os\n    os.abort()\n")
        assert [read().shape for _ in range(3)] == 3 * [(2, 3)]
    measurements._reader.cache_clear()
    assert read().shape == (2, 3)
