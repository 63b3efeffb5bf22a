"""What a dataset recipe asks for: members of scenes, each a part of the work, and who photographs them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..capture.framing import framed
from ..core.json_values import Json
from ..core.sources import code_of_rooms
from ..errors import InputError
from ..learn.random_cameras import random_camera
from ..optics import Camera
from ..recipe.dataset import SPLITS, DatasetRecipe, DatasetScene, Split
from ..recipe.load import Loaded, load_camera, load_member_scene
from ..recipe.scene import SceneRecipe
from ..render.keys import named_files
from ..scene.family import members

ROOMS = ("core", "recipe", "scene", "render", "optics", "capture", "plan", "data")
"""Whose code decides a pair."""


@dataclass(frozen=True)
class Part:
    """A member of a scene.

    family: the scene's name.
    number: among all parts of the recipe.
    """

    scene: Loaded[SceneRecipe]
    family: str
    split: Split
    number: int

    @property
    def name(self) -> str:
        return self.scene.recipe.name


def parts_of(loaded: Loaded[DatasetRecipe]) -> list[Part]:
    """All members that a recipe asks for, in its order. Raises InputError for scenes that cannot be used, and
    for two members of one name."""
    found: list[Part] = []
    problems: list[str] = []
    for entry in loaded.recipe.scenes:
        try:
            scene = load_member_scene(entry.recipe, loaded.base)
            count, seed = entry.members, entry.seed
            recipes = members(scene.recipe, count, seed) if count else [scene.recipe]
        except InputError as error:
            problems += error.problems
            continue
        for number, recipe in enumerate(recipes):
            split = entry.split or _split(loaded.recipe, entry, number)
            each = replace(scene, recipe=_sized(recipe, loaded.recipe))
            found.append(Part(each, scene.recipe.name, split, len(found)))
    names = [part.name for part in found]
    twins = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    problems += [f"{name}: two members have this name; give other seeds, or names" for name in twins]
    if problems:
        raise InputError([f"{loaded.path}: {problem}" for problem in problems])
    return found


def _split(recipe: DatasetRecipe, entry: DatasetScene, number: int) -> Split:
    """Of a family's members the last are for test, those before them for validation."""
    count = max(1, entry.members)
    test = round(recipe.splits.test * count)
    validation = round(recipe.splits.validation * count)
    if number >= count - test:
        return "test"
    return "validation" if number >= count - test - validation else "train"


def _sized(recipe: SceneRecipe, wanted: DatasetRecipe) -> SceneRecipe:
    if recipe.source is not None and not recipe.source.rendered:
        raise InputError(f"{recipe.name}: is read from a picture; data are made of scenes that are rendered")
    size = {"width_px": wanted.frame.width_px, "height_px": wanted.frame.height_px}
    render = recipe.render
    if wanted.frame.samples is not None:
        render = render.model_copy(update={"samples": wanted.frame.samples})
    frame = recipe.frame.model_copy(update={**size, "pixel_angle_mrad": "auto"})
    return recipe.model_copy(update={"frame": frame, "render": render})


def cameras_of(loaded: Loaded[DatasetRecipe]) -> tuple[list[Camera], list[Camera]]:
    """The cameras that photograph every scene, and those of which each scene gets one. Raises InputError."""
    named: list[Camera] = []
    for name in loaded.recipe.cameras:
        found = load_camera(name, loaded.base)
        named.append(Camera.from_recipe(found.recipe, found.base))
    drawn: list[Camera] = []
    if loaded.recipe.drawn is not None:
        table, noise = loaded.recipe.drawn, loaded.recipe.photos.read_noise or (0.005, 0.005)
        for number in range(table.count):
            drawn.append(random_camera(table, loaded.recipe.seed, number, 0, noise).camera)
    names = [camera.recipe.name for camera in (*named, *drawn)]
    if twins := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{loaded.path}: two cameras are called {twins[0]!r}; rename one")
    return [_saturating(each, loaded.recipe) for each in named], [
        _saturating(each, loaded.recipe) for each in drawn
    ]


def _saturating(camera: Camera, recipe: DatasetRecipe) -> Camera:
    if not recipe.photos.saturation:
        return camera
    sensor = camera.recipe.sensor.model_copy(update={"saturation": True})
    return replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))


@dataclass(frozen=True)
class Work:
    """A recipe, understood: its parts, and the cameras of each."""

    loaded: Loaded[DatasetRecipe]
    parts: Sequence[Part]
    named: Sequence[Camera]
    drawn: Sequence[Camera]

    @property
    def recipe(self) -> DatasetRecipe:
        return self.loaded.recipe

    def cameras(self, part: Part) -> list[Camera]:
        """Who photographs a part."""
        own = [self.drawn[part.number % len(self.drawn)]] if self.drawn else []
        return [*self.named, *own]

    def frames(self, part: Part) -> list[SceneRecipe]:
        """The part as each camera frames it: the recipes of its views. Raises InputError."""
        return [framed(part.scene.recipe, camera) for camera in self.cameras(part)]

    def keys(self, part: Part) -> list[str]:
        """Names of the part's pairs, camera by camera."""
        count = self.recipe.photos.noise_seeds
        return [key for camera in self.cameras(part) for key in keys_of(part, camera, count)]

    def ordered(self) -> dict[Split, list[str]]:
        """All pairs by their split, in the order in which they are kept."""
        found: dict[Split, list[str]] = {split: [] for split in SPLITS}
        for part in self.parts:
            found[part.split] += self.keys(part)
        return {split: keys for split, keys in found.items() if keys}

    def digest(self) -> str:
        """SHA-256 of everything that decides the pairs: recipes, what files they name, and the code."""
        content: Json = {
            "recipe": self.recipe.model_dump(mode="json", exclude={"purpose"}),
            "parts": [
                [part.split, part.scene.recipe.model_dump(mode="json", exclude={"purpose"})]
                for part in self.parts
            ],
            "files": sorted({str(named_files(p.scene.recipe.model_dump(mode="json"), p.scene.base))
                             for p in self.parts}),
            "cameras": [
                [camera.recipe.model_dump(mode="json"), camera_files(camera)]
                for camera in (*self.named, *self.drawn)
            ],
            "code": code_of_rooms(*ROOMS),
        }  # fmt: skip
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def camera_files(camera: Camera) -> dict[str, str]:
    """Checksums of the files that a camera's recipe names."""
    return named_files(camera.recipe.model_dump(mode="json"), camera.base)


def keys_of(part: Part, camera: Camera, count: int) -> list[str]:
    """Names of the pairs of a part by a camera, one for each seed of the noise."""
    return [f"{part.name}_{camera.recipe.name}_{number}" for number in range(count)]


def understood(loaded: Loaded[DatasetRecipe]) -> Work:
    """Everything that a dataset recipe names. Raises InputError, all problems together."""
    return Work(loaded, parts_of(loaded), *cameras_of(loaded))


def drawn_for(recipe: DatasetRecipe, key: str) -> np.random.Generator:
    """Random numbers of a pair, or of a part by a camera: the same whatever else is made."""
    words = hashlib.sha256(key.encode()).digest()[:8]
    return np.random.default_rng([recipe.seed, int.from_bytes(words, "big")])
