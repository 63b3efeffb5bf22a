"""Depths that stand for a range: what neighbours may differ by, whatever the camera."""

from __future__ import annotations

import itertools

import pytest
import torch

from edofsim.experiments.protocols import of_three_lines
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.optics.nodes import DIFFERENCE, node_shares, nodes_between
from edofsim.recipe import CameraRecipe, load_camera


def lens(**more: object) -> Camera:
    """An ideal lens, 35 mm f/4 at pixels of 3.45 um, in focus at 1 m."""
    recipe = {
        "name": "lens",
        "lens": {"kind": "ideal", "focal_length_mm": 35, "f_number": 4},
        "focus": {"distance_m": 1.0},
        "sensor": {"pixel_um": 3.45, "response": "lines"},
        "psf": {"window_px": 160},
        **more,
    }
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


def photos_apart(camera: Camera, first: float, last: float) -> list[float]:
    """How photos of one random picture at the last depth, and half-way to it, differ from that at the first,
    relative to its contrast: pixels, not transfer functions.

    Its spectrum falls with the square of the frequency; the picture is periodic."""
    psf = psf_bank(camera, PAPER_COLOURS, [first, (first + last) / 2, last]).values.double()
    size = psf.shape[-1]
    f = torch.fft.fftfreq(size, dtype=torch.float64)
    falls = (f[:, None].square() + f.square()).rsqrt()
    falls[0, 0] = 0
    noise = torch.randn(12, size, size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    pictures = torch.fft.ifft2(torch.fft.fft2(noise) * falls).real
    apart = torch.fft.rfft2(psf[1:] - psf[:1])
    change = torch.fft.irfft2(torch.fft.rfft2(pictures)[:, None, None] * apart, s=(size, size))
    worst = change.square().mean((0, 3, 4)).sqrt().amax(1)
    return (worst / pictures.square().mean().sqrt()).tolist()


CAMERAS = {
    "lens": lens,
    "cubic": lambda: lens(mask={"kind": "cubic", "alpha_rad": 60.0}),
    "paper": lambda: of_three_lines(Camera.from_recipe(load_camera("paper-clear").recipe)),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_photos_at_neighbouring_nodes_differ_by_less_than_the_stated_amount(name: str):
    camera = CAMERAS[name]()
    nodes = nodes_between(camera, PAPER_COLOURS, 0.0, 2.0)
    assert float(nodes[0]) == 0.0 and float(nodes[-1]) == 2.0 and bool((nodes.diff() > 0).all())
    some = list(itertools.pairwise(nodes.tolist()))[:: max(1, len(nodes) // 6)]
    apart = [each for pair in some for each in photos_apart(camera, *pair)]
    assert max(apart) < 1.1 * DIFFERENCE  # a random picture's contrast is that of its spectrum within a few %
    assert max(apart) > DIFFERENCE / 4  # and there are no more nodes than that asks for


def test_the_nodes_of_a_fast_lens_are_close_about_its_focus():
    """And each more open aperture asks for more: the blur's diameter is proportional to it."""
    camera = lens()
    nodes = nodes_between(camera, PAPER_COLOURS, 0.0, 2.5)
    closest = float(nodes[:-1][nodes.diff().argmin()])
    assert abs(closest - 1.0) < 0.1
    assert float(nodes.diff().max() / nodes.diff().min()) >= 8
    numbers = [4.0, 8.0, 16.0]
    lenses = [lens(lens={"kind": "ideal", "focal_length_mm": 35, "f_number": number}) for number in numbers]
    counts = [len(nodes_between(each, PAPER_COLOURS, 0.0, 1.5)) for each in lenses]
    assert counts == sorted(counts, reverse=True) and counts[0] > 2 * counts[-1]


def test_no_more_nodes_than_asked_for_where_they_differ_most():
    camera = lens()
    free = nodes_between(camera, PAPER_COLOURS, 0.0, 2.5)
    few = nodes_between(camera, PAPER_COLOURS, 0.0, 2.5, most=40)
    assert len(few) == 40 < len(free)
    assert set(few.tolist()) <= set(free.tolist())
    assert float(few.diff().max()) > 2 * float(few.diff().min())


def test_few_depths_are_looked_at_that_are_no_nodes(monkeypatch: pytest.MonkeyPatch):
    looked_at = 0

    def counted(camera: Camera, wavelengths: torch.Tensor, depths: torch.Tensor):
        nonlocal looked_at
        looked_at += len(depths)
        return psf_bank(camera, wavelengths, depths)

    monkeypatch.setattr("edofsim.optics.nodes.psf_bank", counted)
    nodes = nodes_between(lens(), PAPER_COLOURS, 0.0, 2.5)
    assert len(nodes) <= looked_at <= 1.2 * len(nodes)


def test_one_depth_is_its_own_node():
    nodes = nodes_between(lens(), PAPER_COLOURS, 0.7, 0.7)
    assert nodes.tolist() == [0.7] and node_shares(nodes).tolist() == [1.0]


def test_the_shares_are_those_of_evenly_drawn_depths():
    """The mean of what is linear between the nodes, by many draws."""
    nodes = torch.tensor([0.0, 0.1, 0.5, 0.6, 2.0], dtype=torch.float64)
    values = torch.tensor([3.0, -1.0, 4.0, 1.0, -5.0], dtype=torch.float64)
    drawn = torch.linspace(0, 2, 200_001, dtype=torch.float64)
    right = torch.searchsorted(nodes, drawn).clamp(1, 4)
    part = (drawn - nodes[right - 1]) / (nodes[right] - nodes[right - 1])
    mean = float((values[right - 1] + part * (values[right] - values[right - 1])).mean())
    shares = node_shares(nodes)
    assert float(shares.sum()) == pytest.approx(1, abs=1e-12)
    assert float(shares @ values) == pytest.approx(mean, abs=1e-4)


def test_gradients_of_a_mask_do_not_pass():
    height = torch.zeros(64, 64, requires_grad=True)
    camera = lens().with_height(height)
    plain = nodes_between(lens().with_height(height.detach()), PAPER_COLOURS, 0.0, 1.0)
    assert torch.equal(nodes_between(camera, PAPER_COLOURS, 0.0, 1.0), plain)
