"""Hard scenes for the renderer.

A surface of reflectance a that sees nothing but a sky of constant radiance L sends out a L, whatever its
place, size and tilt: the truth of most cases.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from edofsim.render.rendering import render_model
from edofsim.render.settings import RenderSettings
from edofsim.render.view import View
from edofsim.scene.model import BandTexture, Environment, SceneModel, SceneObject, Surface, TriangleMesh
from edofsim.stability.case import Case, Finding, timed

BANDS = 3
ALBEDO = 0.5
NOISE = 0.02
"""Of the mean of a view of 12 x 16 pixels and 64 samples."""


def spectrum(value: float) -> BandTexture:
    """The same in every band."""
    return BandTexture(np.full((1, BANDS), value, np.float32))


def sheet(
    z: float, half: float, tilt: float = 0.0, extra: tuple[tuple[int, int, int], ...] = ()
) -> TriangleMesh:
    """A square of side 2 `half` about (0, 0, z) that faces the camera, turned by `tilt` radians about its
    middle column; extra: further triangles of its corners."""
    x, turn = np.array([-half, -half, half, half]), np.array([np.cos(tilt), np.sin(tilt)])
    y = np.array([-half, half, half, -half])
    vertices = np.stack([x * turn[0], y, z + x * turn[1]], axis=1)
    return TriangleMesh(
        vertices.astype(np.float32), np.array([(0, 1, 2), (0, 2, 3), *extra], np.uint32), None
    )


def matt(
    mesh: TriangleMesh, albedo: float = ALBEDO, lamp: float | None = None, name: str = "sheet"
) -> SceneObject:
    """A matt object; lamp: its own radiance."""
    emission = None if lamp is None else np.full(BANDS, lamp, np.float32)
    return SceneObject(name, mesh, Surface({"type": "diffuse"}, "reflectance", spectrum(albedo)), emission)


def view_of(
    objects: list[SceneObject],
    sky: float | None = 1.0,
    angle: float = 0.01,
    *,
    hidden: bool = False,
    samples: int = 64,
    max_depth: int = 5,
    pupil_radius: float = 3e-3,
) -> View:
    """A small view of the objects under a sky of constant radiance."""
    environment = None if sky is None else Environment(spectrum(sky))
    model = SceneModel("hard", np.linspace(450e-9, 650e-9, BANDS), tuple(objects), environment)
    frame = RenderSettings(
        height=12,
        width=16,
        margin=0,
        pixel_angle=angle,
        hidden=hidden,
        samples=samples,
        max_depth=max_depth,
        pupil_radius=pupil_radius,
    )
    return View.of(render_model(model, frame))


def radiance_error(view: View, truth: float) -> float:
    """Of the mean radiance, relative; NaN where a pixel is not finite."""
    image = view.all_in_focus().double()
    whole = view.coverage.double()[~view.hidden].sum() / (view.height * view.width)
    return float((image.mean() / truth - 1).abs()) + float((whole - 1).abs()) + 0 * float(image.sum())


def depth_error(view: View, z: float) -> float:
    """Of the depth of a plane at z, relative, at the worst fragment."""
    return float((view.inverse_depth.double() * z - 1).abs().max())


def _plane(
    z: float, bound: float = NOISE, samples: int = 64, max_depth: int = 5
) -> Callable[[], Iterator[Finding]]:
    def check() -> Iterator[Finding]:
        for hidden in (False, True):
            view = view_of([matt(sheet(z, z))], hidden=hidden, samples=samples, max_depth=max_depth)
            way = ", hidden surfaces" if hidden else ""
            yield timed(f"radiance{way}", bound, lambda view=view: radiance_error(view, ALBEDO))
            yield timed(f"depth{way}", 1e-5, lambda view=view: depth_error(view, z))

    return check


def _objects(
    make: Callable[[], list[SceneObject]], truth: float, sky: float | None = 1.0, bound: float = NOISE
) -> Callable[[], Iterator[Finding]]:
    def check() -> Iterator[Finding]:
        for hidden in (False, True):
            view = view_of(make(), sky, hidden=hidden)
            way = "radiance, hidden surfaces" if hidden else "radiance"
            yield timed(way, bound, lambda view=view: radiance_error(view, truth))

    return check


def _grazing() -> Iterator[Finding]:
    """A sheet seen and lit at 89.9 degrees still shows a L, and its depth is geometry's."""
    tilt = np.radians(89.9)
    view = view_of([matt(sheet(2.0, 1.5, tilt))], angle=2e-4)

    def shown() -> float:
        on = view.inverse_depth > 0
        colour = (view.radiance[:, on] / view.coverage[on]).double()
        return float((colour.mean() / ALBEDO - 1).abs())

    yield timed("radiance", NOISE, shown)


def _grazing_lamp() -> Iterator[Finding]:
    """A lamp of side s, 100 m beside a sheet and 0.1 degrees above it: a / pi L s^2 cos / d^2."""
    side, far, light = 0.02, 100.0, 1e9
    above = far * np.tan(np.radians(0.1))
    corner = np.array([far, -side / 2, 2.0 - above - side / 2])
    up, along = np.array([0, side, 0]), np.array([0, 0, side])
    corners = np.stack([corner, corner + along, corner + along + up, corner + up]).astype(np.float32)
    lamp = TriangleMesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.uint32))
    square = far**2 + above**2
    truth = ALBEDO / np.pi * light * side**2 * (far * above / square) / square
    objects = [matt(sheet(2.0, 2.0)), matt(lamp, 0.0, light, "lamp")]
    view = view_of(objects, None, angle=1e-3, max_depth=2)
    yield timed("radiance", NOISE, lambda: radiance_error(view, truth))


def _black() -> Iterator[Finding]:
    """A black sheet shows nothing, whatever shines on it."""
    view = view_of([matt(sheet(2.0, 2.0), 0.0)], 1e3)
    yield timed("radiance", 0.0, lambda: float(view.radiance.double().abs().max()))


def _contrast() -> Iterator[Finding]:
    """A lamp of 1e5 beside a sheet that it does not light."""
    lamp = matt(sheet(2.0, 0.05), 0.0, 1e5, "lamp")
    dark = matt(sheet(4.0, 4.0), ALBEDO, None, "dark")
    view = view_of([lamp, dark], 1.0)

    def lit() -> float:
        # where a pixel shows nothing but the lamp
        on = (view.inverse_depth > 0.4) & (view.coverage > 1 - 1e-6)
        return float((view.radiance[:, on].double() / 1e5 - 1).abs().max()) if bool(on.any()) else np.nan

    yield timed("lamp seen directly", 1e-5, lit)


COLOURS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9], [0.25, 0.05, 0.45]], np.float32)
"""Radiance [place, band] of four patches: top left, top right, bottom left, bottom right."""


def _patches() -> Iterator[Finding]:
    """Four lamps at as many depths: each place shows its own light, at its own depth. Meshes are in the
    camera's axes: x to the right, y up, z the depth. And a sheet that reflects each band otherwise."""
    depth = np.array([1.0, 1.6, 2.5, 4.0])
    patches = []
    for place, (z, colour) in enumerate(zip(depth, COLOURS, strict=True)):
        x, y = (-0.5 if place % 2 == 0 else 0.5) * z, (0.5 if place < 2 else -0.5) * z
        mesh = sheet(float(z), float(0.5 * z))
        moved = TriangleMesh(mesh.vertices + np.array([x, y, 0], np.float32), mesh.faces, None)
        surface = Surface({"type": "diffuse"}, "reflectance", spectrum(0.0))
        patches.append(SceneObject(f"patch {place}", moved, surface, colour))
    view = view_of(patches, None, angle=0.1, hidden=True)
    image = view.all_in_focus().double().numpy()
    seen = (~view.hidden) & (view.coverage > 0.999)
    rows, columns = view.padded_shape
    at = np.zeros(rows * columns)
    at[view.pixel[seen].numpy()] = view.inverse_depth[seen].double().numpy()
    for place, name in enumerate(("top left", "top right", "bottom left", "bottom right")):
        half_rows = slice(1, rows // 2 - 1) if place < 2 else slice(rows // 2 + 1, rows - 1)
        half_columns = slice(4, columns // 2 - 1) if place % 2 == 0 else slice(columns // 2 + 1, columns - 4)
        colour = image[:, half_rows, half_columns].mean((1, 2))
        there = at.reshape(rows, columns)[half_rows, half_columns]
        yield timed(
            f"{name}, radiance",
            1e-5,
            lambda c=colour, p=place: float(np.abs(c / COLOURS[p] - 1).max()),
        )
        yield timed(f"{name}, depth", 1e-5, lambda t=there, z=depth[place]: float(np.abs(t * z - 1).max()))
    for place, colour in enumerate(COLOURS):
        surface = Surface({"type": "diffuse"}, "reflectance", BandTexture(colour[None]))
        found = (
            view_of([SceneObject("sheet", sheet(2.0, 2.0), surface, None)])
            .all_in_focus()
            .double()
            .mean((1, 2))
        )
        yield timed(
            f"spectrum {place}, reflectance",
            NOISE,
            lambda f=found, p=place: float(np.abs(f.numpy() / COLOURS[p] - 1).max()),
        )


def _behind() -> Iterator[Finding]:
    """A near strip before a wall: what is behind it is found, at the wall's depth and as bright as it is."""
    near = TriangleMesh(
        np.array([[-0.02, -1, 1], [-0.02, 1, 1], [0.02, 1, 1], [0.02, -1, 1]], np.float32),
        np.array([(0, 1, 2), (0, 2, 3)], np.uint32),
    )
    view = view_of([matt(near, 0.2, name="strip"), matt(sheet(4.0, 4.0))], hidden=True, pupil_radius=0.05)
    hidden, front = view.hidden, view.inverse_depth > 0.5
    held = float(front.double().sum())

    def light() -> float:
        colour = view.radiance[:, hidden].double() / view.coverage[hidden].double()
        return float((colour.mean() / ALBEDO - 1).abs()) if bool(hidden.any()) else np.nan

    def depth() -> float:
        return (
            float((view.inverse_depth[hidden].double() * 4 - 1).abs().max()) if bool(hidden.any()) else np.nan
        )

    yield timed("as much is hidden as hides", 0.0, lambda: abs(float(hidden.double().sum()) / held - 1))
    yield timed("radiance of what is hidden", 0.05, light)
    yield timed("depth of what is hidden", 1e-5, depth)


CASES: tuple[Case, ...] = (
    Case(
        "four patches",
        "renderer",
        "four lights in three bands at four depths, each at its place",
        "a picture mirrored, bands exchanged, rays' length for depth",
        "each its own light, z along the axis",
        _patches,
    ),
    Case(
        "behind a strip",
        "renderer",
        "a strip 1 m away before a wall 4 m away",
        "nothing known of what a blur uncovers",
        "the wall's depth and light",
        _behind,
    ),
    Case(
        "a scene of 1 mm",
        "renderer",
        "a plane at 1 mm",
        "offsets in metres",
        "reflectance times sky",
        _plane(1e-3),
    ),
    Case(
        "a scene of 1 km",
        "renderer",
        "a plane at 1 km",
        "offsets in metres",
        "reflectance times sky",
        _plane(1e3),
    ),
    Case(
        "a scene of 1000 km",
        "renderer",
        "a plane at 1e6 m",
        "single precision of positions",
        "reflectance times sky",
        _plane(1e6),
    ),
    Case(
        "one sample a pixel",
        "renderer",
        "no two samples to compare",
        "0 / 0 in the error",
        "reflectance times sky",
        _plane(2.0, 0.1, samples=1),
    ),
    Case(
        "one bounce",
        "renderer",
        "direct light alone",
        "nothing left of the path",
        "reflectance times sky",
        _plane(2.0, max_depth=2),
    ),
    Case(
        "coincident surfaces",
        "renderer",
        "two sheets in one plane",
        "light that leaks between them",
        "reflectance times sky",
        _objects(lambda: [matt(sheet(2.0, 2.0)), matt(sheet(2.0, 2.0), name="twin")], ALBEDO, bound=0.05),
    ),
    Case(
        "degenerate triangles",
        "renderer",
        "triangles without area",
        "normals of length 0",
        "reflectance times sky",
        _objects(lambda: [matt(sheet(2.0, 2.0, extra=((0, 0, 0), (1, 1, 2), (0, 2, 2))))], ALBEDO),
    ),
    Case(
        "needle",
        "renderer",
        "a triangle a nanometre wide before a wall",
        "normals that overflow",
        "reflectance times sky",
        _objects(
            lambda: [
                matt(
                    TriangleMesh(
                        np.array([[0, -1, 1], [0, 1, 1], [1e-9, 1, 1]], np.float32),
                        np.array([[0, 1, 2]], np.uint32),
                        None,
                    ),
                    name="needle",
                ),
                matt(sheet(2.0, 2.0)),
            ],
            ALBEDO,
        ),
    ),
    Case(
        "empty scene",
        "renderer",
        "nothing but sky",
        "a scene without surfaces",
        "the sky",
        _objects(lambda: [matt(sheet(-5.0, 0.1))], 1.0, bound=1e-5),
    ),
    Case(
        "white everywhere",
        "renderer",
        "reflectance 1",
        "energy that grows with bounces",
        "the sky",
        _objects(lambda: [matt(sheet(2.0, 2.0), 1.0)], 1.0),
    ),
    Case(
        "black surface",
        "renderer",
        "a path that carries nothing",
        "a weight of 0 / 0",
        "no light",
        _black,
    ),
    Case(
        "lamp as a wall",
        "renderer",
        "all that is seen shines",
        "light counted twice",
        "its radiance",
        _objects(lambda: [matt(sheet(2.0, 2.0), 0.0, 7.0)], 7.0, None, bound=1e-5),
    ),
    Case(
        "grazing light",
        "renderer",
        "a sheet seen at 89.9 degrees",
        "cosines near 0",
        "reflectance times sky",
        _grazing,
    ),
    Case(
        "grazing lamp",
        "renderer",
        "a lamp 0.1 degrees above the plane of a sheet",
        "rays that hit where they start",
        "the lamp's irradiance",
        _grazing_lamp,
    ),
    Case(
        "contrast 1e5 and a lamp seen",
        "renderer",
        "a lamp of 1e5 in the frame",
        "fireflies",
        "the lamp's radiance",
        _contrast,
    ),
)
