"""A run that nothing was rendered for, and its page."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data

from edofsim.capture import Fidelity, Photo
from edofsim.capture.noise import PhotoNoise
from edofsim.optics import PAPER_COLOURS, Camera
from edofsim.pipeline import Run
from edofsim.plan import Decision, Plan
from edofsim.recipe import CameraRecipe, Loaded, SceneRecipe
from edofsim.render.view import View
from edofsim.restore.places import Method
from edofsim.restore.scores import score_by_depth

CUBIC = CameraRecipe(name="paper-cubic", mask={"kind": "cubic", "alpha_rad": 60}, focus={"distance_m": 1.5})
CARD = {"kind": "text_page", "depth_m": 1.0, "width_mm": 100}
DECISIONS = (
    Decision("hidden surfaces", True, "", "edges", error=(0.012,) * 3, seconds=3.1),
    Decision("fabrication error", False, "", ""),
)


def _made(rows: int = 96, columns: int = 128, **changes: object) -> Run:
    """A photograph of scikit-image on three depths, with noise for a photo, and everything on its page."""
    random = torch.Generator().manual_seed(0)
    encoded = torch.from_numpy(np.ascontiguousarray(data.astronaut()[:rows, :columns])).permute(2, 0, 1) / 255
    ideal = encoded.float() ** 2.2
    depth = torch.full((rows, columns), 1 / 4.46)
    depth[: rows // 3] = 0.0
    depth[rows // 2 :] = 2.0
    taken = ideal + 0.05 * torch.randn(ideal.shape, generator=random)
    restored = ideal + 0.02 * torch.randn(ideal.shape, generator=random)
    photo = Photo(taken, taken, ideal, 1.0, torch.zeros(3))
    alone = replace(photo, image=ideal.roll(2, -1))
    psfs = torch.zeros(3, 3, 33, 33)
    psfs[..., 12:21, 12:21] = 1 / 81
    scored = {"photo": taken, "restored": restored, "lens_alone": alone.image}
    found = {name: score_by_depth(image, ideal, "none", depth) for name, image in scored.items()}
    plan = Plan(DECISIONS, Fidelity(), target="Below half of the noise.")
    camera = Camera.from_recipe(CUBIC)
    made = Run(
        scene=Loaded(
            SceneRecipe(name="table", purpose="A scene for tests.", objects=[CARD]),
            Path("table.toml"),
            'name = "t"',
        ),
        camera=Loaded(CUBIC, Path("cubic.toml"), 'name = "paper-cubic"'),
        optics=camera,
        checkpoint=None,
        seed=3,
        view=View.flat(ideal, depth, wavelengths=PAPER_COLOURS.flip(0), pixel_angle=camera.pixel_angle),
        plan=plan,
        plan_lens_alone=plan,
        photo=photo,
        psfs=psfs,
        psf_depths=torch.tensor([0.0, 2 / 3, 2.0]),
        restored=restored,
        restored_by=Method("a network"),
        wiener=None,
        lens_alone=alone,
        noise=PhotoNoise(),
        noises={},
        scores={name: whole for name, (whole, _) in found.items()},
        by_depth={name: parts for name, (_, parts) in found.items()},
        gains={},
        seconds={"render": 12.0, "expose": 0.4},
        peak_memory_mib=812.3,
    )
    assert math.isclose(made.optics.recipe.focus.distance_m, 1.5)
    return replace(made, **changes)


@pytest.fixture(scope="session")
def made_run() -> Callable[..., Run]:
    return _made
