"""Photographs in memory, and patches drawn from them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from skimage import data
from torch import Tensor

from ..core.images import mirrored
from ..errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
MAX_PIXELS = 100_000_000


@dataclass(frozen=True)
class Images:
    """Photographs, each [3, y, x] of 8 bits (uint8) or of full scale 1, with the SHA-256 over names and bytes
    of their files."""

    pictures: Sequence[Tensor]
    names: tuple[str, ...]
    sha256: str

    @cached_property
    def means(self) -> Tensor:
        """Of each picture, [picture, 3], from 0 to 1."""
        return torch.stack([_full_scale(picture).mean((-1, -2)) for picture in self.pictures])

    @cached_property
    def areas(self) -> Tensor:
        """Pixels of each picture, [picture]."""
        return torch.tensor([float(p.shape[-1] * p.shape[-2]) for p in self.pictures])

    def at(self, index: int) -> tuple[Tensor, Tensor]:
        """A picture, and its mean [3]."""
        return self.pictures[index], self.means[index]

    def some(self, indices: Sequence[int]) -> Images:
        """Those of these numbers."""
        pictures = tuple(self.pictures[i] for i in indices)
        return replace(self, pictures=pictures, names=tuple(self.names[i] for i in indices))


def read_folder(folder: Path, smallest: int) -> Images:
    """All pictures of a folder (not of the folders inside it).

    smallest: pixels that each side must have.

    Raises InputError for a missing or empty folder, and lists all pictures that cannot be read or are smaller
    than a patch.
    """
    _, images, problems = usable_pictures(folder, smallest)
    if problems:
        raise InputError(problems[:20] + ([f"and {len(problems) - 20} more"] if len(problems) > 20 else []))
    return images


def usable_pictures(
    folder: Path, smallest: int, limit: int | None = None, only: str | None = None
) -> tuple[tuple[str, ...], Images, list[str]]:
    """The names of all pictures of a folder, those that can be used, and a sentence for each that cannot.

    smallest: pixels that each side must have.
    limit: only this many files, the first.
    only: the one of that name.

    Raises InputError for a missing or empty folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name one with photographs, --data DIR")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    if not paths:
        kinds = ", ".join(SUFFIXES)
        raise InputError(f"{folder}: holds no pictures ({kinds}); name a folder with photographs")
    digest = hashlib.sha256()
    pictures: list[Tensor] = []
    names: list[str] = []
    problems: list[str] = []
    for path in [path for path in paths if only in (None, path.name)][:limit]:
        try:
            data = path.read_bytes()
            picture = _decode(path)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            problems.append(f"{path}: cannot be read as a picture ({error}); mend or remove it")
            continue
        if min(picture.shape[-2:]) < smallest:
            size = f"{picture.shape[-1]} x {picture.shape[-2]}"
            problems.append(
                f"{path}: {size} pixels are fewer than a patch of {smallest}; remove it or shrink patches"
            )
            continue
        digest.update(path.name.encode() + b"\0" + data)
        pictures.append(picture)
        names.append(path.name)
    images = Images(tuple(pictures), tuple(names), digest.hexdigest())
    return tuple(path.name for path in paths), images, problems


@lru_cache(4)
def packaged_images(smallest: int) -> Images:
    """The photographs that come inside scikit-image's package: nothing is downloaded.

    Raises InputError where a patch is larger than all of them.
    """

    digest = hashlib.sha256()
    pictures: list[Tensor] = []
    names: list[str] = []
    for name in ("astronaut", "chelsea", "coffee", "rocket", "brick", "grass", "gravel", "page", "text"):
        array = np.ascontiguousarray(getattr(data, name)())
        array = np.repeat(array[..., None], 3, axis=-1) if array.ndim == 2 else array[..., :3]
        if min(array.shape[:2]) >= smallest:
            digest.update(name.encode() + b"\0" + array.tobytes())
            pictures.append(torch.from_numpy(array.copy()).permute(2, 0, 1).contiguous())
            names.append(name)
    if not pictures:
        raise InputError(f"no picture of scikit-image holds a patch of {smallest} pixels; shrink patches")
    return Images(tuple(pictures), tuple(names), digest.hexdigest())


def split(images: Images, share: float, seed: int) -> tuple[Images, Images]:
    """(training, validation): whole pictures, at least one in each, chosen by the seed.

    Raises InputError for fewer than two pictures.
    """
    count = len(images.pictures)
    if count < 2:
        raise InputError("one picture cannot be split into training and validation; give at least two")
    order = torch.randperm(count, generator=torch.Generator().manual_seed(seed)).tolist()
    kept = min(max(1, round(share * count)), count - 1)
    return images.some(sorted(order[kept:])), images.some(sorted(order[:kept]))


def draw_patches(
    images: Images,
    count: int,
    patch: int,
    around: tuple[int, int],
    generator: torch.Generator,
    turned: bool = True,
) -> tuple[Tensor, Tensor, Tensor]:
    """Patches with their surroundings, [count, 3, patch + sum(around), ...], float32 in [0, 1], the means of
    the pictures that they are from, [count, 3], and where in these they are: [count, 2], pixels (right, up)
    from the middle of the picture, which is turned with the patch.

    A picture is chosen by its area, so that every place is as likely; patches are mirrored and turned at
    random, where `turned`. Where the surroundings leave the picture, its mirror image continues it.
    """
    chosen = torch.multinomial(images.areas, count, replacement=True, generator=generator).tolist()
    span = torch.arange(-around[0], patch + around[1])
    patches: list[Tensor] = []
    means: list[Tensor] = []
    places: list[tuple[float, float]] = []
    for index in chosen:
        picture, mean = images.at(index)
        rows, columns = picture.shape[-2:]
        top = int(torch.randint(rows - patch + 1, (), generator=generator))
        left = int(torch.randint(columns - patch + 1, (), generator=generator))
        cut = picture[:, mirrored(top + span, rows)][:, :, mirrored(left + span, columns)]
        turns = torch.randint(2, (3,), generator=generator).tolist() if turned else (0, 0, 0)
        cut = cut.transpose(-1, -2) if turns[0] else cut
        patches.append(cut.flip([axis for axis, turn in ((-2, turns[1]), (-1, turns[2])) if turn]))
        means.append(mean)
        away = [top + (patch - rows) / 2, left + (patch - columns) / 2]
        down, right = away[::-1] if turns[0] else away
        places.append((-right if turns[2] else right, down if turns[1] else -down))
    return _full_scale(torch.stack(patches)), torch.stack(means), torch.tensor(places)


def central_patches(
    images: Images, count: int, patch: int, around: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """The same `count` patches each time: the middles of pictures, evenly spaced through the list, the
    pictures' means, [count, 3], and places [count, 2] as of `draw_patches`: evenly spaced from the middle to
    a corner, as though the pictures were moved there."""
    span = torch.arange(-around[0], patch + around[1])
    patches: list[Tensor] = []
    means: list[Tensor] = []
    corners: list[list[float]] = []
    for index in range(count):
        picture, mean = images.at(index * len(images.pictures) // count % len(images.pictures))
        rows, columns = picture.shape[-2:]
        top, left = ((n - patch) // 2 for n in (rows, columns))
        patches.append(picture[:, mirrored(top + span, rows)][:, :, mirrored(left + span, columns)])
        means.append(mean)
        corners.append([(columns - patch) / 2, (rows - patch) / 2])
    places = torch.linspace(0, 1, count)[:, None] * torch.tensor(corners)
    return _full_scale(torch.stack(patches)), torch.stack(means), places


def _full_scale(patches: Tensor) -> Tensor:
    return patches.to(torch.float32) / 255 if patches.dtype == torch.uint8 else patches


def _decode(path: Path) -> Tensor:
    with Image.open(path) as image:
        if image.width * image.height > MAX_PIXELS:
            raise ValueError(f"{image.width} x {image.height} pixels are too many")
        array = np.array(image.convert("RGB"))
    return torch.from_numpy(array).permute(2, 0, 1).contiguous()
