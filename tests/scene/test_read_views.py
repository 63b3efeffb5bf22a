"""Pictures with depths and spectral cubes as views."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from scipy.io import savemat
from skimage.io import imsave

from edofsim.errors import InputError
from edofsim.recipe import load_scene
from edofsim.recipe.scene import SceneRecipe
from edofsim.render.readers.pictures import picture_view
from edofsim.scene.spectra import illuminant

FRAME = {"width_px": 6, "height_px": 4, "margin_px": 2}


def recipe(source: dict, **more) -> SceneRecipe:
    return SceneRecipe.model_validate({"name": "own", "frame": FRAME, "source": source, **more})


def save_rgbd(folder: Path, rows: int = 8, columns: int = 10) -> dict:
    picture = np.random.default_rng(0).integers(0, 256, (rows, columns, 3), dtype=np.uint8)
    picture[0] = 255
    depth = np.linspace(0.5, 4, rows * columns).reshape(rows, columns)
    depth[-1 if rows < 8 else 3, 4] = np.nan
    imsave(folder / "a.png", picture, check_contrast=False)
    np.save(folder / "z.npy", depth)
    return {"kind": "rgbd", "image": "a.png", "depth": {"path": "z.npy"}}


def test_a_white_pixel_shines_as_the_illuminant(tmp_path: Path):
    source = save_rgbd(tmp_path)
    view = picture_view(recipe(source), tmp_path)
    white = view.all_in_focus()[:, 0]
    want = torch.from_numpy(illuminant("D65", view.wavelengths.numpy())).float()[:, None]
    torch.testing.assert_close(white, want.expand(-1, 10), rtol=1e-5, atol=1e-6)


def test_each_pixel_is_one_fragment_at_its_depth_and_the_holes_are_told(tmp_path: Path):
    view = picture_view(recipe(save_rgbd(tmp_path)), tmp_path)
    assert view.padded_shape == (8, 10) and view.bands == 31
    assert (view.coverage == 1).all() and not view.hidden.any()
    got = view.mean_inverse_depth().numpy()
    want = 1 / np.load(tmp_path / "z.npy")
    known = np.isfinite(want)
    np.testing.assert_allclose(got[known], want[known], rtol=1e-6)
    assert got[3, 4] == pytest.approx(min(want[3, 3], want[3, 5]), rel=1e-6)
    assert view.metadata["holes"] == pytest.approx(1 / 80)
    assert "missing" in view.metadata["hidden"]


def test_a_frame_in_the_middle_and_its_mirrored_border(tmp_path: Path):
    """A picture of the frame's own size: the margin is its mirror image, and the view says how much."""
    source = save_rgbd(tmp_path, 4, 6)
    view = picture_view(recipe({**source}), tmp_path)
    image = view.all_in_focus()
    torch.testing.assert_close(image[:, 1], image[:, 2])
    torch.testing.assert_close(image[:, :, 0], image[:, :, 3])
    assert view.metadata["beyond the border"].startswith("70.0%")  # 1 - 4 x 6 / (8 x 10)


def test_a_frame_larger_than_the_picture_is_refused(tmp_path: Path):
    source = save_rgbd(tmp_path, 3, 6)
    with pytest.raises(InputError, match="6 x 4 pixels, the picture only 6 x 3"):
        picture_view(recipe(source), tmp_path)


def test_a_depth_map_of_another_size_is_refused(tmp_path: Path):
    source = save_rgbd(tmp_path)
    np.save(tmp_path / "z.npy", np.ones((4, 5)))
    with pytest.raises(InputError, match="5 x 4 pixels, the picture 10 x 8"):
        picture_view(recipe(source), tmp_path)


BANDS = {"start_nm": 450, "stop_nm": 650, "count": 5}
NM = np.array([400.0, 500, 600, 700])
CUBE = np.random.default_rng(1).uniform(0.1, 1, (4, 8, 10))


def write_cube(folder: Path, kind: str) -> dict:
    if kind == "folder":
        (folder / "cube").mkdir()
        for i, band in enumerate(CUBE):
            imsave(
                folder / "cube" / f"b{i:02d}.png",
                np.round(band * 65535).astype(np.uint16),
                check_contrast=False,
            )
        return {"path": "cube", "start_nm": 400, "step_nm": 100}
    if kind == "mat":
        savemat(folder / "c.mat", {"data": {"values": CUBE.transpose(1, 2, 0)}, "wave": NM})
        return {"path": "c.mat", "key": "data.values"}
    channels = {f"S0.{int(nm)},000000nm": band.astype(np.float32) for nm, band in zip(NM, CUBE, strict=True)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(folder / "c.exr"))
    return {"path": "c.exr"}


@pytest.mark.parametrize("kind", ["folder", "mat", "exr"])
def test_cubes_of_every_format_are_interpolated_to_the_bands(tmp_path: Path, kind: str):
    """450 nm lies midway between 400 and 500, and so on."""
    source = {"kind": "cube", "depth_m": 0.8, "scale": 1.0, **write_cube(tmp_path, kind)}
    view = picture_view(recipe(source, bands=BANDS), tmp_path)
    image = view.all_in_focus().numpy()
    want = np.stack([CUBE[:2].mean(0), CUBE[1], CUBE[1:3].mean(0), CUBE[2], CUBE[2:].mean(0)])
    np.testing.assert_allclose(image, want, atol=2e-5)
    np.testing.assert_allclose(view.inverse_depth.numpy(), 1 / 0.8, rtol=1e-6)
    assert view.metadata["hidden"].startswith("none")


def test_packed_photons_are_unpacked(tmp_path: Path):
    """ISETCam stores u16 between dmin and dmax: value = u / 65535 (dmax - dmin) + dmin."""
    packed = np.full((8, 10, 4), 13107, np.uint16)  # a fifth of full scale
    savemat(tmp_path / "c.mat", {"data": {"photons": packed, "dmin": 2.0, "dmax": 7.0}, "wave": NM})
    source = {"kind": "cube", "path": "c.mat", "key": "data.photons", "depth_m": 1.0, "scale": 1.0}
    view = picture_view(recipe(source, bands=BANDS), tmp_path)
    np.testing.assert_allclose(view.radiance.numpy(), 3.0, rtol=1e-5)


def test_a_cropped_cube_takes_its_depths_along(tmp_path: Path):
    depth = np.linspace(1, 2, 80).reshape(8, 10)
    np.save(tmp_path / "z.npy", depth)
    source = {"kind": "cube", "crop": [2, 2, 2, 2], "depth": {"path": "z.npy"}, **write_cube(tmp_path, "mat")}
    frame = {"width_px": 6, "height_px": 4, "margin_px": 0}
    view = picture_view(recipe(source, bands=BANDS, frame=frame), tmp_path)
    np.testing.assert_allclose(view.mean_inverse_depth().numpy(), 1 / depth[2:-2, 2:-2], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"start_nm": 480, "step_nm": 100}, "480 to 780 nm, the recipe's bands from 450 to 650"),
        ({"path": "nothing"}, "there is no file or folder"),
        ({"key": "nope"}, "holds no 'nope'"),
        ({"crop": [5, 0, 5, 0]}, "nothing is left"),
    ],
)
def test_cubes_that_cannot_be_used_are_refused(tmp_path: Path, change: dict, complaint: str):
    source = {"kind": "cube", "depth_m": 0.8, **write_cube(tmp_path, "mat"), **change}
    with pytest.raises(InputError, match=complaint):
        picture_view(recipe(source, bands=BANDS), tmp_path)


def test_a_folder_without_wavelengths_is_asked_for_them(tmp_path: Path):
    source = {"kind": "cube", "depth_m": 0.8, "path": write_cube(tmp_path, "folder")["path"]}
    with pytest.raises(InputError, match="give start_nm and step_nm, or wavelengths_nm"):
        picture_view(recipe(source, bands=BANDS), tmp_path)


def test_the_motorcycle_has_its_published_geometry():
    """Middlebury 2014, calibration in skimage's docstring: depths 2.1 to 5.1 m, times 0.3; 7.3 % holes."""
    loaded = load_scene("motorcycle")
    view = picture_view(loaded.recipe, loaded.base)
    z = 1 / view.inverse_depth.numpy()
    assert z.min() >= 0.3 * 193.001e-3 * 994.978 / (59.91 + 31.086) and z.max() <= 0.3 * 5.1
    assert view.metadata["holes"] == pytest.approx(0.0735, abs=1e-3)
    assert view.metadata["beyond the border"] == "nothing is needed"
