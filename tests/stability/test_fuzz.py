"""Every reader on mutated files: read, or refused in one message; no traceback, crash, hang or waste."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fuzz_readers import READERS

SCRIPT = Path(__file__).with_name("fuzz_readers.py")


Run = Callable[[str, int, int], dict[str, object]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Has the files of a reader mutated: in a process of its own, forked off one that has all imports."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    server = subprocess.Popen([sys.executable, str(SCRIPT)], env=environment, **pipes)

    def work(reader: str, count: int, seed: int) -> dict[str, object]:
        said = tmp_path_factory.mktemp("fuzz") / "found.json"
        server.stdin.write(json.dumps([reader, count, seed, str(said)]) + "\n")
        server.stdin.flush()
        ended = server.stdout.readline().strip()
        last = Path(f"{said}.stderr").read_text().split("\n")[-5:]
        assert ended == "0", f"{reader}: ended with {ended} about mutation {last}"
        return json.loads(said.read_text())

    yield work
    server.stdin.close()
    server.wait()


@pytest.mark.parametrize("reader", READERS)
def test_mutated_files(run: Run, reader: str):
    found = run(reader, 100, 0)
    assert not found["failed"]
    assert found["refused"] > 0 and found["read"] + found["refused"] == 100


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_many_mutated_files(run: Run, reader: str):
    found = run(reader, 10_000, 1)
    print(f"{reader}: {found['read']} read, {found['refused']} refused")
    assert not found["failed"]
