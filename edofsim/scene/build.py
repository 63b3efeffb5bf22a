"""A scene recipe turned into a SceneModel: every object built, placed and checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.progress import Progress
from ..errors import InputError
from ..recipe.placed import Placed, Thing
from ..recipe.scene import SceneRecipe
from . import solids
from .builders import Builder, Context, Part
from .lights import build_lights
from .model import SceneModel, SceneObject, TriangleMesh
from .placement import place, rotation
from .reader import SceneReader

BRIGHTEST = 1e20
"""W/m2/sr/nm: a star's surface has 1e5."""
REPORT_EVERY = 50
"""Objects between two words on the progress."""
NEAREST = 1e-3
"""Everything lies at least this far in front of the lens plane, in metres."""


def build_scene(recipe: SceneRecipe, base: Path, progress: Progress | None = None) -> SceneModel:
    """Build a scene: meshes in metres in camera space, surfaces and lights at the recipe's bands.

    base: folder that file names in the recipe are relative to.
    progress: given the part of the objects that are built, and a sentence.

    Raises InputError with every problem found: names used twice, missing or unreadable textures and meshes,
    unknown spectra, objects behind the camera.
    """
    wavelengths = recipe.bands.wavelengths()
    if isinstance(recipe.source, SceneReader):
        model = recipe.source.scene(Path(base), wavelengths, recipe.name)
        return _with_lights(model, recipe, Path(base))
    if recipe.source is not None:
        raise InputError(f"{recipe.name} is a picture with depths: it is read, there is nothing to build")
    problems: list[str] = []
    names = _names(recipe.objects, problems)
    objects: list[SceneObject] = []
    tops: dict[str, float] = {}
    angle = recipe.frame.pixel_angle_mrad
    about = (wavelengths, Path(base), recipe.seed)
    for number, (name, item) in enumerate(zip(names, recipe.objects, strict=True)):
        if progress is not None and number % REPORT_EVERY == 0:
            progress(number / len(names), f"building the scene, object {number + 1} of {len(names)}")
        try:
            assert isinstance(item, Builder)  # what the registry holds
            context = Context(*about, name, 0.0 if angle == "auto" else angle * 1e-3)
            parts = item.build(context)
            built = _placed(item, name, parts, recipe, tops)
        except InputError as error:
            problems += [p if p.startswith(name) else f"{name}: {p}" for p in error.problems]
            continue
        tops[name] = max(float(o.mesh.vertices[:, 1].max()) for o in built)
        objects += built
    environment = None
    try:
        environment, lamps = build_lights(recipe.lights, wavelengths, Path(base))
        objects += lamps
        problems += _repeated([o.name for o in objects])
    except InputError as error:
        problems += error.problems
    if environment is None and not any(o.emission is not None for o in objects) and not problems:
        problems.append('the scene has no light: add a table to [[lights]], for instance kind = "sky"')
    if problems:
        raise InputError(problems)
    return _checked(
        SceneModel(recipe.name, wavelengths, tuple(objects), environment, {"purpose": recipe.purpose})
    )


def _with_lights(model: SceneModel, recipe: SceneRecipe, base: Path) -> SceneModel:
    """A scene that was read, with the recipe's own lights added to the file's."""
    environment, lamps = build_lights(recipe.lights, model.wavelengths, base)
    model = replace(
        model,
        objects=(*model.objects, *lamps),
        environment=environment or model.environment,
        notes={**model.notes, "purpose": recipe.purpose},
    )
    if model.environment is None and not any(o.emission is not None for o in model.objects):
        raise InputError(f"{recipe.name}: the scene that was read has no light; add a table to [[lights]]")
    return _checked(model)


def _checked(model: SceneModel) -> SceneModel:
    """The model, if the renderer can count with its numbers."""
    for item in model.objects:
        _check(item.mesh, item.name)
        if item.emission is not None:
            _check_light(item.name, item.emission)
    if model.environment is not None:
        radiance = model.environment.radiance
        brightest = 1.0 if radiance.image is None else float(np.abs(radiance.image).max(initial=0))
        _check_light("the environment", brightest * np.asarray(radiance.basis, np.float64))
    return model


def _names(objects: Sequence[Thing], problems: list[str]) -> list[str]:
    """Every object's name: its own, or its kind with a number."""
    given = [o.name for o in objects if o.name is not None]
    problems += _repeated(given)
    taken = set(given)
    names: list[str] = []
    counts: dict[str, int] = {}
    for item in objects:
        name = item.name
        while name is None or (item.name is None and name in taken):
            counts[item.kind] = counts.get(item.kind, 0) + 1
            name = f"{item.kind}-{counts[item.kind]}"
        names.append(name)
    return names


def _repeated(names: Sequence[str]) -> list[str]:
    twice = sorted((n, count) for n, count in Counter(names).items() if count > 1)
    return [f"the name {n!r} is given to {count} objects; names must differ" for n, count in twice]


def _placed(
    item: Builder, name: str, parts: list[Part], recipe: SceneRecipe, tops: dict[str, float]
) -> list[SceneObject]:
    matrix, shift = np.eye(3), np.array(item.origin())
    if isinstance(item, Placed):
        if item.on is not None and item.on not in tops:
            raise InputError(
                f"{name} stands on {item.on!r}, which is no object given before it; known: "
                f"{', '.join(map(repr, tops)) or 'none'}"
            )
        matrix = rotation(item.turn_deg, item.tilt_deg, item.roll_deg)
        shift = place(item, recipe.frame, None if item.on is None else tops[item.on])
        if item.anchor == "base":
            shift[1] -= min(float((p.mesh.vertices @ matrix.T)[:, 1].min()) for p in parts)
    built = []
    for part in parts:
        label = f"{name}/{part.suffix}" if part.suffix else name
        mesh = solids.moved(part.mesh, matrix, shift)
        built.append(SceneObject(label, mesh, part.surface, part.emission))
    _check_in_front(name, built)
    return built


def _check(mesh: TriangleMesh, label: str) -> None:
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{label}: its size or position is too large for single precision")
    if len(mesh.faces) == 0 or (mesh.normals is not None and not np.isfinite(mesh.normals).all()):
        raise InputError(f"{label}: it is too thin or too small for single precision; make it larger")


def _check_light(what: str, light: np.ndarray) -> None:
    if not (np.isfinite(light).all() and np.abs(light).max(initial=0) < BRIGHTEST):
        raise InputError(
            f"{what}: its radiance is not finite, or more than {BRIGHTEST:g} W/m2/sr/nm, which sums in "
            "single precision cannot hold; make it darker"
        )


def _check_in_front(name: str, built: Sequence[SceneObject]) -> None:
    nearest = min(float(o.mesh.vertices[:, 2].min()) for o in built)
    farthest = max(float(o.mesh.vertices[:, 2].max()) for o in built)
    if nearest >= NEAREST:
        return
    verb = "lies" if farthest < NEAREST else "reaches"
    raise InputError(
        f"{name} {verb} behind the camera (its depth goes from {nearest:.4g} to {farthest:.4g} m); give it a "
        "larger depth_m or make it smaller"
    )
