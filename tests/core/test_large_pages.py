"""The command lets PyTorch hold large tensors in large pages."""

from __future__ import annotations

import subprocess
import sys

import pytest

from edofsim import __main__ as command

FAULTS = """
import os, resource
{}
import torch
few = torch.ones(2**20)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
large = torch.ones(2**25)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before, os.environ.get("THP_MEM_ALLOC_ENABLE"))
"""
ASK = "from edofsim.__main__ import ask_for_large_pages; ask_for_large_pages()"
SMALL_PAGES = 2**25 * 4 // 4096


def faults(before_torch: str) -> tuple[int, str]:
    """Page faults of a tensor of 128 MiB, and the variable of the environment."""
    ran = [sys.executable, "-c", FAULTS.format(before_torch)]
    done = subprocess.run(ran, capture_output=True, text=True, check=True)
    assert not done.stderr
    count, asked = done.stdout.split()
    return int(count), asked


@pytest.mark.skipif(
    not command.LARGE_PAGES.exists() or "[never]" in command.LARGE_PAGES.read_text(),
    reason="this system has no large pages",
)
def test_large_tensors_lie_in_large_pages_where_the_user_does_not_say_otherwise():
    assert faults(ASK)[0] < SMALL_PAGES / 2
    assert faults(f"os.environ['THP_MEM_ALLOC_ENABLE'] = '0'; {ASK}")[1] == "0"


def test_a_system_without_large_pages_is_not_asked_for_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(command, "LARGE_PAGES", command.LARGE_PAGES / "absent")
    monkeypatch.delenv("THP_MEM_ALLOC_ENABLE", raising=False)
    command.ask_for_large_pages()
    assert "THP_MEM_ALLOC_ENABLE" not in command.os.environ
