"""Bands that are gathered in groups, and the wavelengths that stand for these."""

from __future__ import annotations

import torch

from edofsim.capture.band_groups import gathered

BANDS = torch.linspace(420e-9, 720e-9, 31, dtype=torch.float64)
RESPONSE = torch.rand(3, 31, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
FLAT, PLACE = torch.ones(31, dtype=torch.float64), torch.arange(31, dtype=torch.float64)


def test_groups_of_every_wavelength_have_just_those_of_the_bands():
    """To the last bit: PSFs that are known of them are not computed anew."""
    assert torch.equal(gathered(BANDS, RESPONSE, FLAT, PLACE, 2, 0).wavelengths, BANDS)


def test_few_wavelengths_weigh_polynomials_as_all_do():
    """Gauss's rule of n points integrates polynomials up to the degree 2 n - 1."""
    few = gathered(BANDS, RESPONSE, FLAT, PLACE, 1, 2)
    assert len(few.wavelengths) == 6
    for degree in range(4):
        all_bands = (few.light * ((BANDS - 5.7e-7) / 1e-7) ** degree).sum(1)
        of_few = few.psfs @ ((few.wavelengths - 5.7e-7) / 1e-7) ** degree
        assert torch.allclose(of_few, all_bands, atol=1e-7)
