"""Who enters a benchmark: a restoration, an optics, both, or a folder of restored images."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Literal

from torch import Tensor

from ..capture.files import read_image
from ..errors import InputError
from ..experiments.restorations import ByFunction, ByNetwork, Known
from ..experiments.sources import Source, one_of_each, system_of
from ..optics import Camera
from ..recipe.load import load_camera
from ..restore.checkpoint import ANY_CAMERA

Track = Literal["restoration", "optics", "joint"]
OPTICS = "optics:"
SHIPPED = (
    "paper-clear+photo", "paper-cubic+wiener", "rings-dcnn", "fourier-wiener", "zernike-wiener", "levin-dcnn",
    "paper-dcnn", "paper-bank", "photo", "wiener", ANY_CAMERA, f"{OPTICS}paper-clear", f"{OPTICS}paper-cubic",
)  # fmt: skip
"""What is scored where nothing else is named, with `OF_DEEPINV` where that is installed."""
OF_DEEPINV = ("deepinv-wiener", "deepinv-tv")
"""Functions of `benchmark.by_deepinv`."""
LEFT_OUT = "deepinv-wiener and deepinv-tv are left out: deepinv comes with pip install 'edofsim[benchmark]'"
USES = ("psf", "depth range", "noise")
"""What a restoration is given where it does not declare it."""
KNOWN = (*USES, "depth")

SKELETON = '''"""An entry of the benchmark of edofsim: edofsim benchmark score {file} --data DIR"""

import torch

USES = ("psf", "depth range", "noise")  # what it uses of psfs and info; with "depth", the true distances too
TRAINED_ON = "nothing"  # families, photographs, ...


def restore(photo: torch.Tensor, psfs: torch.Tensor, info) -> torch.Tensor:
    """The sharp image, [channel, y, x] as the photo: linear, full scale 1, here a photo that is sharpened a
    little.

    psfs: [depth, channel, y, x], what the sensor sees of white points at info.inverse_depths [depth] in 1/m.
    info: camera, wavelengths, inverse_depths, noise, glare; inverse_depth [y, x] is NaN unless USES has
    "depth".
    """
    mean = torch.nn.functional.avg_pool2d(photo[None], 3, 1, 1, count_include_pad=False)[0]
    return photo + 0.5 * (photo - mean)
'''


@dataclass(frozen=True)
class Entry:
    """Who enters.

    name: in figures.
    uses: what it knows in addition to the photo.
    source: what restores, and its camera if it has one.
    folder: of restored images, in its place.
    """

    name: str
    track: Track
    uses: tuple[str, ...]
    trained_on: str
    digest: str
    source: Source | None = None
    folder: Path | None = None
    built: dict[str, Camera] = field(default_factory=dict, repr=False)

    @property
    def parameters(self) -> int | None:
        """Of its network; None where that is not known."""
        by = None if self.source is None else self.source.restoration
        if isinstance(by, ByNetwork):
            return sum(each.numel() for each in by.checkpoint.network.parameters())
        return None if by is None or isinstance(by, ByFunction) else 0

    def camera(self) -> Camera | None:
        """Its own camera, built once; None for that of the benchmark. Raises InputError."""
        if self.source is None or not self.source.names_camera:
            return None
        if "camera" not in self.built:
            self.built["camera"] = self.source.camera(None, load_camera("paper-clear"))
        return self.built["camera"]

    def restored(self, photo: Tensor, known: Known, key: str) -> Tensor:
        """What it makes of a photo.

        photo: [3, y, x], linear, full scale 1.

        Raises InputError for what is no such image.
        """
        if self.folder is not None:
            return self._from_folder(key, photo)
        assert self.source is not None
        if "depth" not in self.uses:
            known = replace(known, inverse_depth=known.inverse_depth * float("nan"))
        image = self.source.restoration(photo, known)
        if image.shape != photo.shape:
            raise InputError(f"returned the shape {list(image.shape)} for a photo of {list(photo.shape)}")
        if not bool(image.isfinite().all()):
            raise InputError("returned values that are NaN or infinite")
        return image

    def _from_folder(self, key: str, photo: Tensor) -> Tensor:
        assert self.folder is not None
        path = next((p for end in (".exr", ".png") if (p := self.folder / f"{key}{end}").is_file()), None)
        if path is None:
            raise InputError(f"{self.folder / key}.exr or .png is missing")
        image = read_image(path)
        if image.shape != photo.shape:
            size, wanted = (f"{each.shape[-1]} x {each.shape[-2]}" for each in (image, photo))
            raise InputError(f"{path}: {size} pixels, and the photo has {wanted}")
        if not bool(image.isfinite().all()):
            raise InputError(f"{path}: holds values that are NaN or infinite")
        return image


def entries_of(texts: tuple[str, ...]) -> list[Entry]:
    """Entries as they were typed. Raises InputError, all problems together, and for two of one name."""
    found: list[Entry] = []
    problems: list[str] = []
    for text in texts or (*SHIPPED, *(OF_DEEPINV if deepinv_version() else ())):
        try:
            found += entry_of(text)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    one_of_each([entry.name for entry in found])
    return found


def deepinv_version() -> str:
    """The version of deepinv here, empty where it is not installed."""
    try:
        return metadata.version("deepinv")
    except metadata.PackageNotFoundError:
        return ""


def entry_of(text: str) -> list[Entry]:
    """What one text names: a system (see `experiments.sources.system_of`); FILE.py, whose function `restore`
    restores; `optics:CAMERA`, restored by the network for any camera and by Wiener deconvolution; one of
    `OF_DEEPINV`; a folder of images KEY.exr or KEY.png, with what it used in entry.json. Raises InputError.
    """
    if text in OF_DEEPINV:
        if not (version := deepinv_version()):
            raise InputError(
                f"{text}: needs deepinv, which is not installed: pip install 'edofsim[benchmark]'"
            )
        made = _system(f"edofsim.benchmark.by_deepinv:{text.replace('-', '_')}")
        return [replace(made, name=text, digest=f"{made.digest}, deepinv {version}")]
    path = Path(text)
    if path.is_dir():
        return [_folder(path)]
    if text.startswith(OPTICS):
        camera = text.removeprefix(OPTICS)
        made = [_system(f"{camera}+{by}") for by in (ANY_CAMERA, "wiener")]
        return [replace(each, name=f"{OPTICS}{each.name}", track="optics") for each in made]
    return [_system(f"{text}:restore" if text.endswith(".py") else text)]


def _system(text: str) -> Entry:
    source = system_of(text)
    by = source.restoration
    uses: tuple[str, ...] = (*USES, "depth") if by.name == "wiener-depth" else USES
    trained = "" if source.training is None else "see its checkpoint"
    name = source.name
    if isinstance(by, ByFunction):
        module = getattr(by.function.call, "__globals__", {})
        declared = module.get("USES", USES)
        if wrong := [each for each in declared if each not in KNOWN]:
            raise InputError(f"{text}: USES has {wrong[0]!r}; there are {', '.join(KNOWN)}")
        uses, trained = tuple(declared), str(module.get("TRAINED_ON", "not declared"))
        place = Path(text.rpartition("+")[2].rpartition(":")[0])
        name = name if name != "restore" else place.stem
    track: Track = "joint" if source.names_camera else "restoration"
    if by.name == "photo":
        uses = ()
    return Entry(name, track, uses, trained, by.digest, source)


def _folder(path: Path) -> Entry:
    said: dict[str, object] = {}
    if (path / "entry.json").is_file():
        try:
            said = dict(json.loads((path / "entry.json").read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{path / 'entry.json'}: cannot be read ({error})") from None
    uses = said.get("uses", list(USES))
    if not isinstance(uses, list) or any(each not in KNOWN for each in uses):
        raise InputError(f"{path / 'entry.json'}: uses is a list of {', '.join(KNOWN)}")
    trained = str(said.get("trained_on", "not declared"))
    name = str(said.get("name", path.resolve().name))
    return Entry(name, "restoration", tuple(map(str, uses)), trained, "", None, path)


def extra_files(entry: Entry, keys: set[str]) -> list[str]:
    """Files of a folder that belong to no photo."""
    if entry.folder is None:
        return []
    known = {f"{key}{end}" for key in keys for end in (".exr", ".png")} | {"entry.json"}
    return [str(path) for path in sorted(entry.folder.iterdir()) if path.name not in known]
