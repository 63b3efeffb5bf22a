"""Data sets: what is made, that it is the same after a kill, and what is wrong with one is named."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch.utils.data import DataLoader

import edofsim as edof
from edofsim.data import Pairs, PairStream, live
from edofsim.data.kept import SUMS
from edofsim.data.make import write_camera
from edofsim.data.pairs import turned
from edofsim.errors import InputError

Run = Callable[..., tuple[int, str]]
ROOM = (Path(__file__).parents[1] / "small" / "room.toml").read_text()
CAMERA = 'name = "small"\n[mask]\nkind = "cubic"\nalpha_rad = 20\n[psf]\nwindow_px = 32\n'
RECIPE = """
name = "pairs"
cameras = ["small.toml"]
[[scenes]]
recipe = "room.toml"
members = 4
[frame]
width_px = 40
height_px = 32
[photos]
noise_seeds = 2
exposure = [0.5, 1.0]
read_noise = [0.001, 0.02]
rendering_noise = true
fidelity = { layers = 3, band_groups = 1, group_wavelengths = 1, occlusion = "none" }
[splits]
validation = 0.25
test = 0.25
[store]
kind = "KIND"
shard = 3
"""


def recipe(folder: Path, kind: str = "folder") -> Path:
    if kind not in ("folder", "png"):
        pytest.importorskip(kind)
    (folder / "room.toml").write_text(ROOM)
    (folder / "small.toml").write_text(CAMERA)
    path = folder / f"{kind}.toml"
    path.write_text(RECIPE.replace("KIND", kind))
    return path


@pytest.fixture(scope="module", autouse=True)
def workers_begin_with_what_they_import() -> None:
    """The process that others are forked from imports it once, in place of each of them."""
    multiprocessing.set_forkserver_preload(["edofsim.data.pairs", "torch.utils.data"])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set in a folder of files."""
    from edofsim import console
    from edofsim.cli import invoke

    place = tmp_path_factory.mktemp("made")
    command = ["dataset", "make", str(recipe(place)), "--out", str(place / "data"), "--quiet"]
    assert console.exit_status(lambda: invoke(command)) == 0
    return place / "data"


def test_a_camera_has_the_same_bytes_each_time_it_is_written(tmp_path: Path):
    recipe(tmp_path)
    camera = edof.camera(tmp_path / "small.toml")
    wavelengths = torch.linspace(420e-9, 720e-9, 4).double()
    written = {
        write_camera(tmp_path / f"{number}.safetensors", camera, wavelengths, [0.3, 1.7]).read_bytes()
        for number in range(8)
    }
    assert len(written) == 1


def sums(folder: Path) -> dict[str, list[object]]:
    return json.loads((folder / SUMS).read_text())


def test_splits_share_no_scene_and_pairs_hold_what_the_recipe_asks_for(made: Path):
    sets = {split: Pairs(made, split) for split in ("train", "validation", "test")}
    assert {split: len(pairs) for split, pairs in sets.items()} == {"train": 4, "validation": 2, "test": 2}
    seeds = [{(m["family"], m["member_seed"]) for m in pairs.metas} for pairs in sets.values()]
    assert not seeds[0] & seeds[1] and not seeds[0] & seeds[2] and not seeds[1] & seeds[2]
    metas = sets["train"].metas
    assert len({meta["exposure"] for meta in metas}) == 2 and len({meta["noise_seed"] for meta in metas}) == 4
    assert all(0.001 <= meta["read_noise"] <= 0.02 for meta in metas)
    planes = ("photo", "clean", "ideal", "inverse_depth", "edges", "noise.ideal", "noise.photo")
    pair = Pairs(made, planes=planes)[0]
    off = (pair["photo"] - pair["clean"]).std()
    assert float(off) == pytest.approx(metas[0]["read_noise"], rel=0.1)  # the noise that was drawn
    depth = pair["inverse_depth"]
    assert float(depth.min()) == pytest.approx(1 / 3, rel=1e-3)  # the wall; the card is nearer than 1 m
    assert 0.99 <= float(depth.max()) <= 1 / 0.6 + 0.01
    assert pair["edges"].sum() > 0 and (depth[pair["edges"] == 0] - 1 / 3).abs().min() < 1e-3
    with pytest.raises(InputError, match="noise.photo|no 'x'"):
        Pairs(made, planes=("x",))
    with pytest.raises(InputError, match="no split 'all'"):
        Pairs(made, "all")


@pytest.mark.parametrize("kind", ["webdataset", "zarr"])
def test_other_files_hold_the_same_numbers(edofsim: Run, made: Path, tmp_path: Path, kind: str):
    out = tmp_path / "data"
    assert edofsim("dataset", "make", recipe(tmp_path, kind), "--out", out)[0] == 0
    planes = ("photo", "ideal", "inverse_depth", "edge_px", "noise.photo")
    ours, theirs = Pairs(made, planes=planes), Pairs(out, planes=planes)
    assert [meta["key"] for meta in ours.metas] == [meta["key"] for meta in theirs.metas]
    for one, other in zip(ours, theirs, strict=True):
        assert all(torch.equal(one[name], other[name]) for name in planes)
    assert not list((out / "samples").glob("*.exr")) and not (out / ".views").exists()
    assert edofsim("dataset", "verify", out)[0] == 0
    if kind == "webdataset":
        import webdataset

        tars = sorted(str(path) for path in out.glob("train-*.tar"))
        read = list(webdataset.WebDataset(tars, shardshuffle=False).decode())
        assert [each["__key__"] for each in read] == [meta["key"] for meta in theirs.metas]
        np.testing.assert_array_equal(read[0]["ideal.npy"].astype(np.float32), theirs[0]["ideal"])


def test_pictures_of_the_pairs_are_their_srgb(edofsim: Run, made: Path, tmp_path: Path):
    """By the transfer curve of IEC 61966-2-1, written out once more."""
    out = tmp_path / "data"
    assert edofsim("dataset", "make", recipe(tmp_path, "png"), "--out", out)[0] == 0
    assert edofsim("dataset", "verify", out)[0] == 0
    pairs = Pairs(out, "test")
    assert len(list((out / "png").rglob("*.png"))) == 2 * 8
    for number, pair in enumerate(pairs):
        for name in ("photo", "ideal"):
            assert torch.equal(pair[name], Pairs(made, "test")[number][name])
            linear = pair[name].double().numpy().clip(0, 1)
            curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
            picture = np.asarray(Image.open(out / "png" / "test" / name / f"{pair['key']}.png"))
            assert np.abs(picture.transpose(2, 0, 1) - 255 * curve).max() <= 0.501


def test_made_by_shares_and_after_a_kill_it_has_the_same_bytes(edofsim: Run, made: Path, tmp_path: Path):
    source, out = recipe(tmp_path), tmp_path / "data"
    command = ["dataset", "make", str(source), "--out", str(out), "--quiet"]
    child = subprocess.Popen([sys.executable, "-m", "edofsim", *command], stderr=subprocess.DEVNULL)
    limit = time.monotonic() + 300
    while not list(out.glob("samples/*.exr")) and time.monotonic() < limit and child.poll() is None:
        time.sleep(0.02)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    assert not (out / SUMS).exists()
    assert edofsim(*command, "--shard", "1/2")[0] == 0
    assert edofsim("dataset", "verify", out)[0] == 2  # not complete
    assert edofsim(*command)[0] == 0
    assert sums(out) == sums(made)


def test_damaged_missing_and_extra_files_are_named(edofsim: Run, made: Path, tmp_path: Path):
    copy = tmp_path / "copy"
    shutil.copytree(made, copy)
    assert edofsim("dataset", "verify", copy)[0] == 0
    pairs = sorted((copy / "samples").glob("*.exr"))
    data = bytearray(pairs[0].read_bytes())
    data[-1] ^= 1
    pairs[0].write_bytes(bytes(data))
    pairs[1].unlink()
    (copy / "samples" / "more.exr").write_bytes(b"")
    status, said = edofsim("dataset", "verify", copy)
    assert status == 2
    said = " ".join(said.split())
    assert f"{pairs[0].name}: damaged" in said and f"{pairs[1].name}: missing" in said
    assert "more.exr: extra" in said


def test_another_recipe_is_refused_and_the_forecast_makes_nothing(edofsim: Run, made: Path, tmp_path: Path):
    source = recipe(tmp_path)
    status, said = edofsim("dataset", "make", source, "--forecast", "--out", tmp_path / "new")
    assert status == 0 and "8 pairs, 0 there" in said and "core hours" in said
    assert not list((tmp_path / "new").rglob("*.exr"))
    copy = tmp_path / "copy"
    shutil.copytree(made, copy)
    assert "8 pairs, all there" in edofsim("dataset", "make", source, "--forecast", "--out", copy)[1]
    source.write_text(source.read_text().replace("0.02]", "0.03]"))
    status, said = edofsim("dataset", "make", source, "--out", copy)
    assert status == 2 and "another recipe" in said
    source.write_text(source.read_text().replace("members", "member"))
    status, said = edofsim("dataset", "make", source, "--out", copy)
    assert status == 2 and "did you mean 'members'" in " ".join(said.split())


@pytest.mark.parametrize("turn", range(8))
@pytest.mark.parametrize("size", [8, 9])
def test_a_turned_photo_is_the_photo_of_the_turned_scene_by_the_turned_psf(turn: int, size: int):
    draw = torch.Generator().manual_seed(turn)
    scene, psf = (torch.rand(n, n, generator=draw, dtype=torch.float64) for n in (24, size))

    if size % 2 == 0:  # what lies 4 pixels before the middle has no place 4 pixels behind it
        psf[0], psf[:, 0] = 0, 0

    def photo(scene: torch.Tensor, psf: torch.Tensor) -> torch.Tensor:
        """Light of the scene at y lands at y + (index - n // 2): written as a sum, without a transform."""
        found = torch.zeros(24, 24, dtype=torch.float64)
        for y in range(size):
            for x in range(size):
                shift = (y - size // 2, x - size // 2)
                found += psf[y, x] * scene.roll(shift, (0, 1))  # what leaves comes back: borders turn too
        return found

    expected = turned(photo(scene, psf), turn)
    torch.testing.assert_close(photo(turned(scene, turn), turned(psf, turn, centred=True)), expected)
    assert not torch.allclose(psf, psf.flip(0))


def test_loaders_with_workers_give_what_one_process_gives(made: Path):
    pairs = Pairs(made, crop=16, augment=True, psfs=True, seed=3)
    alone = [pairs[i] for i in range(len(pairs))]
    for loader in (
        # a renderer is at work in this process, whose threads no fork would have
        DataLoader(pairs, num_workers=2, multiprocessing_context="forkserver"),
        DataLoader(PairStream(pairs), num_workers=2, multiprocessing_context="forkserver"),
    ):
        found = {batch["key"][0]: batch for batch in loader}
        assert sorted(found) == sorted(each["key"] for each in alone)
        for each in alone:
            for name in ("photo", "ideal", "psfs"):
                assert torch.equal(found[each["key"]][name][0], each[name]), name
    batch = next(iter(DataLoader(pairs, batch_size=4)))
    assert batch["photo"].shape == batch["ideal"].shape == (4, 3, 16, 16)
    assert batch["psfs"].shape[2:] == (3, 32, 32)
    first = pairs[0]["photo"]
    pairs.epoch = 1
    assert not torch.equal(pairs[0]["photo"], first)
    moved = Pairs(made, planes=("ideal",), crop=16, augment=True, turns=False)
    whole = Pairs(made, planes=("ideal",))[0]["ideal"].unfold(1, 16, 1).unfold(2, 16, 1)
    for moved.epoch in range(8):
        part = moved[0]["ideal"][:, None, None]
        assert (whole == part).all(-1).all(-1).all(0).any()
    with pytest.raises(InputError, match="crop"):
        Pairs(made, crop=33)


def test_live_pairs_are_taken_anew_in_each_epoch(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Of the same views as `dataset make`: the same sharp images but for the exposure, other noise."""
    recipe(tmp_path)
    monkeypatch.chdir(tmp_path)
    fidelity = {"layers": 3, "band_groups": 1, "group_wavelengths": 1, "occlusion": "none"}
    asked = {"exposure": [0.5, 1.0], "read_noise": [0.001, 0.02], "fidelity": fidelity}
    pairs = live(
        ["room.toml"], ["small.toml"], members=2, size=(32, 40), photos=asked, cache=tmp_path / "views"
    )
    first, same = list(pairs), list(pairs)
    assert [each["key"] for each in first] == [each["key"] for each in same] and len(first) == len(pairs) == 2
    assert all(torch.equal(one["photo"], two["photo"]) for one, two in zip(first, same, strict=True))
    pairs.epoch = 1
    alone = {each["key"]: each for each in pairs}
    spread = DataLoader(pairs, batch_size=None, num_workers=2, multiprocessing_context="forkserver")
    for each in spread:
        assert torch.equal(each["photo"], alone[each["key"]]["photo"])
    made_before = Pairs(made)
    kept = {str(meta["scene"]): pair for meta, pair in zip(made_before.metas, made_before, strict=True)}
    for early in first:
        scene = early["key"].partition("_")[0]
        late = next(each for key, each in alone.items() if key.startswith(scene))
        assert torch.equal(early["inverse_depth"], late["inverse_depth"])
        assert (early["photo"] - early["clean"]).std() > 0.0005
        for other in (late["ideal"], kept[scene]["ideal"]):
            factor = early["ideal"].sum() / other.sum()
            assert abs(float(factor) - 1) > 1e-3
            torch.testing.assert_close(other * factor, early["ideal"], rtol=0.01, atol=1e-3)
    with pytest.raises(InputError, match="exposur"):
        live(["room.toml"], ["small.toml"], photos={"exposur": [1, 1]})


@pytest.mark.slow
def test_the_network_of_the_page_learns_from_tar_files(edofsim: Run, tmp_path: Path):
    """As a user runs it, in a process of its own: 34 epochs of six batches are 204 steps. The truth has
    little noise of the rendering, which nothing learns, and all photos are well exposed."""
    source, out = recipe(tmp_path, "webdataset"), tmp_path / "data"
    for path, old, new in (
        (tmp_path / "room.toml", "samples = 8", "samples = 64"),
        (tmp_path / "room.toml", "= 40", "= 9"),
        (source, "members = 4", "members = 16"),
        (source, "exposure = [0.5, 1.0]\n", ""),
    ):
        path.write_text(path.read_text().replace(old, new))
    assert edofsim("dataset", "make", source, "--out", out)[0] == 0
    script = Path(__file__).parents[2] / "docs" / "howto" / "train_unet.py"
    command = [sys.executable, str(script), str(out), "34"]
    alone = os.environ | {"OMP_NUM_THREADS": "1"}
    said = subprocess.run(command, check=True, capture_output=True, text=True, env=alone).stdout
    levels = [[float(word) for word in line.split()[1::2]] for line in said.splitlines()]
    assert len(levels) == 8
    assert all(restored > photo for photo, restored in levels)
    assert np.mean([restored - photo for photo, restored in levels]) > 3
