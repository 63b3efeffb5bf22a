"""Data sets as PyTorch reads them: by number (`Pairs`), or one after another (`PairStream`)."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from safetensors.torch import load_file
from torch import Tensor
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from ..core.json_values import Json
from ..errors import InputError
from .kept import about, needed, plain, read_sample

Pair: TypeAlias = dict[str, Tensor | str]
USUAL = ("photo", "ideal")
EDGES = "edges"
IMAGES = ("photo", "clean", "ideal", "noise.ideal", "noise.photo")
PLANES = (*IMAGES, "inverse_depth", "edge_px", EDGES)


class Pairs(Dataset[Pair]):
    """Pairs of a data set that `edofsim dataset make` made, whichever way it is kept.

    folder: the data set.
    split: `train`, `validation` or `test`.
    planes: what each pair holds: `photo`, `clean` (the photo without noise), `ideal` (all in focus), linear
        float32 [channel, y, x], full scale 1; `inverse_depth` [y, x] in 1/m; `edge_px` [y, x], distance from
        the nearest depth edge in pixels; `edges` [y, x], 1 where that is below 1.
    crop: side in pixels of a square part, at random where `augment`, else the middle; None: all of it.
    augment: whether parts are mirrored and turned, PSFs with them.
    turns: False: augmented parts are only moved. A network that is not given PSFs learns one camera so.
    psfs: whether pairs hold the camera's `psfs` [depth, channel, y, x] at `psf_depths` [depth] in 1/m.
    seed: of parts and turns; together with `epoch` it decides all of them, however many workers there are.

    Each pair is a dict; `key` and `camera` are its names, `metadata(i)` is all that is known of it. Raises
    InputError for a folder without such data, and for parts that do not fit into the images.
    """

    def __init__(
        self,
        folder: str | Path,
        split: str = "train",
        *,
        planes: Sequence[str] = USUAL,
        crop: int | None = None,
        augment: bool = False,
        turns: bool = True,
        psfs: bool = False,
        seed: int = 0,
    ) -> None:
        self.folder, self.split, self.planes = Path(folder), split, tuple(planes)
        self.crop, self.augment, self.turns = crop, augment, turns
        self.psfs, self.seed, self.epoch = psfs, seed, 0
        said = about(self.folder)
        self.recipe: Json = said["recipe"]
        self.metas: list[Json] = []
        blocks = [name for name in said["blocks"] if name.rsplit("-", 1)[0] == split]
        if not blocks:
            known = sorted({name.rsplit("-", 1)[0] for name in said["blocks"]})
            raise InputError(f"{folder}: has no split {split!r}; there are {', '.join(known)}")
        if wrong := [name for name in self.planes if name not in PLANES]:
            raise InputError(f"planes: there is no {wrong[0]!r}; there are {', '.join(PLANES)}")
        self.block_of: list[str] = []
        for block in blocks:
            path = self.folder / "index" / f"{block}.jsonl"
            if not path.is_file():
                raise InputError(f"{folder}: is not complete yet; repeat the command that makes it to resume")
            lines = path.read_text(encoding="utf-8").splitlines()
            self.metas += [json.loads(line) for line in lines]
            self.block_of += [block] * len(lines)
        frame = self.recipe["frame"]
        self.size = int(frame["height_px"]), int(frame["width_px"])
        if crop is not None and not 1 <= crop <= min(self.size):
            raise InputError(f"crop = {crop}: images are {self.size[1]} x {self.size[0]} pixels")

    def __len__(self) -> int:
        return len(self.metas)

    def metadata(self, number: int) -> Json:
        """What is known of a pair: scene, camera, exposure, seeds, fidelity, versions."""
        return self.metas[number]

    def camera(self, name: str) -> dict[str, Tensor]:
        """A camera's `psfs`, `inverse_depths`, `wavelengths` and, with a mask of its own, `height_map`."""
        return _camera(self.folder / "cameras" / f"{name}.safetensors")

    def __getitem__(self, index: int) -> Pair:
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        number = index % len(self)
        meta, read = self.metas[number], self._reader(number)
        rows, columns, turn = self._part(number)
        found: Pair = {"key": str(meta["key"]), "camera": str(meta["camera"])}
        for name in self.planes:
            values = read("edge_px" if name == EDGES else name)[..., rows, columns]
            plane = torch.from_numpy(np.array(values, np.float32))
            found[name] = turned((plane < 1).float() if name == EDGES else plane, turn)
        if self.psfs:
            known = self.camera(str(meta["camera"]))
            found["psfs"] = turned(known["psfs"], turn, centred=True)
            found["psf_depths"] = known["inverse_depths"]
        return found

    def _part(self, number: int) -> tuple[slice, slice, int]:
        """Rows and columns of a part, and how it is turned."""
        height, width = self.size
        rng = np.random.default_rng([self.seed, self.epoch, number])
        down, right = rng.random(2) if self.augment else (0.5, 0.5)
        square = self.crop is not None or height == width
        turn = int(rng.integers(8 if square else 4)) if self.augment and self.turns else 0
        if self.crop is None:
            return slice(None), slice(None), turn
        top, left = (int(p * (some - self.crop + 1)) for p, some in ((down, height), (right, width)))
        return slice(top, top + self.crop), slice(left, left + self.crop), turn

    def _reader(self, number: int) -> Callable[[str], np.ndarray]:
        """What gives a plane of a pair. Raises InputError for one that is not kept."""
        meta, block = self.metas[number], self.block_of[number]
        match self.recipe["store"]["kind"]:
            case "folder" | "png":
                every = read_sample(self.folder / "samples" / f"{meta['key']}.exr")[0]
            case "webdataset":
                every = _Tar(self.folder / f"{block}.tar", str(meta["key"]))
            case _:
                every = _Zarr(self.folder / "pairs.zarr", self.split, number)

        def plane(name: str) -> np.ndarray:
            try:
                return every[name]
            except KeyError:
                raise InputError(f"{self.folder}: its pairs hold no {name}") from None

        return plane


class PairStream(IterableDataset[Pair]):
    """The pairs of a `Pairs`, one after another, each worker of a loader its share.

    shuffled: in another order each time, by the seed and `epoch` of the pairs. Blocks of pairs that are kept
    in one file follow each other, in any order.
    """

    def __init__(self, pairs: Pairs, *, shuffled: bool = True) -> None:
        self.pairs, self.shuffled = pairs, shuffled

    def __iter__(self) -> Iterator[Pair]:
        info = get_worker_info()
        count, mine = (1, 0) if info is None else (info.num_workers, info.id)
        rng = np.random.default_rng([self.pairs.seed, self.pairs.epoch])
        blocks = {
            block: np.flatnonzero(np.array(self.pairs.block_of) == block) for block in self.pairs.block_of
        }
        names = list(blocks)
        order = [names[k] for k in rng.permutation(len(names))] if self.shuffled else names
        every = [
            i for name in order for i in (rng.permutation(blocks[name]) if self.shuffled else blocks[name])
        ]
        for number in every[mine::count]:
            yield self.pairs[int(number)]


def turned(image: Tensor, turn: int, *, centred: bool = False) -> Tensor:
    """An image [.., y, x] mirrored along x (bit 0 of `turn`) and y (bit 1), and its axes exchanged (bit 2).

    image: [..., y, x].
    centred: of a PSF, whose middle, index n // 2, stays where it is: the mirror image of a photo is then the
        photo of the mirrored scene by the mirrored PSF. Of a window with an even side the first row and
        column have no mirror image within it, and stay.
    """
    for bit, axis in ((1, -1), (2, -2)):
        if turn & bit:
            image = image.flip(axis)
            if centred and image.shape[axis] % 2 == 0:
                image = image.roll(1, axis)
    return image.transpose(-1, -2).contiguous() if turn & 4 else image


class _Tar:
    """Planes of a pair in a tar file, by name."""

    def __init__(self, path: Path, key: str) -> None:
        self.path, self.key = path, key

    def __getitem__(self, name: str) -> np.ndarray:
        offset, size = _members(self.path)[f"{self.key}.{plain(name)}.npy"]
        with self.path.open("rb") as file:
            file.seek(offset)
            return np.load(io.BytesIO(file.read(size)), allow_pickle=False)


@lru_cache(maxsize=256)
def _members(path: Path) -> dict[str, tuple[int, int]]:
    """Where the files of a tar file begin, and their sizes. Raises InputError."""
    try:
        with tarfile.open(path) as tar:
            return {each.name: (each.offset_data, each.size) for each in tar.getmembers()}
    except (OSError, tarfile.TarError) as error:
        raise InputError(f"{path}: cannot be read ({error}); see edofsim dataset verify") from None


class _Zarr:
    """Planes of a pair in a Zarr group, by name."""

    def __init__(self, path: Path, split: str, number: int) -> None:
        self.path, self.split, self.number = path, split, number

    def __getitem__(self, name: str) -> np.ndarray:
        place = f"{self.split}/{plain(name)}"
        if not (self.path / place / "zarr.json").is_file():
            raise KeyError(name)
        array = needed("zarr").open_array(needed("zarr").storage.LocalStore(self.path), path=place, mode="r")
        return np.asarray(array[self.number])


@lru_cache(maxsize=64)
def _camera(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise InputError(f"{path}: missing; see edofsim dataset verify")
    return load_file(path)
