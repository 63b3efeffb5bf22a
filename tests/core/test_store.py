"""What is kept: found again by its key; damage counts as absence; what cannot be kept is a warning."""

from __future__ import annotations

import logging
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from edofsim.core.store import Store, found, keep


def texts(**more) -> Store[str]:
    """Texts whose files begin with `whole `."""

    def read(path: Path) -> str:
        before, _, text = path.read_text().partition(" ")
        if before != "whole":
            raise ValueError("damaged")
        return text

    return Store("text-{}.txt", read, lambda text, path: path.write_text(f"whole {text}"), **more)


def test_values_are_found_in_the_folder_by_another_process(tmp_path: Path):
    texts().keep("a", "alpha", tmp_path / "new")
    assert texts().find("a", tmp_path / "new") == "alpha"
    assert texts().find("b", tmp_path / "new") is None and texts().find("a", None) is None
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["text-a.txt"]


def test_memory_needs_no_folder_and_can_be_forgotten():
    store = texts(size=len, memory_bytes=100)
    value = "".join(["al", "pha"])
    store.keep("a", value, None)
    assert store.find("a", None) is value
    store.forget()
    assert store.find("a", None) is None


def test_memory_is_bounded_and_what_was_used_last_stays(tmp_path: Path):
    store = texts(size=len, memory_bytes=10)
    store.keep("a", "aaaa", None)
    store.keep("b", "bbbb", None)
    assert store.find("a", None)
    store.keep("c", "cccc", None)
    assert store.find("b", None) is None and store.find("a", None) and store.find("c", None)
    store.keep("long", "x" * 11, tmp_path)
    assert store.find("long", None) is None and store.find("long", tmp_path) == "x" * 11


def test_damaged_files_count_as_none_and_are_written_anew(tmp_path: Path):
    store = texts()
    for damage in (b"", b"whol", b"\xff\xfe"):
        (tmp_path / "text-a.txt").write_bytes(damage)
        assert store.find("a", tmp_path) is None
    store.keep("a", "again", tmp_path)
    assert store.find("a", tmp_path) == "again"


def test_a_folder_that_cannot_be_written_is_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    (tmp_path / "file").touch()
    store = texts(size=len, memory_bytes=10, most_files=3)
    with caplog.at_level(logging.WARNING):
        store.keep("a", "alpha", tmp_path / "file")
    assert "not kept for next time" in caplog.text and "text-a.txt" in caplog.text
    assert store.find("a", tmp_path / "file") == "alpha"


def test_of_many_files_those_used_longest_ago_go(tmp_path: Path):
    store = texts(most_files=2)
    for age, key in ((300, "a"), (200, "b")):
        store.keep(key, key, tmp_path)
        os.utime(tmp_path / f"text-{key}.txt", (1e9 - age, 1e9 - age))
    assert store.find("a", tmp_path) == "a"  # used now
    store.keep("c", "c", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["text-a.txt", "text-c.txt"]


def test_one_file_alone(tmp_path: Path):
    path = tmp_path / "one"
    assert found(path, Path.read_text) is None
    keep(path, lambda at: at.write_text("1"))
    assert found(path, Path.read_text) == "1"
    assert found(path, lambda at: int(at.read_text()[1])) is None


def test_several_threads_keep_values_at_once():
    store, before = texts(size=len, memory_bytes=300), sys.getswitchinterval()

    def kept(number: int) -> None:
        for k in range(3000):
            store.keep(f"{number} {k % 400}", "x", None)
            store.find(f"{1 - number} {k % 400}", None)

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(kept, range(2)))
    finally:
        sys.setswitchinterval(before)
