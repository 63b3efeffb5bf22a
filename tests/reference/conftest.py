"""Scenes of flat, upright screens, with the views that a pinhole has of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from edofsim.optics import Camera
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import Focus, Lens, PsfSettings, Sensor
from edofsim.render.view import View
from edofsim.scene.model import BandTexture, SceneModel, SceneObject, Surface, TriangleMesh

BAND = 543e-9


class Screens:
    """Makers of cameras, scenes and views; one band, so that everything is small."""

    @staticmethod
    def camera(focus_m: float, window: int, mask=None, angle: float | None = None, radius_mm=1.0) -> Camera:
        """A camera of one wavelength with a parabolic lens that is sharp at focus_m; `angle` sets its pixels."""
        recipe = CameraRecipe(
            name="reference",
            lens=Lens(aperture_radius_mm=radius_mm, thickness="parabolic"),
            focus=Focus(distance_m=focus_m, wavelength_nm=BAND * 1e9),
            psf=PsfSettings(window_px=window, oversampling=2),
        )
        if mask is not None:
            recipe = recipe.model_copy(update={"mask": mask})
        camera = Camera.from_recipe(recipe)
        if angle is None:
            return camera
        sensor = Sensor(pixel_um=camera.sensor_distance * angle * 1e6)
        return Camera.from_recipe(recipe.model_copy(update={"sensor": sensor}))

    @staticmethod
    def rectangle(x: tuple[float, float], y: tuple[float, float], z: float) -> TriangleMesh:
        vertices = np.array([(a, b, z) for b in y for a in x], np.float32)
        uv = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32)
        return TriangleMesh(vertices, np.array([[0, 2, 1], [1, 2, 3]], np.uint32), uv)

    @classmethod
    def model(cls, screens: list[tuple[TriangleMesh, np.ndarray]]) -> SceneModel:
        """Lamps with a picture each: (mesh, radiance [y, x]); their light is all there is."""
        objects = []
        for number, (mesh, picture) in enumerate(screens):
            black = BandTexture(np.zeros((1, 1), np.float32))
            surface = Surface({"type": "diffuse"}, "reflectance", black)
            objects.append(SceneObject(f"screen {number}", mesh, surface, emission=picture.astype(np.float32)))
        return SceneModel("screens", np.array([BAND]), tuple(objects))

    @staticmethod
    def view(size: int, margin: int, angle: float, sheets: list[tuple[Tensor, float, Tensor]]) -> View:
        """Sheets from near to far: (mask [y, x], inverse depth, radiance [y, x]) of the padded frame."""
        side = size + 2 * margin
        left = torch.ones(side * side, dtype=torch.bool)
        rows = []
        for order, (mask, depth, radiance) in enumerate(sheets):
            mask = mask.reshape(-1)
            for hidden, chosen in ((False, mask & left), (True, mask & ~left)):
                pixel = torch.nonzero(chosen).squeeze(1)
                light = radiance.reshape(-1)[pixel]
                rows.append((pixel, torch.full_like(light, depth), light, torch.full_like(pixel, hidden), order))
            left &= ~mask
        pixel = torch.cat([r[0] for r in rows])
        order = torch.argsort(pixel * 8 + torch.cat([torch.full_like(r[0], r[4]) for r in rows]))
        return View(
            height=size,
            width=size,
            margin=margin,
            pixel=pixel[order],
            coverage=torch.ones(len(order), dtype=torch.float64),
            inverse_depth=torch.cat([r[1] for r in rows])[order],
            radiance=torch.cat([r[2] for r in rows])[order][None],
            hidden=torch.cat([r[3] for r in rows])[order].bool(),
            wavelengths=torch.tensor([BAND], dtype=torch.float64),
            pixel_angle=angle,
        )


def texture(side: int, seed: int, scale: int = 3) -> Tensor:
    """Positive random light [y, x] in patches of `scale` pixels."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 1, math.ceil(side / scale), math.ceil(side / scale), generator=generator)
    return torch.nn.functional.interpolate(coarse.double(), scale_factor=scale)[0, 0, :side, :side]


@pytest.fixture
def screens() -> type[Screens]:
    return Screens
