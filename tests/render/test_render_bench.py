"""The benchmark of rendering, small: all ways show the same scene, and noise is what it is called."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import render as bench
from benchmarks.packed import PackedScene
from benchmarks.spectral_film import SpectralFilm
from edofsim.render.engine import use_engine
from edofsim.render.translate import build_stage


def test_relative_noise_is_the_standard_deviation_over_the_mean():
    """Images of mean 4 and 10 with noise of 1 and 5 in two bands: sqrt((1/16 + 25/100) / 2)."""
    draw = np.random.default_rng(0).standard_normal((4, 2, 200, 200))
    images = np.array([4.0, 10.0])[:, None, None] + np.array([1.0, 5.0])[:, None, None] * draw
    assert bench.relative_noise(images) == pytest.approx(np.sqrt((1 / 16 + 25 / 100) / 2), rel=0.02)


@pytest.mark.parametrize(("alike", "expected"), [(True, 0.25), (False, 0.25 / np.sqrt(8))])
def test_noise_of_a_channel_averages_only_where_bands_differ(alike: bool, expected: float):
    """Eight bands with weights of one eighth: noise that is one for all stays, other falls by root 8."""
    draw = np.random.default_rng(1).standard_normal((4, 1 if alike else 8, 150, 150))
    images = list(np.broadcast_to(4 + draw, (4, 8, 150, 150)))
    cost = bench.cost_of(images, [1.0, 3.0, 2.0, 2.0], 16, np.full((1, 8), 1 / 8))
    assert cost.band == pytest.approx(0.25, rel=0.02)
    assert cost.channel == pytest.approx(expected, rel=0.02)
    assert cost.seconds == 2.0


def test_the_strongest_setting_of_an_opponent_is_the_main_ratio():
    """Of two samplers the one with the smaller product of seconds and noise squared, for each measure apart;
    the smallest ratio comes first."""
    ours = bench.Cost(2.0, 16, 0.1, 0.1)
    costs: bench.Costs = {("bands", "", 16): ours, ("view", "", 16): ours}
    costs["specfilm", "independent", 16] = bench.Cost(2.0, 16, 0.4, 0.2)
    costs["specfilm", "orthogonal", 16] = bench.Cost(4.0, 25, 0.2, 0.2)
    costs["rgb", "stratified", 16] = bench.Cost(1.0, 16, 0.1, 0.1)
    found = bench.figures_of(costs)
    assert found["channel_ratio.strongest.specfilm.16s"] == pytest.approx(4)
    assert found["band_ratio.strongest.specfilm.16s"] == pytest.approx(8)
    assert found["channel_ratio.strongest.rgb.16s"] == pytest.approx(0.5)
    assert next(iter(found)) == "channel_ratio.strongest.rgb.16s"
    assert "band_ratio.strongest.rgb.16s" not in found
    assert found["times_path_image.16s"] == pytest.approx(2)


@pytest.mark.parametrize("sampler", bench.SAMPLERS)
def test_opponents_show_what_ours_shows(make, sampler: str):
    """A grey card under a sky with a sloping spectrum, whose image is one number a band: by ours, by rgb
    passes, and by the spectral film, which counts light per band, the same up to one factor for all bands."""
    rho = np.linspace(0.1, 0.9, 7)
    card = make.thing("card", make.facing(4, 4, 1.0), make.matt(make.flat(rho, 7)))
    model = make.model([card], sky=2.0, bands=7)
    settings = make.settings(8, 8, max_depth=2, samples=64, hidden=False)
    mi = use_engine()
    stage = build_stage(mi, model)
    ours = bench.view_image(mi, stage, model, settings, 0).mean((1, 2))
    assert ours == pytest.approx(2 * rho, rel=0.02)
    packed = PackedScene(mi, model, settings, sampler=sampler)
    theirs = bench.packed_cost(packed, model, 64, np.eye(7))
    assert theirs.samples == {"orthogonal": 121}.get(sampler, 64)
    packed.set_bands([0, 3, 6])
    assert packed.image(64, 1).mean((1, 2)) == pytest.approx(ours[[0, 3, 6]], rel=0.03)
    film = SpectralFilm(use_engine(colours="spectral"), model, settings, sampler)
    spectral = film.image(256, 1).mean((1, 2))
    inner = slice(1, -1)  # the outermost bands reach beyond the wavelengths that Mitsuba draws for the scene
    shape = ours[inner] / ours[inner].mean()
    assert spectral[inner] / spectral[inner].mean() == pytest.approx(shape, rel=0.1)
    use_engine()
