"""Every reader on mutated files: read, or refused in one message; no traceback, crash, hang or waste."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz_readers import READERS

SCRIPT = Path(__file__).with_name("fuzz_readers.py")


def run(reader: str, count: int, seed: int) -> dict[str, object]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, str(SCRIPT), reader, str(count), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=7200, check=False)
    last = done.stderr.split("\n")[-5:]
    assert done.returncode == 0, f"{reader}: ended with {done.returncode} about mutation {last}"
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("reader", READERS)
def test_mutated_files(reader):
    found = run(reader, 100, 0)
    assert not found["failed"]
    assert found["refused"] > 0 and found["read"] + found["refused"] == 100


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_many_mutated_files(reader):
    found = run(reader, 10_000, 1)
    print(f"{reader}: {found['read']} read, {found['refused']} refused")
    assert not found["failed"]
