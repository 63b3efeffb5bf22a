"""Parts of long commands done by workers, of which one dies: the same figures as on one machine."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from edofsim import console
from edofsim.cli import invoke
from edofsim.cli.evaluate import _absolute
from edofsim.cli.many import share_of, spread_of, work_on
from edofsim.errors import InputError
from edofsim.options import Spreading
from edofsim.render.engine import thread_count
from edofsim.render.spread import Spread

SCENE = """
name = "NAME"
[frame]
width_px = 48
height_px = 40
margin_px = 48
[bands]
count = 4
[render]
samples = 4
[[objects]]
kind = "wall"
depth_m = 3.0
surface = { kind = "matt", reflectance = REFLECTANCE }
[[objects]]
kind = "panel"
depth_m = 0.8
width_mm = 4
height_mm = 4
[[lights]]
kind = "sky"
"""


@pytest.fixture
def scenes(tmp_path: Path) -> list[Path]:
    paths = []
    for number, name in enumerate(("first", "second", "third")):
        paths.append(tmp_path / f"{name}.toml")
        text = SCENE.replace("NAME", name).replace("REFLECTANCE", f"{0.2 + 0.2 * number}")
        paths[-1].write_text(text)
    return paths


def edofsim(*arguments: str | Path) -> int:
    return console.exit_status(lambda: invoke([str(each) for each in arguments]))


def figures(path: Path) -> dict[str, float]:
    """Without what depends on how fast the machine was and what it held, and what was decided by that."""
    found = json.loads(path.read_text())["figures"]
    told_by_time = ("seconds", "peak_memory", "predicted_seconds", "times_faster", "share.time")
    return {name: value for name, value in found.items() if not name.startswith(told_by_time)}


def until(true: Callable[[], bool], seconds: float) -> bool:
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        if true():
            return True
        time.sleep(0.1)
    return False


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@contextmanager
def dask(folder: Path, workers: Sequence[str]) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and workers with these options, each a process of its own: address and workers."""
    place = folder / "scheduler.json"
    start = "import sys; from distributed.cli.dask_{0} import main; sys.exit(main())"
    log = (folder / "dask.log").open("wb")

    def begin(what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", start.format(what), *options]
        return subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, start_new_session=True)

    started = [begin("scheduler", "--scheduler-file", str(place), "--port", "0", "--no-dashboard")]
    try:
        assert until(place.is_file, 60)
        time.sleep(0.5)
        address = json.loads(place.read_text())["address"]
        for options in workers:
            common = ["--nthreads", "1", "--no-dashboard", "--local-directory", str(folder)]
            started.append(begin("worker", address, *common, *options.split()))
        yield address, started[1:]
    finally:
        for process in started:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        log.close()


def busy(address: str) -> dict[str, int]:
    """Parts at work or waiting, by worker."""
    from distributed import Client

    with Client(address, timeout="20s") as client:
        return {worker: len(keys) for worker, keys in client.processing().items()}


def test_shares_are_all_of_the_parts_once():
    parts = list("abcde")
    shares = [share_of(parts, spread_of(Spreading(1, None, f"{number}/3"))) for number in (1, 2, 3)]
    assert sorted(sum(shares, [])) == parts and max(map(len, shares)) - min(map(len, shares)) <= 1
    with pytest.raises(InputError, match="only 5 parts"):
        share_of(parts, spread_of(Spreading(1, None, "6/6")))
    for wrong in ("0/3", "4/3", "1", "a/b"):
        with pytest.raises(InputError, match="shard"):
            spread_of(Spreading(1, None, wrong))


def test_a_part_that_fails_leaves_the_others():
    def work(part: int, progress: object) -> int:
        if part == 2:
            raise InputError("two is no number of ours")
        return part * part

    found, problems, failures = work_on((1, 2, 3), ("one", "two", "three"), work, Spread(), lambda *_: None)
    assert found == [1, None, 9] and failures == [] and problems == ["two is no number of ours"]
    with pytest.raises(InputError, match="two"):
        work_on((2,), ("two",), work, Spread(), lambda *_: None)


def test_photos_of_many_scenes_are_those_of_each(
    scenes: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    # workers have one thread each, as tests have: some processors round by their number
    monkeypatch.setattr("edofsim.render.spread.thread_count", lambda: 2)
    cache = tmp_path / "cache"
    alone, both = tmp_path / "alone", tmp_path / "both"
    camera = tmp_path / "small.toml"
    camera.write_text('name = "small"\n[psf]\nwindow_px = 32\n')
    for scene in scenes:
        scene.write_text(scene.read_text().replace("margin_px = 48", "margin_px = 16"))
    options = ("--camera", camera, "--cache", cache, "--quiet", "--accuracy", "full")
    for scene in scenes[:2]:
        out = ("--out", alone / f"{scene.stem}-small", "--json", alone / f"{scene.stem}.json")
        assert edofsim("expose", scene, *out, *options) == 0
    broken = tmp_path / "broken.toml"
    mesh = SCENE.replace('kind = "panel"', 'kind = "mesh"\npath = "none.obj"').replace("height_mm = 4\n", "")
    broken.write_text(
        mesh.replace("NAME", "broken").replace("REFLECTANCE", "0.5").replace("width_mm", "size_mm")
    )
    said = tmp_path / "both.json"
    jobs = ("--jobs", "2", "--json", said)
    assert edofsim("expose", *scenes[:2], broken, "--out", both, *options, *jobs) == console.BAD_INPUT
    for scene in scenes[:2]:
        photo = f"{scene.stem}-small/photo.exr"
        assert (alone / photo).read_bytes() == (both / photo).read_bytes()
        single = figures(alone / f"{scene.stem}.json")
        assert figures(said)[f"truncated_energy.g.{scene.stem}"] == single["truncated_energy.g"]
    assert edofsim("expose", scenes[0], scenes[0], *options) == console.BAD_INPUT


def scene3d(scenes: list[Path], place: Path, *options: str | Path) -> dict[str, float]:
    given = ("--quick", "--network", "paper-dcnn", "--camera", "paper-clear", "--quiet", *options)
    folders = ("--out", place, "--cache", place / "views", "--json", place / "found.json")
    assert edofsim("evaluate", "scene3d", *scenes, *given, *folders) == 0
    return figures(place / "found.json")


@pytest.mark.slow
def test_an_experiment_on_a_cluster_of_which_a_worker_dies(scenes: list[Path], tmp_path: Path):
    """A real scheduler and two workers, of which one is killed at work."""
    pytest.importorskip("distributed")
    alone = scene3d(scenes, tmp_path / "alone")
    with dask(tmp_path, ["--no-nanny", "--no-nanny"]) as (address, workers):
        command = [sys.executable, "-m", "edofsim", "evaluate", "scene3d", *map(str, scenes), "--quick"]
        command += ["--network", "paper-dcnn", "--camera", "paper-clear", "--quiet", "--cluster", address]
        place = tmp_path / "spread"
        command += ["--out", str(place), "--cache", str(place / "views"), "--json", str(place / "found.json")]
        process = subprocess.Popen(command)
        assert until(lambda: len([n for n in busy(address).values() if n]) == 2, 120)
        time.sleep(2)
        os.killpg(workers[0].pid, signal.SIGKILL)
        assert process.wait(900) == 0
        assert len(busy(address)) == 1
    kept = [json.loads(line)["key"] for line in (place / "finished.jsonl").read_text().splitlines()]
    assert len(kept) == len(scenes)
    spread = figures(place / "found.json")
    assert spread.keys() == alone.keys()
    assert spread == pytest.approx(alone, abs=1e-4, nan_ok=True)
    # the same again by processes and by shares, from what is kept
    again = scene3d(scenes, place, "--jobs", "2")
    assert again == spread
    share = scene3d(scenes, place, "--shard", "2/3")
    assert share["scenes"] == 1
    assert scene3d(scenes, place) == spread


@pytest.mark.slow
def test_the_benchmark_of_a_cluster_of_which_a_worker_dies_has_the_same_bytes(tmp_path: Path):
    """The smallest one as it ships, by its command alone and by two workers."""
    pytest.importorskip("distributed")
    alone, spread = tmp_path / "alone", tmp_path / "spread"
    make = [sys.executable, "-m", "edofsim", "benchmark", "make", "tiny", "--quiet"]
    subprocess.run([*make, "--out", str(alone)], check=True)
    with dask(tmp_path, ["--no-nanny", "--no-nanny"]) as (address, workers):
        process = subprocess.Popen([*make, "--out", str(spread), "--cluster", address])
        assert until(lambda: len([n for n in busy(address).values() if n]) == 2, 120)
        time.sleep(2)
        os.killpg(workers[0].pid, signal.SIGKILL)
        assert process.wait(900) == 0
    assert (alone / "checksums.json").read_bytes() == (spread / "checksums.json").read_bytes()
    command = ("benchmark", "score", "photo", "--data", spread, "--out", tmp_path / "scores", "--quiet")
    assert edofsim(*command) == 0
    assert figures(tmp_path / "scores" / "benchmark.json")["photos"] == 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options"),
    [
        (("cost",), ("--repeats", "1", "--camera", "paper-clear")),
        (("evaluate", "predictions"), ("--quick", "--mask", "clear")),
        (("evaluate", "broadband"), ("--network", "paper-clear", "--network", "paper-cubic")),
    ],
    ids=lambda given: given[-1] if given[0] in ("cost", "evaluate") else "",
)
def test_processes_and_shares_give_the_figures_of_one(
    command: tuple[str, ...],
    options: tuple[str, ...],
    scenes: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    """Two scenes (broadband: two systems), all figures but seconds and what they decide; each way starts with
    no rates learned, and has the threads of one of two processes: how sums are rounded depends on these."""
    torch.set_num_threads(max(1, thread_count() // 2))
    given: list[str | Path] = list(scenes[:2])
    if "broadband" in command:
        given = [each for scene in scenes[:2] for each in ("--scene", scene)]
    found = []
    for way in ((), ("--jobs", "2"), ("--shard", "1/2"), ("--shard", "2/2"), ()):
        place = tmp_path / f"of-{min(len(found), 2)}"  # shares and what gathers them have one folder
        monkeypatch.setenv("XDG_CACHE_HOME", str(place / "home"))
        folders = ("--out", place, "--cache", place / "views", "--json", place / "found.json", "--quiet")
        assert edofsim(*command, *given, *options, *folders, *way) == 0
        found.append(figures(place / "found.json"))
    single, jobs, _, _, shares = found
    assert len(single) > 5
    assert jobs == pytest.approx(single, nan_ok=True, abs=1e-9)
    assert shares == pytest.approx(single, nan_ok=True, abs=1e-9)


@pytest.mark.slow
def test_workers_of_a_cluster_end_with_what_started_them_and_forget_a_client_that_was_killed(
    scenes: list[Path], tmp_path: Path
):
    pytest.importorskip("distributed")
    with dask(tmp_path, ["--nanny"]) as (address, (nanny,)):
        text = scenes[0].read_text().replace("samples = 4", "samples = 4096")
        family = '[family]\nvary = [{ key = "objects.0.depth_m", uniform = [2.0, 4.0] }]\n'
        scenes[0].write_text(text + family)
        command = [sys.executable, "-m", "edofsim", "render", str(scenes[0]), "--members", "40", "--quiet"]
        views = tmp_path / "views"
        client = subprocess.Popen([*command, "--cache", str(views), "--cluster", address])
        assert until(lambda: any(busy(address).values()), 120)
        client.kill()
        client.wait()
        forgotten = until(lambda: not any(busy(address).values()), 120)
        assert forgotten, "parts of a killed client are still at work"
        assert len(list(views.glob("*.exr"))) < 40
        threads = Path(f"/proc/{nanny.pid}/task").glob("*/children")  # any of them may have started it
        children = [pid for thread in threads for pid in thread.read_text().split()]
        (worker,) = [int(pid) for pid in children if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()]
        os.kill(nanny.pid, signal.SIGKILL)
        assert until(lambda: not alive(worker), 60), "a worker outlived its nanny"


def test_workers_elsewhere_find_the_files_of_a_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A worker of a cluster is in a folder of its own: every file within a system's text is absolute."""
    monkeypatch.chdir(tmp_path)
    for name in ("own.py", "camera.toml", "net.safetensors"):
        Path(name).touch()
    own, camera, net = (tmp_path / name for name in ("own.py", "camera.toml", "net.safetensors"))
    typed = ["own.py:f", "camera.toml+own.py:f", "camera.toml+net.safetensors", "camera.toml+wiener"]
    typed += ["wiener", "package.own:f", "camera.toml"]
    found = [f"{own}:f", f"{camera}+{own}:f", f"{camera}+{net}", f"{camera}+wiener", "wiener"]
    found += ["package.own:f", str(camera)]
    assert _absolute(typed) == found
    assert _absolute([3, None, Path("here")]) == [3, None, tmp_path / "here"]
