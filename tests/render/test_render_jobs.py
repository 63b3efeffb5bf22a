"""Many views: interruption and resumption, noise to reach, shards, manifests, forecasts, workers that die."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.errors import EdofsimError, InputError
from edofsim.recipe import SceneRecipe
from edofsim.render import Task, cache, forecast, render, render_many, tracing
from edofsim.render import engine as engines
from edofsim.render import jobs as job_module
from edofsim.render.rendering import render_model
from edofsim.render.spread import shard_of
from edofsim.render.view import View


def recipe(seed=0, **more):
    data = {
        "name": f"card-{seed}",
        "seed": seed,
        "bands": {"count": 3},
        "frame": {"width_px": 12, "height_px": 8, "margin_px": 2, "pixel_angle_mrad": 4.0},
        "render": {"samples": 8, "max_depth": 2},
        "lights": [{"kind": "environment"}],
        "objects": [
            {"kind": "wall", "depth_m": 2.0},
            {"kind": "panel", "depth_m": 0.8, "width_mm": 20, "height_mm": 300},
        ],
    }
    return SceneRecipe.model_validate({**data, **more})


def scene(make):
    """A ball before a wall, partly in the shade of a lamp."""
    ball = make.thing("ball", make.sphere(0.05, (0, 0, 1), rings=12), make.matt(0.6, 4))
    wall = make.thing("wall", make.facing(2, 2, 1.6), make.matt(0.5, 4))
    lamp = make.quad([(0.2, 0.4, 0.5), (0.3, 0.4, 0.5), (0.3, 0.4, 0.9), (0.2, 0.4, 0.9)])
    return make.model(
        [ball, wall, make.thing("lamp", lamp, make.matt(0.0, 4), np.full(4, 20))], sky=0.1, bands=4
    )


def same(a, b):
    """Bytes of two views, all of them."""
    names = ("pixel", "coverage", "inverse_depth", "radiance", "hidden")
    return all(getattr(a, name).numpy().tobytes() == getattr(b, name).numpy().tobytes() for name in names)


def test_same_bytes_for_one_thread_and_two(mi, make, monkeypatch):
    settings = make.settings(24, 16, angle=0.01, samples=256, pupil_radius=0.03)
    views = []
    for threads in (1, 2):
        monkeypatch.setattr(engines, "_threads", threads)
        views.append(View.of(render_model(scene(make), settings)))
        assert views[-1].metadata["run"]["threads"] == threads
    assert same(*views) and views[0].hidden.any()


def test_same_bytes_however_samples_are_launched(mi, make, monkeypatch):
    """Random numbers follow from pixel and sample, so the size of a launch cannot matter."""
    settings = make.settings(24, 16, angle=0.01, samples=16, pupil_radius=0.03)
    whole = View.of(render_model(scene(make), settings))
    monkeypatch.setattr("edofsim.render.passes.LAUNCH_BYTES", 4 * 4 * 16 * 37)
    monkeypatch.setattr(tracing, "SURVEY_LAUNCH", 16 * 29)
    assert same(whole, View.of(render_model(scene(make), settings)))


@pytest.mark.parametrize("after", [1, 3, 7])
def test_interrupted_work_goes_on_from_where_it_was(mi, make, tmp_path, monkeypatch, after):
    """Ctrl-C keeps finished launches; the second start traces only the others and gives the same bytes."""
    settings = make.settings(24, 16, angle=0.01, samples=256, pupil_radius=0.03)
    traced = []
    real = tracing.run_launch

    def counted(*arguments):
        traced.append(1)
        return real(*arguments)

    monkeypatch.setattr(tracing, "run_launch", counted)
    whole = View.of(render_model(scene(make), settings))
    needed = len(traced)
    traced.clear()

    def ctrl_c(fraction, message):
        if len(traced) == after:
            os.kill(os.getpid(), signal.SIGINT)

    partial = tmp_path / "view.partial"
    with pytest.raises(KeyboardInterrupt):
        View.of(render_model(scene(make), settings, partial=partial, progress=ctrl_c))
    first = len(traced)
    assert first == after and partial.is_file()
    traced.clear()
    again = View.of(render_model(scene(make), settings, partial=partial))
    assert first + len(traced) == needed
    assert same(whole, again) and again.noise == whole.noise


def test_damaged_sums_are_not_gone_on_from(mi, make, tmp_path):
    settings = make.settings(24, 16, angle=0.01, samples=16)
    whole = View.of(render_model(scene(make), settings))
    partial = tmp_path / "view.partial"

    def stop(fraction, message):
        if "tracing" in message:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        View.of(render_model(scene(make), settings, partial=partial, progress=stop))
    content = bytearray(partial.read_bytes())
    content[len(content) // 2] ^= 1
    partial.write_bytes(content)
    assert same(whole, View.of(render_model(scene(make), settings, partial=partial)))


def test_noise_to_reach(mi, make):
    """Samples are added until the estimate is there; half the noise takes about four times as many."""
    settings = make.settings(16, 12, angle=0.01, samples=16, hidden=False)
    coarse = View.of(render_model(scene(make), replace(settings, noise=0.04)))
    fine = View.of(render_model(scene(make), replace(settings, noise=0.02)))
    assert coarse.noise <= 0.04 and fine.noise <= 0.02
    assert 2.5 < fine.metadata["samples"] / coarse.metadata["samples"] < 6


def views_of(model, settings):
    return [View.of(render_model(model, replace(settings, seed=seed))) for seed in range(12)]


@pytest.fixture(scope="module")
def of_seeds(mi, make):
    """Settings, and the views of twelve seeds."""
    settings = make.settings(16, 12, angle=0.01, samples=32, hidden=False)
    return settings, views_of(scene(make), settings)


def test_estimated_noise_is_the_true_noise(make, of_seeds):
    """The estimate from the scatter between passes against the difference from a long render."""
    settings, views = of_seeds
    many = replace(settings, samples=2048, seed=99)
    truth = View.of(render_model(scene(make), many)).all_in_focus().mean(0)
    estimated, true = [], []
    for view in views:
        error = view.all_in_focus().mean(0) - truth
        true.append(float(error.square().mean().sqrt() / truth.mean()))
        estimated.append(view.noise)
    assert np.mean(estimated) == pytest.approx(np.sqrt(np.mean(np.square(true))), rel=0.15)


@pytest.mark.parametrize("samples", [32, 24])
def test_half_differences_are_as_the_views_own_noise(make, of_seeds, samples):
    """Over seeds: the variance of radiance, in every band, and independent of the noise itself. Of 24 samples
    the passes are not alike (8, 8, 8): one half is twice as large as the other."""
    settings, views = of_seeds
    if samples != settings.samples:
        views = views_of(scene(make), replace(settings, samples=samples))
    light = torch.stack([view.all_in_focus() for view in views]).double()
    halves = torch.stack([view.with_light(view.half_difference).all_in_focus() for view in views]).double()
    errors = light - light.mean(0)
    variance = errors.square().sum(0).mean((1, 2)) / (len(views) - 1)
    assert torch.allclose(halves.square().mean((0, 2, 3)), variance, rtol=0.15)
    for each in ((errors * halves).mean((1, 2, 3)), halves.mean((1, 2, 3))):
        assert abs(float(each.mean() / each.std())) < 4 / math.sqrt(len(views))


def test_one_pass_has_no_halves(mi, make):
    settings = make.settings(8, 6, angle=0.01, samples=1, hidden=False)
    assert render_model(scene(make), settings).half_difference is None


def test_many_views(tmp_path, workers_without_torch):
    """Two workers; what is in the cache is not rendered; a manifest line each; failures do not stop the
    rest."""
    texture = {"kind": "file", "path": "no-such.png"}
    broken = recipe(
        9,
        objects=[{"kind": "wall", "depth_m": 2.0, "surface": {"kind": "matt", "texture": texture}}],
    )
    tasks = [Task(recipe(0), tmp_path), Task(broken, tmp_path), Task(recipe(1), tmp_path)]
    render(recipe(0), tmp_path, cache=tmp_path / "cache")
    said = []
    outcomes = render_many(tasks, cache=tmp_path / "cache", jobs=2, progress=lambda *a: said.append(a))
    assert [o.name for o in outcomes] == ["card-0", "card-9", "card-1"]
    assert [o.fresh for o in outcomes] == [False, False, True]
    assert "no-such.png" in outcomes[1].error and not outcomes[0].error and not outcomes[2].error
    assert outcomes[2].samples == 8 and outcomes[2].noise > 0 and outcomes[2].seconds > 0
    lines = [json.loads(line) for line in (tmp_path / "cache" / "manifest.jsonl").read_text().splitlines()]
    assert sorted(line["name"] for line in lines) == ["card-0", "card-1", "card-9"]
    assert all({"key", "seconds", "samples", "noise", "host", "error"} <= line.keys() for line in lines)
    assert "3 views" in said[0][1] and "to render" in said[0][1] and said[-1][0] == 1.0


def test_shards_share_the_work():
    tasks = [Task(recipe(seed), "") for seed in range(7)]
    parts = [shard_of(tasks, (number, 3)) for number in (1, 2, 3)]
    assert sorted(t.recipe.seed for part in parts for t in part) == list(range(7))
    assert [len(part) for part in parts] == [3, 2, 2]
    for wrong in ((0, 3), (4, 3)):
        with pytest.raises(InputError, match="no shard"):
            shard_of(tasks, wrong)


def test_forecast_learns_from_what_was_rendered(mi, tmp_path):
    tasks = [Task(recipe(seed), tmp_path) for seed in range(4)]
    before = forecast(tasks, cache=tmp_path)
    assert (before.views, before.in_cache, before.measured) == (4, 0, False) and "rough guess" in str(before)
    render(tasks[0].recipe, tmp_path, cache=tmp_path)
    after = forecast(tasks, cache=tmp_path)
    (entry,) = cache.ls(tmp_path)
    assert after.measured and after.in_cache == 1
    assert after.seconds == pytest.approx(3 * entry.record["run"]["total_seconds"], rel=0.01)
    assert after.bytes == pytest.approx(3 * entry.record["bytes"], rel=0.01)


def test_forecast_tells_set_up_from_samples(tmp_path, monkeypatch):
    """Two views of 10 s set-up and 1 us a sample and thread, one of them small, tell what any other takes."""
    monkeypatch.setattr(job_module, "thread_count", lambda: 2)

    def record(pixels, samples):
        paths = pixels * samples * 1e-6 / 2
        run = {"host": job_module.platform.node(), "threads": 2, "seconds": {"paths": paths}}
        run["total_seconds"] = paths + 10
        return {"pixels": pixels, "samples": samples, "bands": 3, "bytes": 1, "run": run}

    entries = [cache.Entry(tmp_path, "", "", 0, 0.0, record(*size)) for size in ((100, 2), (10**6, 64))]
    monkeypatch.setattr(job_module.store, "ls", lambda folder: entries)
    settings = job_module.RenderSettings.from_recipe(recipe())
    count = settings.padded_shape[0] * settings.padded_shape[1] * settings.samples
    expected = forecast([Task(recipe(seed), tmp_path) for seed in range(3)], cache=tmp_path)
    assert expected.seconds == pytest.approx(3 * (10 + count * 1e-6 / 2), rel=1e-6)


def test_disk_too_small_is_noticed_before(tmp_path, monkeypatch):
    class Usage:
        total, used, free = 10, 10, 10

    monkeypatch.setattr(job_module.shutil, "disk_usage", lambda folder: Usage)
    with pytest.raises(EdofsimError, match="too small"):
        render_many([Task(recipe(), tmp_path)], cache=tmp_path)


BATCH = """
import json, sys
from pathlib import Path
if __name__ == "__main__":
    from edofsim.recipe import SceneRecipe
    from edofsim.render import Task, render_many
    folder = Path(sys.argv[1])
    tasks = [Task(SceneRecipe.model_validate(each), folder) for each in json.loads(sys.argv[2])]
    print("started", flush=True)
    outcomes = render_many(tasks, cache=folder, jobs=int(sys.argv[3]))
    assert not any(outcome.error for outcome in outcomes)
"""
"""It imports no test: these have all that they need, for seconds in every worker."""


def start_batch(folder, count, path, jobs=1):
    script = folder.parent / "batch.py"
    script.write_text(BATCH)
    recipes = json.dumps([recipe(seed).model_dump(mode="json", by_alias=True) for seed in range(count)])
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), recipes, str(jobs)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(path), *sys.path])},
        start_new_session=True,
        stdout=subprocess.PIPE,
    )


@pytest.mark.parametrize("views, kills, most_s", [(2, 2, 2), pytest.param(20, 50, 8, marks=pytest.mark.slow)])
def test_killed_at_any_time(tmp_path, workers_without_torch, views, kills, most_s):
    """After SIGKILLs at random moments, one run to the end: every entry is as written, none that was complete
    is rendered again, none is missing."""
    rng = np.random.default_rng(0)
    folder = tmp_path / "cache"
    folder.mkdir()
    complete = {}

    def remember():
        for entry in cache.ls(folder):
            stamp = entry.record["written"]
            assert complete.setdefault(entry.key, stamp) == stamp, "a complete view was rendered again"

    for _ in range(kills):
        process = start_batch(folder, views, workers_without_torch)
        process.stdout.readline()
        time.sleep(rng.uniform(0, most_s))
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        remember()
    process = start_batch(folder, views, workers_without_torch)
    assert process.wait(1200) == 0
    process.stdout.close()
    remember()
    assert len(complete) == views
    assert cache.verify(folder) == cache.Verified(views, ())
    assert not list(folder.glob("*.damaged-*"))


def children(pid):
    """Processes that a process has started and that still live."""
    listing = subprocess.run(["ps", "-A", "-o", "pid=,ppid=,stat="], capture_output=True, text=True).stdout
    rows = [line.split() for line in listing.splitlines()]
    return [int(child) for child, parent, state in rows if int(parent) == pid and state[0] != "Z"]


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    "jobs, patterns", [(1, ["*.exr"]), pytest.param(2, ["*.lock", "*.exr"], marks=pytest.mark.slow)]
)
def test_workers_end_with_a_killed_parent(tmp_path, workers_without_torch, jobs, patterns):
    """SIGKILL to the parent alone, once while its workers start or render, once between two views."""
    folder = tmp_path / "cache"
    folder.mkdir()
    for pattern in patterns:
        there = set(folder.glob(pattern))
        process = start_batch(folder, 20, workers_without_torch, jobs)
        process.stdout.readline()
        limit = time.monotonic() + 120
        while set(folder.glob(pattern)) <= there and time.monotonic() < limit:
            time.sleep(0.05)
        workers = children(process.pid)
        assert len(workers) > jobs - 1
        process.kill()
        process.wait()
        process.stdout.close()
        limit = time.monotonic() + 30
        while any(map(alive, workers)) and time.monotonic() < limit:
            time.sleep(0.2)
        left = [pid for pid in workers if alive(pid)]
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        assert not left
    assert not list(folder.glob("*.damaged-*"))


LOST = """
import os, sys, threading, time
from multiprocessing import get_context
from edofsim.render.orphans import at_work, end_with_parent

def work():
    end_with_parent()
    with at_work():
        try:
            print(os.getpid(), flush=True)
            time.sleep(60)
        except KeyboardInterrupt:
            pass
    threading.Event().wait()

if __name__ == "__main__":
    get_context("spawn").Process(target=work).start()
"""


def test_a_worker_ends_where_its_interruption_was_lost(tmp_path):
    """As in a finaliser, whose exceptions Python drops: the work ends, and its process waits for more."""
    script = tmp_path / "lost.py"
    script.write_text(LOST)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, start_new_session=True)
    try:
        worker = int(parent.stdout.readline())
        parent.kill()
        parent.wait()
        parent.stdout.close()
        limit = time.monotonic() + 15
        while alive(worker) and time.monotonic() < limit:
            time.sleep(0.1)
        assert not alive(worker)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(parent.pid, signal.SIGKILL)


@pytest.mark.slow
def test_on_a_dask_cluster(tmp_path):
    """A real scheduler with two worker processes, reached by its address."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        tasks = [Task(recipe(seed), tmp_path) for seed in range(3)]
        outcomes = render_many(tasks, cache=tmp_path, cluster=cluster.scheduler_address)
    assert all(o.fresh and not o.error for o in outcomes)
    assert cache.verify(tmp_path) == cache.Verified(3, ())
    views = [render(task.recipe, tmp_path, cache=tmp_path) for task in tasks]
    assert not torch.equal(views[0].radiance, views[1].radiance)


def test_no_scheduler_is_one_message(tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler"):
        render_many([Task(recipe(), tmp_path)], cache=tmp_path, cluster="not an address")
