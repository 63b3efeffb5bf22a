"""Memory that cannot be had ends in one message with the size and what bounds it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from edofsim import console


def in_numpy() -> None:
    np.empty(1 << 50, np.uint8)


def in_torch() -> None:
    torch.empty(1 << 50, dtype=torch.uint8)


def in_drjit() -> None:
    raise RuntimeError(
        "jit_malloc(): out of memory! Could not allocate 1125899906842624 bytes of host memory."
    )


def on_cuda() -> None:
    raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 1048576.00 GiB. GPU 0 has ...")


@pytest.mark.parametrize("work, size", [(in_numpy, "1.00 PiB"), (in_torch, "1.05e+06 GiB")])
def test_what_an_allocation_says(work, size: str, capfd: pytest.CaptureFixture[str]):
    with pytest.raises((MemoryError, RuntimeError)) as caught:
        work()
    assert console.refused_memory(caught.value) is not None
    assert console.exit_status(work) == console.FAILED
    said = capfd.readouterr().err
    assert said.count("\n") == 1 and "out of memory: " + size in said and "window_px" in said


@pytest.mark.parametrize("work, size", [(in_drjit, "1.05e+06 GiB"), (on_cuda, "1048576.00 GiB")])
def test_other_engines_words_for_it(work, size: str):
    with pytest.raises(RuntimeError) as caught:
        work()
    assert console.refused_memory(caught.value) == size


def test_other_errors_are_not_taken_for_it():
    def broken() -> None:
        raise RuntimeError("shapes do not match")

    with pytest.raises(RuntimeError):
        console.exit_status(broken)
