"""Where the pairs of a data set are: one OpenEXR file each while it is made, then as the recipe says.

DIR/dataset.json says which recipe and code made it, DIR/samples/KEY.exr holds a pair, and DIR/index has a
file for each block of pairs that is complete, with a line of metadata a pair. DIR/cameras has the cameras and
their PSFs. DIR/checksums.json is written last.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

import numpy as np

from ..core.files import whole, write_text
from ..core.images import openexr, read_exr, srgb_encode, write_exr, write_png
from ..core.json_values import Json
from ..errors import InputError
from ..recipe.dataset import Split

ABOUT, SUMS = "dataset.json", "checksums.json"
FORMAT = 1
"""Of the files of a data set: another one is refused."""
UNCHECKED = (".json", ".lock", ".partial")
"""Endings in the folder of views that say when and where they were rendered."""
Planes: TypeAlias = dict[str, np.ndarray]


@dataclass(frozen=True)
class Folder:
    """A data set's folder.

    blocks: which pairs are kept together, by the block's name.
    keep_views: whether rendered views belong to it.
    """

    path: Path
    blocks: Mapping[str, Sequence[str]]
    keep_views: bool = False

    @property
    def views(self) -> Path:
        """The cache of its rendered views."""
        return self.path / ("views" if self.keep_views else ".views")

    @cached_property
    def _block_of(self) -> dict[str, str]:
        return {key: name for name, keys in self.blocks.items() for key in keys}

    def sample(self, key: str) -> Path:
        """The file of a pair."""
        return self.path / "samples" / f"{key}.exr"

    def index(self, block: str) -> Path:
        """What says that a block is complete."""
        return self.path / "index" / f"{block}.jsonl"

    def has(self, key: str) -> bool:
        """Whether a pair is there, by itself or in its block."""
        return self.sample(key).is_file() or self.index(self._block_of[key]).is_file()

    def write(self, key: str, planes: Planes, meta: Json, kind: type[np.floating]) -> None:
        """A pair: images [channel, y, x] and planes [y, x] by name.

        kind: of the images' numbers.
        """
        channels: Planes = {}
        for name, values in planes.items():
            if values.ndim == 3:
                names = [f"{name}.{colour}" for colour in "RGB"[: len(values)]]
                channels |= dict(zip(names, values.astype(kind), strict=True))
        channels["Z"] = 1 / np.maximum(planes["inverse_depth"].astype(np.float32), np.float32(1e-30))
        channels["edge_px"] = np.minimum(planes["edge_px"], 60000).astype(np.float16)
        write_exr(self.sample(key), channels, {"edofsim": json.dumps(meta, sort_keys=True)})


def blocks_of(ordered: Mapping[Split, Sequence[str]], count: int) -> dict[str, Sequence[str]]:
    """Blocks of `count` pairs of one split, by name."""
    return {
        f"{split}-{number:06d}": keys[number * count : (number + 1) * count]
        for split, keys in ordered.items()
        for number in range(-(-len(keys) // count))
    }


def read_sample(path: Path) -> tuple[Planes, Json]:
    """A pair's planes and what is known of it. Raises InputError for a file that is none."""
    channels = read_exr(path, "pair")
    try:
        with openexr().File(str(path), header_only=True) as file:
            meta = json.loads(file.header()["edofsim"])
        planes: Planes = {}
        for name in sorted({each.rpartition(".")[0] for each in channels} - {""}):
            planes[name] = np.stack([channels[f"{name}.{c}"] for c in "RGB" if f"{name}.{c}" in channels])
        planes["inverse_depth"] = 1 / channels["Z"]
        planes["edge_px"] = channels["edge_px"]
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is no pair of a data set ({error}); make it again") from None
    return planes, meta


Pack: TypeAlias = Callable[[Folder, str, Sequence[tuple[str, Planes, Json]]], None]


def pack_folder(folder: Folder, block: str, pairs: Sequence[tuple[str, Planes, Json]]) -> None:
    """Leave the pairs as they are."""


def pack_png(folder: Folder, block: str, pairs: Sequence[tuple[str, Planes, Json]]) -> None:
    """Pictures of the pairs in addition, as loaders of image restoration read them: png/SPLIT/photo/KEY.png
    and png/SPLIT/ideal/KEY.png, 8 bits, sRGB, in the sensor's colours."""
    for key, planes, _ in pairs:
        for name in ("photo", "ideal"):
            place = folder.path / "png" / block.rsplit("-", 1)[0] / name / f"{key}.png"
            write_png(place, srgb_encode(planes[name].astype(np.float32)))


def pack_tar(folder: Folder, block: str, pairs: Sequence[tuple[str, Planes, Json]]) -> None:
    """A tar file as WebDataset reads it: KEY.photo.npy, KEY.ideal.npy, ..., KEY.json."""
    webdataset = needed("webdataset")
    how = {"user": "", "group": "", "mtime": 0.0, "encoder": False}
    with (
        whole(folder.path / f"{block}.tar") as temporary,
        temporary.open("wb") as file,
        webdataset.TarWriter(file, **how) as tar,
    ):
        for key, planes, meta in pairs:
            arrays = {f"{plain(name)}.npy": _npy(values) for name, values in planes.items()}
            tar.write({"__key__": key, **arrays, "json": json.dumps(meta, sort_keys=True).encode()})


def plain(name: str) -> str:
    """The name of a plane without dots, as files of tars and arrays have it."""
    return name.replace(".", "-")


def _npy(values: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(values))
    return buffer.getvalue()


def pack_zarr(folder: Folder, block: str, pairs: Sequence[tuple[str, Planes, Json]]) -> None:
    """A part of the group pairs.zarr/SPLIT: an array a plane, [pair, ..], a file of it a block."""
    zarr = needed("zarr")
    split, number = block.rsplit("-", 1)
    total = sum(len(keys) for name, keys in folder.blocks.items() if name.rsplit("-", 1)[0] == split)
    most = max(len(keys) for keys in folder.blocks.values())
    store = zarr.storage.LocalStore(folder.path / "pairs.zarr")
    zarr.open_group(store, mode="a")
    zarr.open_group(store, path=split, mode="a")
    for name in pairs[0][1]:
        stack = np.stack([planes[name] for _, planes, _ in pairs])
        place, shape = f"{split}/{plain(name)}", (total, *stack.shape[1:])
        if (folder.path / "pairs.zarr" / place / "zarr.json").is_file():
            array = zarr.open_array(store, path=place, mode="r+")
        else:
            chunks, shards = (1, *stack.shape[1:]), (most, *stack.shape[1:])
            how = {"chunks": chunks, "shards": shards, "dtype": stack.dtype}
            array = zarr.create_array(store, name=place, shape=shape, **how)
        first = int(number) * most
        array[first : first + len(pairs)] = stack


FILES = ("folder", "png")
"""Kinds whose pairs stay files of their own."""
PACKS: Mapping[str, Pack] = {
    "folder": pack_folder, "png": pack_png, "webdataset": pack_tar, "zarr": pack_zarr
}  # fmt: skip


def needed(name: str) -> ModuleType:
    """A package of the extra `data`. Raises InputError where it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(f"this needs {name}: pip install 'edofsim[data]'") from error


def pack(folder: Folder, block: str, kind: str) -> None:
    """Put the pairs of a block together, and say that it is complete."""
    if folder.index(block).is_file():
        return
    keys = folder.blocks[block]
    pairs = [(key, *read_sample(folder.sample(key))) for key in keys]
    PACKS[kind](folder, block, pairs)
    lines = [json.dumps(meta, sort_keys=True) for _, _, meta in pairs]
    write_text(folder.index(block), "\n".join(lines) + "\n")
    if kind not in FILES:
        for key in keys:
            with suppress(FileNotFoundError):
                folder.sample(key).unlink()


def files_of(path: Path) -> Iterator[Path]:
    """All files that belong to a data set, but what says when and where its views were rendered."""
    for file in sorted(path.rglob("*")):
        inner = file.relative_to(path)
        hidden = any(name.startswith(".") for name in inner.parts)
        of_views = inner.parts[0] == "views" and file.suffix in UNCHECKED
        if file.is_file() and not hidden and not of_views and str(inner) != SUMS:
            yield file


def write_sums(path: Path) -> Path:
    """SHA-256 and size of every file."""
    sums = {str(file.relative_to(path)): [_sha256(file), file.stat().st_size] for file in files_of(path)}
    return write_text(path / SUMS, json.dumps(sums, indent=0, sort_keys=True) + "\n")


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def problems_of(path: Path) -> tuple[int, list[str]]:
    """How many files are as they were written, and a sentence for each that is damaged, missing or extra.
    Raises InputError for a folder without checksums."""
    about(path)
    try:
        sums = json.loads((path / SUMS).read_text(encoding="utf-8"))
        wanted = {str(name): str(entry[0]) for name, entry in sums.items()}
    except FileNotFoundError:
        raise InputError(f"{path}: is not complete yet; repeat the command that makes it to resume") from None
    except (OSError, ValueError, AttributeError, IndexError, TypeError) as error:
        raise InputError(f"{path / SUMS}: cannot be read ({error}); get or make the data again") from None
    there = {str(file.relative_to(path)): file for file in files_of(path)}
    problems = [f"{path / name}: missing" for name in sorted(wanted.keys() - there.keys())]
    problems += [
        f"{path / name}: extra, no file of these data" for name in sorted(there.keys() - wanted.keys())
    ]
    damaged = [name for name in sorted(wanted.keys() & there.keys()) if _sha256(there[name]) != wanted[name]]
    problems += [f"{path / name}: damaged, its checksum differs" for name in damaged]
    return len(wanted.keys() & there.keys()) - len(damaged), problems


def about(path: Path) -> Json:
    """What a data set says of itself. Raises InputError for a folder that holds none, or one of another
    version."""
    try:
        found = json.loads((path / ABOUT).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path}: holds no data set (no {ABOUT}); make one with edofsim dataset make"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path / ABOUT}: cannot be read ({error}); get or make the data again") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"{path}: a data set of another version of edofsim than this, which reads {FORMAT}")
    return found
