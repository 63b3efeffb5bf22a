"""A restoration of the user's own: a Python function from a photo to a sharp image.

It is named `module:function`, or `file.py:function` for one that is in no package, and is called as

    image = function(photo, psfs, info)

photo: float32 tensor [channel, y, x], linear, full scale 1. psfs: float32 tensor [depth, channel, y, x], what
the sensor sees of white points at `info.inverse_depths`, each the fraction of the light in each pixel,
centred at index n // 2. info: see `PhotoInfo`. It returns the sharp image, a tensor or an array
[channel, y, x], which is clamped to [0, 1] before it is scored. What it is given are copies; gradients may be
computed.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import cast

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError, first_line
from ..optics import Camera

HOW = "def NAME(photo, psfs, info) returns the sharp image, [channel, y, x] as the photo"


@dataclass(frozen=True)
class PhotoInfo:
    """What a function knows of a photo in addition to its PSFs.

    camera: with its mask as designed.
    wavelengths: [band] in metres.
    inverse_depths: [depth] in 1/m, ascending, that stand for the range.
    noise: standard deviation, relative to full scale.
    glare: [channel], the part of the light that is spread evenly over the photo.
    inverse_depth: [y, x] in 1/m, the true distances. No photo tells these: whoever uses them has a baseline
        that knows depth.
    """

    camera: Camera
    wavelengths: Tensor
    inverse_depths: Tensor
    noise: float
    glare: Tensor
    inverse_depth: Tensor


@dataclass(frozen=True)
class OwnFunction:
    """A function of the user's.

    name: in figures.
    source: as typed.
    digest: SHA-256 of its file and name.
    """

    name: str
    source: str
    digest: str
    call: Callable[[Tensor, Tensor, PhotoInfo], object]

    def __call__(self, photo: Tensor, psfs: Tensor, info: PhotoInfo) -> Tensor:
        """The image [channel, y, x] in [0, 1], like the photo. Raises InputError where the function fails, or
        returns anything else."""
        with torch.inference_mode(False), torch.enable_grad():
            try:
                found = self.call(photo.detach().clone(), psfs.detach().clone().to(photo), info)
            except (Exception, SystemExit) as error:
                raise InputError(f"{self.source}: raised {_said(error)}") from error
        return self._checked(found, photo)

    def _checked(self, found: object, photo: Tensor) -> Tensor:
        if not isinstance(found, Tensor | np.ndarray):
            raise self._wrong(f"{type(found).__name__}, not a tensor or an array")
        image = torch.as_tensor(found).detach()
        if image.shape != photo.shape:
            raise self._wrong(f"the shape {list(image.shape)} for a photo of {list(photo.shape)}")
        if image.is_complex():
            raise self._wrong("complex values")
        image = image.to(photo)
        if not torch.isfinite(image).all():
            raise self._wrong("values that are NaN or infinite")
        return image.clamp(0, 1)

    def _wrong(self, what: str) -> InputError:
        return InputError(f"{self.source}: returned {what}; {HOW}")


def names_function(source: str) -> bool:
    """Whether a text is of the form `module:function` or `file.py:function`."""
    place, colon, name = source.rpartition(":")
    return bool(colon and place) and name.isidentifier() and not Path(source).exists()


def load_function(source: str) -> OwnFunction:
    """A function by `module:function` or `file.py:function`; modules are looked for in the working folder,
    too. Raises InputError where there is none."""
    place, _, name = source.rpartition(":")
    module = _from_file(Path(place), source) if place.endswith(".py") else _from_package(place, source)
    found = getattr(module, name, None)
    if not callable(found):
        known = ", ".join(key for key, value in vars(module).items() if callable(value) and key[0] != "_")
        raise InputError(f"{source}: no function {name!r} there; there are: {known or 'none'}")
    file = getattr(module, "__file__", None)
    if file is None:
        raise InputError(f"{source}: no Python file has this module; name a function in a file: {HOW}")
    digest = hashlib.sha256(Path(file).read_bytes() + name.encode()).hexdigest()
    return OwnFunction(name, source, digest, cast("Callable[[Tensor, Tensor, PhotoInfo], object]", found))


def _from_file(path: Path, source: str) -> ModuleType:
    if not path.is_file():
        raise InputError(f"{source}: no such file: {path}")
    spec = importlib.util.spec_from_file_location(f"edofsim_own_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # of a file that ends in .py
    module, loader = importlib.util.module_from_spec(spec), spec.loader
    _imported(lambda: loader.exec_module(module), path.resolve().parent, source)
    return module


def _from_package(name: str, source: str) -> ModuleType:
    _imported(lambda: importlib.import_module(name), Path.cwd(), source)
    return sys.modules[name]


def _imported(load: Callable[[], object], folder: Path, source: str) -> None:
    """Import; modules in the folder are found too, also by what a function imports when it is called."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        load()
    except (Exception, SystemExit) as error:
        raise InputError(f"{source}: cannot be imported: {_said(error)}") from error


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {first_line(error)}"
