"""PSFs that hardly differ from depth to depth: what masks for extended depth of field are made for.

Low rank lives on their differences, which are little beside what they share.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..optics import Camera
from ..recipe import load_camera
from ..render.view import View
from .case import Case, Finding, timed
from .measures import typical, worst
from .photos import LAYERED, SINGLE
from .views import uniform

FRAME, WINDOW, LAYERS = 48, 128, 24
NANOMETRES = (482.0, 543.0)


def _view(camera: Camera, wavelength: float) -> View:
    """Noise of one band on a slope from 5 m to 0.55 m."""
    size = FRAME + WINDOW
    return View.flat(
        uniform(1, size, size),
        torch.linspace(0.2, 1.8, size, dtype=torch.float64)[:, None].expand(size, size),
        wavelengths=[wavelength],
        pixel_angle=camera.pixel_angle,
        margin=WINDOW // 2,
    )


def _photo(view: View, camera: Camera, method: str, dtype: torch.dtype) -> Tensor:
    fidelity = Fidelity(method=method, layers=LAYERS, occlusion="none", rank_db=50.0)
    return capture(view, camera, fidelity, exposure=1.0, dtype=dtype).clean.double()


def _findings() -> Iterator[Finding]:
    for name in ("paper-learned", "paper-cubic"):
        loaded = load_camera(name)
        camera = Camera.from_recipe(loaded.recipe, loaded.base)
        for nm in NANOMETRES:
            made = partial(_photo, _view(camera, nm * 1e-9), camera)
            truth = made("layered", torch.float64)
            double = made("low_rank", torch.float64)
            way = f"{name}, {nm:g} nm"
            yield timed(
                f"low_rank, {way}, float64", LAYERED, lambda d=double, t=truth: typical(d, t), alike=True
            )
            yield timed(
                f"low_rank, {way}, float32 against float64",
                SINGLE,
                lambda m=made, d=double: worst(m("low_rank", torch.float32), d),
                alike=True,
            )


CASES: tuple[Case, ...] = (
    Case(
        "alike at all depths",
        "depth",
        "masks that even out distance, 24 depths",
        "differences lost beside what is shared",
        "layers of the same depths; both precisions alike",
        _findings,
    ),
)
