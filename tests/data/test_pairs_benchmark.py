"""What many pairs cost: the figures of the benchmark add up, and it reads what was made."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.pairs import WANTED, measured

ROOM = (Path(__file__).parents[1] / "small" / "room.toml").read_text()
CAMERA = 'name = "small"\n[mask]\nkind = "cubic"\nalpha_rad = 20\n[psf]\nwindow_px = 32\n'
RECIPE = """
name = "few"
cameras = ["small.toml"]
scenes = [{ recipe = "room.toml", members = 2 }]
frame = { width_px = 40, height_px = 32 }
photos = { fidelity = { layers = 3, band_groups = 1, group_wavelengths = 1, occlusion = "none" } }
splits = { validation = 0.0, test = 0.0 }
"""


def test_pairs_are_made_once_and_read_in_each_form(tmp_path: Path):
    for kind in ("webdataset", "zarr"):
        pytest.importorskip(kind)
    for name, text in (("room", ROOM), ("small", CAMERA), ("few", RECIPE)):
        (tmp_path / f"{name}.toml").write_text(text)
    first = measured(tmp_path / "few.toml", tmp_path / "data")
    again = measured(tmp_path / "few.toml", tmp_path / "data")
    assert first["core_seconds.render"] > 0 and first["core_seconds.photos"] > 0
    assert {name for name in first if first[name] != again[name]} <= {
        name
        for name in first
        if name.startswith(("pairs_per_second.", "packing_seconds.", "hours.", "core_hours", "workers."))
    }
    kinds = ("folder", "png", "webdataset", "zarr")
    assert all(first[f"pairs_per_second.{kind}"] > 0 for kind in kinds)
    assert first["pairs_per_second.webdataset.own"] > 0
    # uncompressed: photo, clean and ideal of 16 bits, and depth and edges
    assert first["bytes.webdataset"] > 40 * 32 * (9 * 2 + 4 + 2)
    assert first["gib.zarr"] == pytest.approx(first["bytes.zarr"] * WANTED / 2**30)
    work = first["core_seconds.render"] + first["core_seconds.photos"]
    alone = first["packing_seconds.webdataset"]
    assert first["hours.1"] == first["core_hours"] == pytest.approx(WANTED * (work + alone) / 3600)
    assert first["hours.256"] > WANTED * alone / 3600
    assert work / first["workers.half"] == pytest.approx(alone)
