"""Photos and images on disk: OpenEXR, linear, float32."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..core.colours import read_colours
from ..core.files import write_bytes
from ..core.images import exr_attribute, openexr, png_text, read_exr, write_exr
from ..core.json_values import Json
from ..core.notebook import COLOURS, picture_png
from ..errors import InputError

if TYPE_CHECKING:
    from .photo import Photo


def write_photo(path: Path, photo: Photo) -> Path:
    """The sensor image as R, G, B, with the noise-free (`clean.R`) and the ideal image (`ideal.R`),
    and the depth of each pixel along the axis in metres (`Z`, infinity is legal).

    Attributes: exposure, how the photo was made, and the matrix to sRGB (`colours`), as JSON.
    Raises what `core.files.whole` raises.
    """
    channels = (
        _channels(photo.image, "") | _channels(photo.clean, "clean.") | _channels(photo.ideal, "ideal.")
    )
    if photo.inverse_depth is not None:
        channels["Z"] = photo.inverse_depth.detach().cpu().float().reciprocal().numpy()
    truncated = photo.truncated.detach().cpu().tolist()
    said: dict[str, object] = {"how": photo.how.said(), "truncated": truncated}
    if photo.colours is not None:
        said["colours"] = photo.colours.tolist()
    texts = {name: json.dumps(value, sort_keys=True) for name, value in said.items()}
    return write_exr(path, channels, {"exposure": float(photo.exposure), **texts})


def read_photo(path: Path) -> Json:
    """What `write_photo` wrote, float32, by the fields of a `Photo`. Raises InputError for any other file."""
    planes = read_exr(path, "photo")
    try:
        with openexr().File(str(path), header_only=True) as file:
            header = file.header()
            found = {"exposure": float(header["exposure"]), "how": json.loads(header["how"])}
            found["truncated"] = torch.tensor(json.loads(header["truncated"]))
        images = {"image": "", "clean": "clean.", "ideal": "ideal."}
        found |= {name: _image_of(planes, prefix) for name, prefix in images.items()}
        depth = {"inverse_depth": torch.from_numpy(planes["Z"]).reciprocal()} if "Z" in planes else {}
        return {**found, **depth, "colours": read_colour_matrix(path)}
    except (KeyError, ValueError, TypeError):
        raise InputError(
            f"photo: {str(path)!r} is not one that edofsim saved, or of an older version; "
            "edofsim.read_image reads its picture"
        ) from None


def _image_of(planes: Mapping[str, np.ndarray], prefix: str) -> Tensor:
    names = "RGB" if f"{prefix}R" in planes else "Y"
    return torch.from_numpy(np.stack([planes[prefix + name] for name in names]))


def write_image(path: Path, image: Tensor) -> Path:
    """A linear image [3 or 1, y, x] as an OpenEXR file.

    image: [3 or 1, y, x], linear.
    path: ends in .exr.

    Raises what `core.files.whole` raises.
    """
    return write_exr(path, _channels(image, ""), {})


def save_image(path: str | Path, image: Tensor, colours: Tensor | None = None) -> Path:
    """Write a linear image. Returns the path.

    path: `.exr` keeps the sensor's linear values; `.png` is sRGB, full scale 1 white.
    image: linear, [3 or 1, y, x], full scale 1.
    colours: matrix [3, 3] from the sensor's colours to linear sRGB, for `.png`: `colours` of the photo; None
        leaves them as they are.
    Raises InputError for another suffix, and what `core.files.whole` raises.
    """
    path = Path(path)
    match path.suffix.lower():
        case ".exr":
            return write_image(path, image)
        case ".png":
            return write_bytes(path, picture_png(image, colours))
    raise InputError(f"{path}: images are written as .exr (linear) or .png (sRGB)")


def read_image(path: str | Path) -> Tensor:
    """Any image as linear [3, y, x] float32, upright.

    path: OpenEXR, PFM, Radiance and floats are taken as they are; PNG, JPEG, TIFF and their like are sRGB
        unless they say otherwise, and are decoded. A PNG file of a photo says how its colours were made, and
        becomes the sensor's again.

    Raises InputError for a file that is missing or no image.
    """
    image = read_colours(Path(path), "image").linear
    found = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1), np.float32))
    colours = read_colour_matrix(path) if Path(path).suffix.lower() == ".png" else None
    if colours is None:
        return found
    return (torch.linalg.inv(colours).to(found) @ found.flatten(1)).reshape(found.shape).clamp(0, 1)


def read_colour_matrix(path: str | Path) -> Tensor | None:
    """The matrix [3, 3] to linear sRGB that a photo's file (EXR, PNG) states; None where it states none.

    Raises InputError for a file that cannot be read, and for a matrix that is none.
    """
    stated = exr_attribute(Path(path), "colours") if Path(path).suffix.lower() == ".exr" else None
    if Path(path).suffix.lower() == ".png":
        stated = png_text(Path(path), COLOURS)
    if stated is None:
        return None
    try:
        matrix = torch.tensor(json.loads(stated), dtype=torch.float64)
        torch.linalg.inv(matrix.reshape(3, 3))
    except (ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"{path}: its colours are no matrix of 3 x 3: save the photo anew") from error
    return matrix.reshape(3, 3)


def _channels(image: Tensor, prefix: str) -> dict[str, np.ndarray]:
    names = "RGB" if image.shape[0] == 3 else "Y" if image.shape[0] == 1 else None
    if names is None:
        raise InputError(f"an image of {image.shape[0]} channels has no place in a file: 3 or 1 are needed")
    values = image.detach().cpu().float().numpy()
    return {prefix + name: plane for name, plane in zip(names, values, strict=True)}
