"""The bank for any camera: what it is told of one, when it is used, and that cameras are kept apart."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch
from torch import Tensor

from edofsim.capture.planes import capture_planes, surroundings
from edofsim.errors import InputError
from edofsim.experiments.systems import evaluated_system
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.optics.nodes import node_shares, nodes_between
from edofsim.recipe import load_camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.load import Loaded
from edofsim.restore import choice
from edofsim.restore.camera_bank import BLIND, LEAST_NOISE, PSFS_A_DEPTH, SHARES, CameraBank
from edofsim.restore.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from edofsim.restore.choice import choose_network, said_of, usual_network
from edofsim.restore.conditioning import conditioned_on, refusal
from edofsim.restore.depths import FINEST_PX, closer_about_focus
from edofsim.restore.filter_bank import FilterBank
from edofsim.restore.light import without_glare
from edofsim.restore.linear import local_filters
from edofsim.restore.network import apply_network, build_network
from edofsim.restore.places import BY_WIENER, Method
from edofsim.restore.restore import channel_psfs, deconvolved, restore

SMALL = {"groups": 2, "support": 9, "distances": 2, "width": 4, "blocks": (1, 1)}
DEPTHS = torch.tensor([0.8, 1.2], dtype=torch.float64)


def _camera(**changes: object) -> Camera:
    values = {
        "name": "own",
        "lens": {"kind": "ideal", "focal_length_mm": 20, "f_number": 5},
        "sensor": {"pixel_um": 4.0, "response": "lines", "read_noise": 0.005},
        "psf": {"window_px": 24},
    }
    return Camera.from_recipe(CameraRecipe.model_validate({**values, **changes}))


def _discs(diameters: list[float], window: int = 24) -> Tensor:
    """Blurs of these diameters in pixels, [disc, 3, window, window]."""
    place = torch.arange(window) - window // 2
    distance = (place[:, None].square() + place.square()).sqrt()
    discs = torch.stack([(0.5 + d / 2 - distance).clamp(0, 1) for d in diameters])
    return (discs / discs.sum((-1, -2), keepdim=True))[:, None].expand(-1, 3, -1, -1).contiguous()


@pytest.fixture(name="checkpoint")
def _checkpoint(tmp_path: Path) -> Checkpoint:
    torch.manual_seed(0)
    recipe = load_camera("paper-clear").recipe.model_dump(mode="json", exclude={"schema_"})
    network = build_network("camera-bank", SMALL)
    path = save_checkpoint(tmp_path / "any.safetensors", network, {"name": "any", "camera": recipe})
    return load_checkpoint(path)


def test_grown_from_a_bank_it_restores_as_that_does() -> None:
    """With the same filters and likelihoods: what it sees besides has no weight yet."""
    torch.manual_seed(1)
    bank = FilterBank(**SMALL)
    with torch.no_grad():
        for parameter in bank.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape))
    grown = CameraBank.grown(bank)
    psf = _discs([1, 3, 5, 7])
    bank.set_psfs(psf)
    grown.set_psfs(psf.repeat_interleave(PSFS_A_DEPTH, 0))
    bank.filters.copy_(grown.filters[: 3 * bank.groups])
    bank._matrix, bank._constant = grown._matrix, grown._constant
    photo = torch.rand(1, 3, 64, 64)
    expected = bank.eval().unclamped(photo)
    torch.testing.assert_close(grown.eval().unclamped(photo), expected, atol=1e-3, rtol=0)
    assert (expected - photo).abs().max() > 0.1


def test_grown_to_see_wiener_deconvolution_it_restores_as_before() -> None:
    torch.manual_seed(1)
    before = CameraBank(**SMALL)
    with torch.no_grad():
        for parameter in before.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape))
    grown = CameraBank.grown(before, {"linear": True})
    assert grown.settings() == {**before.settings(), "linear": True}
    for network in (before.eval(), grown.eval()):
        network.set_camera(_discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0), 0.01)
    photo, linear = torch.rand(2, 3, 64, 64).unbind()
    expected = apply_network(before, photo)
    torch.testing.assert_close(apply_network(grown, photo, linear=linear), expected, atol=1e-5, rtol=0)
    with torch.no_grad():
        grown.trunk.first.weight.add_(0.05)
    found = [apply_network(grown, photo, linear=seen) for seen in (linear, photo, None)]
    assert (found[0] - found[1]).abs().max() > 1e-3
    assert torch.equal(found[1], found[2])


def test_it_grows_out_of_nothing_else() -> None:
    for other in (build_network("dcnn"), CameraBank(**SMALL, linear=True)):
        with pytest.raises(InputError, match=repr(other.kind) + "$"):
            CameraBank.grown(other)


def test_light_that_leaves_the_windows_of_psfs_is_taken_off_first() -> None:
    """Half of the light of a plane spread evenly: its photo is restored as one of twice the noise that lost
    nothing."""
    psf = _discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0)
    whole, half = CameraBank(**SMALL).eval(), CameraBank(**SMALL).eval()
    whole.set_camera(psf, 0.01)
    half.set_camera(psf / 2, 0.005)
    torch.testing.assert_close(half.filters, whole.filters)
    assert half.noise == pytest.approx(whole.noise)
    photo = torch.rand(3, 64, 64)
    glare = torch.full((3,), 0.5)
    light = without_glare(photo, glare)
    torch.testing.assert_close(apply_network(half, photo, glare=glare), apply_network(whole, light))
    expected = deconvolved(light, psf, 0.01)
    torch.testing.assert_close(deconvolved(light, psf / 2, 0.005), expected, atol=1e-5, rtol=0)


def test_photos_side_by_side_are_deconvolved_as_each_by_itself() -> None:
    psf, photos = _discs([1, 3, 5, 7]), torch.rand(2, 3, 40, 40)
    found = deconvolved(photos, psf, 0.01)
    torch.testing.assert_close(found, torch.stack([deconvolved(each, psf, 0.01) for each in photos]))


def test_a_camera_that_it_is_told_is_no_part_of_its_weights() -> None:
    network = CameraBank(**SMALL)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    network.set_camera(_discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0), 0.01)
    assert network.state_dict().keys() == before.keys()
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


def test_told_a_blur_it_takes_it_away_untrained() -> None:
    """An untrained U-Net adds nothing: what is gained is the filters'."""
    network = CameraBank(**SMALL).eval()
    psf = _discs([4.0, 4.2, 4.4, 4.6])
    network.set_camera(psf.repeat_interleave(PSFS_A_DEPTH, 0), 0.002)
    generator = torch.Generator().manual_seed(0)
    grey = torch.rand(1, 1, 20, 20, generator=generator).expand(1, 3, 20, 20)
    world = torch.nn.functional.interpolate(grey, size=(120, 120))
    photo = capture_planes(world, psf[1:2])
    before, after = surroundings(24)
    sharp = world[..., before:-after, before:-after]
    inside = (..., slice(16, -16), slice(16, -16))
    left = (network(photo)[inside] - sharp[inside]).square().mean()
    assert left < 0.5 * (photo[inside] - sharp[inside]).square().mean()


def test_a_dim_photo_is_restored_as_one_of_more_noise() -> None:
    """Brightened by a power of 2; single bright pixels do not keep it from that."""
    network = CameraBank(**SMALL).eval()
    psf = _discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0)
    photo = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    photo[:, 20:40, 20:40] = 1.0
    assert network.brightened_for(photo / 8) == (network, 1)  # told no camera
    network.set_camera(psf, 0.002)
    assert network.brightened_for(photo) == (network, 1)
    assert network.brightened_for(photo / 3) == (network, 1)
    louder, factor = network.brightened_for(photo / 6)
    hot = photo / 9
    hot[0, 5, 5] = 0.7
    assert factor == 4 and network.brightened_for(hot)[0] is louder
    other = CameraBank(**SMALL).eval()
    other.load_state_dict(network.state_dict())
    other.set_camera(psf, 0.008)
    dim = photo / 6
    expected = apply_network(other, 4 * dim) / 4
    found = apply_network(network, dim).clamp_max(1 / 4)  # what is beyond full scale is kept
    torch.testing.assert_close(found, expected, atol=6e-3, rtol=0)
    network.set_camera(psf, 0.001)
    assert network.brightened_for(photo / 6)[0] is not louder


def test_filters_are_those_of_the_noise_and_of_the_whole_range() -> None:
    network = CameraBank(**SMALL)
    psf = _discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0)
    known = network.condition(psf, 0.01)
    blind = known.filters.unflatten(0, (-1, 3))[network.groups :]
    for filters, share in zip(blind, BLIND, strict=True):
        torch.testing.assert_close(filters, local_filters(psf, 9, 1, 0.01 * share)[0])
    assert not torch.equal(known.filters, network.condition(psf, 0.02).filters)


@pytest.mark.parametrize("noise", [0.0, 5e-4, 1.9e-3])
def test_filters_of_a_sensor_with_hardly_any_noise_are_those_of_double_precision(noise: float) -> None:
    camera = Camera.from_recipe(load_camera("paper-cubic").recipe)
    depths = torch.full((2,), 1.0, dtype=torch.float64)  # one distance: least of all tells pixels apart
    psf = channel_psfs(camera, PAPER_COLOURS.double(), depths).float()
    filters = local_filters(psf, 27, 1, max(noise, LEAST_NOISE))
    assert filters.dtype == torch.float32
    expected = local_filters(psf.double(), 27, 1, max(noise, LEAST_NOISE))
    assert torch.allclose(filters.double(), expected, atol=1e-6 * float(expected.abs().max()))


def test_expected_errors_are_in_order() -> None:
    """One filter for all distances is no better than each one's own, on the mean error; noise costs."""
    network = CameraBank(**SMALL)
    psf = _discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0)
    quiet, loud = (network.condition(psf, noise).expected for noise in (0.002, 0.02))
    error = 10 ** (-quiet.double())
    assert error[:-1].mean() < error[-1]
    assert (loud < quiet).all()


def test_it_is_told_each_camera_once_and_keeps_them_apart(checkpoint: Checkpoint) -> None:
    def told(camera: Camera, depths: Tensor = DEPTHS) -> object:
        return conditioned_on(checkpoint, camera, PAPER_COLOURS, depths)

    first = told(_camera())
    assert told(_camera()) is first
    others = [
        _camera(focus={"distance_m": 0.9}),
        _camera(mask={"kind": "cubic", "alpha_rad": 5.0}),
        _camera(sensor={"pixel_um": 4.0, "response": "lines", "read_noise": 0.02}),
    ]
    found = [first, *(told(camera) for camera in others), told(_camera(), DEPTHS + 0.2)]
    filters = [network.filters for network in found]
    assert not any(torch.equal(a, b) for i, a in enumerate(filters) for b in filters[:i])
    assert told(_camera()) is first


def test_what_it_is_told_are_the_cameras_psfs_between_the_depths(checkpoint: Checkpoint) -> None:
    camera = _camera(mask={"kind": "cubic", "alpha_rad": 5.0})
    network = conditioned_on(checkpoint, camera, PAPER_COLOURS, DEPTHS)
    depths = closer_about_focus(camera, network.psf_depths((0.8, 1.2)))
    assert 0.8 < float(depths.min()) < 0.85 and 1.15 < float(depths.max()) < 1.2
    psf = psf_bank(camera, PAPER_COLOURS, depths).values
    expected = checkpoint.network.condition(psf, camera.read_noise)
    torch.testing.assert_close(network.filters, expected.filters, atol=1e-4, rtol=0)


def test_depths_are_closer_about_the_focus_of_a_lens_with_a_large_blur() -> None:
    """By geometry: a disc as wide as the aperture's light is on a sensor that is not in focus."""
    wide = _camera(
        lens={"kind": "ideal", "focal_length_mm": 50, "f_number": 2},
        sensor={"pixel_um": 3.45, "response": "lines"},
        focus={"distance_m": 2.0},
    )
    even = torch.linspace(0.0, 1.0, 97, dtype=torch.float64)
    depths = closer_about_focus(wide, even)
    per_dioptre = 25e-3 * wide.sensor_distance / wide.pixel
    steps = depths.diff() * per_dioptre
    assert (steps > 0).all()
    assert float(depths[0]) == pytest.approx(0, abs=1e-9) and float(depths[-1]) == pytest.approx(1, abs=1e-9)
    assert float(steps.min()) == pytest.approx(FINEST_PX, rel=0.05)
    assert abs(float(depths[steps.argmin()]) - 0.5) < 0.02
    assert float(even.diff()[0]) * per_dioptre > 3
    small = _camera(lens={"kind": "ideal", "focal_length_mm": 5, "f_number": 4})
    assert torch.equal(closer_about_focus(small, even), even)


def test_there_is_more_of_wiener_deconvolution_where_filters_are_expected_to_reach_little(
    checkpoint: Checkpoint,
) -> None:
    """The same lens, and a sensor whose noise leaves next to nothing."""
    noisy = _camera(sensor={"pixel_um": 4.0, "response": "lines", "read_noise": 0.3})
    shares = [
        conditioned_on(checkpoint, camera, PAPER_COLOURS, DEPTHS).linear_share()
        for camera in (_camera(), noisy)
    ]
    assert shares == list(SHARES)


def test_a_share_of_wiener_deconvolution_is_in_what_it_restores(checkpoint: Checkpoint) -> None:
    photo = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(4))
    camera = _camera()
    network = conditioned_on(checkpoint, camera, PAPER_COLOURS, DEPTHS)
    nodes = nodes_between(camera, PAPER_COLOURS, *DEPTHS.aminmax())
    psf, shares = psf_bank(camera, PAPER_COLOURS, nodes).values, node_shares(nodes)
    truncated = 1 - psf_bank(camera, PAPER_COLOURS, DEPTHS.mean()[None]).values[0].sum((-1, -2))
    linear = deconvolved(without_glare(photo, truncated), psf, camera.read_noise, shares).clamp(0, 1)
    own = apply_network(network, photo, glare=truncated)
    expected = (1 - SHARES[0]) * own + SHARES[0] * linear
    sharp, _ = restore(photo, camera, PAPER_COLOURS, DEPTHS, checkpoint=checkpoint)
    torch.testing.assert_close(sharp, expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("network", [True, False])
def test_psfs_that_are_known_are_not_made_again(
    monkeypatch: pytest.MonkeyPatch, checkpoint: Checkpoint, network: bool
) -> None:
    photo, camera = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(4)), _camera()
    used, truncated = checkpoint if network else None, torch.zeros(3)
    own, by = restore(photo, camera, PAPER_COLOURS, DEPTHS, checkpoint=used, truncated=truncated)
    nodes = nodes_between(camera, PAPER_COLOURS, *DEPTHS.aminmax())
    psfs = channel_psfs(camera, PAPER_COLOURS, nodes)
    monkeypatch.setattr(
        sys.modules[restore.__module__], "channel_psfs", lambda *told: pytest.fail("made again")
    )
    told = {"checkpoint": used, "truncated": truncated}
    assert torch.equal(restore(photo, camera, PAPER_COLOURS, nodes, psfs=psfs, **told)[0], own)
    other = restore(photo, camera, PAPER_COLOURS, nodes, psfs=psfs.roll(3, -1), **told)
    assert other[1] == by and not torch.allclose(other[0], own, atol=1e-3)


def test_a_window_that_is_too_wide_is_refused_before_its_psfs_are_computed(checkpoint: Checkpoint) -> None:
    wide = _camera(psf={"window_px": 600})
    why = refusal(checkpoint, wide)
    assert why is not None and "600 pixels" in why and "512" in why
    assert refusal(checkpoint, _camera()) is None and refusal(load_checkpoint("paper-dcnn"), wide) is None
    sharp, by = restore(torch.rand(3, 16, 16), wide, PAPER_COLOURS, DEPTHS[:1], checkpoint=checkpoint)
    assert by.name == "Wiener" and by.reason.startswith("the window")
    assert str(by) == f"Wiener, as {by.reason}" and bool(torch.isfinite(sharp).all())
    said = said_of(checkpoint, by)
    assert said is not None and said.startswith("Wiener deconvolution restored the photo: the window")


def test_a_photo_of_one_distance_can_be_restored(checkpoint: Checkpoint) -> None:
    photo = torch.rand(3, 64, 64)
    sharp, by = restore(photo, _camera(), PAPER_COLOURS, DEPTHS[:1], checkpoint=checkpoint)
    assert by == Method("any") and sharp.shape == photo.shape and bool(torch.isfinite(sharp).all())


def test_a_checkpoint_for_any_camera_is_refused_for_none_and_changes_no_mask(checkpoint: Checkpoint) -> None:
    own = load_camera("phone-5mm-f2")
    assert checkpoint.path is not None
    found, camera = choose_network(checkpoint.path, own)
    assert found is not None and found.network.any_camera
    assert camera.recipe == own.recipe
    rings = load_camera("paper-rings")
    assert choose_network(checkpoint.path, rings)[1].mask == rings.recipe.mask


def test_it_restores_for_cameras_without_a_network_of_their_own(
    monkeypatch: pytest.MonkeyPatch, checkpoint: Checkpoint
) -> None:
    assert checkpoint.path is not None
    monkeypatch.setattr(choice, "any_camera_checkpoints", lambda: {"universal": checkpoint.path})
    found, camera = choose_network(None, load_camera("paper-rings"))
    assert found is not None and found.name == "any" and camera.mask.kind == "rings"
    assert choose_network("wiener", load_camera("paper-rings"))[0] is None
    own = usual_network(load_camera("paper-learned"))
    assert own is not None and own.name == "paper-bank"


def test_without_that_checkpoint_there_is_wiener_deconvolution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "any_camera_checkpoints", dict)
    assert choose_network(None, load_camera("paper-rings"))[0] is None


def test_a_sentence_says_that_it_restored(checkpoint: Checkpoint) -> None:
    said = said_of(checkpoint, Method("any"))
    assert said is not None and "any" in said and said.endswith(".")
    assert said_of(None, BY_WIENER) is None
    assert said_of(load_checkpoint("paper-dcnn"), Method("paper-dcnn")) is None


def test_as_a_system_it_has_the_camera_that_is_named(checkpoint: Checkpoint) -> None:
    assert checkpoint.path is not None
    clear, rings = (evaluated_system(checkpoint.path, camera=name) for name in (None, "paper-rings"))
    assert (clear.name, rings.name) == ("paper-clear+any", "paper-rings+any")
    assert rings.camera.mask.kind == "rings" and clear.digest != rings.digest


def test_a_photo_in_tiles_is_the_same_as_whole(checkpoint: Checkpoint) -> None:
    network = conditioned_on(checkpoint, _camera(), PAPER_COLOURS, DEPTHS)
    photo = torch.rand(3, 200, 200, generator=torch.Generator().manual_seed(2))
    whole, tiled = (apply_network(network, photo, tile=tile) for tile in (512, 96))
    torch.testing.assert_close(tiled, whole, atol=2e-4, rtol=0)


def test_the_cameras_recipe_is_used_with_its_files(checkpoint: Checkpoint) -> None:
    """A camera of Python, with a height map of its own."""
    learned = load_camera("paper-learned")
    loaded = Loaded(learned.recipe, learned.path, "")
    camera = choose_network(checkpoint.path, loaded)[1]
    assert camera.recipe.mask == learned.recipe.mask


def test_what_it_is_given_goes_on_to_the_next_process() -> None:
    """To the last bit, for dark photos, too."""
    torch.manual_seed(0)
    network = CameraBank(4, 9, 1, 4, (1, 1)).eval()
    psf = _discs([1, 3, 5, 7]).repeat_interleave(PSFS_A_DEPTH, 0)
    assert not network.camera_state()
    network.set_camera(psf, 0.01)
    other = CameraBank(4, 9, 1, 4, (1, 1)).eval()
    other.load_state_dict(network.state_dict())
    other.load_camera_state([each.clone() for each in network.camera_state()])
    photo = torch.rand(1, 3, 40, 48, generator=torch.Generator().manual_seed(1))
    for seen in (photo, 0.02 * photo):
        one, two = (each.brightened_for(seen[0])[0] for each in (network, other))
        assert torch.equal(one(seen), two(seen))
