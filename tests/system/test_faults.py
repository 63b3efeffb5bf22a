"""Disks that are full or can only be read, two runs at once, clocks that were set back: one message that says
what to do, nothing that was complete is lost, and the same command ends well once the fault is gone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from edofsim.capture import read_image, write_image
from edofsim.render import cache

Run = Callable[..., tuple[int, str]]
PAGE = 4096
SMALL = Path(__file__).parents[1] / "small"
"""A scene, a camera and a training that take a second."""


@pytest.fixture
def command(tmp_path: Path) -> Callable[[str, Path], list[str | Path]]:
    """The command line of a small job that keeps all it writes in a folder."""
    scene, camera = tmp_path / "small.toml", tmp_path / "camera.toml"
    shutil.copytree(SMALL, tmp_path, dirs_exist_ok=True)
    write_image(tmp_path / "photo.exr", torch.rand(3, 24, 32, generator=torch.Generator().manual_seed(1)))

    def line(name: str, folder: Path) -> list[str | Path]:
        out, kept = folder / "out", folder / "cache"
        where = ["--out", out, "--json", out / "record.json"]
        if name == "train":
            where += ["--resume"] if (out / "state.safetensors").exists() else []
            return ["train", tmp_path / "train.toml", *where, "--cache", kept, "--quiet"]
        if name == "restore":
            return ["restore", tmp_path / "photo.exr", "--camera", camera, "--network", "wiener", *where]
        if name == "evaluate":
            return ["evaluate", "stability", "one depth", *where, "--quiet"]
        photographed = [] if name == "render" else ["--camera", camera]
        return [name, scene, *photographed, *where, "--cache", kept, "--quiet"]

    return line


def pages(path: Path) -> int:
    return -(-path.stat().st_size // PAGE)


def fills(folder: Path) -> list[int]:
    """Sizes of a disk on which the writing of each of these files in turn would not come to its end."""
    files = sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda p: p.stat().st_mtime_ns)
    sizes, before = [], 0
    for path in files:
        if pages(path):
            sizes.append(PAGE * (before + pages(path) // 2))
        before += pages(path)
    return sorted(set(sizes))


def complete(folder: Path) -> dict[str, float]:
    """When each view in the cache was written."""
    kept = folder / "cache"
    return {entry.key: entry.record["written"] for entry in cache.ls(kept)} if kept.is_dir() else {}


def fails_then_ends(edofsim: Run, arguments: Callable[[], list[str | Path]], disk, size: int) -> bool:
    """On a disk of that size: one message; with room again the command ends and keeps what was there. Whether
    it failed at all: pages hold timings, and may be some bytes shorter than last time."""
    for entry in disk.folder.iterdir():
        shutil.rmtree(entry)
    disk.size(size)
    status, said = edofsim(*arguments())
    failed = status != 0
    if failed:
        assert status in (1, 2), f"{size} bytes: status {status} {said}"
        assert "Traceback" not in said and ("space" in said or "full" in said or "too small" in said), said
    before = complete(disk.folder)
    disk.size(256 << 20)
    status, said = edofsim(*arguments())
    assert status == 0, said
    after = complete(disk.folder)
    assert before.items() <= after.items(), "a finished view was rendered again"
    assert (disk.folder / "out" / "record.json").is_file()
    leftover = [path for path in disk.folder.rglob("*") if path.suffix in (".tmp", ".part")]
    assert not leftover
    return failed


COMMANDS = ["run", "render", "expose", "cost", "train", "evaluate", "restore"]


@pytest.mark.usefixtures("plots_left_out")
@pytest.mark.parametrize("name", ["expose", "restore"])
def test_a_disk_that_is_full_from_the_start(edofsim: Run, command, disk, name: str):
    assert fails_then_ends(edofsim, lambda: command(name, disk.folder), disk, PAGE)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_disk_that_is_full_at_each_write(edofsim: Run, command, disk, name: str):
    status, said = edofsim(*command(name, disk.folder))
    assert status == 0, said
    sizes = fills(disk.folder)
    assert sizes
    failed = sum(fails_then_ends(edofsim, lambda: command(name, disk.folder), disk, size) for size in sizes)
    assert failed >= len(sizes) - 1
    print(f"{name}: full at {failed} writes")


def test_a_cache_that_can_only_be_read(edofsim: Run, command, disk, tmp_path: Path):
    """What is in it serves; what is not ends in one message, whose advice works."""

    def arguments(folder: Path) -> list[str | Path]:
        return ["expose", tmp_path / "small.toml", "--camera", tmp_path / "camera.toml", "--quiet",
                "--out", tmp_path / "out", "--cache", folder]  # fmt: skip

    line = command("render", disk.folder)
    assert edofsim(*arguments(disk.folder))[0] == 0
    disk.change("ro")
    try:
        before = sorted(disk.folder.rglob("*"))
        assert edofsim(*arguments(disk.folder))[0] == 0
        other = (tmp_path / "small.toml").read_text().replace("samples = 16", "samples = 8")
        (tmp_path / "small.toml").write_text(other)
        status, said = edofsim(*arguments(disk.folder))
        assert status == 2 and "cannot be written" in said and "--cache" in said
        status, said = edofsim(*line)
        assert status == 2 and "--out" in said
        assert sorted(disk.folder.rglob("*")) == before
    finally:
        disk.change("rw")
    assert edofsim(*arguments(tmp_path / "another"))[0] == 0


@pytest.mark.slow
def test_two_runs_at_once_on_one_cache_and_one_folder(edofsim: Run, command, tmp_path: Path):
    line = [str(each) for each in command("run", tmp_path)]
    both = [
        subprocess.Popen([sys.executable, "-m", "edofsim", *line], stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for process in both:
        said = process.communicate(timeout=600)[1]
        assert process.returncode == 0, said
    before = complete(tmp_path)
    assert before and cache.verify(tmp_path / "cache") == cache.Verified(len(before), ())
    assert not list((tmp_path / "cache").glob("*.damaged-*"))
    photo = read_image(tmp_path / "out" / "photo.exr")
    status, said = edofsim(*command("run", tmp_path))
    assert status == 0, said
    torch.testing.assert_close(read_image(tmp_path / "out" / "photo.exr"), photo, rtol=0, atol=0)
    assert complete(tmp_path) == before


def test_a_clock_that_was_set_back(edofsim: Run, command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Files from the future are used as any others, and not taken for old ones."""
    line = command("render", tmp_path)
    assert edofsim(*line)[0] == 0
    before = complete(tmp_path)
    ahead = time.time() + 10 * 365 * 86400
    for path in (tmp_path / "cache").iterdir():
        os.utime(path, (ahead, ahead))
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() - 86400.0)
    assert edofsim(*line)[0] == 0
    assert complete(tmp_path) == before
    for tool in (["ls"], ["verify"], ["prune", "--older-than-days", "1"]):
        status, said = edofsim("cache", *tool, "--cache", tmp_path / "cache")
        assert status == 0, said
    assert complete(tmp_path) == before
