"""Broken renderings."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from importlib import import_module

import numpy as np

from edofsim.render import rendering
from edofsim.render.fragments import Fragments

from .mutant import Mutant, after, scaled, swapped, together

RENDERER = ("renderer",)


def _views(change: Callable[[Fragments], Fragments]) -> Callable[[], AbstractContextManager[object]]:
    return lambda: after(rendering, "assemble", change)


def _light(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[], AbstractContextManager[object]]:
    return _views(lambda view: replace(view, radiance=change(view.radiance)))


def _visible_alone(view: Fragments) -> Fragments:
    seen = ~view.hidden
    return replace(
        view,
        pixel=view.pixel[seen],
        coverage=view.coverage[seen],
        inverse_depth=view.inverse_depth[seen],
        radiance=view.radiance[:, seen],
        hidden=view.hidden[seen],
    )


def _along_rays(view: Fragments) -> Fragments:
    """Depth as the length of a ray."""
    rows, columns = view.padded_shape
    y = (view.pixel // columns - (rows - 1) / 2) * view.pixel_angle
    x = (view.pixel % columns - (columns - 1) / 2) * view.pixel_angle
    return replace(view, inverse_depth=(view.inverse_depth / np.sqrt(1 + x**2 + y**2)).astype(np.float32))


def _rays(across: float, down: float) -> Callable[[], AbstractContextManager[object]]:
    """A camera whose picture is mirrored."""

    def broken() -> AbstractContextManager[object]:
        rooms = [import_module(f"edofsim.render.{name}") for name in ("paths", "tracing")]

        def turned(rays):  # pyrefly: ignore  # Mitsuba's classes exist once a variant is set
            import mitsuba as mi

            way = rays.ray.d
            ray = mi.Ray3f(rays.ray.o, mi.Vector3f(across * way.x, down * way.y, way.z))
            return replace(rays, ray=ray)

        return together(*(after(room, "camera_rays", turned) for room in rooms))

    return broken


def _one_bounce_less() -> AbstractContextManager[object]:
    paths = import_module("edofsim.render.paths")
    inner = paths.trace

    def trace(stage: object, lens: object, samples: object, gap: float, max_depth: int) -> object:
        return inner(stage, lens, samples, gap, max_depth - 1)

    return swapped(paths, "trace", trace)


MUTANTS: tuple[Mutant, ...] = (
    Mutant("half the light", "in every pixel", RENDERER, _light(lambda x: 0.5 * x)),
    Mutant("light 5 % up", "in every pixel", RENDERER, _light(lambda x: 1.05 * x)),
    Mutant("bands of a view reversed", "violet is red", RENDERER, _light(lambda x: x[::-1].copy())),
    Mutant(
        "gamma",
        "light is stored as the root of itself",
        RENDERER,
        _light(lambda x: np.sqrt(np.maximum(x, 0))),
    ),
    Mutant("lamps clamped", "at a radiance of 100", RENDERER, _light(lambda x: np.minimum(x, 100))),
    Mutant("mirrored camera", "left and right change places", RENDERER, _rays(-1, 1)),
    Mutant("camera upside down", "top and bottom change places", RENDERER, _rays(1, -1)),
    Mutant("length of rays", "in place of depth along the axis", RENDERER, _views(_along_rays)),
    Mutant(
        "depth 1 % off",
        "everything is nearer",
        RENDERER,
        _views(lambda view: replace(view, inverse_depth=1.01 * view.inverse_depth)),
    ),
    Mutant("nothing hidden", "what is behind edges is not rendered", RENDERER, _views(_visible_alone)),
    Mutant(
        "light left to coverage",
        "every fragment covers its pixel",
        RENDERER,
        _views(lambda view: replace(view, coverage=np.ones_like(view.coverage))),
    ),
    Mutant("a bounce fewer", "than is asked for", RENDERER, _one_bounce_less),
    Mutant(
        "darker surfaces",
        "reflect 10 % less",
        RENDERER,
        lambda: scaled(import_module("edofsim.render.paths"), "affine", 0.9),
    ),
)
