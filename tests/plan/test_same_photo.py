"""The same photo everywhere: what is chosen depends on scene, camera and target, and on no machine."""

from __future__ import annotations

import itertools
import math
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture import Fidelity
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.plan import (
    Planner,
    Rendering,
    Target,
    all_effects,
    checked_overrule,
    choose,
    costs,
    planner_of,
    rates,
    remember,
)
from edofsim.plan.costs import Costs
from edofsim.plan.effect import Effect, Level
from edofsim.plan.estimate import Estimate, Estimates
from edofsim.recipe import CameraRecipe, load_camera, load_scene
from edofsim.recipe.camera import PsfSettings
from edofsim.render import render

from .test_plan_scenes import small

PSF = PsfSettings(window_px=32)
TARGETS = (Target(), *(Target("db", db) for db in (35.0, 45.0, 55.0)))
SCENES = ("desk", "stilllife", "motorcycle")
PAIRS = [
    *(("desk", mask) for mask in ("clear", "relief")),
    *(("stilllife", mask) for mask in ("clear", "cubic")),
    *(("motorcycle", mask) for mask in ("cubic", "relief")),
]
"""Each scene and each mask twice; `make test-all` takes all."""
MASKS: Mapping[str, Callable[[], Camera]] = {
    "clear": lambda: Camera.from_recipe(CameraRecipe(name="clear", psf=PSF)),
    "cubic": lambda: Camera.from_recipe(
        load_camera("paper-cubic").recipe.model_copy(update={"psf": PSF}), Path()
    ),
    "relief": lambda: Camera.from_recipe(CameraRecipe(name="relief", psf=PSF)).with_height(
        0.5e-6 * torch.rand(96, 96, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    ),
}


def planner_for(scene: str, mask: str, cache: Path | None = None) -> Planner:
    loaded = small(scene)
    recipe = loaded.recipe.model_copy(update={"bands": loaded.recipe.bands.model_copy(update={"count": 11})})
    return planner_of(render(recipe, loaded.base, cache=cache), MASKS[mask]())


def chosen(planner: Planner) -> list[Fidelity]:
    return [planner.plan(target).fidelity for target in TARGETS]


def asked(planner: Planner) -> list[object]:
    """What would be looked at, whatever is to save."""
    return [planner.costs.worth_asking(all_effects(), least_saved=least) for least in (0.0, 0.02, 0.1)]


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("views")


@pytest.fixture(scope="module")
def planners(cache: Path) -> dict[tuple[str, str], Planner]:
    return {pair: planner_for(*pair, cache) for pair in PAIRS}


def at_other_rates(planner: Planner, draw: random.Random) -> Planner:
    """The planner on a machine whose seconds of each kind of work are 0.3 to 3 times as long."""
    other = {
        stage: {
            kind: rate * 10 ** draw.uniform(math.log10(0.3), math.log10(3)) for kind, rate in kinds.items()
        }
        for stage, kinds in planner.costs.rates.items()
    }
    slower = draw.uniform(0.3, 3)
    rendering = replace(planner.costs.rendering, seconds=lambda fidelity: slower * (fidelity.bounces or 9))
    return replace(planner, costs=Costs(planner.facts, planner.costs.shape, other, rendering))


@pytest.mark.parametrize(
    "pair",
    [
        pytest.param(pair, marks=() if pair in PAIRS else pytest.mark.slow)
        for pair in itertools.product(SCENES, MASKS)
    ],
    ids="-".join,
)
def test_the_choice_is_the_same_on_machines_of_any_rates(planners, pair: tuple[str, str]):
    planner, draw = planners.get(pair) or planner_for(*pair), random.Random(str(pair))
    first, looked = chosen(planner), asked(planner)
    reported = sum(planner.seconds_of(first[0]).values())
    for _ in range(3):
        other = at_other_rates(planner, draw)
        assert chosen(other) == first and asked(other) == looked
        assert sum(other.seconds_of(first[0]).values()) != pytest.approx(reported)


def test_the_choice_is_a_saving_and_not_the_same_for_all(planners):
    """Else the tests above would hold for choices that are none."""
    found = [each for planner in planners.values() for each in chosen(planner)]
    assert len(set(found)) > 10
    for planner in planners.values():
        counted = planner.costs.reference
        costs = [counted(each) for each in chosen(planner)]
        assert costs[1] <= costs[2] <= costs[3] < counted(planner.facts.full)
        assert costs[1] < 0.5 * counted(planner.facts.full)


def test_what_photos_took_before_changes_what_is_reported_and_nothing_else(
    planners, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    planner = planners["desk", "clear"]
    first, seconds = chosen(planner), planner.seconds_of(planner.facts.full)
    monkeypatch.setattr(rates, "_known", {})
    monkeypatch.setattr(rates, "user_folder", lambda: tmp_path)
    monkeypatch.setattr(rates, "paces", lambda: rates.SHIPPED[rates.PACE])
    for slower in (0.4, 4.0):
        for _ in range(20):
            rates.learn({"blur": 1.0, "psf": 1.0}, {"blur": slower, "psf": 1.0})
    again = planner_of(planner.facts.view, planner.facts.camera)
    assert again.seconds_of(planner.facts.full) != seconds
    assert chosen(again) == first


def test_the_choice_is_the_same_whatever_rendering_takes_here(planners):
    """Only rays that are counted decide what of rendering is worth to leave out."""
    planner = planners["stilllife", "clear"]

    def rays(fidelity: Fidelity) -> float:
        return 1.0 * (fidelity.bounces or 9)

    plans = {
        replace(planner, costs=replace(planner.costs, rendering=Rendering(rays, lambda _, s=s: s)))
        .plan(Target("db", 40.0))
        .fidelity
        for s in (0.01, 1e4)
    }
    assert len(plans) == 1


def test_the_choice_is_the_same_for_any_count_of_threads_and_in_an_empty_home(
    planners, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A planner of two threads, for one of one, which shares the views and no file else."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(remember, "_folder", lambda: tmp_path / "plans")
    first, threads = chosen(planners["desk", "relief"]), torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        again = planner_for("desk", "relief", cache)
        assert any((tmp_path / "plans").iterdir()) and chosen(again) == first
    finally:
        torch.set_num_threads(threads)


def made_up(draw: random.Random) -> tuple[Estimates, Callable[[choose.Chosen], float]]:
    """Four effects of up to four levels each, with independent errors and costs that multiply in part."""
    rows, price = [], {}
    for number in range(4):
        name, count = f"effect {number}", draw.randint(2, 4)
        errors = sorted((10 ** draw.uniform(-4, -1) for _ in range(count - 1)), reverse=True)
        levels = tuple(Level(str(level), {}) for level in range(count))
        effect = Effect(name, lambda facts: (), lambda facts: "", added="noise")
        rows.append(Estimate(effect, "", levels, (*((e,) for e in errors), (0.0,)), (-1,) * count))
        price[name] = sorted(10 ** draw.uniform(-2, 0) for _ in range(count))
    estimates = Estimates(tuple(rows), torch.zeros(0, 0, dtype=torch.float64))

    def cost(levels: choose.Chosen) -> float:
        each = [price[name][level] for name, level in levels.items()]
        return each[0] * each[1] + sum(each[2:])

    return estimates, cost


def gaps(pick: Callable[..., choose.Chosen]) -> list[float]:
    """By how many times choices cost more than the best of all combinations; infinite beyond the budget."""
    found = []
    for seed in range(40):
        draw = random.Random(seed)
        estimates, cost = made_up(draw)
        budget = 10 ** draw.uniform(-3.5, -1)
        combinations = itertools.product(*(range(len(row.levels)) for row in estimates.rows))
        named = [
            dict(zip((row.effect.name for row in estimates.rows), levels, strict=True))
            for levels in combinations
        ]
        best = min(cost(each) for each in named if estimates.total(each) <= budget)
        picked = pick(estimates, budget, cost, {})
        found.append(cost(picked) / best if estimates.total(picked) <= budget else math.inf)
    return found


def test_the_choice_is_near_the_cheapest_of_all_combinations():
    ratios = gaps(choose.cheapest)
    assert max(ratios) < 1.6 and sorted(ratios)[len(ratios) // 2] < 1.02


def test_broken_choices_are_noticed(planners, monkeypatch: pytest.MonkeyPatch):
    """Mutants: a cost of nothing, a level swapped for its neighbour, history or seconds that leak in."""

    def swapped(*given) -> choose.Chosen:
        picked = choose.cheapest(*given)
        name = next(iter(picked))
        return {**picked, name: max(0, picked[name] - 1)}

    free = [lambda estimates, budget, cost, fixed: choose.cheapest(estimates, budget, lambda _: 0.0, fixed)]
    for mutant in (*free, swapped):
        assert max(gaps(mutant)) >= 1.6
    planner = planners["desk", "clear"]
    first = chosen(planner)
    with monkeypatch.context() as history:  # as if what blurs took on this machine counted
        slow = {**rates.SHIPPED, "blur": {kind: 30 * rate for kind, rate in rates.SHIPPED["blur"].items()}}
        history.setattr(costs, "SHIPPED", slow)
        assert chosen(planner_of(planner.facts.view, planner.facts.camera)) != first
    monkeypatch.setattr(Costs, "reference", Costs.seconds)
    with pytest.raises(AssertionError):
        test_the_choice_is_the_same_on_machines_of_any_rates({("desk", "clear"): planner}, ("desk", "clear"))


AFTER_PHOTOS = """
import sys
from pathlib import Path
from edofsim.capture import capture
from edofsim.plan import learn_rates, rates
from tests.plan.test_same_photo import chosen, shipped_planners
photos = int(sys.argv[2])
for (scene, mask), planner in shipped_planners(Path(sys.argv[1])):
    for _ in range(photos):
        view, camera, fidelity = planner.facts.view, planner.facts.camera, planner.plan().fidelity
        learn_rates(planner.seconds_of(fidelity), capture(view, camera, fidelity).seconds)
    photos = 0
    print(scene, mask, chosen(planner))
assert len(list(rates.user_folder().glob("rates-*"))) == (int(sys.argv[2]) > 0)
"""


def shipped_planners(cache: Path) -> Iterator[tuple[tuple[str, str], Planner]]:
    """Of the middles of shipped scenes through three masks."""
    from edofsim.experiments.predictions import MASKS as NAMES
    from edofsim.experiments.predictions import SCENES as ALL
    from edofsim.experiments.predictions import camera_of, small_version

    for scene in (*ALL[4:], *ALL[:4]):  # one that takes time is photographed first
        loaded = load_scene(scene)
        view = render(small_version(loaded.recipe), loaded.base, cache=cache)
        for mask in NAMES:
            yield (scene, mask), planner_of(view, camera_of(mask))


@pytest.mark.slow
def test_shipped_scenes_have_the_same_plans_whatever_was_done_before_and_is_done_beside(tmp_path: Path):
    """In an empty home on one thread; and in one on two threads, after twenty photos that what is told was
    corrected by, beside a process that is busy. 11 scenes, 3 masks, 4 targets."""
    root, found = Path(__file__).parents[2], []
    for threads, photos in (("1", "0"), ("2", "20")):
        home = tmp_path / threads
        own = {"OMP_NUM_THREADS": threads, "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
        busy = subprocess.Popen([sys.executable, "-c", "while True: pass"]) if photos != "0" else None
        try:
            done = subprocess.run(
                [sys.executable, "-c", AFTER_PHOTOS, str(tmp_path / "views"), photos],
                env={**os.environ, **own},
                cwd=root,
                capture_output=True,
                text=True,
            )
        finally:
            if busy:
                busy.kill()
        assert done.returncode == 0, done.stderr
        found.append(done.stdout.splitlines())
    assert len(found[0]) == 33 and len({line.split(maxsplit=2)[2] for line in found[0]}) > 20
    assert found[0] == found[1]


@pytest.mark.slow
def test_shipped_scenes_have_the_same_plan_at_any_rates():
    draw = random.Random(0)
    for pair, planner in shipped_planners(Path("render_cache")):
        first = chosen(planner)
        for _ in range(3):
            assert chosen(at_other_rates(planner, draw)) == first, pair


def test_methods_that_there_were_are_understood_or_refused(caplog: pytest.LogCaptureFixture):
    assert checked_overrule({"method": "constant"}) == {"layers": 1}
    assert checked_overrule({"method": "layered"}) == {}
    assert "--layers 1" in caplog.text
    with pytest.raises(InputError, match="for tests"):
        checked_overrule({"method": "brute"})
