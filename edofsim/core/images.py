"""Images as files, and the transfer curve of sRGB.

Arrays are [y, x, channel] or [y, x], row 0 the top. Every reader raises InputError that names the file and
what it is for.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import OpenEXR
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from ..errors import InputError, first_line
from .decoded import read_picture as read_picture
from .files import whole, write_bytes
from .limits import check_numbers as check_numbers
from .limits import check_pixels as check_pixels
from .limits import existing as existing

if TYPE_CHECKING:
    import OpenEXR
    from numpy.typing import ArrayLike
    from torch import Tensor


A = TypeVar("A", np.ndarray, "Tensor")


def srgb_encode(linear: A) -> A:
    """Transfer curve of sRGB (IEC 61966-2-1): linear in, encoded out, both clipped to [0, 1], same shape."""
    x = linear.clip(0, 1)
    low = x <= 0.0031308
    return low * (12.92 * x) + ~low * (1.055 * x.clip(0.0031308) ** (1 / 2.4) - 0.055)  # pyrefly: ignore


def developed(image: Tensor, colours: Tensor | None) -> Tensor:
    """A sensor's linear image [..., 3, y, x] in linear sRGB of the same shape; as it is without `colours`.

    image: [..., 3, y, x], linear, of the sensor.
    colours: [3, 3], matrix to linear sRGB, white balance included (`Photo.colours`). What exceeds full scale
        is clipped first, so that highlights stay white; images of one channel have no colours.
    """
    if colours is None or image.shape[-3] != 3:
        return image
    return (colours.to(image) @ image.clamp(max=1).flatten(-2)).reshape(image.shape)


def srgb_decode(encoded: A) -> A:
    """The inverse of `srgb_encode`: values in [0, 1] to linear ones, same shape. Values above 1 go on."""
    low = encoded <= 0.04045
    return low * (encoded / 12.92) + ~low * ((encoded.clip(0.04045) + 0.055) / 1.055) ** 2.4  # pyrefly: ignore


def unit_rgb(image: np.ndarray) -> np.ndarray:
    """A picture of any kind as three channels in [0, 1], float64 [y, x, 3]; transparency is painted white.

    image: [y, x], [y, x, 1], [y, x, 3] or [y, x, 4].

    Raises InputError for another shape than [y, x] or [y, x, 1 to 4].
    """
    image = np.asarray(image)
    if image.dtype == bool:
        image = image.astype(float)
    elif np.issubdtype(image.dtype, np.integer):
        image = image / np.iinfo(image.dtype).max
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3:
        raise InputError(f"a picture needs the shape [y, x] or [y, x, channel], not {image.shape}")
    if image.shape[2] in (2, 4):  # alpha: paint on white
        alpha = image[..., -1:]
        image = image[..., :-1] * alpha + (1 - alpha)
    if image.shape[2] not in (1, 3):
        raise InputError(
            f"a picture needs the shape [y, x, 1 to 4 channels], not {list(image.shape)}; one from "
            "`read_image` is [channel, y, x] and linear: give the file instead"
        )
    return np.clip(np.broadcast_to(image, (*image.shape[:2], 3)), 0, 1)


def png_bytes(pixels: np.ndarray, texts: Mapping[str, str] | None = None) -> bytes:
    """uint8 [y, x, 3] or uint16 [y, x] as a PNG file with `texts` in it; the same gives the same bytes.

    pixels: uint8 [y, x, 3] or uint16 [y, x].
    """
    about = PngInfo()
    for key, text in (texts or {}).items():
        about.add_text(key, text)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", pnginfo=about, compress_level=4)
    return buffer.getvalue()


def write_png(path: Path, image: ArrayLike) -> Path:
    """An image [3, y, x] of values as people see them, 1 is white, as PNG of 8 bits. Returns the path.

    image: [3, y, x].

    Values beyond [0, 1] are clipped, and NaN is black. Raises what `files.whole` raises.
    """
    values = np.nan_to_num(np.asarray(image).transpose(1, 2, 0)).clip(0, 1)
    return write_bytes(path, png_bytes((values * 255).round().astype(np.uint8)))


@lru_cache(maxsize=1)
def openexr() -> ModuleType:
    """The package OpenEXR, with all cores to unpack what it reads and pack what it writes; by itself it takes
    one."""

    OpenEXR.set_global_thread_count(os.cpu_count() or 1)
    return OpenEXR


def read_exr(path: Path, what: str) -> dict[str, np.ndarray]:
    """The channels of an OpenEXR file by name, each [y, x], of all its parts.

    Those of a further part whose name the file has already, or whose size differs from the first part's, are
    called PART.CHANNEL. Raises InputError.
    """
    return _read_exr(path, what)[0]


def exr_attribute(path: Path, name: str) -> str | None:
    """A text in the header of an OpenEXR file; None where it has none. Raises InputError."""
    existing(path, "image")
    try:
        with openexr().File(str(path), header_only=True) as file:
            found = file.parts[0].header.get(name)
    except Exception as error:  # OpenEXR raises its own kinds
        raise InputError(f"{str(path)!r} cannot be read as OpenEXR: {first_line(error)}") from error
    return found if isinstance(found, str) else None


def png_text(path: Path, key: str) -> str | None:
    """A text in a PNG file; None where it has none, or is no PNG. Raises InputError for a missing file."""
    existing(path, "image")
    try:
        with Image.open(path) as file:
            found = getattr(file, "text", {}).get(key)
    except (OSError, SyntaxError, ValueError):
        return None
    return found if isinstance(found, str) else None


def exr_chromaticities(path: Path, what: str) -> tuple[float, ...] | None:
    """(x, y) of red, green, blue and white that an OpenEXR file states; None where it states none."""
    return _read_exr(path, what, header_only=True)[1]


def _read_exr(
    path: Path, what: str, header_only: bool = False
) -> tuple[dict[str, np.ndarray], tuple[float, ...] | None]:
    existing(path, what)
    reader = openexr()
    try:
        with reader.File(str(path), header_only=True) as file:
            count = 0
            for part in file.parts:
                low, high = (np.asarray(corner, int) for corner in part.header["dataWindow"])
                columns, rows = (high - low + 1).tolist()
                check_pixels(rows, columns, path, what)
                count += rows * columns * len(part.header["channels"])
                if str(part.header["type"]).rpartition(".")[2].startswith("deep"):
                    raise InputError(f"{what}: {str(path)!r} is a deep OpenEXR file; save it flat")
            check_numbers((count,), path, what)
            stated = file.parts[0].header.get("chromaticities")
        if header_only:
            return {}, None if stated is None else tuple(float(value) for value in stated)
        found: dict[str, np.ndarray] = {}
        with reader.File(str(path), separate_channels=True) as file:
            for number, part in enumerate(file.parts):
                prefix = str(part.header.get("name") or f"part {number}")
                for name, channel in part.channels.items():
                    pixels = np.array(channel.pixels)
                    first = next(iter(found.values()), pixels)
                    other = name in found or pixels.shape != first.shape
                    found[f"{prefix}.{name}" if other else name] = pixels
        if not found:
            raise InputError(f"{what}: {str(path)!r} holds no channels; it is damaged")
        return found, None
    except InputError:
        raise
    except Exception as error:  # OpenEXR raises its own kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as OpenEXR: {first_line(error)}") from error


def exr_colours(path: Path, what: str, layer: str | None = None) -> tuple[np.ndarray, str]:
    """Linear colours of an OpenEXR file, float32 [y, x, 3], and the channels that they are.

    layer: what stands before `.R`; None for the channels R, G, B, else the only layer that has such, else the
        one called Combined, beauty or rgba, else Y as grey. A depth is never taken for colours.

    Raises InputError, which lists the channels.
    """
    channels = read_exr(path, what)
    layers: dict[str, dict[str, str]] = {}
    for name in channels:
        before, _, last = name.rpartition(".")
        layers.setdefault(before, {})[last.upper()] = name
    coloured = {name: planes for name, planes in layers.items() if {"R", "G", "B"} <= set(planes)}
    usual = [n for n in coloured if n.rpartition(".")[2].lower() in ("combined", "beauty", "rgba")]
    if layer is not None:
        chosen = layer if layer in coloured else None
    elif "" in coloured:
        chosen = ""
    elif len(coloured) == 1 or len(usual) == 1:
        chosen = (usual or list(coloured))[0]
    else:
        chosen = None
    if chosen is not None:
        names = [coloured[chosen][colour] for colour in "RGB"]
    elif layer is None and not coloured and "Y" in channels and not {"RY", "BY"} & set(channels):
        names = ["Y"] * 3
    else:
        advice = "name a layer" if coloured else "a depth alone is no picture"
        wanted = "R, G, B" if layer is None else f"{layer}.R, {layer}.G, {layer}.B"
        if len(coloured) > 1 and layer is None:
            wanted = "R, G, B outside its layers " + ", ".join(sorted(coloured))
        raise InputError(
            f"{what}: {str(path)!r} has no channels {wanted}; it has {', '.join(sorted(channels)[:24])}; "
            f"{advice}"
        )
    planes = [channels[name].astype(np.float32) for name in names]
    if len({plane.shape for plane in planes}) > 1:
        raise InputError(f"{what}: {str(path)!r} has channels of several sizes; save them with one")
    return np.stack(planes, axis=-1), ", ".join(dict.fromkeys(names))


def read_exr_rgb(path: Path, what: str) -> np.ndarray:
    """The linear colours of an OpenEXR file, see `exr_colours`, float32 [y, x, 3]."""
    return exr_colours(path, what)[0]


def write_exr(path: Path, channels: Mapping[str, np.ndarray], attributes: Mapping[str, object]) -> Path:
    """Write an OpenEXR file: float32, half where planes are float16. Returns the path.

    channels: planes [y, x] by name.

    Raises what `files.whole` raises.
    """
    writer = openexr()
    header = {"compression": writer.ZIP_COMPRESSION, "type": writer.scanlineimage, **attributes}
    halves = {name for name, plane in channels.items() if plane.dtype == np.float16}
    planes = {
        name: np.ascontiguousarray(plane, np.float16 if name in halves else np.float32)
        for name, plane in channels.items()
    }
    with whole(path) as temporary:
        save_exr(writer.File(header, planes), temporary)
    return path


def save_exr(file: OpenEXR.File, path: Path) -> None:
    """Write it there and then, and not as `files.whole` does. Raises OSError where that cannot be."""
    try:
        file.write(str(path))
    except RuntimeError as error:  # OpenEXR's own kind, for anything that goes wrong with the file
        raise OSError(first_line(error)) from error


def mirrored(index: A, size: int) -> A:
    """Integers, of NumPy or torch, as indices into an axis of `size` pixels that its mirror images continue;
    the border pixel is repeated: 0 1 2 2 1 0 0 1 for 0 to 7 and three pixels."""
    last = 2 * size - 1
    return (last - abs(2 * (index % (2 * size)) - last)) // 2  # pyrefly: ignore
