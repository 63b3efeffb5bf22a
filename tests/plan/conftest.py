"""Plans in tests are made at made-up rates: measuring takes seconds, and choices would differ by machine."""

from __future__ import annotations

import pytest

from edofsim.plan import rates, remember

RATES = {
    "prepare": (0.0, 1.3e-8),
    "psf": (1e-3, 5e-9, 4.8e-8, 1.8e-10, 4.9e-9),
    "blur": (4e-3, 2.5e-10, 1.5e-8),
    "sensor": (9e-3, 7e-9),
}


@pytest.fixture(autouse=True)
def known_rates(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setitem(rates._known, rates._name(), RATES)
    folder = tmp_path_factory.getbasetemp() / "plans"
    monkeypatch.setattr(remember, "_folder", lambda: folder)
