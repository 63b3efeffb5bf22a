"""Fabrication files hold the mask that was learned, in whole levels, and lose no square of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from edofsim.errors import EdofsimError, InputError
from edofsim.learn.fabricate import device, rectangles, write_device
from edofsim.recipe.camera import CameraRecipe
from edofsim.restore.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from edofsim.restore.network import build_network


def _checkpoint(folder: Path, height: torch.Tensor | None) -> Checkpoint:
    camera = CameraRecipe(name="c", mask={"kind": "height-map"} if height is not None else {"kind": "clear"})
    card = {"name": "doe", "camera": camera.model_dump(mode="json", exclude={"schema_"})}
    path = folder / "doe.safetensors"
    return load_checkpoint(save_checkpoint(path, build_network("dcnn"), card, height=height, sampling=21e-6))


def _smooth() -> torch.Tensor:
    axis = torch.linspace(-1, 1, 239)
    return 0.55e-6 * (1 + torch.sin(3 * axis[:, None] + 2 * axis[None, :] ** 2))


def test_the_made_relief_is_the_learned_one_in_98_levels(tmp_path: Path) -> None:
    """1667 squares of 3 um cover 5 mm; a smooth map is met within half a level, apart from its piston."""
    height = _smooth()
    made = device(_checkpoint(tmp_path, height))
    assert made.levels.shape == (1667, 1667)
    assert made.levels.min() == 0 and made.levels.max() <= 97
    assert made.level_height == pytest.approx(1.2e-6 / 97)
    # square (i, j) of the device lies on sample 119 + (i - 833) / 7 of the map: every seventh meets one
    height_map = torch.from_numpy(made.levels[::7, ::7].astype(float)) * made.level_height
    designed = (height - height.min()).double()
    assert height_map.shape == designed.shape
    assert (height_map - designed).abs().max() < 0.6 * made.level_height


def test_files_hold_the_levels_and_say_what_they_mean(tmp_path: Path) -> None:
    made = device(_checkpoint(tmp_path, _smooth()), pitch_um=21.0)
    png, levels, heights = write_device(made, tmp_path / "out", "doe")
    with Image.open(png) as image:
        about = json.loads(image.text["edofsim"])
        grey = np.array(image)
    assert about["level_nm"] == pytest.approx(1200 / 97)
    np.testing.assert_array_equal(grey, made.levels.astype(int) * about["grey_per_level"])
    np.testing.assert_array_equal(np.loadtxt(levels, delimiter=",", dtype=int), made.levels)
    table = np.loadtxt(heights, delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 1], table[:, 0] * 1200 / 97, atol=1e-3)


def test_rectangles_cover_every_square_once() -> None:
    levels = np.random.default_rng(1).integers(0, 3, (20, 31)).astype(np.uint16)
    levels[5:9, 4:20] = 2
    painted = np.full(levels.shape, -1)
    for level, top, bottom, left, right in rectangles(levels):
        assert (painted[top:bottom, left:right] == -1).all()
        painted[top:bottom, left:right] = level
    np.testing.assert_array_equal(painted, levels)


def test_gds_has_the_area_of_each_level(tmp_path: Path) -> None:
    gdstk = pytest.importorskip("gdstk")
    made = device(_checkpoint(tmp_path, _smooth()), pitch_um=84.0)
    path = write_device(made, tmp_path, "doe", gds=True)[-1]
    cell = gdstk.read_gds(path).cells[0]
    area = {}
    for polygon in cell.polygons:
        area[polygon.layer] = area.get(polygon.layer, 0) + polygon.area()
    counts = np.bincount(made.levels.ravel())
    for level in range(1, len(counts)):
        assert area.get(level, 0) == pytest.approx(counts[level] * 84**2)


def test_what_cannot_be_made_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no height map"):
        device(_checkpoint(tmp_path, None))
    with pytest.raises(InputError, match="deep"):
        device(_checkpoint(tmp_path, 3 * _smooth()))
    (tmp_path / "file").write_text("")
    made = device(_checkpoint(tmp_path, _smooth()), pitch_um=210.0)
    with pytest.raises(EdofsimError, match="cannot be written"):
        write_device(made, tmp_path / "file" / "out", "doe")
