"""edofsim: a physically based 3D scene simulator for extended-depth-of-field cameras.

The names in `__all__` are the public ones; each is imported when it is first used, so that `import edofsim`
takes no time. Everything else but `edofsim.plugins` is private and may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api import look, photograph, plan_for, psfs, restored, view, views
    from .capture import Fidelity, Photo
    from .capture.files import read_image, save_image
    from .core.notebook import show
    from .errors import EdofsimError, InputError
    from .optics import Camera, PsfField
    from .own_camera import camera
    from .plan import Plan
    from .render.view import View
    from .restore.truth import score

__version__ = "0.2.0"

__all__ = [
    "Camera",
    "EdofsimError",
    "Fidelity",
    "InputError",
    "Photo",
    "Plan",
    "PsfField",
    "View",
    "camera",
    "look",
    "photograph",
    "plan_for",
    "psfs",
    "read_image",
    "restored",
    "save_image",
    "score",
    "show",
    "view",
    "views",
]

_FROM = {
    "Camera": "optics",
    "EdofsimError": "errors",
    "Fidelity": "capture",
    "InputError": "errors",
    "Photo": "capture",
    "Plan": "plan",
    "PsfField": "optics",
    "View": "render.view",
    "camera": "own_camera",
    "look": "api",
    "photograph": "api",
    "plan_for": "api",
    "psfs": "api",
    "read_image": "capture.files",
    "restored": "api",
    "save_image": "capture.files",
    "score": "restore.truth",
    "show": "core.notebook",
    "view": "api",
    "views": "api",
}
"""Where each public name is defined."""


def __getattr__(name: str) -> object:
    """A public name, imported now and kept."""
    if name not in _FROM:
        raise AttributeError(f"module 'edofsim' has no public {name!r}; there is {', '.join(__all__)}")
    found = getattr(import_module(f".{_FROM[name]}", __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
