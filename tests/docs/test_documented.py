"""The public functions say what each of their arguments is, on a line of its own."""

from __future__ import annotations

import importlib.util
import inspect
from pathlib import Path

import pytest

import edofsim

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("documented", ROOT / "docs" / "documented.py")
assert spec and spec.loader
documented = importlib.util.module_from_spec(spec)
spec.loader.exec_module(documented)
FUNCTIONS = [name for name in edofsim.__all__ if inspect.isfunction(getattr(edofsim, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_argument_of_the_public_functions_has_a_line(name: str):
    function = getattr(edofsim, name)
    arguments = list(inspect.signature(function).parameters)
    found = documented.Function(name, arguments, [], inspect.getdoc(function) or "")
    assert not found.missing(arrays=False)


def test_docstrings_state_shapes_and_errors(monkeypatch: pytest.MonkeyPatch):
    read = list(documented.public())  # once for both
    monkeypatch.setattr(documented, "public", lambda package: read)
    every, errors = list(documented.functions()), list(documented.raising())
    assert len(every) > 400 and len(errors) > 150
    shapeless = [each.place for each in every if each.missing(arrays=True)]
    silent = [place for place, said in errors if not said]
    assert len(shapeless) < 0.02 * len(every), "no shape: " + ", ".join(shapeless)
    assert len(silent) < 0.02 * len(errors), "no word of InputError: " + ", ".join(silent)


def test_what_is_missing_is_counted():
    said = "What it does.\n\nphoto: linear, [channel, y, x],\n    full scale 1.\ndepths, ends: in metres."
    found = documented.Function("f", ["photo", "depths", "ends", "seed"], ["photo", "depths"], said)
    assert found.missing(arrays=True) == ["depths"]
    assert found.missing(arrays=False) == ["seed"]
