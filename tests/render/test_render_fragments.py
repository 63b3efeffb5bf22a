"""Fragments: depth taken per sample, silhouettes, and the light behind edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.render.depths import split
from edofsim.render.edges import seen_around
from edofsim.render.rendering import render_model
from edofsim.render.view import View


def test_depth_of_a_tilted_plane(mi, make):
    """Inverse depth of a plane n.p = c seen along (x, y, 1) is (n.(x, y, 1)) / c, linear over the picture."""
    slope, c = 0.7, 1.5
    # z = 1.5 - 0.7 x: corners well outside of the frame
    corners = [(x, y, c - slope * x) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    plane = make.thing("plane", make.quad(corners), make.matt(0.5))
    settings = make.settings(24, 16, margin=3, angle=0.01, samples=64, max_depth=1)
    view = View.of(render_model(make.model([plane], sky=1.0), settings))
    rows, columns = view.padded_shape
    x = (np.arange(columns) + 0.5 - columns / 2) * 0.01
    expected = np.broadcast_to((1 + slope * x) / c, (rows, columns))
    assert view.mean_inverse_depth().numpy() == pytest.approx(expected, rel=1e-4)
    # A slanted surface is one surface: nothing to see behind it, and no pass for it
    assert not view.hidden.any() and len(view.pixel) == rows * columns
    assert view.metadata["hidden"] == "none: no depth edge"
    assert view.metadata["layers"] == [rows * columns]


def test_sphere_before_a_wall(mi, make):
    """Silhouette pixels have a fragment on the sphere and one on the wall, and their coverages are those of
    the circle that the sphere's outline is: a sphere of radius r at distance d has half angle asin(r / d)."""
    radius, distance = 0.05, 1.0
    ball = make.thing("ball", make.sphere(radius, (0, 0, distance), rings=96), make.matt(0.5))
    wall = make.thing("wall", make.facing(4, 4, 3.0), make.matt(0.5))
    settings = make.settings(40, 40, angle=0.004, samples=64, max_depth=1, hidden=False)
    view = View.of(render_model(make.model([ball, wall], sky=1.0), settings))
    count = torch.bincount(view.pixel, minlength=1600)
    total = torch.zeros(1600).index_add_(0, view.pixel, view.coverage)
    assert torch.allclose(total, torch.ones(1600), atol=1e-6)
    outline = np.tan(np.arcsin(radius / distance)) / 0.004  # in pixels
    y, x = np.mgrid[:40, :40]
    corner = [np.hypot(x + dx - 20, y + dy - 20) for dx in (0, 1) for dy in (0, 1)]
    crossed = (np.min(corner, axis=0) < outline - 0.1) & (np.max(corner, axis=0) > outline + 0.1)
    plain = (np.max(corner, axis=0) < outline - 0.1) | (np.min(corner, axis=0) > outline + 0.1)
    several = (count.numpy() > 1).reshape(40, 40)
    assert not several[plain].any()
    assert several[crossed].mean() > 0.9
    near = view.inverse_depth > 0.5
    assert (view.inverse_depth[~near] - 1 / 3).abs().max() < 1e-4
    area = float(view.coverage[near].sum())
    assert area == pytest.approx(np.pi * outline**2, rel=2e-3)


def test_background_is_a_fragment_at_infinity(mi, make):
    card = make.thing("card", make.facing(0.02, 4, 1.0), make.matt(0.5))
    view = View.of(render_model(make.model([card], sky=2.0), make.settings(8, 4, angle=0.01, samples=16)))
    sky = view.inverse_depth == 0
    assert sky.any() and torch.allclose(view.radiance[:, sky], 2 * view.coverage[sky])
    visible = torch.zeros(32).index_add_(0, view.pixel[~view.hidden], view.coverage[~view.hidden])
    assert torch.allclose(visible, torch.ones(32))
    # What is hidden by the card is sky, too
    assert view.hidden.any() and (view.inverse_depth[view.hidden] == 0).all()


def test_hidden_surface_reaches_as_far_as_the_pupil_sees(mi, make):
    """Behind a card at z1 before a wall at z2, a pupil of radius a sees a (1/z1 - 1/z2) beyond the edge."""
    near, far, pupil, angle = 0.8, 2.0, 8e-3, 1e-3
    card = make.thing("card", make.facing(0.4, 4, near, x=-0.2), make.matt(0.2))  # its right edge is at x = 0
    wall = make.thing("wall", make.facing(8, 8, far), make.matt(0.9))
    settings = make.settings(40, 4, angle=angle, samples=16, max_depth=2, pupil_radius=pupil)
    view = View.of(render_model(make.model([card, wall], sky=1.0), settings))
    assert (view.inverse_depth[view.hidden] - 1 / far).abs().max() < 1e-4
    columns = np.unique(view.pixel[view.hidden].numpy() % 40)
    reach = pupil * (1 / near - 1 / far) / angle
    assert reach == pytest.approx(6)
    assert list(columns[-6:]) == list(range(14, 20))
    assert columns[0] >= 12  # and not much more than is needed
    # The wall is as bright there as beside the card: Lambert under an even sky, but for the card's own shade
    hidden, seen = view.radiance[:, view.hidden].mean(), view.radiance[:, view.inverse_depth < 1].mean()
    assert hidden == pytest.approx(float(seen), rel=0.15)


def test_back_of_a_closed_thing_is_not_a_hidden_surface(mi, make):
    """Behind a ball comes the wall, not the ball's own inside."""
    ball = make.thing("ball", make.sphere(0.03, (0, 0, 0.5), rings=24), make.matt(0.5))
    wall = make.thing("wall", make.facing(8, 8, 2.0), make.matt(0.5))
    settings = make.settings(32, 32, angle=0.005, samples=16, max_depth=1, pupil_radius=0.02)
    view = View.of(render_model(make.model([ball, wall], sky=1.0), settings))
    assert view.hidden.any()
    assert (view.inverse_depth[view.hidden] - 0.5).abs().max() < 1e-4


def test_a_sheet_seen_from_behind_is_a_hidden_surface(mi, make):
    """A leaf has two sides: whichever it turns to the camera, it is in the way of what is behind it."""
    front = make.thing("front", make.facing(0.02, 0.2, 0.5), make.matt(0.5))
    leaf = make.facing(0.5, 0.5, 1.0)
    turned = replace(leaf, faces=leaf.faces[:, ::-1].copy())
    for mesh in (leaf, turned):
        scene = make.model([front, make.thing("leaf", mesh, make.matt(0.5))], sky=1.0)
        view = View.of(
            render_model(scene, make.settings(32, 8, angle=0.005, samples=16, max_depth=1, pupil_radius=0.02))
        )
        assert view.hidden.any() and (view.inverse_depth[view.hidden] - 1).abs().max() < 1e-4


def test_split_takes_the_widest_gaps():
    """At most so many surfaces a pixel, the closest of them taken together; a gap below the limit is none."""
    depths = np.array([[2.0, 1.0, 1.02, 0.5, 0.46], [1.0, 1.0, 1.0, 1.0, np.nan]], np.float32)
    bounds, tops = split(depths, 0.03, 3)
    assert bounds == pytest.approx(np.array([[1.51, 0.75], [-1, -1]]))
    assert tops == pytest.approx(np.array([[1.02, 0.5], [-1, -1]]))
    assert split(depths, 0.03, 4)[0][0] == pytest.approx(np.array([1.51, 0.75, 0.48]))
    assert split(depths, 0.05, 4)[0][0] == pytest.approx(np.array([1.51, 0.75, -1]))


def test_seen_around_is_the_definition(mi):
    """Against the definition, pixel by pixel: some pixel q with |p - q| < reach (nearest(p) -
    farthest(q))."""
    rng = np.random.default_rng(0)
    rows, columns = 24, 31
    y, x = np.mgrid[:rows, :columns]
    for _ in range(6):
        blocks = rng.uniform(0, 2, (rows // 5 + 1, columns // 5 + 1)).repeat(5, 0).repeat(5, 1)
        farthest = blocks[:rows, :columns].astype(np.float32)
        nearest = (farthest + (rng.random((rows, columns)) < 0.05) * 0.5).astype(np.float32)
        nearest[rng.random((rows, columns)) < 0.1] = -np.inf
        reach = rng.uniform(1, 8)
        expected = np.zeros((rows, columns), bool)
        for i, j in np.ndindex(rows, columns):
            distance = np.hypot(y - i, x - j)
            expected[i, j] = (
                nearest[i, j] - farthest > np.maximum(0.03, (distance - np.sqrt(2)) / reach)
            ).any()
        assert (seen_around(nearest, farthest, 0.03, reach) == expected).all()


def lens_scene(make):
    """A textured card with an edge down the middle before a textured wall; even light, three bands."""
    rng = np.random.default_rng(1)
    basis = np.eye(3, dtype=np.float32)

    def picture(level):
        return (level + 0.15 * rng.uniform(-1, 1, (12, 12, 3))).astype(np.float32)

    card = make.facing(0.2, 0.4, 0.8, x=-0.1)
    wall = make.facing(0.6, 0.6, 2.0)
    return make.model(
        [
            make.thing("card", card, make.matt(make.texture(basis, picture(0.75)))),
            make.thing("wall", wall, make.matt(make.texture(basis, picture(0.3)))),
        ],
        sky=1.0,
        bands=3,
    )


def thin_lens(mi, scene, settings, aperture, focus):
    """Mitsuba's own thin-lens camera, [band, y, x]."""
    from benchmarks.packed import PackedScene

    packed = PackedScene(
        mi,
        scene,
        settings,
        lens=(aperture, focus),
        integrator={"type": "direct", "bsdf_samples": 2, "emitter_samples": 0},
        sampler="multijitter",
    )
    return packed.image(4096, 1)


def photographed(view, aperture, focus, hidden):
    """The same photo from fragments by geometrical optics: over points of the pupil, fragments shifted by
    their parallax against the plane in focus, the near layer over the far one."""
    rows, columns = view.padded_shape
    layers = {}
    for name, chosen in (("near", view.inverse_depth > 0.9), ("far", view.inverse_depth <= 0.9)):
        used = chosen & (~view.hidden if not hidden else torch.ones_like(chosen))
        image = torch.zeros(4, rows * columns)
        image.index_add_(1, view.pixel[used], torch.cat([view.radiance, view.coverage[None]])[:, used])
        layers[name] = image.reshape(4, rows, columns).numpy()
    step = 0.25
    grid = np.arange(-1 + step / 2, 1, step / 4)
    points = [(s, t) for s in grid for t in grid if s * s + t * t < 1]
    out = np.zeros((3, rows, columns))
    for s, t in points:
        moved = {}
        for name, depth in (("near", 0.8), ("far", 2.0)):
            shift = aperture * (1 / depth - 1 / focus) / view.pixel_angle
            moved[name] = shifted(layers[name], t * shift, s * shift)
        far = moved["far"][:3] / np.maximum(moved["far"][3], 1e-6)  # where nothing was rendered it is black
        out += moved["near"][:3] + (1 - moved["near"][3]) * far * (moved["far"][3] > 1e-3)
    return out / len(points)


def shifted(image, down, right):
    """An image moved by a fraction of pixels, linearly interpolated, edges repeated."""
    from scipy.ndimage import shift

    return np.stack([shift(channel, (down, right), order=1, mode="nearest") for channel in image])


@pytest.mark.parametrize("focus", [2.0, 0.8], ids=["focus behind", "focus in front"])
def test_photo_from_fragments_is_the_thin_lens_photo(mi, make, focus):
    """With the light behind the edge, geometrical optics on fragments is Mitsuba's thin lens, 40 dB at the
    edge; without it, light is missing where the pupil looks around the card."""
    aperture, angle = 16e-3, 2e-3
    scene = lens_scene(make)
    settings = make.settings(32, 12, margin=8, angle=angle, samples=256, max_depth=2, pupil_radius=aperture)
    view = View.of(render_model(scene, settings))
    truth = thin_lens(mi, scene, settings, aperture, focus)
    edge = (slice(None), slice(8, -8), slice(24 - 8, 24 + 8))

    def psnr(image):
        return 10 * np.log10(truth.max() ** 2 / np.mean((image[edge] - truth[edge]) ** 2))

    whole = psnr(photographed(view, aperture, focus, hidden=True))
    without = psnr(photographed(view, aperture, focus, hidden=False))
    print(f"focus at {focus} m: {whole:.1f} dB with hidden fragments, {without:.1f} dB without")
    assert whole >= 40
    assert without < whole - 5


def test_no_survey_of_depths_where_pixels_are_not_parted(mi, make, monkeypatch):
    """One fragment a pixel and nothing hidden: the same radiance as with more fragments, and no depth is
    measured before."""
    ball = make.thing("ball", make.sphere(0.03, (0, 0, 1), rings=16), make.matt(0.5))
    wall = make.thing("wall", make.facing(4, 4, 3.0), make.matt(0.9))
    scene = make.model([ball, wall], sky=1.0)
    parted = View.of(render_model(scene, make.settings(samples=16, hidden=False, fragments=3)))

    def refuse(*arguments):
        raise AssertionError("depths were measured")

    monkeypatch.setattr("edofsim.render.tracing.depth_tiles", refuse)
    whole = View.of(render_model(scene, make.settings(samples=16, hidden=False, fragments=1)))
    assert len(parted.pixel) > len(whole.pixel) == 16 * 12
    np.testing.assert_allclose(whole.all_in_focus().numpy(), parted.all_in_focus().numpy(), rtol=1e-5)


def test_another_scene_of_the_same_kinds_compiles_nothing(mi, make):
    """Kernels are of the kinds of objects and lights, not of their number and place, nor of the layer, the
    number of pixels or the seed; and all layers share the large one."""
    import drjit as dr

    def compiled(shift, *more, **sizes):
        cards = [
            make.thing(f"card at {z} m", make.facing(width, width, z, x=shift * z), make.matt(0.2 + shift))
            for width, z in ((0.02, 0.5), (0.05, 1.0), (0.12, 2.0), *more)
        ]
        wall = make.thing("wall", make.facing(40, 40, 8.0), make.matt(0.5))
        dr.kernel_history_clear()
        view = View.of(
            render_model(
                make.model([*cards, wall], sky=1.0 + shift),
                make.settings(margin=4, angle=0.004, pupil_radius=0.02, samples=16, max_depth=3, **sizes),
            )
        )
        assert len(view.metadata["layers"]) == 3  # what is seen, and two surfaces behind it
        large = [entry for entry in dr.kernel_history() if entry.get("operation_count", 0) > 1000]
        return sum(not entry["cache_hit"] for entry in large), len({entry["hash"] for entry in large})

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        assert compiled(0.0, width=20, height=16)[1] == 1
        assert compiled(0.01, (0.3, 5.0), (0.4, 6.0), width=23, height=18, seed=5) == (0, 1)
