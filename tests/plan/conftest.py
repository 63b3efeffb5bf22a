"""Plans in tests are made at made-up rates: measuring takes seconds, and choices would differ by machine."""

from __future__ import annotations

import pytest

from edofsim.plan import rates, remember

RATES = {
    "prepare": (1e-3, 2e-9, 1e-8, 3e-8, 1e-8, 1e-4),
    "psf": (2e-3, 9e-5, 1e-8, 7e-8, 1e-8, 1e-8, 3e-10, 1.5e-8, 1e-9),
    "blur": (1e-3, 1e-4, 1e-4, 3e-10, 3e-9, 8e-9, 4e-8, 5e-8),
    "sub_apertures": (2e-3, 4e-10, 2e-9, 4e-10, 4e-9),
    "sensor": (1e-3, 2e-8, 1e-8, 2e-9, 1e-8),
    "pace": (1e-3, 3e-3, 1e-3, 1e-3, 1e-3),
}


@pytest.fixture(autouse=True)
def known_rates(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setitem(rates._known, rates._name(), RATES)
    folder = tmp_path_factory.getbasetemp() / "plans"
    monkeypatch.setattr(remember, "_folder", lambda: folder)
