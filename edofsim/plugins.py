"""What other packages build on: the base classes of all that people add, and what their methods are given.

Names here keep their meaning between minor versions of edofsim. Each is imported when it is first used.
"""

# ruff: noqa: F401 - the imports below are for type checkers
from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, TypeVar

from .errors import InputError

if TYPE_CHECKING:
    from .capture.fidelity import Simplification
    from .capture.planes import surroundings
    from .capture.sensor import SensorEffect, Signal
    from .core.progress import Progress
    from .experiments.experiment import Findings, in_paper, in_parts
    from .learn.reader import TrainingReader, Wanted
    from .learn.system import Planes, Scenes
    from .optics.lenses.base import Field, Lens
    from .optics.lenses.ideal import ThinLens
    from .optics.masks import Finite, Mask, SmoothMask
    from .options import CameraOption
    from .plan.effect import Effect, Errors, Level
    from .plan.facts import Facts
    from .recipe.base import NotNegative, Positive
    from .recipe.placed import Placed
    from .recipe.scene import SceneRecipe
    from .recipe.surfaces import AnySurface, MattSurface
    from .render.readers import (
        ViewReader,
        frame_indices,
        plain_view,
    )
    from .report import Key, Keys, Page
    from .restore.restorer import Restorer
    from .scene.builders import Builder, Context, Part
    from .scene.solids import mesh

Added = TypeVar("Added", bound=type)


def register(thing: Added) -> Added:
    """A decorator for a class of a script or a notebook that derives from one of these base classes, so that
    recipes and `edofsim.camera` take its `kind` in this process. A PyTorch network needs none: `learn.fit`
    takes it as it is. Raises InputError for what is none of them, and for a `kind` of this package."""
    kinds = import_module(".recipe.kinds", __package__)
    if any(one.take(thing) for one in vars(kinds).values() if isinstance(one, kinds.Registry)):
        return thing
    raise InputError(
        f"{thing.__name__} derives from no base class of edofsim.plugins; see {', '.join(__dir__())}"
    )


_IN = {
    "capture.fidelity": "Simplification",
    "capture.planes": "surroundings",
    "capture.sensor": "SensorEffect Signal",
    "core.progress": "Progress",
    "experiments.experiment": "Findings in_paper in_parts",
    "learn.reader": "TrainingReader Wanted",
    "learn.system": "Planes Scenes",
    "optics.lenses.base": "Field Lens",
    "optics.lenses.ideal": "ThinLens",
    "optics.masks": "Finite Mask SmoothMask",
    "options": "CameraOption",
    "plan.effect": "Effect Errors Level",
    "plan.facts": "Facts",
    "recipe.base": "NotNegative Positive",
    "recipe.placed": "Placed",
    "recipe.scene": "SceneRecipe",
    "recipe.surfaces": "AnySurface MattSurface",
    "render.readers": "ViewReader frame_indices plain_view",
    "report": "Key Keys Page",
    "restore.restorer": "Restorer",
    "scene.builders": "Builder Context Part",
    "scene.solids": "mesh",
}
"""Names by the module that defines them."""


def __getattr__(name: str) -> object:
    for module, names in _IN.items():
        if name in names.split():
            return getattr(import_module(f".{module}", __package__), name)
    raise AttributeError(f"edofsim.plugins has no {name!r}; there is {', '.join(__dir__())}")


def __dir__() -> list[str]:
    return sorted(name for names in _IN.values() for name in names.split())
