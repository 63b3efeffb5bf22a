"""Lenses by measured PSFs: read back as they were saved, the right way round, and what is wrong named."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.io import savemat

from edofsim import View, photograph
from edofsim.capture.fidelity import Fidelity
from edofsim.core.images import png_bytes, write_exr
from edofsim.errors import InputError
from edofsim.optics import Camera, psf_bank, sub_aperture_psfs
from edofsim.optics.field import relative_light
from edofsim.optics.measured.bank import MeasuredBank, left_by_mixing
from edofsim.optics.measured.saving import save_bank
from edofsim.optics.mtf import mtf, strehl
from edofsim.recipe import load_camera
from edofsim.recipe.camera import CameraRecipe

SAID = {
    "inverse_depths_per_m": [0.0, 1.0],
    "wavelengths_nm": [500.0, 600.0],
    "pixel_um": 6.0,
    "orientation": "upright",
    "centre": "pixel",
    "normalisation": "sum",
}
F = np.array(
    [
        [1, 1, 1, 1, 0],
        [1, 0, 0, 0, 0],
        [1, 0, 0, 0, 0],
        [1, 1, 1, 0, 0],
        [1, 0, 0, 0, 0],
        [1, 0, 0, 0, 0],
        [1, 0, 0, 0, 0],
    ],
    float,
)


def camera_of(path, window: int = 32, pixel: float = 6.0, **said) -> Camera:
    lens = {"kind": "measured", "file": path.name, "focal_length_mm": 36.0, "f_number": 7.2, **said}
    told = {"name": "of-a-file", "lens": lens, "psf": {"window_px": window}, "sensor": {"pixel_um": pixel}}
    return Camera.from_recipe(CameraRecipe.model_validate(told), path.parent)


def of_arrays(folder, values, **said) -> Camera:
    """Of an .npy with all else in the recipe; None leaves a key out."""
    np.save(folder / "psfs.npy", values)
    said = {key: value for key, value in {**SAID, **said}.items() if value is not None}
    how = {key: said.pop(key) for key in ("window", "pixel") if key in said}
    return camera_of(folder / "psfs.npy", **how, **said)


def refused(folder, values, *said: str, **keys) -> None:
    with pytest.raises(InputError) as error:
        of_arrays(folder, values, **keys)
    for each in said:
        assert each in str(error.value)


def letters(*shape: int) -> np.ndarray:
    return np.broadcast_to(F, (*shape, *F.shape)).copy()


def seen_point(camera: Camera) -> np.ndarray:
    """A photo of one point of light in the middle of a dark picture at 1 m, scaled to the brightest pixel."""
    picture = np.zeros((40, 40, 3))
    picture[20, 20] = 1
    view = View.from_image(picture, 1.0, pixel_angle=camera.pixel_angle)
    photo = photograph(view, camera, Fidelity(occlusion="none"), exposure=1.0).clean[1].numpy()
    return photo / photo.max()


HELD = {"hold": ["depth", "wavelength"]}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("even", [0, 1])
def test_a_letter_lands_upright_and_at_its_size(tmp_path, turned, even):
    """In arrays of odd and even sides; turned, the chief ray is at n // 2 of the array as it is stored."""
    psfs = np.pad(letters(2, 2), [(0, 0), (0, 0), (even, 0), (even, 0)])
    how = {"orientation": "sensor"} if turned else {}
    camera = of_arrays(tmp_path, psfs[..., ::-1, ::-1] if turned else psfs, **HELD, **how)
    photo = seen_point(camera)
    expected = np.zeros((40, 40))
    top, left = (17 + even * turned, 18 + even * turned)  # n // 2 of the stored array on the point
    expected[top : top + 7, left : left + 5] = F
    np.testing.assert_allclose(photo, expected, atol=2e-3)


def test_a_camera_photographs_as_its_saved_psfs_do(tmp_path):
    """At depths that were saved, to rounding; between two, as their mix."""
    recipe = load_camera("paper-clear").recipe
    recipe = CameraRecipe.model_validate(recipe.model_dump() | {"psf": {"window_px": 48}})
    camera = Camera.from_recipe(recipe)
    picture = np.random.default_rng(1).random((48, 48, 3))
    view = View.from_image(picture, 1.0, pixel_angle=camera.pixel_angle)
    depths, bands = [0.7, 1.0, 2.0], (view.wavelengths * 1e9).tolist()
    save_bank(camera, tmp_path / "bank.exr", wavelengths_nm=bands, depths_m=depths, fields_deg=(0.0,))
    loaded = load_camera(tmp_path / "bank.toml")
    again = Camera.from_recipe(loaded.recipe, loaded.base)
    assert again.pixel_angle == pytest.approx(camera.pixel_angle, rel=1e-9)
    how = Fidelity(occlusion="none")

    def photo(optics: Camera, depth: float) -> torch.Tensor:
        seen = View.from_image(picture, depth, pixel_angle=camera.pixel_angle)
        return photograph(seen, optics, how, exposure=1.0).clean

    whole = [photo(camera, depth) for depth in (1.0, 2.0)]
    torch.testing.assert_close(photo(again, 1.0), whole[0], rtol=0, atol=1e-5)
    share = (1 / 1.3 - 0.5) / 0.5
    mixed = share * whole[0] + (1 - share) * whole[1]
    torch.testing.assert_close(photo(again, 1.3), mixed, rtol=0, atol=1e-5)
    assert float((whole[0] - whole[1]).abs().max()) > 0.1
    told = left_by_mixing(again.lens.bank())
    assert told["depth"] > 3 * told["wavelength"] > 0


@pytest.mark.parametrize("ending", ["exr", "npz"])
def test_psfs_over_the_field_read_back_the_same(tmp_path, ending):
    """And those beside the axis are the same ones, turned."""
    given = load_camera("doublet-25mm-f6").recipe
    recipe = CameraRecipe.model_validate(given.model_dump(exclude_unset=True) | {"psf": {"window_px": 41}})
    camera = Camera.from_recipe(recipe)
    what = {"wavelengths_nm": (611.0, 543.0), "depths_m": (1.0, math.inf), "fields_deg": (0.0, 3.0, 6.0)}
    save_bank(camera, tmp_path / f"bank.{ending}", **what)
    loaded = load_camera(tmp_path / "bank.toml")
    again = Camera.from_recipe(loaded.recipe, loaded.base)
    assert again.lens.varies
    up = math.tan(math.radians(6.0))
    above = psf_bank(again.at_field((0.0, up)), [543e-9, 611e-9], [0.0, 1.0]).values
    for place, most in (((0.0, up), 1e-6), ((-up, 0.0), 2e-6), ((0.6 * up, -0.8 * up), 0.06)):
        banks = [
            psf_bank(each.seen_at(place), [543e-9, 611e-9], [0.0, 1.0]).values for each in (camera, again)
        ]
        apart = (banks[0] - banks[1]).abs().sum((-1, -2)) / banks[0].sum((-1, -2))
        assert float(apart.max()) < most, place
        if place[0]:  # the same PSF unturned is another one
            assert float((banks[0] - above).abs().sum((-1, -2)).max()) > 0.1
    assert relative_light(again.at_field((0.0, up))) == pytest.approx(
        relative_light(camera.seen_at((0.0, up)))
    )
    with pytest.raises(InputError, match="8 degrees are asked for, and measured at 0 to 6"):
        psf_bank(again.at_field((0.0, math.tan(math.radians(8.0)))), [543e-9], [1.0])


def test_a_mask_that_is_not_round_is_saved_on_a_grid_of_places(tmp_path):
    given = load_camera("doublet-25mm-f6").recipe.model_dump(exclude_unset=True)
    recipe = CameraRecipe.model_validate(given | {"psf": {"window_px": 32}, "mask": {"kind": "cubic"}})
    camera = Camera.from_recipe(recipe)
    what = {"wavelengths_nm": (543.0,), "depths_m": (1.0,), "fields_deg": (0.0, 5.0)}
    save_bank(camera, tmp_path / "bank.exr", **what)
    loaded = load_camera(tmp_path / "bank.toml")
    again = Camera.from_recipe(loaded.recipe, loaded.base)
    up = math.tan(math.radians(5.0))
    for place in ((up, -up), (-up, 0.0)):
        banks = [psf_bank(each.seen_at(place), [543e-9], [1.0]).values for each in (camera, again)]
        assert float((banks[0] - banks[1]).abs().max()) < 1e-6
        assert float((banks[0] - banks[1].flip(-1)).abs().max()) > 1e-3


def test_between_what_was_measured_psfs_are_mixed(tmp_path):
    values = np.zeros((2, 2, 5, 5))
    values[0, :, 2, 1] = values[1, :, 2, 3] = 1
    camera = of_arrays(tmp_path, values, window=5)
    psf = psf_bank(camera, [540e-9], [0.25], dtype=torch.float64).values[0, 0]
    assert float(psf[2, 1]) == pytest.approx(0.75) and float(psf[2, 3]) == pytest.approx(0.25)
    for wavelength, inverse, said in ((540e-9, 1.5, "1.5 1/m"), (650e-9, 0.5, "650 nm")):
        with pytest.raises(InputError, match=said):
            psf_bank(camera, [wavelength], [inverse])
    held = of_arrays(tmp_path, values, window=5, **HELD)
    assert float(psf_bank(held, [650e-9], [1.5]).values[0, 0, 2, 3]) == pytest.approx(1)


def test_what_mixing_leaves_is_told():
    """A spot that moves by a sample from node to node: the middle one shares no light with the mix of its
    neighbours, and half a step away mixes err by a quarter of that."""
    values = torch.zeros(1, 3, 1, 5, 5)
    for depth in range(3):
        values[0, depth, 0, 2, 1 + depth] = 1
    middle = torch.full((1, 3, 1, 2), 2.0, dtype=torch.float64)
    bank = MeasuredBank(values, middle, 6e-6, (), (0.0,), (0.0, 1.0, 2.0), (5e-7,), torch.ones(1))
    assert left_by_mixing(bank) == {"depth": pytest.approx(25.0)}


def test_light_is_shared_among_pixels_of_another_pitch(tmp_path):
    fine = of_arrays(tmp_path, letters(2, 2), pixel_um=2.0, window=9)
    psf = psf_bank(fine, [550e-9], [0.5], dtype=torch.float64).values[0, 0]
    expected = np.zeros((9, 9))
    padded = np.zeros((9, 9))
    padded[1:8, 2:7] = F / F.sum()
    expected[3:6, 3:6] = padded.reshape(3, 3, 3, 3).sum((1, 3))
    np.testing.assert_allclose(psf, expected, atol=1e-12)
    coarse = of_arrays(tmp_path, letters(2, 2), pixel_um=18.0, window=33)
    wide = psf_bank(coarse, [550e-9], [0.5], dtype=torch.float64).values[0, 0]
    np.testing.assert_allclose(wide[6:27, 9:24], np.kron(F / F.sum(), np.ones((3, 3)) / 9), atol=1e-12)


@pytest.mark.parametrize("size", [8, 9])
@pytest.mark.parametrize("centre", ["pixel", "middle", "peak", "centroid"])
def test_the_chief_ray_of_odd_and_even_arrays(tmp_path, size, centre):
    """A disc about sample 3, 4: its middle is where it is said to be."""
    values = np.zeros((2, 2, size, size))
    values[..., 2:5, 3:6] = [[1, 2, 1], [2, 4, 2], [1, 2, 1]]
    camera = of_arrays(tmp_path, values, centre=centre, window=21)
    psf = psf_bank(camera, [550e-9], [0.5], dtype=torch.float64).values[0, 0]
    at = torch.arange(21, dtype=torch.float64) - 10
    middle = float((psf.sum(1) * at).sum()), float((psf.sum(0) * at).sum())
    chief = {"pixel": size // 2, "middle": (size - 1) / 2}.get(centre)
    expected = (0, 0) if chief is None else (3 - chief, 4 - chief)
    assert middle == pytest.approx(expected, abs=1e-9)


def test_what_is_not_said_is_asked_for(tmp_path):
    for key, said in (
        ("pixel_um", "pixel_um"),
        ("orientation", '"upright"'),
        ("centre", '"centroid"'),
        ("normalisation", '"sum"'),
        ("wavelengths_nm", "wavelengths_nm"),
        ("inverse_depths_per_m", "inverse_depths_per_m"),
    ):
        refused(tmp_path, letters(2, 2), "neither the file nor the recipe says", said, **{key: None})


def test_what_no_light_makes_is_named(tmp_path):
    values = letters(2, 2)
    values[1, 0, 2, 2] = np.nan
    refused(tmp_path, values, "NaN", "1m.500nm (1 samples)")
    values = letters(2, 2)
    refused(tmp_path, values, "sum to more than 1", "infinity.500nm (sum 12)", normalisation="light")
    values[0, 1] = 0
    refused(tmp_path, values, "hold no light", "infinity.600nm")
    values[0, 1] = F - 0.3
    refused(tmp_path, values, "below 0", "infinity.600nm")
    refused(tmp_path, letters(3, 2), "shape (3, 2, 7, 5)", "[1, 2, 2, y, x]")
    refused(tmp_path, letters(2, 2), "twice the same", wavelengths_nm=[500.0, 500.0])
    refused(tmp_path, letters(2, 2), "nanometres", wavelengths_nm=[0.5, 0.6])


def test_one_wavelength_is_that_wavelength_alone(tmp_path):
    one = {"wavelengths_nm": [550.0], "inverse_depths_per_m": [1.0]}
    camera = of_arrays(tmp_path, F, **one)
    assert float(psf_bank(camera, [550e-9], [1.0]).values.sum()) == pytest.approx(1)
    with pytest.raises(InputError, match="500 nm are asked for, and measured at 550 alone"):
        psf_bank(camera, [500e-9], [1.0])
    assert float(psf_bank(of_arrays(tmp_path, F, **one, **HELD), [500e-9], [0.0]).values.sum()) == 1


def test_files_say_themselves_what_they_hold(tmp_path):
    np.savez(tmp_path / "own.npz", values=letters(2, 2), **(SAID | {"depths_m": [np.inf, 1.0]}))
    camera = camera_of(tmp_path / "own.npz")
    assert camera.lens.problems() == []
    with pytest.raises(InputError, match="the recipe says pixel_um = 3"):
        camera_of(tmp_path / "own.npz", pixel_um=3.0)
    np.savez(tmp_path / "other.npz", psf=F)
    with pytest.raises(InputError, match="no array `values`.*it has psf"):
        camera_of(tmp_path / "other.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "own.npz").read_bytes()[:200])
    with pytest.raises(InputError, match="cannot be read as PSFs"):
        camera_of(tmp_path / "cut.npz")
    with pytest.raises(InputError, match="does not exist"):
        camera_of(tmp_path / "none.npz")


def test_files_of_isetcam(tmp_path):
    """psf [y, x, wavelength], nanometres and micrometres a sample, as `ieSaveSIDataFile` writes them."""
    path, at = tmp_path / "iset.mat", {"inverse_depths_per_m": [1.0]}
    psfs = np.stack([F, 2 * F[::-1]], -1)
    told = {"psf": psfs, "wave": np.array([[500.0], [600.0]]), "umPerSamp": np.array([[6.0, 6.0]])}
    savemat(path, told | {"notes": {"timeStamp": "today"}})
    camera = camera_of(path, window=9, orientation="upright", **at)
    for nm, wanted in ((500e-9, F), (600e-9, F[::-1])):
        psf = psf_bank(camera, [nm], [1.0]).values[0, 0]
        np.testing.assert_allclose(psf[1:8, 2:7], wanted / F.sum(), atol=1e-6)
    with pytest.raises(InputError, match="orientation"):
        camera_of(path, **at)
    savemat(path, told | {"umPerSamp": np.array([[6.0, 5.0]])})
    with pytest.raises(InputError, match="square samples"):
        camera_of(path, orientation="upright", **at)
    savemat(path, told | {"psf": "none"})
    with pytest.raises(InputError, match="cannot be read as PSFs"):
        camera_of(path, orientation="upright", **at)
    savemat(path, told | {"wave": np.array([500.0])})
    with pytest.raises(InputError, match="for 1 places in the field, 1 depths and 1 wavelengths"):
        camera_of(path, orientation="upright", **at)


def test_a_folder_of_pictures_and_planes_by_name(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    said = {key: SAID[key] for key in ("pixel_um", "orientation", "centre", "normalisation")}
    for name in ("0.5m_500nm", "inf_500nm", "0.5m_600nm", "inf_600nm"):
        (folder / f"{name}.png").write_bytes(png_bytes((F * 60000).astype(np.uint16)))
    (folder / "notes.txt").write_text("taken on a Friday")
    psf = psf_bank(camera_of(folder, window=9, **said), [500e-9], [2.0]).values[0, 0]
    np.testing.assert_allclose(psf[1:8, 2:7], F / F.sum(), atol=1e-6)
    (folder / "inf_600nm.png").unlink()
    with pytest.raises(InputError, match=r"gaps, 1 in all: infinity\.600nm"):
        camera_of(folder, **said)
    (folder / "inf_600nm.png").write_bytes(png_bytes(np.ones((4, 4), np.uint16)))
    with pytest.raises(InputError, match="2 sizes"):
        camera_of(folder, **said)
    write_exr(tmp_path / "rgb.exr", {"R": F, "G": F, "B": F}, {})
    with pytest.raises(InputError, match=r"no PSF by name.*B, G, R"):
        camera_of(tmp_path / "rgb.exr", **said)
    planes = {f"{field}0.5m.{nm}nm": F for field in ("", "10deg.") for nm in (500, 600)}
    write_exr(tmp_path / "planes.exr", planes, {})
    assert camera_of(tmp_path / "planes.exr", **said).lens.varies
    write_exr(tmp_path / "grid.exr", {f"{p},10deg.0.5m.500nm": F for p in (-5, 5)} | {"1m.500nm": F}, {})
    with pytest.raises(InputError, match="gaps"):
        camera_of(tmp_path / "grid.exr", **said)


def test_of_the_pupil_nothing_is_known(tmp_path):
    camera = of_arrays(tmp_path, letters(2, 2))
    with pytest.raises(InputError, match="nothing is known of its pupil"):
        strehl(camera, [550e-9], [0.5])
    with pytest.raises(InputError, match="nothing is known of its pupil"):
        list(sub_aperture_psfs(camera, [550e-9], [0.5], 3))
    with pytest.raises(InputError, match="what stood in the pupil: no mask can be added"):
        psf_bank(camera.with_height(torch.zeros(8, 8)), [550e-9], [0.5])
    lens = camera.recipe.lens
    with pytest.raises(InputError, match="leave out mask"):
        Camera.from_recipe(CameraRecipe(name="m", lens=lens, mask={"kind": "cubic"}), tmp_path)


def test_the_transfer_function_is_that_of_the_psf(tmp_path):
    """Of two samples side by side, |cos| of half of the phase between them."""
    values = np.zeros((2, 2, 4, 4))
    values[..., 2, 2:4] = 0.5
    camera = of_arrays(tmp_path, values)
    frequencies = torch.tensor([0.0, 2e4, 4e4, 8e4], dtype=torch.float64)
    across = mtf(camera, 550e-9, [0.5], frequencies)[0]
    torch.testing.assert_close(across, torch.cos(math.pi * frequencies * 6e-6).abs())
    torch.testing.assert_close(
        mtf(camera, 550e-9, [0.5], frequencies, angle_deg=90)[0], torch.ones(4).double()
    )


def test_a_file_that_changed_is_read_again(tmp_path):
    camera = of_arrays(tmp_path, letters(2, 2), window=9)
    before = psf_bank(camera, [550e-9], [0.5]).values
    np.save(tmp_path / "psfs.npy", letters(2, 2)[..., ::-1, :])
    assert not torch.equal(psf_bank(camera, [550e-9], [0.5]).values, before)
