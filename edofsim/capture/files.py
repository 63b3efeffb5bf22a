"""Photos and images on disk: OpenEXR, linear, float32."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from .photo import Photo

PNG_AND_JPEG = (".png", ".jpg", ".jpeg")


def write_photo(path: Path, photo: Photo) -> Path:
    """The sensor image as R, G, B, with the noise-free (`clean.R`) and the ideal image (`ideal.R`) beside it.

    Attributes: exposure, and how the photo was made as JSON. Raises OSError where it cannot be written.
    """
    channels = (
        _channels(photo.image, "") | _channels(photo.clean, "clean.") | _channels(photo.ideal, "ideal.")
    )
    how = json.dumps(dict(photo.how), sort_keys=True)
    return write_channels(path, channels, {"exposure": float(photo.exposure), "how": how})


def write_image(path: Path, image: Tensor) -> Path:
    """A linear image [3 or 1, y, x] as an OpenEXR file. Raises OSError where it cannot be written."""
    return write_channels(path, _channels(image, ""), {})


def read_image(path: Path) -> Tensor:
    """Any image as linear [3, y, x] float32: OpenEXR as it is; PNG and JPEG are sRGB and are decoded.

    Raises InputError for a file that is missing or no image.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.suffix.lower() == ".exr":
        return _read_exr(path)
    if path.suffix.lower() not in PNG_AND_JPEG:
        raise InputError(f"{path}: give an OpenEXR, PNG or JPEG image")
    from skimage import io

    try:
        pixels = np.asarray(io.imread(path))
    except Exception as error:  # the readers behind imread raise errors of many kinds
        raise InputError(f"{path}: not a readable image ({error})") from error
    if pixels.dtype not in (np.uint8, np.uint16) or pixels.ndim not in (2, 3):
        raise InputError(f"{path}: {pixels.dtype} pixels of shape {pixels.shape} are not a photograph")
    values = pixels.astype(np.float32) / np.iinfo(pixels.dtype).max
    values = np.repeat(values[..., None], 3, -1) if values.ndim == 2 else values
    values = np.repeat(values[..., :1], 3, -1) if values.shape[-1] < 3 else values[..., :3]
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return torch.from_numpy(np.ascontiguousarray(linear.transpose(2, 0, 1), dtype=np.float32))


def _read_exr(path: Path) -> Tensor:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {
                name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()
            }
    except Exception as error:  # OpenEXR raises RuntimeError and ValueError alike
        raise InputError(f"{path}: not a readable OpenEXR file ({error})") from error
    names = ["R", "G", "B"] if {"R", "G", "B"} <= set(channels) else ["Y"] * 3
    if names[0] not in channels:
        raise InputError(f"{path}: has the channels {', '.join(sorted(channels))}; R, G and B are needed")
    image = np.stack([channels[name] for name in names])
    if not np.isfinite(image).all():
        raise InputError(f"{path}: holds values that are NaN or infinite")
    return torch.from_numpy(image)


def _channels(image: Tensor, prefix: str) -> dict[str, np.ndarray]:
    names = "RGB" if image.shape[0] == 3 else "Y" if image.shape[0] == 1 else None
    if names is None:
        raise InputError(f"an image of {image.shape[0]} channels has no place in a file: 3 or 1 are needed")
    values = image.detach().cpu().float().numpy()
    return {prefix + name: np.ascontiguousarray(plane) for name, plane in zip(names, values, strict=True)}


def write_channels(path: Path, channels: dict[str, np.ndarray], attributes: dict[str, object]) -> Path:
    """Float32 planes [y, x] by name, with a header, as an OpenEXR file. Raises OSError where it cannot be."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        OpenEXR.File(header, channels).write(str(path))
    except RuntimeError as error:  # OpenEXR's own kind, with the system's reason in its text
        full = os.strerror(errno.ENOSPC) in str(error)
        raise OSError(errno.ENOSPC if full else errno.EIO, str(error), str(path)) from error
    return path
