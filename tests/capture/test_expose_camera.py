"""Photos through the real optics: the paper's camera on small views."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from benchmarks.brute import brute
from edofsim.capture import Fidelity, capture, ideal_image, read_image, write_image, write_photo
from edofsim.capture.resample import resampled
from edofsim.errors import InputError
from edofsim.optics import Camera, psf_bank, response
from edofsim.optics.masks.coded import CodedMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings, Sensor

WINDOW = 33


def camera(mask=None, **sensor) -> Camera:
    recipe = CameraRecipe(
        name="small", psf=PsfSettings(window_px=WINDOW, oversampling=2), sensor=Sensor(**sensor)
    )
    return Camera.from_recipe(recipe.model_copy(update={"mask": mask}) if mask else recipe)


def view_of(bench, image, depth, margin=WINDOW // 2, through=None):
    return bench.flat_view(image, depth, margin, pixel_angle=(through or camera()).pixel_angle)


def deep(bench, bands=3, rows=50, columns=53):
    depth = torch.linspace(0.4, 1.2, columns, dtype=torch.float64).expand(rows, columns)
    return view_of(bench, bench.texture(bands, rows, columns), depth)


@pytest.mark.parametrize("window", [32, 33])
@pytest.mark.parametrize("size", [(50, 53), (51, 52)])
def test_point_source_through_a_cubic_mask(bench, window, size):
    """The photo of a point is the bank's PSF of its depth and band, and veiling glare; so is its centroid."""
    optics = camera(CubicMask(alpha_rad=25.0))
    image = torch.zeros(3, *size, dtype=torch.float64)
    image[1, 24, 27] = 1
    view = view_of(bench, image, 0.6, margin=16)
    photo = capture(view, optics, Fidelity(window_px=window), exposure=1.0, dtype=torch.float64)
    psf = psf_bank(optics, view.wavelengths, [0.6], window_px=window, dtype=torch.float64).values[0, 1]
    weight = response(optics, view.wavelengths)[:, 1]
    row, column = 24 - 16, 27 - 16
    c = window // 2
    full = torch.zeros(3, size[0] + 64, size[1] + 64, dtype=torch.float64)
    full[:, 24 - c + 32 : 24 - c + 32 + window, 27 - c + 32 : 27 - c + 32 + window] = (
        weight[:, None, None] * psf
    )
    glare = (weight * (1 - psf.sum()) / image[0].numel())[:, None, None]
    expected = full[:, 48 : 48 + view.height, 48 : 48 + view.width] + glare
    assert torch.allclose(photo.clean, expected, atol=1e-12)
    got, wanted = photo.clean.sum(0), expected.sum(0)
    for axis, place in ((0, row), (1, column)):
        line = torch.arange(got.shape[axis], dtype=torch.float64)
        centre, wanted_centre = ((i.sum(1 - axis) @ line / i.sum()).item() for i in (got, wanted))
        assert abs(centre - wanted_centre) < 1e-9
        assert abs(centre - place) < 6  # the cubic mask shifts its PSF, by less than this


def test_clear_aperture_centres_a_point_to_a_hundredth_of_a_pixel(bench):
    """A lens without a mask is symmetric: the centroid of a point's photo is the point."""
    image = torch.zeros(3, 65, 66, dtype=torch.float64)
    image[:, 33, 31] = 1
    photo = capture(view_of(bench, image, 0.9, margin=16), camera(), exposure=1.0, dtype=torch.float64)
    for channel in photo.clean:
        rows, columns = (torch.arange(n, dtype=torch.float64) for n in channel.shape)
        assert abs((channel.sum(1) @ rows / channel.sum()).item() - (33 - 16)) < 0.01
        assert abs((channel.sum(0) @ columns / channel.sum()).item() - (31 - 16)) < 0.01


def test_picture_is_upright(bench):
    """Light from beyond the focus that enters through the upper half of the pupil crosses the axis before the
    sensor and lands below it: in the upright picture, above. The mask's top row is the pupil's top."""
    upper = CodedMask(pattern=("1", "0"))
    image = torch.zeros(3, 65, 65, dtype=torch.float64)
    image[:, 32, 32] = 1
    photo = capture(view_of(bench, image, 0.0, margin=16), camera(upper), exposure=1.0, dtype=torch.float64)
    rows = torch.arange(33, dtype=torch.float64)
    centre = (photo.clean.sum((0, 2)) @ rows / photo.clean.sum()).item()
    assert centre < 16 - 2
    assert photo.how.transmission == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("layers", [None, 1])
def test_energy_in_is_energy_out(bench, layers):
    """Of a point's light, what the window holds lands around it, the rest in equal parts on every pixel."""
    image = torch.zeros(3, 80, 81, dtype=torch.float64)
    image[:, 40, 41] = torch.tensor([1.0, 2.0, 0.5], dtype=torch.float64)
    view = view_of(bench, image, 2.0)
    photo = capture(view, camera(), Fidelity(layers=layers), exposure=1.0, dtype=torch.float64)
    sent = response(camera(), view.wavelengths) @ image[:, 40, 41]
    lost = 1 - psf_bank(camera(), view.wavelengths, [2.0], dtype=torch.float64).values.sum((-1, -2))[0]
    beyond = response(camera(), view.wavelengths) @ (lost * image[:, 40, 41])
    glare = beyond / image[0].numel()
    corner = photo.clean[:, 0, 0]  # the window ends before it
    assert torch.allclose(corner, glare, rtol=1e-4)
    outside = image[0].numel() - photo.clean[0].numel()
    assert torch.allclose(photo.clean.sum((1, 2)) + outside * glare, sent, rtol=1e-6)
    assert torch.allclose(photo.truncated, beyond / sent, rtol=1e-4)
    assert (photo.truncated > 0.01).all()  # at 0.5 m this window is narrower than the blur


@pytest.mark.parametrize("layers", [None, 1])
def test_constant_scene(bench, layers):
    """A constant scene is constant to the frame's edge, margin or not, and as bright as it is."""
    view = view_of(bench, torch.ones(3, 50, 53, dtype=torch.float64), 0.9, margin=5)
    photo = capture(view, camera(), Fidelity(layers=layers), exposure=1.0, dtype=torch.float64)
    assert photo.how.margin_repeated_px == 11
    assert (photo.truncated > 1e-4).all()
    assert (photo.clean - 1).abs().max() < 1e-5


def test_a_veil_stands_for_what_wider_windows_hold(bench):
    """Against PSFs that hold nearly all light, a window is ten times closer with the glare than without."""
    image = 0.2 + torch.rand(3, 200, 210, generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    view = view_of(bench, image, 1.6)
    wide = capture(view, camera(), Fidelity(window_px=160), exposure=1.0, dtype=torch.float64)
    narrow = capture(view, camera(), Fidelity(window_px=40), exposure=1.0, dtype=torch.float64)
    sent = response(camera(), view.wavelengths) @ image.flatten(1).mean(1)
    glare = (narrow.truncated * sent)[:, None, None]
    off, off_without = (
        (photo - wide.clean).square().mean().sqrt() for photo in (narrow.clean, narrow.clean - glare)
    )
    assert off < 0.1 * off_without


def test_brute_force_agrees_on_a_deep_scene(bench, monkeypatch: pytest.MonkeyPatch):
    """Brute force over many depths and layers at 17: one photo, to the accuracy asked for."""
    view = deep(bench)
    settings = dict(dtype=torch.float64, exposure=1.0)
    layered = capture(view, camera(), Fidelity(layers=17), **settings).clean
    monkeypatch.setattr("edofsim.capture.blurring.layered", brute)
    slow = capture(view, camera(), Fidelity(layers=33), **settings).clean

    def psnr(a, b):
        return -10 * torch.log10((a - b).square().mean()).item()

    assert psnr(layered, slow) > 50


def test_single_precision_and_device_argument(bench):
    view = deep(bench)
    exact = capture(view, camera(), dtype=torch.float64, exposure=1.0).clean
    single = capture(view, camera(), exposure=1.0, device="cpu").clean
    assert single.dtype == torch.float32
    assert (single - exact).abs().max() < 3e-5


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cuda_agrees_with_cpu(bench):
    view = deep(bench)
    cpu = capture(view, camera(), exposure=1.0, seed=3)
    cuda = capture(view, camera(), exposure=1.0, seed=3, device="cuda")
    assert cuda.image.device.type == "cuda"
    assert (cuda.image.cpu() - cpu.image).abs().max() < 1e-4


def test_gradcheck_from_the_height_map_to_the_photo_with_occlusion(bench):
    """Analytic against numerical derivatives of the whole chain, float64: PSFs, layers, occlusion, exposure.

    Heights are in units of 100 nm, so that a numerical step is neither lost nor too long.
    """
    side, window = 13, 9
    optics = Camera.from_recipe(CameraRecipe(name="tiny", psf=PsfSettings(window_px=window, oversampling=1)))
    near = torch.zeros(side, side, dtype=torch.float64)
    near[:, :6] = 1
    depth = torch.ones(side, side, dtype=torch.float64)
    view = bench.stacked_view(
        [(near, depth, bench.texture(2, side, side)), (depth, depth * 0.5, bench.texture(2, side, side, 1))],
        4,
        pixel_angle=optics.pixel_angle,
    )
    start = torch.rand(4, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def picture(height):
        photo = capture(view, optics.with_height(height * 1e-7), exposure=1.0, dtype=torch.float64)
        return photo.clean[:, 1:4, 1:4]

    assert torch.autograd.gradcheck(picture, (start.requires_grad_(),), eps=1e-4, atol=1e-6, fast_mode=True)


def test_noise_is_the_recipe_s_and_seeded(bench):
    view = deep(bench)
    one, again, other = (capture(view, camera(read_noise=0.02), seed=s) for s in (1, 1, 2))
    assert torch.equal(one.image, again.image)
    assert not torch.equal(one.image, other.image)
    assert abs((one.image - one.clean).std().item() / 0.02 - 1) < 0.15
    white = torch.quantile(one.ideal.flatten(), 0.995).item()
    assert white == pytest.approx(0.9, rel=0.01)


def test_ideal_image_is_that_of_the_photo(bench):
    view = deep(bench)
    photo = capture(view, camera())
    assert torch.allclose(view.crop_margin(ideal_image(view, camera())).float(), photo.ideal, atol=1e-6)


def test_batch_of_views(bench):
    """Several views of one size through one camera: stacked images, the same as one by one."""
    views = [deep(bench), replace(deep(bench), radiance=deep(bench).radiance.flip(1))]
    together = capture(views, camera(), seed=4, exposure=0.7)
    assert together.image.shape == (2, 3, 50 - 32, 53 - 32)
    for k, view in enumerate(views):
        alone = capture(view, camera(), seed=4 + k, exposure=0.7)
        assert torch.allclose(together.image[k], alone.image, atol=1e-6)
        assert torch.allclose(together.truncated[k], alone.truncated, atol=1e-6)


def test_bad_input_is_refused(bench):
    view = deep(bench)
    with pytest.raises(InputError, match="wider than the image"):
        capture(view, camera(), Fidelity(window_px=64))
    with pytest.raises(InputError, match="from 1 to"):
        capture(view, camera(), Fidelity(layers=0))
    for rendered in ({"samples": 4}, {"bounces": 2}, {"scene_dispersion": False}):
        fidelity = Fidelity(**rendered)
        with pytest.raises(InputError, match=f"{next(iter(rendered))} of the fidelity: for rendering alone"):
            capture(view, camera(), fidelity)
        assert fidelity.of_photo() == Fidelity()
    with pytest.raises(InputError, match="occlusion 'some' is not known.*hidden"):
        capture(view, camera(), Fidelity(occlusion="some"))
    with pytest.raises(InputError, match="mrad"):
        capture(replace(view, pixel_angle=3e-4), camera())
    with pytest.raises(InputError, match="exposure"):
        capture(view, camera(), exposure=-1.0)
    with pytest.raises(InputError, match="of red.*render more bands"):
        capture(
            replace(view, wavelengths=torch.tensor([420e-9, 485e-9, 550e-9], dtype=torch.float64)), camera()
        )
    outside = replace(view, wavelengths=torch.tensor([380e-9, 500e-9, 600e-9], dtype=torch.float64))
    with pytest.raises(InputError, match="380"):
        capture(outside, camera())


def test_resampling_on_request(bench):
    view = replace(deep(bench), pixel_angle=camera().pixel_angle * 2)
    photo = capture(resampled(view, camera().pixel_angle), camera())
    assert photo.image.shape[-2:] == ((50 - 32) * 2, (53 - 32) * 2)


def test_photo_file_round_trip(bench, tmp_path):
    photo = capture(deep(bench), camera())
    path = write_photo(tmp_path / "photo.exr", photo)
    assert torch.equal(read_image(path), photo.image)
    assert torch.equal(read_image(write_image(tmp_path / "ideal.exr", photo.ideal)), photo.ideal)


def test_unreadable_images_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_image(tmp_path / "none.exr")
    for name in ("text.exr", "text.png", "text.txt"):
        (tmp_path / name).write_text("not an image")
        with pytest.raises(InputError, match="cannot be read|not a picture that can be read"):
            read_image(tmp_path / name)
