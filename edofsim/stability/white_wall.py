"""A white disc before a white wall, which is white through any camera.

Light neither comes nor goes at the disc's edge: the truth is 1 everywhere. Where light is added up without
asking what hides what, photos are from 0.1 to 1.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..optics import Camera
from ..recipe import CameraRecipe, load_camera
from ..render.view import View
from .case import Cameras, Case, Finding, timed

SIDE, MARGIN = 64, 64
RADIUS = 20.0
"""Of the disc, in pixels."""
NEAR, FAR = 1 / 0.6, 1 / 3.0
NANOMETRES = (546.5,)
WAYS: Mapping[str, Fidelity] = {
    "none": Fidelity(occlusion="none"),
    "over": Fidelity(occlusion="over"),
    "normalised": Fidelity(occlusion="normalised"),
    "hidden": Fidelity(),
    "sub_apertures": Fidelity(sub_apertures=3),
}
"""Ways to composite by name; `hidden` is what nobody has to ask for."""
BEHIND: Mapping[str, bool] = {"known": True, "guessed": False}
"""Whether a view holds the wall behind the disc."""
WHITE = 0.01
"""Largest difference from white: 0.13 % was seen, through sub-apertures."""


def _shipped(name: str) -> Camera:
    loaded = load_camera(name)
    return Camera.from_recipe(loaded.recipe, loaded.base)


def _fast() -> Camera:
    recipe = {
        "name": "35mm-f4",
        "lens": {"kind": "ideal", "focal_length_mm": 35, "f_number": 4},
        "focus": {"distance_m": 1.5},
        "sensor": {"pixel_um": 3.45},
    }
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


CAMERAS: Mapping[str, Callable[[], Camera]] = {
    "paper-clear": lambda: _shipped("paper-clear"),
    "paper-learned": lambda: _shipped("paper-learned"),
    "35mm-f4": _fast,
}


def shipped_cameras() -> dict[str, Camera]:
    """Those of `CAMERAS`."""
    return {name: make() for name, make in CAMERAS.items()}


def disc_before_wall(camera: Camera, known: bool) -> View:
    """A white disc at 0.6 m before a white wall at 3 m, in the pixels of a camera.

    known: whether the view holds the wall behind the disc, or nothing of what is hidden.
    """
    size = SIDE + 2 * MARGIN
    place = (torch.arange(size) - size / 2 + 0.5).square()
    disc = (place[:, None] + place < RADIUS**2).flatten()
    view = white(camera, torch.where(disc, NEAR, FAR).reshape(size, size))
    if not known:
        return view
    behind = torch.nonzero(disc).squeeze(1)
    pixel = torch.cat([view.pixel, behind])
    hidden = torch.arange(len(pixel)) >= len(view.pixel)
    order = torch.argsort(2 * pixel + hidden)
    depth = torch.cat([view.inverse_depth, torch.full((len(behind),), FAR)])
    return replace(
        view,
        pixel=pixel[order],
        hidden=hidden[order],
        inverse_depth=depth[order],
        coverage=torch.ones(len(pixel)),
        radiance=torch.ones(view.bands, len(pixel)),
        metadata={"hidden": "behind all edges"},
    )


def white(camera: Camera, inverse_depth: Tensor) -> View:
    """White light of one wavelength from inverse depths [y, x] of the frame with its margin.

    inverse_depth: [y, x], 1/m.
    """
    return View.flat(
        torch.ones(len(NANOMETRES), *inverse_depth.shape),
        inverse_depth.float(),
        wavelengths=[1e-9 * each for each in NANOMETRES],
        pixel_angle=camera.pixel_angle,
        margin=MARGIN,
    )


def off(view: View, camera: Camera, fidelity: Fidelity, truth: float = 1.0) -> float:
    """By how much a photo differs from one even value, at most; NaN where it is not finite."""
    photo = capture(view, camera, fidelity, exposure=1.0).clean
    return float((photo - truth).abs().max()) if bool(photo.isfinite().all()) else math.nan


def by_every_way(camera: Camera) -> dict[tuple[str, str], float]:
    """How far a white disc before a white wall is from white, at most, by `BEHIND` and way."""
    found: dict[tuple[str, str], float] = {}
    for said, known in BEHIND.items():
        view = disc_before_wall(camera, known)
        found |= {(said, way): off(view, camera, how) for way, how in WAYS.items()}
    return found


def _disc(cameras: Mapping[str, Camera]) -> Iterator[Finding]:
    for name, camera in cameras.items():
        for behind, known in BEHIND.items():
            view = disc_before_wall(camera, known)
            for way in ("hidden", "sub_apertures"):
                said = f"{way}, {name}, the wall behind the disc {behind}"
                yield timed(said, WHITE, lambda v=view, c=camera, w=way: off(v, c, WAYS[w]))


def cases_of(cameras: Cameras) -> tuple[Case, ...]:
    """A white disc before a white wall through these cameras."""
    return (
        Case(
            "white disc before a white wall",
            "occlusion",
            "what is behind the disc is white, whether it is known or guessed",
            "all light added up is too bright at the disc's edge, and too dark behind it",
            "white everywhere",
            lambda: _disc(cameras()),
        ),
    )
