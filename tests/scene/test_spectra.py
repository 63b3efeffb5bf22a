"""Spectra against published tables and closed forms."""

from __future__ import annotations

import colour
import numpy as np
import pytest

from edofsim.errors import InputError
from edofsim.scene import spectra

BANDS = np.linspace(420e-9, 720e-9, 31)


def test_d65_has_the_ratios_of_the_cie_table():
    """CIE 15, table of D65: 82.7549 at 400, 117.008 at 450, 100 at 560, 71.6091 at 700 nm."""
    got = spectra.illuminant("d65", np.array([400, 450, 560, 700]) * 1e-9)
    np.testing.assert_allclose(got / got[2], [0.827549, 1.17008, 1.0, 0.716091], rtol=1e-6)


@pytest.mark.parametrize("name", ["D65", "A", "FL2", "LED-B1"])
def test_an_illuminant_of_radiance_1_has_the_luminance_of_the_constant_spectrum_1(name: str):
    """Y of colour-science for the scaled spectrum and for the equal-energy one."""
    nm = np.arange(380, 781, 1.0)
    shape = colour.SpectralShape(380, 780, 1)
    values = dict(zip(nm, spectra.illuminant(name, nm * 1e-9), strict=True))
    got = colour.sd_to_XYZ(colour.SpectralDistribution(values), method="Integration")[1]
    flat = colour.sd_to_XYZ(colour.sd_ones(shape), method="Integration")[1]
    assert got == pytest.approx(flat, rel=2e-3)


def test_daylight_of_6504_k_is_d65():
    got, want = spectra.daylight(6504, BANDS), spectra.illuminant("D65", BANDS)
    np.testing.assert_allclose(got, want, rtol=5e-3)


def test_sRGB_basis_keeps_white_white_and_stays_a_reflectance():
    """Mallett and Yuksel: the three spectra sum to 1 and none is negative."""
    basis = spectra.srgb_basis(BANDS)
    np.testing.assert_allclose(basis.sum(axis=0), 1, atol=1e-12)
    assert basis.min() >= 0


@pytest.mark.parametrize("text", ["#c0392b", "#2ecc71", "#2980b9", "#f1c40f"])
def test_a_colour_in_hex_is_seen_as_that_colour_under_d65(text: str):
    nm = np.arange(380, 781, 5.0)
    values = dict(zip(nm, spectra.reflectance(text, nm * 1e-9), strict=True))
    xyz = (
        colour.sd_to_XYZ(colour.SpectralDistribution(values), illuminant=colour.SDS_ILLUMINANTS["D65"]) / 100
    )
    np.testing.assert_allclose(colour.XYZ_to_sRGB(xyz), colour.notation.HEX_to_RGB(text), atol=0.01)


def test_color_checker_patches_are_the_measured_ones():
    """Lab of the patches under D65 within CIEDE2000 0.2 of the same spectra in colour-science."""
    nm = np.arange(380, 781, 5.0)
    source = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    d65 = colour.SDS_ILLUMINANTS["D65"]
    patches = spectra.color_checker(nm * 1e-9)
    assert list(patches) == list(source) and len(patches) == 24
    for name, values in patches.items():
        mine = colour.SpectralDistribution(dict(zip(nm, values, strict=True)))
        labs = [colour.XYZ_to_Lab(colour.sd_to_XYZ(sd, illuminant=d65) / 100) for sd in (mine, source[name])]
        assert colour.delta_E(*labs, method="CIE 2000") < 0.2, name


def test_gold_and_aluminium_reflect_as_metals_do():
    """Gold turns from absorbing blue to reflecting red near 500 nm (its interband edge at 2.4 eV);
    aluminium is flat near 0.91 (Rakic, Appl. Opt. 34, 4755, 1995)."""
    gold = spectra.metal("gold", np.array([450, 650]) * 1e-9)
    assert gold[0] < 0.5 and gold[1] > 0.9
    np.testing.assert_allclose(spectra.metal("aluminium", BANDS), 0.915, atol=0.02)


def test_reflectances_go_on_as_constants_only_a_little_beyond_their_data():
    end, beyond = spectra.reflectance("orange", np.array([780e-9, 830e-9]))
    assert end == beyond
    with pytest.raises(InputError, match="380 to 780 nm"):
        spectra.reflectance("orange", np.array([900e-9]))


def test_illuminants_are_never_continued_beyond_their_data():
    with pytest.raises(InputError, match="illuminant 'LED-B1'"):
        spectra.illuminant("LED-B1", np.array([800e-9]))


@pytest.mark.parametrize(
    ("call", "wrong", "near"),
    [
        (spectra.reflectance, "orang", "'orange'"),
        (spectra.illuminant, "D66", "'D65'"),
        (spectra.metal, "aluminum", "'aluminium'"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest_known_one(call, wrong: str, near: str):
    with pytest.raises(InputError) as caught:
        call(wrong, BANDS)
    assert wrong in str(caught.value) and near in str(caught.value)


def test_a_colour_that_is_none_is_refused():
    with pytest.raises(InputError, match="#rrggbb"):
        spectra.reflectance("#12345", BANDS)
