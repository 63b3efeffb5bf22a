"""Which view a recipe asks for: a key of everything that decides its pixels, and of nothing else."""

from __future__ import annotations

import hashlib
import json
import re
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from ..core.json_values import Json
from ..recipe.kinds import OBJECTS, SOURCES
from ..recipe.scene import SceneRecipe
from .settings import INTEGRATOR

IGNORED = ("schema_", "purpose", "camera")
"""What a scene recipe says for its reader and for the camera, not for the renderer."""

LIBRARIES = ("mitsuba", "drjit", "colour-science", "scikit-image", "trimesh")
"""Their versions decide pixels: they trace, or they bring spectra, photographs and meshes."""


NAMES = {
    **dict.fromkeys((".xml", ".json", ".gltf"), r'"([^"\n]{1,1000})"'),
    ".obj": r"(?m)^[ \t]*mtllib[ \t]+([^\r\n]{1,1000})",
    ".mtl": r"(?mi)^[ \t]*map_kd[ \t]+([^\r\n]{1,1000})",
    ".ply": r"(?mi)^comment[ \t]+texturefile[ \t]+([^\r\n]{1,1000})",
}
"""How files name others, by their suffixes."""


def canonical(recipe: SceneRecipe) -> Json:
    """A recipe as JSON-able data, defaults filled in; independent of how and in which order it was
    written."""
    data = recipe.model_dump(mode="json")
    return {key: value for key, value in data.items() if key not in IGNORED}


def view_key(recipe: SceneRecipe, base: Path, noise: float | None = None) -> str:
    """SHA-256, in hex, of the recipe, the content of the files it names, the noise to stop at, and
    versions."""
    content = {
        "recipe": canonical(recipe),
        "files": named_files(canonical(recipe), Path(base)),
        "noise": noise,
        "integrator": INTEGRATOR,
        "scenes": scene_code(),
        **_code_of_others(recipe),
        **({} if says_path_length(recipe) else {"path length": "the file's"}),
        "versions": {name: version(name) for name in LIBRARIES},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def says_path_length(recipe: SceneRecipe) -> bool:
    """Whether the recipe says how long light paths are; where it does not, a scene's own file may."""
    of_file = recipe.source is not None and recipe.source.kind == "mitsuba"
    return not of_file or "max_depth" in recipe.render.model_fields_set


def _code_of_others(recipe: SceneRecipe) -> dict[str, dict[str, str]]:
    """Checksums of the code of what other packages add, where a recipe names it."""
    found = {item.kind: code for item in recipe.objects if (code := OBJECTS.code_of(item.kind))}
    if recipe.source is not None and (code := SOURCES.code_of(recipe.source.kind)):
        found[recipe.source.kind] = code
    return {"code of others": found} if found else {}


@lru_cache(maxsize=1)
def scene_code() -> str:
    """Checksum of the code that turns recipes into scenes: a better bust must not meet an old view."""
    folder = Path(__file__).resolve().parent.parent / "scene"
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def named_files(data: object, base: Path) -> dict[str, str]:
    """Checksums of all files that strings in a recipe name, by that string (folders: of all that is in
    them)."""
    found: dict[str, str] = {}
    for text in sorted(set(_strings(data))):
        path = base / text if text.strip() else base
        try:
            if path.is_file():
                found[text] = _file_digest(path, set())
            elif (
                path.is_dir()
                and path.resolve() != base.resolve()
                and base.resolve() not in path.resolve().parents
            ):
                continue  # a word that happens to name some folder elsewhere
            elif path.is_dir() and path.resolve() != base.resolve():
                parts = [
                    f"{p.relative_to(path).as_posix()}:{_file_digest(p, set())}"
                    for p in sorted(path.rglob("*"))
                    if p.is_file()
                ]
                found[text] = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        except (
            OSError,
            ValueError,
        ):  # not a file name at all, or not ours to read: building the scene will say
            continue
    return found


def _strings(data: object) -> list[str]:
    if isinstance(data, str):
        return [data]
    if isinstance(data, dict):
        return [text for value in data.values() for text in _strings(value)]
    if isinstance(data, list):
        return [text for value in data for text in _strings(value)]
    return []


def _file_digest(path: Path, seen: set[Path], folders: tuple[Path, ...] = ()) -> str:
    """Checksum of a file and, if it is a scene of Mitsuba's or a mesh, of the files that it names.

    folders: where those may lie in addition to its own folder."""
    seen.add(path.resolve())
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    pattern = NAMES.get(path.suffix.lower())
    if pattern is not None:
        text = path.read_text(encoding="utf-8", errors="replace")
        named = sorted({name.strip() for name in re.findall(pattern, text)} - {""})
        near = (path.parent, *folders)
        found = [at / name for at in near for name in named]
        # a scene's <path> is a folder to look in
        further = [place for place in found if place.is_dir()]
        found += [at / name for at in further for name in named]
        for inner in found:
            if inner.is_file() and inner.resolve() not in seen:
                digest.update(_file_digest(inner, seen, (*near, *further)).encode())
    return digest.hexdigest()
