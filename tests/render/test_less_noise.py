"""Where samples go: light samples to lamps or the sky, and fewer behind edges. Neither moves the mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from edofsim.render import rendering, translate
from edofsim.render.passes import launches_of
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
        monkeypatch.setattr(rendering, "launches_of", lambda *arguments: [
            replace(launch, samples=launch.weight) for launch in launches_of(*arguments)])  # fmt: skip
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
