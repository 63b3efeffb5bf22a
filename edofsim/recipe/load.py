"""From a path or the name of a shipped recipe to a validated model."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import BaseModel

from ..core.shipped import shipped, shipped_folder, today
from ..errors import InputError
from .camera import CameraRecipe
from .dataset import DatasetRecipe
from .scene import SceneRecipe
from .toml import read_toml, validate
from .train import TrainRecipe

__all__ = [
    "Loaded",
    "load_camera",
    "load_dataset",
    "load_member_scene",
    "load_scene",
    "load_train",
    "shipped",
    "shipped_folder",
]

Recipe = TypeVar("Recipe", bound=BaseModel)


@dataclass(frozen=True)
class Loaded(Generic[Recipe]):
    """A recipe, the file it came from (relative files in it start from `base`), and that file's text."""

    recipe: Recipe
    path: Path
    text: str

    @property
    def base(self) -> Path:
        return self.path.parent


def load_scene(source: str | Path) -> Loaded[SceneRecipe]:
    """A scene recipe from its file, or a shipped one by name (`desk`). Raises InputError."""
    return _read(SceneRecipe, _file(source, shipped_folder("scenes"), "scene"))


def load_camera(source: str | Path, base: Path | None = None) -> Loaded[CameraRecipe]:
    """A camera recipe from its file (relative to `base` if that is given), or a shipped one by name
    (`paper-cubic`). Raises InputError."""
    return _read(CameraRecipe, camera_file(source, base))


def camera_file(source: str | Path, base: Path | None = None) -> Path:
    """The file that `load_camera` reads. Raises InputError where there is none."""
    if base is not None and (base / source).is_file():
        return base / source
    return _file(source, shipped_folder("scenes") / "cameras", "camera")


def load_train(source: str | Path) -> Loaded[TrainRecipe]:
    """A training recipe from its file, or a shipped one by name. Raises InputError."""
    return _read(
        TrainRecipe,
        _file(
            source if Path(source).exists() else today(str(source)),
            shipped_folder("train"),
            "training recipe",
        ),
    )


def load_dataset(source: str | Path) -> Loaded[DatasetRecipe]:
    """A dataset recipe from its file, or a shipped benchmark's by name (`tiny`). Raises InputError."""
    return _read(DatasetRecipe, _file(source, shipped_folder("scenes") / "benchmarks", "dataset recipe"))


def load_member_scene(source: str, base: Path) -> Loaded[SceneRecipe]:
    """A scene recipe from its file (relative to `base`), or a shipped scene or family by name. Raises
    InputError."""
    if (base / source).is_file():
        return load_scene(base / source)
    family = shipped_folder("scenes") / "families" / f"{source}.toml"
    return load_scene(family if family.is_file() and "/" not in source else source)


def _file(source: str | Path, folder: Path, noun: str) -> Path:
    """A recipe's file, or the shipped one of that name."""
    path = Path(source)
    if path.suffix != ".toml" and not path.exists():
        known = shipped(folder)
        if path.name not in known or len(path.parts) > 1:
            near = difflib.get_close_matches(str(source), known, 1, 0.5)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(
                f"{source}: no such file and no shipped {noun}; {hint}shipped: {', '.join(known) or 'none'}"
            )
        path = known[path.name]
    return path


FOREIGN = {
    ".zmx": "a lens of Zemax", ".zar": "a lens of Zemax", ".zos": "a lens of Zemax", ".agf": "glasses of "
    "Zemax",
    ".seq": "a lens of CODE V", ".len": "a lens of OSLO or CODE V", ".roa": "a lens of ray-optics",
    ".json": "JSON, as optiland writes lenses", ".xml": "XML, as Mitsuba writes scenes",
    ".yaml": "YAML", ".yml": "YAML", ".blend": "a scene of Blender",
}  # fmt: skip
"""What files are that are taken for recipes, by their suffix."""


def _refuse_foreign(path: Path) -> None:
    """Raises InputError for a file of another program."""
    found = FOREIGN.get(path.suffix.lower())
    if found is None or not path.is_file():
        return
    if path.suffix.lower() == ".xml":
        way = 'name it in a scene recipe: [source] kind = "mitsuba", path'
    elif path.suffix.lower() == ".blend":
        way = "export it as meshes, or as a Mitsuba scene"
    else:
        way = "`edofsim new camera` begins a camera, `edofsim list lenses` has the lenses that it can hold"
    raise InputError(f"{path}: is {found}, no recipe of edofsim; {way}")


def _read(model: type[Recipe], path: Path) -> Loaded[Recipe]:
    _refuse_foreign(path)
    data, text = read_toml(path)
    return Loaded(validate(model, data, text, path), path, text)
