"""The angle that a camera's pixel sees, kept in the user's folder: to find it loads PyTorch, which takes a
second, and rendering does without."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.store import Store, user_folder
from ..recipe.load import camera_file, load_camera
from ..recipe.scene import SceneRecipe
from ..recipe.toml import read_toml

if TYPE_CHECKING:
    from ..optics import Camera

FOLLOWS_FROM = ("optics/camera.py", "optics/materials.py", "optics/lenses/*.py", "recipe/*.py")
"""The files of this package that a camera recipe's angle follows from."""


def _read(path: Path) -> float:
    angle = float(json.loads(path.read_text(encoding="utf-8")))
    if not 0 < angle < math.inf:
        raise ValueError("no angle")
    return angle


_KEPT = Store("{}.json", _read, lambda angle, path: path.write_text(json.dumps(angle)), most_files=256)


def pixel_angle(camera: str | Path, base: Path) -> float:
    """Tangent of the angle that one pixel of a camera sees, on the axis, by its recipe's name or file, see
    `load_camera`. Raises InputError for a recipe that is none, or that no camera can be made of."""
    key, folder = _key(camera_file(camera, base)), user_folder() / "angles"
    known = _KEPT.find(key, folder)
    if known is not None:
        return known
    from ..recipe.kinds import LENSES

    found = _camera(camera, base)
    # another package's lens may change with that package, and one that varies is seen along its chief rays
    if not LENSES.code_of(found.lens.kind) and not found.lens.varies:
        _KEPT.keep(key, found.pixel_angle, folder)
    return found.pixel_angle


def framed_by_own(recipe: SceneRecipe, base: Path) -> SceneRecipe:
    """A scene that follows its own camera, as that frames it (see `capture.framing`). Raises as
    `pixel_angle`."""
    known = _KEPT.find(_key(camera_file(recipe.camera, base)), user_folder() / "angles")
    if known is not None:
        return recipe.seen_at(known)
    from ..capture.framing import framed

    pixel_angle(recipe.camera, base)
    return framed(recipe, _camera(recipe.camera, base))


def _camera(camera: str | Path, base: Path) -> Camera:
    from ..optics import Camera

    loaded = load_camera(camera, base)
    return Camera.from_recipe(loaded.recipe, loaded.base)


def _key(recipe: Path) -> str:
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(read_toml(recipe)[1].encode())
    for pattern in FOLLOWS_FROM:
        for path in sorted(package.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:32]
