"""Wrong numbers in every field of every recipe, and wrong files for every reader: each ends in a result or in
one readable message, in a minute and in little memory. See `sweep.py`, which can make any try again."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest

SWEEP = Path(__file__).with_name("sweep.py")
AT_A_TIME = 200
"""Tries of one process: the engine's memory grows with every scene."""
SILENCE = 240.0
"""Seconds without a word after which a try hangs, on a busy machine too."""


def sweep(folder: Path, first: int, last: int) -> list[tuple[int, str, str]]:
    """(number, name, how it ended) of tries. A process that dies or hangs is followed by another."""
    done: list[tuple[int, str, str]] = []
    while first < last:
        until = min(last, first + AT_A_TIME)
        command = [sys.executable, str(SWEEP), str(folder), str(first), str(until)]
        worker = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=_collect, args=(worker, lines), daemon=True).start()
        name, how = "before the first try", ""
        while first < until:
            try:
                line = lines.get(timeout=SILENCE)
                ending = "" if line else f"the process ended with {worker.wait()}"
            except queue.Empty:
                line, ending = None, f"no end within {SILENCE:g} s"
            if line:
                first, name, how = json.loads(line)
            if how or ending:
                done.append((first, name, how or ending))
                first, how = first + 1, ""
            if ending:
                break
        worker.kill()
        worker.wait()
    return done


def _collect(worker: subprocess.Popen[str], lines: queue.Queue[str | None]) -> None:
    assert worker.stdout is not None
    for line in worker.stdout:
        if line.startswith("["):  # whatever else libraries print
            lines.put(line)
    lines.put(None)


@pytest.mark.slow
def test_whatever_is_given_ends_in_a_result_or_one_message(tmp_path: Path):
    sys.path.insert(0, str(SWEEP.parent))
    import sweep as tries

    tries.good_files(tmp_path)
    count = len(tries.tries(tmp_path))
    assert count >= 1900
    done = sweep(tmp_path, 0, count)
    failures = [f"{number} {name}: {how}" for number, name, how in done if how not in ("made", "refused")]
    print(len(done), "tries:", Counter(how if how in ("made", "refused") else "failed" for _, _, how in done))
    assert len(done) == count
    assert not failures, "\n".join(failures)
