"""Depth maps: formats, holes, stereo calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from scipy.io import savemat
from skimage.io import imsave

from edofsim.errors import InputError
from edofsim.recipe.sources import DepthMap
from edofsim.scene.depth_maps import fill_holes, read_inverse_depth

Z = np.array([[1.0, 2.0, 4.0], [0.5, 8.0, 1.25]])


def write(folder: Path, kind: str) -> dict:
    if kind == "png":
        imsave(folder / "z.png", (Z * 1000).astype(np.uint16), check_contrast=False)
        return {"path": "z.png", "unit": 0.001}
    if kind == "npy":
        np.save(folder / "z.npy", Z)
    elif kind == "npz":
        np.savez(folder / "z.npz", depth=Z, other=Z + 1)
        return {"path": "z.npz", "key": "depth"}
    elif kind == "mat":
        savemat(folder / "z.mat", {"scene": {"depth": Z}})
        return {"path": "z.mat", "key": "scene.depth"}
    elif kind == "exr":
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Z": Z.astype(np.float32), "Y": Z.astype(np.float32)}).write(
            str(folder / "z.exr")
        )
    elif kind == "dpt":
        head = np.float32(202021.25).tobytes() + np.array([3, 2], "<i4").tobytes()
        (folder / "z.dpt").write_bytes(head + Z.astype("<f4").tobytes())
    elif kind == "pfm":
        (folder / "z.pfm").write_bytes(b"Pf\n3 2\n-1.0\n" + Z[::-1].astype("<f4").tobytes())
    return {"path": f"z.{kind}"}


@pytest.mark.parametrize("kind", ["png", "npy", "npz", "mat", "exr", "pfm", "dpt"])
def test_every_format_gives_the_same_inverse_depth(tmp_path: Path, kind: str):
    source = DepthMap(**write(tmp_path, kind))
    np.testing.assert_allclose(read_inverse_depth(source, tmp_path), 1 / Z, rtol=1e-6)


def test_stereo_calibration_gives_metres(tmp_path: Path):
    """z = baseline focal / (d + offset): 0.2 m x 1000 px / (30 + 10) px = 5 m, stretched by 0.3 to 1.5 m."""
    np.save(tmp_path / "d.npy", np.array([[30.0, np.inf, np.nan, 0.0]]))
    source = DepthMap(path="d.npy", holds="disparity", focal_length_px=1000, baseline_mm=200,
                      disparity_offset_px=10, scale=0.3)  # fmt: skip
    np.testing.assert_allclose(read_inverse_depth(source, tmp_path), [[1 / 1.5, np.nan, np.nan, np.nan]])


def test_negative_disparities_of_light_fields_are_depths(tmp_path: Path):
    """Disparity counts from the plane in focus, so that what is farther is negative (Honauer et al., ACCV
    2016): z = 0.1 m x 500 px / (d + 5)."""
    np.save(tmp_path / "d.npy", np.array([[-2.5, 2.5, -5.0, -7.0, np.nan, -1.0]]))
    source = DepthMap(path="d.npy", holds="disparity", focal_length_px=500, baseline_mm=100,
                      disparity_offset_px=5)  # fmt: skip
    np.testing.assert_allclose(
        read_inverse_depth(source, tmp_path), [[0.05, 0.15, np.nan, np.nan, np.nan, 0.08]]
    )
    plain = source.model_copy(update={"disparity_offset_px": 0.0})
    np.testing.assert_allclose(
        read_inverse_depth(plain, tmp_path), [[np.nan, 0.05, np.nan, np.nan, np.nan, np.nan]]
    )


def test_holes_and_infinity_are_told_apart(tmp_path: Path):
    np.save(tmp_path / "z.npy", np.array([[2.0, np.inf, np.nan, 0.0, -1.0]]))
    np.testing.assert_array_equal(
        read_inverse_depth(DepthMap(path="z.npy"), tmp_path), [[0.5, 0, np.nan, np.nan, np.nan]]
    )


def test_holes_take_the_farther_neighbour_of_their_row():
    """A stereo pair's holes lie beside near things, on what is behind them."""
    nan = np.nan
    inverse = np.array([[2.0, nan, nan, 0.5, nan], [nan, nan, nan, nan, nan], [nan, 1.0, 1.0, nan, 3.0]])
    filled = fill_holes(inverse, "background", "x")
    np.testing.assert_array_equal(filled[0], [2, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(filled[2], [1, 1, 1, 1, 3])
    assert np.isfinite(filled[1]).all()


def test_nearest_takes_the_nearest_known_pixel():
    filled = fill_holes(np.array([[2.0, np.nan, np.nan, np.nan, 0.5]]), "nearest", "x")
    assert filled[0, 1] == 2.0 and filled[0, 3] == 0.5


def test_holes_can_be_refused():
    with pytest.raises(InputError, match="50.0% of its pixels are holes"):
        fill_holes(np.array([[1.0, np.nan]]), "refuse", "x")


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ({"path": "none.png"}, "does not exist"),
        ({"path": "two.npz"}, "say which with key"),
        ({"path": "two.npz", "key": "c"}, "holds no 'c'"),
        ({"path": "pickle.npy"}, "cannot be read"),
        ({"path": "cube.npy"}, "needs \\[y, x\\]"),
        ({"path": "empty.npy"}, "no depth at all"),
        ({"path": "text.mat"}, "cannot be read"),
        ({"path": "empty.mat"}, "holds no variable"),
        ({"path": "empty.mat", "key": "depth"}, "holds no variable"),
        ({"path": "skimage:no_such"}, "brings no 'no_such'"),
        ({"path": "skimage:../../../etc/passwd"}, "brings no"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, source: dict, complaint: str):
    np.savez(tmp_path / "two.npz", a=Z, b=Z)
    np.save(tmp_path / "pickle.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "cube.npy", np.ones((2, 2, 2)))
    np.save(tmp_path / "empty.npy", np.full((2, 2), np.nan))
    (tmp_path / "text.mat").write_text("hello")
    savemat(tmp_path / "empty.mat", {})
    with pytest.raises(InputError, match=complaint):
        read_inverse_depth(DepthMap(**source), tmp_path)
