"""Photographs that the paper's experiments take: a folder of them, or those that come with scikit-image."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from ..learn.sources import Images, packaged_images, usable_pictures
from ..scene.charts import rasterise, usaf_chart

REACH_PX = 64
"""What a PSF of 128 pixels reaches: so far inside a picture its photo holds no light from beyond it."""
SMALLEST_PX = 2 * REACH_PX + 64
CHART_PX = 1024
CHART_GROUP, CHART_PAIRS = -2, 3


@dataclass(frozen=True)
class Photograph:
    """A picture: uint8 [3, y, x], its place among all files of its folder, and the SHA-256 of its pixels."""

    name: str
    pixels: Tensor
    place: int
    sha256: str

    @property
    def values(self) -> Tensor:
        """The 8-bit values as intensities, float32 in [0, 1]."""
        return self.pixels.to(torch.float32) / 255


@dataclass(frozen=True)
class Photographs:
    """Pictures that can be used, where they come from, and a sentence for each that cannot."""

    pictures: tuple[Photograph, ...]
    source: str
    problems: tuple[str, ...] = ()


def photographs(folder: Path | None, limit: int | None = None) -> Photographs:
    """The pictures of a folder, in the order of their names; None for those of scikit-image.

    limit: only this many, the first. Files that cannot be used are left out, and named in `problems`.

    Raises InputError for a folder that is missing, empty, or without a single picture that can be used.
    """
    if folder is None:
        images = packaged_images(SMALLEST_PX)
        every = [one(name, image, i) for i, (name, image) in enumerate(_named(images))]
        return Photographs(tuple(every[:limit]), "the photographs that come with scikit-image")
    names, images, problems = usable_pictures(folder, SMALLEST_PX, limit)
    if not images.names:
        raise InputError(problems)
    found = [one(name, image, names.index(name)) for name, image in _named(images)]
    return Photographs(tuple(found), str(folder), tuple(problems))


def chart(path: Path | None) -> Photograph:
    """A test chart: a picture file, or the USAF-1951 drawn from its standard, 1024 pixels wide.

    Raises InputError for a file that cannot be used."""
    if path is None:
        drawn = usaf_chart(CHART_GROUP, CHART_PAIRS)
        ink = rasterise(drawn, CHART_PX / drawn.width)
        grey = torch.from_numpy(255 * (1 - ink)).round().to(torch.uint8)
        return one("USAF-1951", grey.expand(3, -1, -1).contiguous(), 0)
    if not path.is_file():
        raise InputError(f"{path}: no such file; name a picture of a chart, or leave --chart away")
    names, images, problems = usable_pictures(path.parent, SMALLEST_PX, None, only=path.name)
    if problems or not images.names:
        raise InputError(problems or f"{path}: not a kind of picture that is read here")
    return one(path.stem, images.pictures[0], 0)


def one(name: str, pixels: Tensor, place: int) -> Photograph:
    """A photograph of uint8 pixels [3, y, x].

    pixels: [3, y, x], uint8.
    """
    return Photograph(name, pixels, place, hashlib.sha256(pixels.numpy().tobytes()).hexdigest())


def chosen(pictures: Sequence[Photograph], names: Sequence[str], count: int) -> tuple[str, ...]:
    """Names of the pictures to show: those asked for, else the first `count`. Raises InputError."""
    known = [picture.name for picture in pictures]
    wrong = [name for name in names if name not in known]
    if wrong:
        raise InputError(f"--show {wrong[0]}: no such picture; there are {', '.join(known[:12])}")
    return tuple(names) or tuple(known[:count])


def _named(images: Images) -> list[tuple[str, Tensor]]:
    return list(zip(images.names, images.pictures, strict=True))
