"""Plans in tests are made at made-up rates: measuring takes seconds, and choices would differ by machine."""

from __future__ import annotations

import pytest

from edofsim.plan import rates, remember

RATES = {
    "prepare": {"calls": 1e-3, "moves": 3e-8, "elements": 1e-8},
    "psf": {"calls": 9e-5, "elements": 2e-8, "products": 3e-10},
    "blur": {"calls": 1e-4, "transforms": 3e-10, "elements": 3e-9, "moves": 4e-8},
    "sub_apertures": {"calls": 2e-3, "products": 4e-10, "elements": 4e-9},
    "sensor": {"elements": 2e-8},
    "pace": {"calls": 1e-3, "products": 3e-3, "transforms": 1e-3, "elements": 1e-3, "moves": 1e-3},
}


@pytest.fixture(autouse=True)
def known_rates(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setitem(rates._known, rates._name(), RATES)
    folder = tmp_path_factory.getbasetemp() / "plans"
    monkeypatch.setattr(remember, "_folder", lambda: folder)
