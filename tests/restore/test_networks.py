"""The networks' shape and size, and that tiles do not show."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import pad

from edofsim.errors import InputError
from edofsim.optics import psf_bank
from edofsim.recipe.load import shipped_folder
from edofsim.restore import filter_bank
from edofsim.restore.blur_likelihood import BLOCK, STEP
from edofsim.restore.borders import continued
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, save_checkpoint, trained_camera
from edofsim.restore.filter_bank import BEYOND, compressed
from edofsim.restore.network import NETWORKS, apply_network, build_network, weights_of
from edofsim.restore.photograph_statistics import power_spectrum

SETTINGS = {"own": {"of": "torch.nn.modules.linear:Identity"}}
"""Of kinds that are not built without."""


def _random_network(kind: str) -> torch.nn.Module:
    """A network with no zero weights, so that every path in it matters."""
    torch.manual_seed(3)
    network = build_network(kind, SETTINGS.get(kind))
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape, generator=generator))
    return network.eval()


def test_dcnn_has_as_many_weights_as_the_paper_describes() -> None:
    """Counted from Akpinar et al.: blocks of 3x3 convolution with bias and batch normalisation, the
    convolution to 3 channels, two transposed 3 -> 3 convolutions."""
    blocks = (3 * 32 * 9 + 32 + 2 * 32) + 4 * (32 * 32 * 9 + 32 + 2 * 32)
    assert blocks + (32 * 3 * 9 + 3) + 2 * (3 * 3 * 9 + 3) == 39243
    assert weights_of(build_network("dcnn")) == 39243


def test_folded_normalisations_of_the_dcnn_change_nothing() -> None:
    """In use the D-CNN folds them into its convolutions; layer by layer, in float64, it is the same."""
    network = _random_network("dcnn").double()
    generator = torch.Generator().manual_seed(5)
    for name, statistics in network.named_buffers():
        if "running" in name:
            statistics.copy_(0.5 + torch.rand(statistics.shape, generator=generator))
    photo = torch.rand(1, 3, 20, 24, generator=generator, dtype=torch.float64)
    padded = continued(photo, network.radius)
    expected = network.refine(padded + network.residual(padded))
    reach = network.radius
    torch.testing.assert_close(network.unclamped(photo), expected[..., reach:-reach, reach:-reach])


def test_channels_that_hardly_vary_are_left_out_in_use_alone() -> None:
    """Of 32 kernels 20 are all but still, some above the bend of the leak, some at it: 16 are left out where
    no gradient is asked for, and what they give in the mean is not. None is where gradients are."""
    network = _random_network("dcnn").double()
    generator = torch.Generator().manual_seed(8)
    for layer in (network.residual[1], network.residual[7]):
        layer.weight.data[torch.randperm(32, generator=generator)[:20]] = 2e-5
        layer.bias.data = torch.randn(32, generator=generator, dtype=torch.float64)
        layer.bias.data[:8] = 0
    photo = torch.rand(1, 3, 20, 24, generator=generator, dtype=torch.float64)
    whole = network.unclamped(photo).detach()
    with torch.no_grad():
        assert [len(weight) for weight, _ in network._folded()] == [16, 32, 16, 32, 32, 3]
        torch.testing.assert_close(network.unclamped(photo), whole, rtol=0, atol=1e-4)
        network.residual[1].bias.data += 1  # what is left out still counts
        assert float((network.unclamped(photo) - whole).abs().max()) > 1e-3
    assert [len(weight) for weight, _ in network._folded()] == [32] * 5 + [3]


def test_checkpoints_that_ship_are_small() -> None:
    found = list((shipped_folder("train") / "checkpoints").rglob("*.safetensors"))
    assert len(found) > 5 and max(path.stat().st_size for path in found) < 4_000_000
    assert 4 * weights_of(build_network("local-unet")) < 2_000_000


@pytest.mark.parametrize("size", [(21, 34), (filter_bank.TILE + 9, 2 * filter_bank.TILE)])
def test_a_bank_of_filters_is_a_convolution_that_continues_the_border(size: tuple[int, int]) -> None:
    """Also where the photo takes several transforms, which overlap by the filters' support less a pixel."""
    bank = build_network("filter-bank", {"groups": 3, "support": 7})
    bank.filters.copy_(torch.randn(bank.filters.shape, generator=torch.Generator().manual_seed(6)))
    photo = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(7))
    padded = torch.nn.functional.pad(photo, (3, 3, 3, 3), mode="replicate")
    expected = torch.nn.functional.conv2d(padded, bank.filters)
    torch.testing.assert_close(bank.filtered(photo).flatten(1, 2), expected, rtol=1e-5, atol=1e-5)


def test_a_lamp_hides_no_distances_from_a_bank() -> None:
    """What is likely beside a lamp does not depend on how far beyond full scale it is."""
    bank = _random_network("filter-bank")
    bank.set_filters(
        torch.zeros(16, 3, 3, 27, 27), torch.rand(32, 3, 9, 9, generator=torch.Generator().manual_seed(1))
    )
    photo = torch.rand(1, 3, 96, 96, generator=torch.Generator().manual_seed(2))
    photo[..., 48, 48] = 1.0
    brighter = photo.clone()
    brighter[..., 48, 48] = 60.0
    torch.testing.assert_close(bank.weights(brighter), bank.weights(photo), rtol=0, atol=0)


def test_a_bank_takes_values_beyond_full_scale_by_their_logarithm() -> None:
    within = torch.linspace(-BEYOND, 1 + BEYOND, 101)
    torch.testing.assert_close(compressed(within), within, rtol=0, atol=0)
    wide = torch.linspace(-50, 50, 20_001)
    steps = compressed(wide).diff() / wide.diff()
    assert bool((steps > 0).all())
    assert float(steps.max()) < 1 + 1e-3  # no jump where the logarithm begins
    assert float(compressed(torch.tensor(60.0))) < 6


_kept_network = functools.cache(_random_network)
"""For tests that leave it as it is: to make one takes longer than to use it."""


@pytest.mark.parametrize("kind", NETWORKS)
@settings(max_examples=8, deadline=None)
@given(rows=st.integers(1, 40), columns=st.integers(1, 40))
def test_any_size_in_same_size_out(kind: str, rows: int, columns: int) -> None:
    photo = torch.rand(1, 3, rows, columns, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        restored = _kept_network(kind)(photo)
    assert restored.shape == photo.shape
    assert restored.min() >= 0 and restored.max() <= 1


@pytest.mark.parametrize("kind", NETWORKS)
def test_an_untrained_network_returns_its_photo(kind: str) -> None:
    """Networks add a residual to the photo; the U-Net's starts at zero, the D-CNN's is small. The filter
    starts without a blur to remove and smooths a little, for its noise."""
    photo = torch.rand(3, 32, 32, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        restored = build_network(kind, SETTINGS.get(kind)).eval()(photo[None])[0]
    most = {
        "dcnn": 0.15,
        "local-unet": 1e-6,
        "filter-bank": 1e-6,
        "camera-bank": 1e-6,
        "wiener": 0.05,
        "own": 0,
    }
    assert (restored - photo).abs().mean() <= most[kind]


@pytest.mark.parametrize("kind", ["dcnn", "local-unet", "filter-bank", "camera-bank"])
def test_a_pixel_sees_no_further_than_the_radius(kind: str) -> None:
    """The gradient of one output pixel is zero outside the radius, and not zero near it (D-CNN: at it)."""
    network = _random_network(kind)
    with torch.no_grad():  # a smaller residual keeps the sum away from the clamp
        (network.residual[-1] if kind == "dcnn" else network.trunk.last).weight.mul_(0.05)
    # filters that are told apart, so that the choice among them matters
    if kind.endswith("-bank"):
        network.filters.mul_(torch.linspace(0.9, 1.1, len(network.filters))[:, None, None, None])
    size = 2 * network.radius + 2 * network.multiple + 9
    photo = torch.full((1, 3, size, size), 0.5, requires_grad=True)
    centre = size // 2
    network(photo)[0, 1, centre, centre].backward()
    gradient = photo.grad[0].abs().sum(0)
    # Fourier transforms leave rounding everywhere
    least = 1e-5 * gradient.max() if kind.endswith("-bank") else 0.0
    seen = (gradient > least).nonzero() - centre
    assert seen.abs().max() <= network.radius
    if kind == "dcnn":
        assert seen.abs().max() == network.radius


@pytest.mark.parametrize("kind", NETWORKS)
def test_tiles_give_the_whole_photo(kind: str) -> None:
    network = _random_network(kind)
    # as long as some tiles do not see all of it
    for rows, columns in [(150, 197)] if kind in ("dcnn", "local-unet") else [(24, 197), (197, 24)]:
        photo = torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(4))
        whole = apply_network(network, photo, tile=256)
        tiled = apply_network(network, photo, tile=64)
        # Fourier transforms of other sizes round otherwise, and these weights magnify it
        assert torch.allclose(tiled, whole, atol=1e-5 if kind == "filter-bank" else 1e-6)


def test_the_untrained_shape_is_checked_before_the_work() -> None:
    network = build_network("dcnn")
    with pytest.raises(InputError, match=r"3 channels"):
        apply_network(network, torch.rand(1, 16, 16))
    with pytest.raises(InputError, match="finite"):
        apply_network(network, torch.full((3, 16, 16), torch.nan))
    with pytest.raises(InputError, match="local-unet"):
        build_network("unet")
    with pytest.raises(InputError, match="cannot be built"):
        build_network("dcnn", {"widths": 64})
    with pytest.raises(InputError, match="dilations"):
        build_network("dcnn", {"dilations": [1, 0]})


def _told_bank() -> torch.nn.Module:
    """A small bank for blurs by squares of 1, 3, 5 and 7 pixels, whose filters differ."""
    bank = build_network(
        "filter-bank", {"groups": 4, "distances": 1, "support": 9, "width": 4, "blocks": [1]}
    )
    psf = torch.zeros(4, 3, 9, 9)
    for reach in range(4):
        psf[reach, :, 4 - reach : 5 + reach, 4 - reach : 5 + reach] = 1 / (2 * reach + 1) ** 2
    filters = 0.01 * torch.randn(4, 3, 3, 9, 9, generator=torch.Generator().manual_seed(8))
    filters[:, range(3), range(3), 4, 4] += torch.linspace(0.5, 0.9, 4)[:, None]
    bank.set_filters(filters, psf)
    return bank.eval()


def _texture(size: int, generator: torch.Generator) -> torch.Tensor:
    """Grey, with the spectrum of photographs, [1, 3, size, size]."""
    white = torch.fft.rfft2(torch.randn(size, size, generator=generator))
    return torch.fft.irfft2(white * power_spectrum(size, torch.zeros(1)).sqrt()).expand(1, 3, -1, -1)


def test_a_bank_takes_the_filter_of_the_blur_that_it_sees() -> None:
    bank = _told_bank()
    generator = torch.Generator().manual_seed(9)
    sharp = _texture(128, generator)
    for reach in range(4):
        photo = torch.nn.functional.avg_pool2d(sharp, 2 * reach + 1, 1)
        weights = bank.weights(photo + 0.003 * torch.randn(photo.shape, generator=generator))
        assert weights.shape == (1, 4, *photo.shape[-2:])
        assert torch.allclose(weights.sum(1), torch.ones(1), atol=1e-5)
        assert weights[:, reach].mean() > 0.95


def test_a_bank_sees_no_further_than_its_radius() -> None:
    """What chooses among the filters has no gradient: pixels beyond the radius are replaced instead."""
    bank = _told_bank()
    size = 2 * bank.radius + 64
    generator = torch.Generator().manual_seed(10)
    photo = 0.5 + 0.02 * torch.randn(1, 3, size, size, generator=generator)
    place = size // 2
    near = slice(place - bank.radius, place + bank.radius + 1)
    other = torch.rand(photo.shape, generator=generator)
    other[..., near, near] = photo[..., near, near]
    closer = photo.clone()
    closer[..., place + 20 :, :] = 0.5
    with torch.no_grad():
        same, here, changed = (bank(each)[0, :, place, place] for each in (photo, other, closer))
    torch.testing.assert_close(here, same, rtol=0, atol=1e-5)
    assert (changed - same).abs().max() > 1e-4


@pytest.mark.parametrize("sideways", [False, True])
def test_a_told_bank_restores_in_tiles_as_whole(sideways: bool) -> None:
    """Which filter counts at a pixel follows from the blocks about it. The pixel lies between places `STEP`
    apart, each is judged with its neighbours, `STEP` further, and a block reaches half its width beyond. To
    that the U-Net adds its own: 2 pixels each for the first and the last convolution and for the block of
    3 x 3 at half the resolution, and 2 that share a coarse one."""
    bank = _told_bank()
    assert bank.radius == (STEP + STEP + BLOCK // 2) + (2 + 2 + 2 + 2)
    photo = 0.5 + 0.02 * torch.randn(3, 40, 290, generator=torch.Generator().manual_seed(12))
    # the first tile ends at 64 and sees 64 more: blurred in the farther half of these
    photo[..., 96:] = torch.nn.functional.avg_pool2d(photo[..., 96:], 7, 1, 3)
    photo = photo.mT if sideways else photo
    whole, tiled = (apply_network(bank, photo, tile=tile) for tile in (512, 64))
    torch.testing.assert_close(tiled, whole, rtol=0, atol=2e-6)


def test_a_checkpoint_keeps_what_a_bank_was_told(tmp_path: Path) -> None:
    bank = _told_bank()
    photo = torch.rand(3, 70, 60, generator=torch.Generator().manual_seed(11))
    path = save_checkpoint(tmp_path / "bank.safetensors", bank, {"name": "bank"})
    torch.testing.assert_close(
        apply_network(load_checkpoint(path).network, photo), apply_network(bank, photo), rtol=0, atol=1e-6
    )


def test_a_photo_goes_on_with_its_slope() -> None:
    ramp = torch.linspace(0.2, 0.5, 31).expand(3, 9, 31)
    turned = continued(ramp, 8)
    assert torch.equal(turned[:, 8:-8, 8:-8], ramp) and continued(ramp, 0) is ramp
    # one step of the slope is spent on the border, whose pixel comes twice
    expected = 0.5 + 0.01 * torch.arange(8.0)
    assert torch.allclose(turned[:, 8:-8, -8:], expected.expand(3, 9, 8), atol=1e-6)
    dark = continued(torch.linspace(0.0, 1.0, 12).expand(3, 9, 12), 8)
    assert dark.min() == 0  # light is not negative


def test_light_from_beyond_the_frame_leaves_no_line_on_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grey picture with something bright outside, of which the blur reaches in: the shipped filters fold it
    back into a line where the world is taken for mirrored, and do without where it is not."""
    checkpoint = load_checkpoint("paper-bank")
    camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
    wavelengths = torch.tensor([611e-9, 543e-9, 482e-9], dtype=torch.float64)
    psf = psf_bank(camera, wavelengths, [1.0]).values[0]
    world = torch.full((3, 224, 224), 0.3)
    world[:, :, :60] = 0.9
    spectrum = torch.fft.rfft2(world) * torch.fft.rfft2(psf, s=(224, 224))
    blurred = torch.fft.irfft2(spectrum, s=(224, 224)).roll((-48, -48), (-2, -1))
    photo = blurred[:, 64:160, 64:160].float()

    def error() -> float:
        return float((apply_network(checkpoint.network, photo)[:, 16:-16, :6] - 0.3).abs().mean())

    ours = error()
    monkeypatch.setattr(filter_bank, "continued", lambda image, reach: pad(image, (reach,) * 4, "reflect"))
    assert ours < 0.6 * error()


def test_noise_leaves_no_combs_on_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flat grey world: what the shipped bank makes of the noise is no stronger along the frame than inside.
    Continued by its one border pixel each line would draw a tooth some pixels deep."""
    network = load_checkpoint("paper-bank").network
    noise = torch.randn(3, 128, 128, generator=torch.Generator().manual_seed(4))
    photo = 0.5 + 0.005 * noise

    def strength() -> float:
        image, found = apply_network(network, photo), []
        for side in (image, image.flip(1), image.mT, image.mT.flip(1)):
            change = side[..., 1:] - side[..., :-1]
            power = (change - change.mean(0)).square().mean((0, 2))  # what is coloured of it
            found.append(power[:6].mean() / power[32:-32].mean())
        return float(torch.stack(found).mean().sqrt())

    assert strength() < 1.3
    monkeypatch.setattr("edofsim.restore.borders.ALONG_PX", 0.01)
    assert strength() > 1.5
