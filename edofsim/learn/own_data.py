"""Training data given in Python: images of a PyTorch `Dataset`, or pairs of a photo and its ideal image."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, cast

import torch
from torch import Tensor
from torch.utils.data import DataLoader

from ..core.json_values import Json
from ..errors import InputError
from .photographs import VALIDATION_BATCH
from .sources import Images, central_patches, draw_patches
from .system import Captured, Scenes
from .training_camera import TrainingCamera


class Items(Protocol):
    """What is asked of a `Dataset`: its items by number, the same each time."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> object: ...


class ReadImages(Sequence[Tensor]):
    """Images of a `Dataset` as they are asked for, float32 [3, y, x], full scale 1; of pairs [6, y, x], the
    photo and the ideal image. An item is an image, a tuple that begins with one, or a pair."""

    def __init__(self, items: Items, numbers: Sequence[int], smallest: int) -> None:
        self.items, self.numbers, self.smallest = items, numbers, smallest

    def __len__(self) -> int:
        return len(self.numbers)

    # pyrefly: ignore[bad-override] - nobody asks for slices
    def __getitem__(self, place: int) -> Tensor:
        index = self.numbers[place]
        item = self.items[index]
        if isinstance(item, Sequence) and item:
            item = item[0]
        if isinstance(item, Mapping):
            item = torch.cat(
                [image_of(item.get(name), f"{name} of item {index}") for name in ("photo", "ideal")]
            )
        else:
            item = image_of(item, f"item {index}")
        if min(item.shape[-2:]) < self.smallest:
            size = f"{item.shape[-1]} x {item.shape[-2]}"
            raise InputError(f"data: item {index} has {size} pixels, fewer than a patch of {self.smallest}")
        return item


def image_of(item: object, name: str) -> Tensor:
    """An image [3, y, x] of full scale 1, float32. Raises InputError, calling it `name`, for what is none."""
    if not isinstance(item, Tensor) or item.ndim != 3 or len(item) != 3:
        found = list(item.shape) if isinstance(item, Tensor) else type(item).__name__
        raise InputError(f"data: {name} is {found}: give images as tensors [3, y, x]")
    image = item.to(torch.float32)
    return image / 255 if item.dtype == torch.uint8 else image


@dataclass(frozen=True)
class DatasetImages(Images):
    """Images of a `Dataset`, none of which is held; each is as likely."""

    @cached_property
    def areas(self) -> Tensor:
        return torch.ones(len(self.pictures))

    def at(self, index: int) -> tuple[Tensor, Tensor]:
        picture = self.pictures[index]
        return picture, picture.mean((-1, -2))

    def some(self, indices: Sequence[int]) -> DatasetImages:
        read = self.pictures
        assert isinstance(read, ReadImages)
        part = ReadImages(read.items, [read.numbers[i] for i in indices], read.smallest)
        return replace(self, pictures=part, names=tuple(self.names[i] for i in indices))


def dataset_images(data: object, smallest: int) -> DatasetImages:
    """Those of a `Dataset`, or of the one of a `DataLoader`. Raises InputError for what has no items by
    number."""
    items = data.dataset if isinstance(data, DataLoader) else data
    if not (hasattr(items, "__len__") and hasattr(items, "__getitem__")) or len(cast(Items, items)) == 0:
        raise InputError(
            f"data is a {type(data).__name__}: give a folder of pictures, or a torch Dataset that has len() "
            "and images [3, y, x] by number"
        )
    read = ReadImages(cast(Items, items), range(len(cast(Items, items))), smallest)
    digest = hashlib.sha256(f"{type(items).__name__} {len(read)}".encode())
    for index in (0, len(read) - 1):
        digest.update(read[index].contiguous().numpy().tobytes())
    return DatasetImages(read, tuple(map(str, range(len(read)))), digest.hexdigest())


@dataclass(frozen=True)
class StoredPairs:
    """Photos that were taken already, each with its ideal image: [batch, 6, y, x]."""

    pairs: Tensor

    def photograph(self, optics: TrainingCamera) -> Captured:
        photo, ideal = self.pairs.to(optics.device).split(3, 1)
        return Captured(photo, ideal.clamp_max(1), photo.new_zeros(()), noisy=True)

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        return self


@dataclass(frozen=True)
class PairSource:
    """Pairs, a part of them held back for validation."""

    training: Images
    held_back: Images
    patch: int
    described: Json
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        return StoredPairs(draw_patches(self.training, count, self.patch, (0, 0), generator, turned=False)[0])

    def validation(self, count: int) -> list[Scenes]:
        patches = central_patches(self.held_back, count, self.patch, (0, 0))[0]
        return [StoredPairs(part) for part in patches.split(VALIDATION_BATCH)]
