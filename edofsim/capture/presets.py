"""Fidelities by name."""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import InputError
from ..optics import Camera
from ..render.view import View
from .fidelity import Fidelity, full_fidelity

PRESETS: Mapping[str, Mapping[str, object]] = {
    "reference": {},
    "preview": {"band_groups": 1, "group_wavelengths": 2, "layers": 9, "sub_apertures": 1},
}
"""Fidelities by name: what each changes of everything that a view and a camera have."""


def preset(name: str, camera: Camera, view: View) -> Fidelity:
    """A fidelity of `PRESETS` for a view through a camera: `reference` leaves nothing out, `preview` takes a
    moment. Raises InputError for a name that is none."""
    if name not in PRESETS:
        raise InputError(f"{name}: no preset; choose one of {', '.join(PRESETS)}")
    return full_fidelity(camera, view).changed(PRESETS[name])
