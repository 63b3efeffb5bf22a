"""Where samples go: light samples to lamps or the sky, and fewer behind edges. Neither moves the mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from edofsim.render import rendering, translate
from edofsim.render.passes import Group, LaunchResult, Sums, launches_of, pass_sizes
from edofsim.render.rendering import render_model


def room(make, lamps=1, sky=0.5):
    """A card before a wall, under equal lamps and a sky."""
    over = [make.quad([(x, 1, 0.5), (x + 0.2, 1, 0.5), (x + 0.2, 1, 0.9), (x, 1, 0.9)])
            for x in np.linspace(-1, 1, lamps)]  # fmt: skip
    objects = [
        make.thing("card", make.facing(0.4, 4, 0.8, x=-0.2), make.matt(0.3, 3)),
        make.thing("wall", make.facing(8, 8, 2.0), make.matt(0.8, 3)),
        *(make.thing(f"lamp{n}", mesh, make.matt(0.0, 3), np.full(3, 40.0)) for n, mesh in enumerate(over)),
    ]
    return make.model(objects, sky, 3)


def test_a_smooth_sky_is_not_looked_for_beside_a_lamp(make):
    def sky_weight(**how):
        return translate._light_weights(room(make, **how))[-1]

    assert sky_weight() == 0 and sky_weight(lamps=2) == 0
    assert sky_weight(lamps=0) > 0 and sky_weight(lamps=6) > 0
    sun = np.ones((64, 128, 1), np.float32)
    assert sky_weight(sky=make.texture(np.ones((1, 3), np.float32), sun)) == 0
    sun[10, 20] = 5.0
    assert sky_weight(sky=make.texture(np.ones((1, 3), np.float32), sun)) > 0


SETTINGS = {"angle": 2e-3, "samples": 32, "max_depth": 3, "pupil_radius": 8e-3}


def images(scene, settings, first=0, seeds=8):
    """Visible and hidden light of each pixel, [seed, 2, pixel]; hidden light is 0 where nothing is hidden."""
    found = []
    for seed in range(first, first + seeds):
        view = render_model(scene, replace(settings, seed=seed))
        light = np.zeros((2, settings.width * settings.height))
        np.add.at(light, (view.hidden.astype(int), view.pixel), view.radiance.mean(0, dtype=np.float64))
        found.append(light)
    return np.stack(found)


@pytest.fixture(scope="module")
def ours(mi, make):
    return images(room(make), make.settings(16, 8, **SETTINGS))


@pytest.mark.parametrize("other", ["light samples for the sky", "all samples behind edges"])
def test_means_are_those_of_plain_rendering(ours, make, monkeypatch, other):
    """Welch's test of each pixel on independent images, its threshold corrected for their number (Sidak)."""
    if other == "light samples for the sky":
        monkeypatch.setattr(translate, "SMOOTH_SKY", 0.0)
    else:
        monkeypatch.setattr(rendering, "launches_of", lambda groups, number, samples, bands: [
            replace(launch, samples=samples, weight=samples)
            for launch in launches_of(groups, number, samples, bands)])  # fmt: skip
    plain = images(room(make), make.settings(16, 8, **SETTINGS), first=1000)
    seen = (ours.var(0) + plain.var(0)) > 0
    assert seen[1].any()

    def smallest(images):
        return stats.ttest_ind(images[..., seen], plain[..., seen], axis=0, equal_var=False).pvalue.min()

    least = 1 - (1 - 0.01) ** (1 / seen.sum())
    assert smallest(ours) > least
    assert smallest(ours * np.array([1, 1.1])[:, None]) < least  # 10 % too much light behind edges is found
    noise, before = (each.var(0, ddof=1).mean(-1) for each in (ours, plain))
    assert noise[0] < 0.8 * before[0] if "sky" in other else noise[1] > 1.3 * before[1]


def test_where_all_is_alike_fewer_samples_give_the_same(make):
    """Every sample meets a surface at 2 m of radiance 3, seen or behind an edge: that is what comes out,
    however few samples a pass takes there, an odd number of them, too."""
    pixels, limit = np.arange(4), np.full(4, 1.0, np.float32)
    groups = (Group((), pixels, None, 0), Group((limit,), pixels, None, 4))
    frame, sums = make.settings(2, 2, samples=11), Sums.empty(groups, bands=2)
    assert list(pass_sizes(frame)) == [4, 4, 3]
    for number, samples in enumerate(pass_sizes(frame)):
        launches = launches_of(groups, number, samples, bands=2)
        assert sum(launch.samples for launch in launches) < 2 * samples
        for launch in launches:
            hits = np.full(4, float(launch.samples))
            sums.add(launch, groups, LaunchResult([np.stack([3 * hits] * 2)], [hits], [hits / 2]))
        sums.finished(number, samples)
    view = rendering.assemble(np.array([5e-7, 6e-7]), frame, groups, sums, {})
    assert view.hidden.sum() == len(view.pixel) / 2 == 4
    np.testing.assert_allclose(view.coverage, 1, rtol=1e-6)
    np.testing.assert_allclose(view.radiance, 3, rtol=1e-6)
    np.testing.assert_allclose(view.inverse_depth, 0.5, rtol=1e-6)
    np.testing.assert_allclose(view.half_difference, 0, atol=1e-6)
