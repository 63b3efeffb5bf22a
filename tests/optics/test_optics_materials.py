"""Refractive indices against values that are published beside, not made from, the formulas."""

from __future__ import annotations

import pytest
import torch

from edofsim.errors import InputError
from edofsim.optics import MATERIALS, material


@pytest.mark.parametrize(
    ("name", "wavelength_nm", "index", "within"),
    [
        ("fused-silica", 587.6, 1.45846, 2e-5),  # Malitson (1965), table I: d line
        ("fused-silica", 486.1, 1.46313, 2e-5),  # F line
        ("fused-silica", 656.3, 1.45637, 2e-5),  # C line
        ("N-BK7", 587.56, 1.51680, 1e-5),  # SCHOTT catalogue: n_d, n_F, n_C
        ("N-BK7", 486.13, 1.52238, 1e-5),
        ("N-BK7", 656.27, 1.51432, 1e-5),
        ("N-SF11", 587.56, 1.78472, 1e-5),
        ("N-F2", 587.56, 1.62005, 1e-5),
        ("PMMA", 587.6, 1.4906, 1e-3),  # commonly tabulated n_d 1.490 to 1.492
        ("NOA61", 589.3, 1.56, 1e-3),  # Norland's data sheet: 1.56 for the cured polymer
        ("S1813", 450.0, 1.6867, 1e-4),  # data sheet's table of the bleached resist
        ("S1813", 480.0, 1.6754, 1e-4),
        ("S1813", 402.0, 1.7103, 1e-4),
        ("air", 543.0, 1.0, 0.0),
    ],
)
def test_indices_agree_with_published_tables(name, wavelength_nm, index, within):
    assert float(material(name).index(wavelength_nm * 1e-9)) == pytest.approx(index, abs=max(within, 1e-12))


def test_resist_carried_beyond_its_data_sheet_follows_measured_dispersion():
    # NIST ellipsometry of bleached S1800 (Q. Wang, 2015): n is 1.63340 at 500.0 and 1.60687 at 720.4 nm
    resist = material("S1813").index(torch.tensor([500.0e-9, 720.4e-9]).double())
    assert float(resist[0] - resist[1]) == pytest.approx(1.63340 - 1.60687, rel=0.5)


@pytest.mark.parametrize("name", [name for name in MATERIALS if name != "air"])
def test_dispersion_is_normal_over_the_visible(name):
    known = material(name)
    wavelengths = torch.linspace(max(known.shortest, 400e-9), 750e-9, 50, dtype=torch.float64)
    index = known.index(wavelengths)
    assert bool((index.diff() < 0).all())
    assert bool((index > 1.4).all()) and bool((index < 1.86).all())  # N-SF11 at 400 nm: 1.85


def test_every_material_states_its_source_and_refuses_what_it_does_not_cover():
    for known in MATERIALS.values():
        assert known.source
        for wavelength in (known.shortest * 0.99, known.longest * 1.01, float("nan")):
            with pytest.raises(InputError, match=known.name):
                known.index(wavelength)


def test_an_unknown_material_names_the_nearest():
    with pytest.raises(InputError, match="fused-silica"):
        material("fused silica")
