"""One thread an operation: tests take small tensors, whose threads would only wait for each other."""

from __future__ import annotations

import pytest
import torch

THREADS = torch.get_num_threads()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before all fixtures, those of modules too. Slow tests measure seconds and memory as they are for
    users."""
    torch.set_num_threads(THREADS if item.get_closest_marker("slow") else 1)
