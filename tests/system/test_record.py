"""What records say of the process."""

from __future__ import annotations

import subprocess
import sys

CHILD = "from edofsim.record import peak_memory_mib; print(peak_memory_mib())"
PARENT = f"""
import subprocess, sys
import numpy
held = numpy.ones(100_000_000)  # 763 MiB
print(subprocess.run([sys.executable, "-c", {CHILD!r}], capture_output=True, text=True).stdout)
"""


def test_peak_memory_is_that_of_the_process_alone():
    """Not of the one that started it, which the kernel counts in a child's largest resident size."""
    alone, child = (
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout)
        for code in (CHILD, PARENT)
    )
    assert 5 < alone < 500
    assert abs(child - alone) < 50
