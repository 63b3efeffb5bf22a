"""Where depth edges are, and the cameras that ways to composite them are judged through."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from ..capture.framing import framed
from ..errors import InputError
from ..optics import Camera
from ..optics.lenses.plano_convex import PlanoConvexLens
from ..optics.masks.clear import ClearMask
from ..optics.masks.cubic import CubicMask
from ..recipe import CameraRecipe, Loaded, SceneRecipe
from ..reference.pinhole import Crop
from ..render.view import View

MASKS = ("clear", "cubic", "smooth")
WINDOW = 64
"""Side of the PSFs, and the margin around the crop twice."""
SIZE = 64
GAPS = (0.25, 1.3)
"""Depth edges of this many dioptres count, for the paper's aperture: blurs are then no wider than the window.
Other apertures have the same blurs."""
APERTURE_MM, PIXEL_MRAD = 2.5, 0.16264
"""Of the paper's camera: radius, and the angle that a pixel sees."""
THIN_LENS = "thin-lens"
"""Stands in place of a mask: the clear aperture, judged by rays."""


@dataclass(frozen=True)
class Edge:
    """A crop, and the inverse depths in 1/m of what is in front and behind at its depth edges."""

    where: Crop
    near: float
    far: float


def smooth_height_map() -> Tensor:
    """White noise under a Gaussian of 10 samples, [n, n] in metres, float32, with the samples of 21 um and
    the height of the paper's mask (Fig. `MTF`)."""
    samples, width, top = 238, 10.0, 1.135e-6
    noise = torch.randn(samples, samples, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    f = torch.fft.fftfreq(samples, dtype=torch.float64)
    window = torch.exp(-2 * (math.pi * width) ** 2 * (f[:, None] ** 2 + f**2))
    height = torch.fft.ifft2(torch.fft.fft2(noise) * window).real
    return ((height - height.min()) / (height.max() - height.min()) * top).float()


def busiest_edge(view: View, gaps: tuple[float, float] = GAPS) -> Edge:
    """The crop of `SIZE` pixels with the most depth edge in it, each pixel of edge counted by its jump of
    inverse depth, on a raster of half its size.

    gaps: the least and the largest jump that counts, 1/m.

    Raises InputError for a view without such edges.
    """
    depth = view.crop_margin(view.mean_inverse_depth())
    # two pixels apart: a pixel on an edge has a depth between those of its neighbours
    pairs = ((depth[:-2, :-2], depth[2:, :-2]), (depth[:-2, :-2], depth[:-2, 2:]))
    jumps = torch.stack([(a - b).abs() for a, b in pairs])
    jumps = torch.where((jumps >= gaps[0]) & (jumps <= gaps[1]), jumps, torch.zeros_like(jumps))
    best, most = (0, 0), -1.0
    for top in range(0, view.height - SIZE + 1, SIZE // 2):
        for left in range(0, view.width - SIZE + 1, SIZE // 2):
            edge = float(jumps[:, top : top + SIZE, left : left + SIZE].sum())
            if edge > most:
                best, most = (top, left), edge
    inside = (slice(best[0], best[0] + SIZE), slice(best[1], best[1] + SIZE))
    near, far = (
        torch.cat([which(a, b)[inside][jump[inside] > 0] for (a, b), jump in zip(pairs, jumps, strict=True)])
        for which in (torch.maximum, torch.minimum)
    )
    if not near.numel():
        raise InputError(f"the view has no depth edge between {gaps[0]:.2g} and {gaps[1]:.2g} dioptres")
    return Edge(Crop(*best, SIZE, SIZE), float(near.median()), float(far.median()))


def focus_distances(edge: Edge) -> dict[str, float]:
    """Distances in metres a quarter of the gap in front of both surfaces, midway, and as far behind both."""
    gap = edge.near - edge.far
    places = {"front": edge.near + gap / 4, "between": edge.near - gap / 2, "behind": edge.far - gap / 4}
    return {name: 1 / max(place, 0.05) for name, place in places.items()}


@dataclass(frozen=True)
class TestCameras:
    """What photographs the edges.

    own: a camera with its mask; None for the paper's lens with `MASKS`.
    """

    own: Camera | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the masks, the `THIN_LENS` apart."""
        return MASKS if self.own is None else (self.own.recipe.name,)

    def framed(self, recipe: SceneRecipe) -> SceneRecipe:
        """A scene in the pixels that the camera has, see `capture.framing.framed`."""
        return recipe if self.own is None else framed(recipe, self.own)

    def gaps(self, pixel_angle: float) -> tuple[float, float]:
        """Jumps of inverse depth that count as depth edges, 1/m."""
        if self.own is None:
            return GAPS
        wider = self.own.aperture_radius * 1e3 / APERTURE_MM * PIXEL_MRAD / (pixel_angle * 1e3)
        return GAPS[0] / wider, GAPS[1] / wider

    def at(self, name: str, distance: float, pixel_angle: float) -> Camera:
        """A camera of `names`, or the `THIN_LENS`, at a focus, its pixels seeing this angle there."""
        if self.own is None:
            return camera_with(name, distance, pixel_angle)
        camera = self.own
        if name == THIN_LENS:
            camera = camera.without_mask()
            camera = replace(camera, lens=camera.lens.without_spherical_aberration())
        return refocused(camera, distance, pixel_angle)


def test_cameras(loaded: Loaded[CameraRecipe] | None) -> TestCameras:
    """Of a camera's recipe with its mask as it is made; None for the paper's. Raises InputError for one that
    cannot be built."""
    return TestCameras(None if loaded is None else Camera.from_recipe(loaded.recipe, loaded.base))


def refocused(camera: Camera, distance: float, pixel_angle: float, window: int = WINDOW) -> Camera:
    """A camera focused at a distance in metres, with pixels that see an angle there, and without noise."""
    given = camera.recipe
    focus = given.focus.model_copy(update={"distance_m": distance})
    psf = given.psf.model_copy(update={"window_px": window})
    quiet = given.sensor.model_copy(update={"read_noise": 0.0})
    moved = given.model_copy(update={"focus": focus, "psf": psf, "sensor": quiet})
    pixel = Camera.from_recipe(moved, camera.base).sensor_distance * pixel_angle * 1e6
    sensor = quiet.model_copy(update={"pixel_um": pixel})
    made = Camera.from_recipe(moved.model_copy(update={"sensor": sensor}), camera.base)
    return replace(made, lens=camera.lens).with_height(camera.height_map)


def camera_with(
    mask: str, distance: float, pixel_angle: float, window: int = WINDOW, aperture_mm: float = APERTURE_MM
) -> Camera:
    """The paper's lens with pixels that see the view's angle at this focus, and a mask, or none for the
    `THIN_LENS`: as that, it is then without aberrations."""
    profile: Literal["parabolic", "spherical"] = "parabolic" if mask == THIN_LENS else "spherical"
    recipe = CameraRecipe(
        name=f"paper-{mask}",
        lens=PlanoConvexLens(aperture_radius_mm=aperture_mm, surface_profile=profile),
        mask=CubicMask(alpha_rad=30.0) if mask == "cubic" else ClearMask(),
    )
    camera = refocused(Camera.from_recipe(recipe), distance, pixel_angle, window)
    return camera.with_height(smooth_height_map()) if mask == "smooth" else camera
