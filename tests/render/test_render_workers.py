"""Workers that make way for new ones, that die, and whose scheduler goes away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import CancelledError, Future

import pytest
import torch

from edofsim.errors import EdofsimError
from edofsim.recipe import SceneRecipe
from edofsim.render import Task, cache, render, render_many, spread
from edofsim.render.batch import batch

SECONDS = 300


def tasks_in(folder, count):
    """Small views, each of another seed."""
    data = {
        "bands": {"count": 3},
        "frame": {"width_px": 12, "height_px": 8, "margin_px": 2, "pixel_angle_mrad": 4.0},
        "render": {"samples": 8, "max_depth": 2},
        "lights": [{"kind": "environment"}],
        "objects": [{"kind": "wall", "depth_m": 2.0}],
    }
    return [
        Task(SceneRecipe.model_validate({"name": f"wall-{seed}", "seed": seed, **data}), folder)
        for seed in range(count)
    ]


def ended(work):
    """What `work` returns or raises, in a thread of its own: a batch that stops for ever fails the test."""
    found = {}

    def run():
        try:
            found["outcomes"] = work()
        except EdofsimError as error:
            found["error"] = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(SECONDS)
    assert not thread.is_alive(), "the batch does not come to an end"
    if "error" in found:
        raise found["error"]
    return found["outcomes"]


def killer(monkeypatch, times):
    """A progress that kills the next `times` workers as soon as they are there."""
    real, killed = spread.ProcessPoolExecutor, []
    pools = []

    def pool(*arguments, **options):
        pools.append(real(*arguments, **options))
        return pools[-1]

    monkeypatch.setattr(spread, "ProcessPoolExecutor", pool)

    def progress(fraction, message):
        for process in list((pools[-1]._processes or {}).values()) if pools else []:
            if len(killed) < times and process.pid not in killed:
                os.kill(process.pid, signal.SIGKILL)
                killed.append(process.pid)

    return progress, killed


def test_more_views_than_a_worker_renders(mi, tmp_path, monkeypatch, workers_without_torch):
    """Workers make way for new ones after two views: all of three come, by two workers."""
    monkeypatch.setattr(spread, "PARTS_A_WORKER", 2)
    tasks = tasks_in(tmp_path, 3)
    for task in tasks:
        render(task.recipe, tmp_path, cache=tmp_path)
    outcomes = ended(lambda: render_many(tasks, cache=tmp_path, jobs=1))
    assert [outcome.name for outcome in outcomes] == [task.recipe.name for task in tasks]
    assert not any(outcome.error for outcome in outcomes)


def threads_of_a_worker(part, tell):
    """Threads that PyTorch and the engine have where a part is done."""
    return torch.get_num_threads(), spread.thread_count()


def test_workers_share_the_cores(monkeypatch):
    """Each of two workers on two cores has one thread, for PyTorch and for the engine. The second is not
    started where there is nothing for it to do."""
    monkeypatch.setattr(spread, "thread_count", lambda: 2)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    work = spread.Workers([0], threads_of_a_worker, lambda number, error: error, lambda *said: None)
    assert work.run(2, None) == [(1, 1)]


def test_a_worker_that_dies_once_costs_nothing(tmp_path, monkeypatch, workers_without_torch):
    progress, killed = killer(monkeypatch, 1)
    tasks = tasks_in(tmp_path, 1)
    outcomes = ended(lambda: render_many(tasks, cache=tmp_path, jobs=1, progress=progress))
    assert len(killed) == 1
    assert all(outcome.fresh and not outcome.error for outcome in outcomes)


@pytest.mark.slow
def test_only_the_view_that_kills_its_worker_fails(tmp_path, monkeypatch):
    """The first view's worker dies in the batch, and again when the view is rendered alone."""
    progress, killed = killer(monkeypatch, 2)
    tasks = tasks_in(tmp_path, 3)
    outcomes = ended(lambda: render_many(tasks, cache=tmp_path, jobs=1, progress=progress))
    assert len(killed) == 2
    assert "worker died" in outcomes[0].error and "--jobs" in outcomes[0].error
    assert all(outcome.fresh and not outcome.error for outcome in outcomes[1:])
    assert cache.verify(tmp_path) == cache.Verified(2, ())


def test_what_dask_says_of_dead_workers_and_schedulers_is_one_message(tmp_path):
    scheduler = pytest.importorskip("distributed.scheduler")
    each = batch(tasks_in(tmp_path, 1), tmp_path, None, "auto", tmp_path / "manifest", print)
    dead, gone = Future(), Future()
    dead.set_exception(scheduler.KilledWorker("view", None, 3))
    assert "worker died" in each._result(0, dead).error
    gone.set_exception(CancelledError())
    with pytest.raises(EdofsimError, match="scheduler went away.*again"):
        each._result(0, gone)


CLUSTER = """
import sys, time
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None)
    print(cluster.scheduler_address, flush=True)
    time.sleep(600)
"""


@pytest.mark.slow
def test_a_scheduler_that_goes_away(tmp_path):
    """Killed with its worker after a view: one message, and the next start has only the rest to do."""
    pytest.importorskip("distributed")
    script = tmp_path / "cluster.py"
    script.write_text(CLUSTER)
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        address = process.stdout.readline().strip()
        tasks = tasks_in(tmp_path, 40)

        def progress(fraction, message):
            if cache.ls(tmp_path):
                os.killpg(process.pid, signal.SIGKILL)

        with pytest.raises(EdofsimError, match="scheduler went away.*again"):
            ended(lambda: render_many(tasks, cache=tmp_path, cluster=address, progress=progress))
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    done = {entry.key for entry in cache.ls(tmp_path)}
    assert 0 < len(done) < len(tasks)
    outcomes = ended(lambda: render_many(tasks, cache=tmp_path, jobs=1))
    assert {outcome.key for outcome in outcomes if not outcome.fresh} == done
    assert cache.verify(tmp_path) == cache.Verified(len(tasks), ())
