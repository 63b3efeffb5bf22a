"""Data sets from recipes: what they will take, how they begin, and what makes them whole."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from ..core.files import whole, write_text
from ..core.json_values import Json
from ..core.progress import Progress, part
from ..core.words import counted, duration
from ..errors import EdofsimError, InputError
from ..optics import Camera, psf_bank, response
from ..optics.nodes import nodes_between
from ..render.engine import thread_count
from ..render.jobs import Task
from ..render.jobs import forecast as views_forecast
from .kept import ABOUT, FILES, FORMAT, SUMS, Folder, blocks_of, needed, pack, write_sums
from .parts import Work

SECONDS_A_PHOTO, SECONDS_A_MEGAPIXEL = 0.5, 30.0
"""Of one core, for a planned photo: of any, and of what is photographed with its margin. A fixed fidelity of
few layers and one group of bands takes a tenth."""
BYTES_A_VALUE = {"half": 1.7, "float": 3.6}
"""Of images, a channel and pixel, as they are compressed."""
MOST_PSFS = 17
"""Depths at which a camera's PSFs are kept."""


@dataclass(frozen=True)
class DataForecast:
    """What making data will take.

    pairs: in all.
    there: of these.
    core_seconds: of one core.
    seconds: with `jobs` processes on this machine.
    bytes: of the finished data.
    working: of what is on the disk meanwhile as well.
    free: on the disk.
    """

    pairs: int
    there: int
    core_seconds: float
    seconds: float
    bytes: int
    working: int
    free: int

    def __str__(self) -> str:
        if self.there == self.pairs:
            return f"{counted(self.pairs, 'pair')}, all there"
        return (
            f"{counted(self.pairs, 'pair')}, {self.there} there: about {duration(self.seconds)} on this "
            f"machine, {self.core_seconds / 3600:.2g} core hours, {self.bytes / 2**20:.0f} MiB of data, "
            f"{self.working / 2**20:.0f} MiB of views meanwhile; {self.free / 2**30:.1f} GiB free (roughly)"
        )


def forecast(work: Work, folder: Folder, jobs: int = 1) -> DataForecast:
    """Time, bytes and core hours of what is not there yet."""
    recipe = work.recipe
    todo = [part for part in work.parts if not all(folder.has(key) for key in work.keys(part))]
    frames = [(frame, part) for part in todo for frame in work.frames(part)]
    different = {frame.model_dump_json(): Task(frame, part.scene.base) for frame, part in frames}
    views = views_forecast(list(different.values()), cache=folder.views, jobs=jobs)
    margin = max((frame.frame.margin_px for frame, _ in frames), default=0)
    size = (recipe.frame.width_px + 2 * margin) * (recipe.frame.height_px + 2 * margin)
    photo = SECONDS_A_PHOTO + SECONDS_A_MEGAPIXEL * size / 1e6
    photo *= 0.1 if recipe.photos.fidelity is not None else 1.0
    keys = [key for part in work.parts for key in work.keys(part)]
    planes = 9 + (6 if recipe.photos.rendering_noise else 0)
    values = planes * BYTES_A_VALUE[recipe.store.precision] + 4
    pixels = recipe.frame.width_px * recipe.frame.height_px
    core = views.seconds * thread_count() + len(frames) * photo
    kept = views.bytes if recipe.store.keep_views else 0
    working = views.bytes / max(1, len(different)) * jobs * max(1, len(frames) // max(1, len(todo)))
    seconds = core / min(thread_count(), max(jobs, 1) if len(frames) < views.views else thread_count())
    there = sum(folder.has(key) for key in keys)
    windows = sum(camera.recipe.psf.window_px**2 for camera in (*work.named, *work.drawn))
    size = int(len(keys) * pixels * values) + kept + 12 * MOST_PSFS * windows
    return DataForecast(len(keys), there, core, seconds, size, int(working), views.free)


def begun(work: Work, path: Path) -> Folder:
    """The folder that a recipe's pairs go into. Raises InputError for one that holds others, and where a
    package for the asked-for files is missing."""
    recipe = work.recipe
    if recipe.store.kind not in FILES:
        needed(recipe.store.kind)
    folder = Folder(path, blocks_of(work.ordered(), recipe.store.shard), recipe.store.keep_views)
    digest = work.digest()
    try:
        known = json.loads((path / ABOUT).read_text(encoding="utf-8")).get("digest")
    except FileNotFoundError:
        known = digest
    except (OSError, ValueError, AttributeError) as error:
        raise InputError(f"{path / ABOUT}: cannot be read ({error}); choose another --out") from None
    if known != digest:
        raise InputError(
            f"{path}: holds data of another recipe, or of another version of edofsim; choose another --out"
        )
    said: Json = {"format": FORMAT, "name": recipe.name, "digest": digest}
    said |= {
        "recipe": recipe.model_dump(mode="json"),
        "blocks": {k: len(v) for k, v in folder.blocks.items()},
    }
    write_text(path / ABOUT, json.dumps(said, indent=1, sort_keys=True) + "\n")
    return folder


def check_room(expected: DataForecast, path: Path) -> None:
    """Raise EdofsimError for a disk that is too small."""
    if expected.pairs > expected.there and expected.bytes + expected.working > expected.free:
        raise EdofsimError(f"The disk of {path} is too small for this: {expected}")


def finished(work: Work, folder: Folder, progress: Progress) -> Path | None:
    """Put the pairs together as the recipe says, with their cameras and checksums, once all are there.
    Returns the file of checksums; None where pairs are missing yet."""
    sums = folder.path / SUMS
    if sums.is_file():
        return sums
    if not all(folder.has(key) for keys in folder.blocks.values() for key in keys):
        return None
    for number, block in enumerate(folder.blocks):
        progress(0.8 * number / len(folder.blocks), f"putting together {block}")
        pack(folder, block, work.recipe.store.kind)
    lines = [line for block in folder.blocks for line in folder.index(block).read_text().splitlines()]
    metas = [json.loads(line) for line in lines]
    cameras = {camera.recipe.name: camera for camera in (*work.named, *work.drawn)}
    wavelengths = torch.as_tensor(work.parts[0].scene.recipe.bands.wavelengths()).double()
    for number, (name, camera) in enumerate(cameras.items()):
        ends = [end for meta in metas if meta["camera"] == name for end in meta["inverse_depths"]]
        if ends:
            part(progress, 0.8, 0.95)(number / len(cameras), f"PSFs of {name}")
            write_camera(folder.path / "cameras" / f"{name}.safetensors", camera, wavelengths, ends)
    if not folder.keep_views:
        shutil.rmtree(folder.views, ignore_errors=True)
    progress(0.95, "checksums")
    return write_sums(folder.path)


def write_camera(path: Path, camera: Camera, wavelengths: Tensor, ends: Sequence[float]) -> Path:
    """A camera's recipe, its given mask, and PSFs: `psfs` [depth, channel, y, x] of white points at
    `inverse_depths` [depth] in 1/m that stand for the range, for a lens that varies on its axis.

    wavelengths: [band], metres.
    """
    depths = nodes_between(camera, wavelengths, min(ends), max(ends), most=MOST_PSFS)
    bank = psf_bank(camera, wavelengths, depths)
    psfs = torch.einsum("cb,dbyx->dcyx", response(camera, wavelengths).to(bank.values), bank.values)
    tensors = {"psfs": psfs.float(), "inverse_depths": depths, "wavelengths": wavelengths}
    for name, given in (("height_map", camera.height_map), ("amplitude", camera.amplitude)):
        if given is not None:
            tensors[name] = given.detach().double()
    # one entry: safetensors writes several in a random order, and the same camera must have the same bytes
    said = {"recipe": camera.recipe.model_dump_json()}
    with whole(path) as temporary:
        save_file({name: value.contiguous() for name, value in tensors.items()}, temporary, said)
    return path


def figures_of(expected: DataForecast, spent: Sequence[Mapping[str, float]], path: Path) -> dict[str, float]:
    """What making came to, and what was forecast, as figures."""
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    found = {
        "pairs": expected.pairs,
        "pairs.made": expected.pairs - expected.there,
        "forecast.core_seconds": expected.core_seconds,
        "forecast.bytes": expected.bytes,
        "bytes": size,
    }
    for name in ("render", "photos"):
        found[f"core_seconds.{name}"] = sum(each.get(name, 0.0) for each in spent)
    return found
