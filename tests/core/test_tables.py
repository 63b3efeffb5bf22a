"""Tables out of colour-science: the same numbers from the user's folder, without the package."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from edofsim.core import tables
from edofsim.errors import InputError
from edofsim.optics.sensor import COLOUR_SCIENCE, _from_colour_science
from edofsim.scene import spectra


def spectra_of_all_kinds() -> bytes:
    nm = np.linspace(420e-9, 720e-9, 31)
    patches = spectra.color_checker(nm)
    found = [*patches.values(), spectra.srgb_basis(nm), spectra.srgb_weights(nm), spectra.illuminant("A", nm)]
    found += [spectra.daylight(5500, nm), spectra.reflectance("Black 2", nm)]
    found += [array for title in COLOUR_SCIENCE.values() for array in _from_colour_science(title)]
    return repr(list(patches)).encode() + b"".join(array.tobytes() for array in found)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tables, "user_folder", lambda: tmp_path)
    tables.forget()
    yield tmp_path / "tables"
    tables.forget()


def test_kept_spectra_are_the_same_bytes_and_need_no_import(folder: Path, monkeypatch: pytest.MonkeyPatch):
    made = spectra_of_all_kinds()
    tables.forget()
    for name in [name for name in sys.modules if name.partition(".")[0] == "colour"]:
        monkeypatch.setitem(sys.modules, name, None)  # importing it raises
    assert len(made) > 5_000 and spectra_of_all_kinds() == made


def test_numbers_come_back_in_their_order_to_the_last_bit(folder: Path):
    made = {"z": np.random.default_rng(1).normal(size=(2, 5)), "a / b": [[np.pi, 1e-300]]}
    tables.kept_tables("some", lambda: made)
    tables.forget()
    again = tables.kept_tables("some", lambda: pytest.fail("made twice"))
    assert list(again) == ["z", "a / b"]
    np.testing.assert_array_equal(again["z"], made["z"])
    np.testing.assert_array_equal(again["a / b"], made["a / b"])


@pytest.mark.parametrize("damage", ["", "{", "[1, 2]", '{"": [[1, 2], [3]]}', '{"": "x"}'])
def test_a_damaged_file_is_made_again(folder: Path, damage: str):
    made = spectra.illuminant("D65", np.array([500e-9]))
    (path,) = (path for path in folder.iterdir() if "d65" in path.name)
    path.write_text(damage)
    tables.forget()
    np.testing.assert_array_equal(spectra.illuminant("D65", np.array([500e-9])), made)
    assert json.loads(path.read_text())


def test_another_version_of_colour_science_is_asked_anew(folder: Path, monkeypatch: pytest.MonkeyPatch):
    tables.kept_tables("some", lambda: {"": [[1.0]]})
    monkeypatch.setattr(tables, "version", lambda package: "99")
    assert tables.kept_tables("some", lambda: {"": [[2.0]]})[""] == 2


def test_a_name_that_is_not_known_is_refused_each_time_and_not_kept(folder: Path):
    for _ in range(2):
        with pytest.raises(InputError, match="D65"):
            spectra.illuminant("D66", np.array([500e-9]))
    assert not [path for path in folder.glob("*") if "d66" in path.name]
