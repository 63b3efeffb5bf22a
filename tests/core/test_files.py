"""Every file is complete or absent: on disks that are full, in folders that cannot be written, and when
writing is interrupted."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError
from safetensors.numpy import save_file

from edofsim.core import files
from edofsim.core.files import append_line, whole, write_bytes, write_text
from edofsim.core.images import read_exr, write_exr, write_png
from edofsim.errors import DiskFullError, EdofsimError, InputError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_in_one_step(tmp_path: Path):
    path = tmp_path / "new" / "file.txt"
    with whole(path) as temporary:
        temporary.write_text("one")
        assert temporary.parent == path.parent and temporary.suffix == ".tmp" and not path.exists()
    with whole(path) as temporary:
        temporary.write_text("two")
        assert path.read_text() == "one"
    assert path.read_text() == "two" and names(path.parent) == ["file.txt"]


@pytest.mark.parametrize(
    ("problem", "kind", "said"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), DiskFullError, "disk is full.*free some space"),
        (OSError(errno.EDQUOT, os.strerror(errno.EDQUOT)), DiskFullError, "disk is full"),
        (OSError(errno.EACCES, os.strerror(errno.EACCES)), InputError, "Permission denied.*another place"),
        (OSError(errno.EROFS, os.strerror(errno.EROFS)), InputError, "Read-only"),
        (OSError(errno.EIO, os.strerror(errno.EIO)), EdofsimError, "cannot be written"),
        (SafetensorError("I/O error"), EdofsimError, "I/O error"),
    ],
)
def test_a_write_that_fails_says_what_and_where_and_leaves_the_old_file(
    tmp_path: Path, problem: Exception, kind: type[EdofsimError], said: str
):
    path = write_text(tmp_path / "file.txt", "old")
    with pytest.raises(kind, match=f"file.txt.*{said}") as raised, whole(path) as temporary:
        temporary.write_text("half of the n")
        raise problem
    assert type(raised.value) is kind
    assert path.read_text() == "old" and names(tmp_path) == ["file.txt"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit, RuntimeError])
def test_what_interrupts_goes_on_and_leaves_nothing(tmp_path: Path, interruption: type[BaseException]):
    with pytest.raises(interruption), whole(tmp_path / "file.txt") as temporary:
        temporary.write_text("half")
        raise interruption
    assert not names(tmp_path)


def test_a_disk_that_fails_while_the_file_is_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Some file systems tell only then that there is no room."""

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DiskFullError):
        write_bytes(tmp_path / "file", b"1")
    assert not names(tmp_path)


def test_places_that_are_no_files(tmp_path: Path):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for place in ("file/below", "folder", "pipe", "x" * 300):
        with pytest.raises(InputError, match="cannot be written.*another place"):
            write_bytes(tmp_path / place, b"1")
        with pytest.raises(InputError, match="cannot be written"), whole(tmp_path / place, advice="go"):
            pass
    assert names(tmp_path) == ["file", "folder", "pipe"]


def test_a_link_goes_on_pointing_to_its_file(tmp_path: Path):
    write_text(tmp_path / "file", "old")
    (tmp_path / "link").symlink_to("file")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "file").read_text() == "new"


def test_files_have_the_permissions_that_the_user_asks_for(tmp_path: Path):
    before = os.umask(0o027)
    try:
        assert write_text(tmp_path / "file", "").stat().st_mode & 0o777 == 0o640
        with whole(tmp_path / "arrays") as temporary:
            save_file({"a": np.zeros(3)}, temporary)  # makes a file of its own, for its owner alone
        assert (tmp_path / "arrays").stat().st_mode & 0o777 == 0o640
    finally:
        os.umask(before)


@pytest.mark.parametrize("room", [0, 4096, 40 << 10, 400 << 10])
def test_a_disk_that_gets_full_holds_whole_files_only(disk, room: int):
    """Images of half a MiB on a disk with less room: the message says so, and there is no cut file."""
    noise = np.random.default_rng(0).random((3, 256, 256), np.float32)
    disk.size(room)
    for write in (
        lambda path: write_exr(path, dict(zip("RGB", noise, strict=True)), {}),
        lambda path: write_png(path, np.tile(noise, (1, 3, 3))),
        lambda path: write_bytes(path, noise.tobytes()),
    ):
        with pytest.raises(DiskFullError, match="photo.exr: cannot be written, the disk is full"):
            write(disk.folder / "photo.exr")
        assert not names(disk.folder)


def test_an_image_that_just_fits_is_whole(disk):
    """At every size of a disk near the size of the file, it is there whole, or not at all."""
    noise = {"Y": np.random.default_rng(0).random((64, 64), np.float32)}
    size = write_exr(disk.folder / "a.exr", noise, {}).stat().st_size
    (disk.folder / "a.exr").unlink()
    written = 0
    for room in range(4096, size + 5 * 4096, 4096):
        disk.size(room)
        try:
            path = write_exr(disk.folder / "a.exr", noise, {})
        except DiskFullError:
            assert not names(disk.folder)
            continue
        np.testing.assert_array_equal(read_exr(path, "image")["Y"], noise["Y"])
        path.unlink()
        written += 1
    assert written >= 2


def test_lines_are_appended_and_cut_ones_stay_alone(tmp_path: Path):
    path = tmp_path / "new" / "lines.jsonl"
    append_line(path, "one")
    append_line(path, "two")
    path.write_bytes(path.read_bytes() + b'{"cut')
    append_line(path, "three")
    assert path.read_text().splitlines() == ["one", "two", '{"cut', "three"]
    with pytest.raises(InputError, match="cannot be written"):
        append_line(path / "below", "four")


def test_two_writers_of_one_file_do_not_meet(tmp_path: Path):
    path = tmp_path / "file"
    with whole(path) as first, whole(path) as second:
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first" and names(tmp_path) == ["file"]


def test_free_room_is_found_for_folders_that_are_not_there_yet(tmp_path: Path):
    assert files._room(tmp_path / "a" / "b" / "c") > 0
