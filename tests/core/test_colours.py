"""Pictures of other programs: upright, in sRGB, with their transparency, and linear where they hold floats.

What is right is known by how each file was made here, and by Pillow for what Exif means.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms

from edofsim.core.colours import colours_of, read_colours
from edofsim.core.images import srgb_decode, srgb_encode
from edofsim.errors import InputError

FIFTY = settings(
    max_examples=50,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
STORED_AS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}
"""How a camera stores an upright picture, by the orientation that it writes: the inverse of what shows it."""


def upright(seed: int, rows: int, columns: int, channels: int = 3) -> np.ndarray:
    picture = np.random.default_rng(seed).integers(0, 256, (rows, columns, channels), dtype=np.uint8)
    return picture if channels > 1 else picture[..., 0]


def stored(picture: np.ndarray, orientation: int) -> Image.Image:
    image = Image.fromarray(picture)
    return image.transpose(STORED_AS[orientation]) if orientation in STORED_AS else image


@FIFTY
@given(
    orientation=st.integers(1, 8),
    kind=st.sampled_from(["png", "jpg", "tif", "webp"]),
    seed=st.integers(0, 1000),
    size=st.tuples(st.integers(2, 5), st.integers(2, 5)),
)
def test_pictures_are_upright_whatever_the_camera_wrote(
    tmp_path: Path, orientation: int, kind: str, seed: int, size: tuple[int, int]
):
    rows, columns = (8 * side for side in size)
    picture = np.kron(upright(seed, *size), np.ones((8, 8, 1), np.uint8))  # even blocks survive JPEG
    image = stored(picture, orientation)
    about = Image.Exif()
    about[274] = orientation
    path = tmp_path / f"a.{kind}"
    image.save(path, exif=about, **({"quality": 98, "subsampling": 0} if kind == "jpg" else {}))
    read = read_colours(path, "picture")
    assert read.linear.shape == (rows, columns, 3)
    near = 12 if kind in ("jpg", "webp") else 0
    if kind != "webp":
        assert np.abs(srgb_encode(read.linear) * 255 - picture).max() <= near + 1e-6
    else:  # lossy colours: the turn alone
        assert np.abs(srgb_encode(read.linear) * 255 - picture).mean() < 40
    assert (orientation in STORED_AS) == any("upright" in phrase for phrase in read.assumed)


@FIFTY
@given(
    mode=st.sampled_from(["1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "I;16"]),
    kind=st.sampled_from(["png", "tif", "bmp"]),
    seed=st.integers(0, 1000),
)
def test_every_colour_mode_has_the_colours_that_a_viewer_shows(
    tmp_path: Path, mode: str, kind: str, seed: int
):
    colours = upright(seed, 5, 7)
    if mode == "I;16":
        image = Image.fromarray(upright(seed, 5, 7, 1).astype(np.uint16) * 257)
        want = np.repeat(upright(seed, 5, 7, 1)[..., None], 3, axis=2) / 255
    else:
        if mode in ("LA", "RGBA"):
            image = Image.fromarray(upright(seed, 5, 7, 4)).convert(mode)
        else:
            image = Image.fromarray(colours).convert(mode)
        page = Image.new("RGBA", image.size, "white")
        page.alpha_composite(image.convert("RGBA"))
        want = np.asarray(page.convert("RGB")) / 255
    path = tmp_path / f"a.{kind}"
    try:
        image.save(path)
    except (OSError, ValueError, KeyError):  # a format that has no such mode
        return
    if Image.open(path).mode != mode:
        return  # the format keeps it as another one
    got = srgb_encode(read_colours(path, "picture").linear)
    assert np.abs(got - want).max() < 2.1 / 255


def test_cmyk_jpegs_have_colours_and_not_white(tmp_path: Path):
    red = Image.new("RGB", (16, 16), (220, 30, 40)).convert("CMYK")
    red.save(tmp_path / "a.jpg", quality=98)
    got = srgb_encode(read_colours(tmp_path / "a.jpg", "picture").linear).mean((0, 1)) * 255
    assert np.abs(got - [220, 30, 40]).max() < 6


def test_colours_in_another_space_are_brought_to_srgb(tmp_path: Path):
    """Little CMS, which has its own arithmetic, turns sRGB to LAB and back through the profile."""
    colours = Image.fromarray(upright(3, 6, 6))
    lab = ImageCms.profileToProfile(
        colours, ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB"), outputMode="LAB"
    )
    assert lab is not None
    lab.save(
        tmp_path / "a.tif", icc_profile=ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    )
    read = read_colours(tmp_path / "a.tif", "picture")
    assert any("profile" in phrase for phrase in read.assumed)
    assert np.abs(srgb_encode(read.linear) * 255 - np.asarray(colours)).mean() < 4


def test_a_png_that_says_it_is_linear_is_taken_as_linear(tmp_path: Path):
    from PIL.PngImagePlugin import PngInfo

    about = PngInfo()
    about.add(b"gAMA", (100000).to_bytes(4, "big"))
    Image.new("L", (3, 3), 51).save(tmp_path / "a.png", pnginfo=about)
    assert read_colours(tmp_path / "a.png", "picture").linear == pytest.approx(0.2)


def save_exr(path: Path, *parts: dict[str, np.ndarray], **header: object) -> None:
    about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    made = [OpenEXR.Part(dict(about), dict(part), f"part{i}") for i, part in enumerate(parts)]
    OpenEXR.File(made).write(str(path))


@FIFTY
@given(
    layer=st.sampled_from(["", "ViewLayer.Combined.", "beauty."]),
    extra=st.sets(st.sampled_from(["Z", "A", "normal.X", "Depth.V", "albedo.R", "id"]), max_size=4),
    parts=st.booleans(),
    half=st.booleans(),
    seed=st.integers(0, 99),
)
def test_of_an_exr_the_colours_are_the_picture_and_never_the_depth(
    tmp_path: Path, layer: str, extra: set[str], parts: bool, half: bool, seed: int
):
    rng = np.random.default_rng(seed)
    kind = np.float16 if half else np.float32
    colours = {f"{layer}{c}": rng.uniform(0, 3, (4, 6)).astype(kind) for c in "RGB"}
    others = {name: rng.uniform(5, 9, (4, 6)).astype(np.float32) for name in extra}
    if parts and others:
        save_exr(tmp_path / "a.exr", others, colours)
    else:
        save_exr(tmp_path / "a.exr", {**others, **colours})
    got = read_colours(tmp_path / "a.exr", "picture").linear
    np.testing.assert_array_equal(got, np.stack([colours[f"{layer}{c}"] for c in "RGB"], -1))


def test_an_exr_of_depth_alone_or_of_several_layers_asks(tmp_path: Path):
    plane = np.ones((3, 3), np.float32)
    save_exr(tmp_path / "z.exr", {"Z": plane})
    with pytest.raises(InputError, match="a depth alone is no picture"):
        read_colours(tmp_path / "z.exr", "picture")
    two = {f"{layer}.{c}": plane * i for i, layer in enumerate(("left", "right")) for c in "RGB"}
    save_exr(tmp_path / "two.exr", two)
    with pytest.raises(InputError, match="left, right"):
        read_colours(tmp_path / "two.exr", "picture")
    assert read_colours(tmp_path / "two.exr", "picture", "right").linear == pytest.approx(1)


def test_wide_primaries_that_an_exr_states_are_brought_to_srgb(tmp_path: Path):
    """Grey stays grey, and Rec. 2020's red has less green than none in sRGB (ITU-R BT.2087: -0.1246)."""
    red = {
        "R": np.ones((1, 2), np.float32),
        "G": np.zeros((1, 2), np.float32),
        "B": np.zeros((1, 2), np.float32),
    }
    for plane in red.values():
        plane[0, 1] = 0.5
    wide = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    save_exr(tmp_path / "a.exr", red, chromaticities=wide)
    got = read_colours(tmp_path / "a.exr", "picture").linear[0]
    np.testing.assert_allclose(got[0], [1.6605, -0.1246, -0.0182], atol=2e-3)
    np.testing.assert_allclose(got[1], 0.5, atol=1e-3)


@FIFTY
@given(
    kind=st.sampled_from(["float32", "float64", "uint16", "uint8"]),
    planar=st.booleans(),
    seed=st.integers(0, 99),
)
def test_tiffs_of_floats_are_linear_and_those_of_whole_numbers_srgb(
    tmp_path: Path, kind: str, planar: bool, seed: int
):
    values = np.random.default_rng(seed).uniform(0, 1, (4, 5, 3))
    whole = kind.startswith("u")
    array = (values * np.iinfo(kind).max).astype(kind) if whole else values.astype(kind)
    data = array.transpose(2, 0, 1) if planar else array
    tifffile.imwrite(
        tmp_path / "a.tif", data, photometric="rgb", planarconfig="separate" if planar else "contig"
    )
    got = read_colours(tmp_path / "a.tif", "picture").linear
    want = srgb_decode(array / np.iinfo(kind).max) if whole else values
    np.testing.assert_allclose(got, want, atol=1e-6)


@pytest.mark.parametrize("scale", [255.0, 65535.0])
def test_floats_that_count_to_255_are_refused_with_the_way_out(scale: float):
    with pytest.raises(InputError, match=f"divide by {scale:.0f}"):
        colours_of(np.random.default_rng(0).uniform(0, scale, (5, 5, 3)))


def test_a_bomb_and_an_animation_are_refused(tmp_path: Path):
    Image.new("1", (20000, 20000)).save(tmp_path / "bomb.png")
    with pytest.raises(InputError, match="too many pixels to read"):
        read_colours(tmp_path / "bomb.png", "picture")
    frames = [Image.new("L", (4, 4), shade) for shade in (0, 255)]
    frames[0].save(tmp_path / "a.gif", save_all=True, append_images=frames[1:])
    with pytest.raises(InputError, match="holds 2 pictures"):
        read_colours(tmp_path / "a.gif", "picture")
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((3, 8, 8), np.uint8), photometric="minisblack")
    with pytest.raises(InputError, match="several pages"):
        read_colours(tmp_path / "a.tif", "picture")


def test_nothing_of_another_library_reaches_the_user(tmp_path: Path, capfd):
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, np.zeros((8, 8), np.uint8))
    for cut in range(10, len(buffer.getvalue()), 7):
        (tmp_path / "a.tif").write_bytes(buffer.getvalue()[:cut])
        with pytest.raises(InputError):
            read_colours(tmp_path / "a.tif", "picture")
    assert capfd.readouterr() == ("", "")
