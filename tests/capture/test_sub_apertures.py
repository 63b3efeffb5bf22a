"""Slabs are blurred in the part of the frame that their blur reaches, for each sub-aperture."""

from __future__ import annotations

import pytest
import torch

import edofsim
from edofsim.capture.convolution import Grid
from edofsim.capture.fidelity import SUB_APERTURE_STEP_PX, Fidelity, of_sub_apertures
from edofsim.capture.light import Light
from edofsim.capture.occlusion import sub_apertures
from edofsim.capture.occlusion.hidden import merged
from edofsim.capture.occlusion.sub_apertures import Slabs
from edofsim.capture.prepare import blur_per_dioptre

GRID = Grid(50, 60, 12, 16)
FRAME = 26, 36


def _light(y: int, x: int) -> Light:
    """One fragment of light and what it covers."""
    return Light(50, 60, torch.tensor([60 * y + x]), torch.zeros(1), torch.tensor([[2.0], [1.0]]), (0, 1))


@pytest.mark.parametrize("frame", [FRAME, None])
@pytest.mark.parametrize("y, x", [(0, 0), (3, 40), (20, 30), (49, 59), (13, 58), (4, 30)])
def test_a_slab_is_blurred_as_in_the_whole_frame(
    y: int, x: int, frame: tuple[int, int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blur of one pixel is a copy of the PSF there, cut at the frame; a blur may reach none of it."""
    psf = torch.rand(1, 16, 16, generator=torch.Generator().manual_seed(0))
    top, left, rows, columns = (12, 12, *FRAME) if frame else (0, 0, 50, 60)
    expected = torch.zeros(50 + 32, 60 + 32)
    expected[y + 8 : y + 24, x + 8 : x + 24] = psf[0]
    expected = expected[16 + top : 16 + top + rows, 16 + left : 16 + left + columns]

    def blurred() -> torch.Tensor:
        slab = Slabs.of([_light(y, x)], GRID, frame)
        return slab.place.image(slab.spectra[0][1][0] * torch.fft.rfft2(psf, s=slab.place.grid.transform))

    found = blurred()
    assert found.shape == (2, rows, columns)
    assert torch.allclose(found, torch.stack([2 * expected, expected]), atol=1e-6)
    monkeypatch.setattr(sub_apertures, "box_of", lambda light, window: None)
    if frame:  # in the whole frame light wraps into the margin
        assert torch.allclose(blurred(), found, atol=1e-6)


def test_small_slabs_take_small_transforms() -> None:
    assert Slabs.of([_light(20, 30)], GRID, FRAME).place.grid.transform < GRID.transform


def test_where_a_sub_aperture_sees_next_to_nothing_it_sees_what_the_pupil_does() -> None:
    """A hole behind the nearest slab: PSFs that fall below 0 leave light of either sign there, and next to no
    coverage. Where all is covered, what the pupil sees does not matter."""
    ringing, hole = torch.tensor([-0.003, 0.002, 0.03]), torch.tensor([0.002, -0.001, 1.0])
    nearest = torch.zeros(3), torch.tensor([0.0, 0.5, 0.25])
    slabs = [(each[0][None, None], each[1][None, None]) for each in ((ringing, hole), nearest)]
    behind = torch.full((1, 1, 3), 0.02)
    image, past = merged(slabs, 2, behind)
    assert image.flatten().tolist() == pytest.approx([0.02, 0.01, 0.0225], abs=0.007)
    assert past.flatten()[2] == pytest.approx(0.03)
    assert float(merged(slabs, 2)[0].min()) < -1  # light from around, of the whole pupil alone


def test_a_fast_lens_has_as_many_nodes_as_its_blur_asks_for():
    """Nine and thirteen for the paper's camera; no step of more than eight pixels of blur, up to a limit."""
    fine, coarse = Fidelity(sub_apertures=6), Fidelity(sub_apertures=6, sub_aperture_pixel=2)
    paper, widest = edofsim.camera("paper-clear"), edofsim.camera("lens-50mm-f2")
    fast = edofsim.camera(focal_length=35e-3, f_number=4, pixel=3.45e-6, focus=1.0)
    assert [of_sub_apertures(each, paper, 2.0).layers for each in (fine, coarse)] == [13, 9]
    layers = of_sub_apertures(fine, fast, 1.9).layers
    assert layers == of_sub_apertures(coarse, fast, 1.9).layers > 13
    blur = 1.9 * blur_per_dioptre(fast)
    assert blur / (layers - 1) <= SUB_APERTURE_STEP_PX < blur / (layers - 2)
    assert of_sub_apertures(fine, widest, 2.0).layers == 25
    assert of_sub_apertures(fine.changed({"layers": 5}), fast, 1.9).layers == 5


def test_a_mask_that_is_wrapped_as_it_is_made_is_told_two_wavelengths_in_coarse_pixels():
    coarse = Fidelity(sub_apertures=6, sub_aperture_pixel=2)
    device = edofsim.camera("paper-device")
    assert of_sub_apertures(coarse, device, 2.0).group_wavelengths == 2
    assert of_sub_apertures(coarse.changed({"fabrication": False}), device, 2.0).group_wavelengths == 1
    assert of_sub_apertures(coarse, edofsim.camera("paper-cubic"), 2.0).group_wavelengths == 1
