"""Scenes of flat, upright screens, with the views that a pinhole has of them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from edofsim.optics import Camera
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import Focus, PsfSettings, Sensor
from edofsim.render.view import View
from edofsim.scene.model import BandTexture, SceneModel, SceneObject, Surface, TriangleMesh

BAND = 543e-9
NEAR, FAR = 0.4, 0.8


class Screens:
    """Makers of cameras, scenes and views; one band, so that everything is small."""

    @staticmethod
    def camera(
        focus_m: float, window: int, mask=None, angle: float | None = None, radius_mm=1.0, oversampling=2
    ) -> Camera:
        """A camera of one wavelength with a parabolic lens that sharp at focus_m; `angle`: of its pixels."""
        recipe = CameraRecipe(
            name="reference",
            lens=PlanoConvexLens(aperture_radius_mm=radius_mm, surface_profile="parabolic"),
            focus=Focus(distance_m=focus_m, wavelength_nm=BAND * 1e9),
            psf=PsfSettings(window_px=window, oversampling=oversampling),
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
    def model(cls, screens: list[tuple[TriangleMesh, float]]) -> SceneModel:
        """Lamps of one radiance each: their light is all there is."""
        black = Surface({"type": "diffuse"}, "reflectance", BandTexture(np.zeros((1, 1), np.float32)))
        objects = [
            SceneObject(f"screen {number}", mesh, black, emission=np.array([radiance], np.float32))
            for number, (mesh, radiance) in enumerate(screens)
        ]
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
                rows.append(
                    (pixel, torch.full_like(light, depth), light, torch.full_like(pixel, hidden), order)
                )
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

    @classmethod
    def two(cls, angle: float, size: int, margin: int) -> tuple[SceneModel, View]:
        """A screen at 0.4 m over the left half of the frame, before one at 0.8 m: (model, view).

        Stripes of light, across on the near one and upright on the far one, whose edges lie between pixels.
        """
        side = size + 2 * margin
        reach = 2 * side  # screens go on beyond the margin: pupil points off the axis look there
        lamps = []
        shown = torch.zeros(2, side, side, dtype=torch.float64)
        for number, (z, right) in enumerate(((NEAR, 0), (FAR, reach))):
            low = np.arange(-reach, reach, 5 + number)
            # from dark to light as in a well-exposed photograph: the PSNR is one of full scale
            light = np.random.default_rng(number).uniform(0.1, 0.8, len(low))
            for begin, radiance in zip(low, light, strict=True):
                end = begin + 5 + number
                if number == 0:
                    x, y = (-reach, right), (-end, -begin)  # rows count downwards
                    rows = slice(max(0, begin + side // 2), max(0, end + side // 2))
                    shown[0, rows] = radiance
                else:
                    x, y = (begin, end), (-reach, reach)
                    columns = slice(max(0, begin + side // 2), max(0, end + side // 2))
                    shown[1, :, columns] = radiance
                x, y = (tuple(value * angle * z for value in pair) for pair in (x, y))
                lamps.append((cls.rectangle(x, y, z), float(radiance)))
        left = torch.zeros(side, side, dtype=torch.bool)
        left[:, : side // 2] = True
        sheets = [(left, 1 / NEAR, shown[0]), (torch.ones_like(left), 1 / FAR, shown[1])]
        return cls.model(lamps), cls.view(size, margin, angle, sheets)


@pytest.fixture
def screens() -> type[Screens]:
    return Screens
