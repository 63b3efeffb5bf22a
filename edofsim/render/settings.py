"""How a view is rendered: the part of a scene recipe that the renderer itself needs."""

from __future__ import annotations

from dataclasses import dataclass

from ..recipe.scene import SceneRecipe, SeenFrame

INTEGRATOR = 5
"""Version of what turns a scene into numbers. Raised whenever the same recipe would give another view."""

SURVEY_SAMPLES = 64
"""At most this many samples a pixel tell the depths that it sees."""
LARGEST_PASS = 64
"""Samples beyond which stratifying them against each other gains little."""


@dataclass(frozen=True)
class RenderSettings:
    """height, width, margin: of the frame in pixels (see `View`). pixel_angle: tangent of one pixel's angle.
    chief_rays: those of a lens that distorts (see `recipe.scene.SeenFrame`). samples: a pixel. max_depth: 2
    is direct light alone. fragments: visible surfaces a pixel at most. gap: difference of inverse depth in
    1/m that parts two surfaces. hidden: whether to look behind edges. pupil_radius: in metres, of the widest
    pupil that may look behind them. noise: relative standard error to stop at, or None to take exactly
    `samples`.
    """

    height: int
    width: int
    margin: int
    pixel_angle: float
    samples: int = 64
    max_depth: int = 5
    fragments: int = 3
    gap: float = 0.03
    hidden: bool = True
    pupil_radius: float = 3e-3
    seed: int = 0
    noise: float | None = None
    chief_rays: tuple[tuple[float, float, float], ...] = ()

    @property
    def padded_shape(self) -> tuple[int, int]:
        """(rows, columns) of the frame with its margin."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin

    @property
    def pass_samples(self) -> int:
        """Samples of one pass: a power of two, at least two passes a view so that their scatter is known."""
        return samples_of_a_pass(self.samples)

    @classmethod
    def from_recipe(cls, recipe: SceneRecipe, noise: float | None = None) -> RenderSettings:
        """The settings of a recipe."""
        frame, render = recipe.frame, recipe.render
        return cls(
            height=frame.height_px,
            width=frame.width_px,
            margin=frame.margin_px,
            pixel_angle=frame.pixel_angle,
            samples=render.samples,
            max_depth=render.max_depth,
            fragments=render.fragments,
            gap=render.depth_gap_dpt,
            hidden=render.hidden,
            pupil_radius=render.pupil_radius_mm * 1e-3,
            seed=recipe.seed,
            noise=noise,
            chief_rays=frame.chief_rays if isinstance(frame, SeenFrame) else (),
        )


def samples_of_a_pass(samples: int) -> int:
    """Of this many in all: see `RenderSettings.pass_samples`."""
    size = 1
    while size < LARGEST_PASS and 4 * size <= samples:
        size *= 2
    return size
