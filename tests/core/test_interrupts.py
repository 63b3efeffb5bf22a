"""Ctrl-C that comes while a library is imported, or between two words on progress."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from edofsim.core.interrupts import interruptible

DEAF = """
import os, signal
try:  # as libraries in C do it
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        str()
except KeyboardInterrupt:
    pass
whole = True
"""


@pytest.mark.parametrize(
    ("first", "ends"), [("interrupt_after_imports()", "whole True"), ("", "never interrupted")]
)
def test_an_interrupt_within_an_import_is_taken_when_it_is_done(first: str, ends: str, tmp_path: Path):
    (tmp_path / "deaf.py").write_text(DEAF)
    code = (
        "import time; from edofsim.core.interrupts import interrupt_after_imports\n"
        f"{first}\n"
        "try:\n"
        "    import deaf\n"
        "    time.sleep(1)\n"
        "    print('never interrupted')\n"
        "except KeyboardInterrupt:\n"
        "    print('whole', deaf.whole)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert done.stdout.strip() == ends, done.stderr


@pytest.mark.parametrize(
    ("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_interrupts_are_taken_where_progress_is_told_or_at_the_end(number: int, raised: type[BaseException]):
    before = signal.getsignal(number)
    reported: list[float] = []
    for at in (0.5, None):
        whole = False
        with pytest.raises(raised), interruptible(lambda done, text: reported.append(done)) as say:
            os.kill(os.getpid(), number)
            whole = True
            if at is not None:
                say(at, "half")
                reported.append(1.0)
        assert whole and signal.getsignal(number) == before
    assert reported == [0.5]


def test_a_second_interrupt_does_not_wait():
    whole = False
    with pytest.raises(KeyboardInterrupt), interruptible(lambda done, text: None):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        whole = True
    assert not whole
