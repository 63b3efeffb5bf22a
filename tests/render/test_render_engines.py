"""Which engines are tried, and how often."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from edofsim.render import engine


def test_two_threads_that_ask_at_once_try_an_engine_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second waits, and takes what the first found, even where nothing can be remembered on disk."""
    tried: list[str] = []

    def slowly(variant: str, library: str) -> engine.Tried:
        tried.append(library)
        time.sleep(0.2)
        return {"works": True, "version": "19.1", "reason": ""}

    monkeypatch.setattr(engine, "_tried", {})
    monkeypatch.setattr(engine, "_try_engine", slowly)
    monkeypatch.setattr(engine, "_memory_file", lambda: tmp_path / "no-such-folder" / "x" / "engines.json")
    monkeypatch.setattr(engine, "_save_memory", lambda memory: None)
    monkeypatch.setattr(engine, "cuda_driver", lambda: None)
    monkeypatch.setattr(engine, "llvm_libraries", lambda: [tmp_path / "libLLVM-19.so"])
    other = threading.Thread(target=engine.find_engines)
    other.start()
    time.sleep(0.05)
    found = engine.find_engines()
    other.join()
    assert len(tried) == 1
    assert [probe.works for probe in found] == [True]
    engine.find_engines(again=True)
    assert len(tried) == 2
