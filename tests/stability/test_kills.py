"""Commands killed at random moments: nothing that was finished is lost, and the next start ends well."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from skimage import data
from skimage.io import imsave

from edofsim.render import cache
from edofsim.restore.checkpoint import load_arrays

SMALL = Path(__file__).parents[1] / "small"
"""A scene, a camera and a training that take a second."""
LONGER = {
    "steps = 4": "steps = 60",
    "log_every = 1": "log_every = 10",
    "save_every = 2": "save_every = 5",
    "validate_every = 4": "validate_every = 50",
    "pictures_every = 4": "pictures_every = 100",
}
"""Lines of the training, so that it can be killed in the middle."""
PICTURES = 6


def command(name: str, folder: Path) -> list[str]:
    """The command line of a small job in `folder`; it can be started again and again."""
    base = [sys.executable, "-m", "edofsim"]
    scene, camera = str(folder / "small.toml"), ["--camera", str(folder / "camera.toml")]
    where = ["--out", str(folder / "out"), "--cache", str(folder / "cache"), "--quiet"]
    resume = ["--resume"] if (folder / "out" / "state.safetensors").exists() else []
    record = ["--json", str(folder / "record.json")]
    return {
        "run": [*base, "run", scene, *camera, *where, *record],
        "render": [*base, "render", scene, *where, *record],
        "cost": [*base, "cost", scene, *camera, *where, *record],
        "train": [*base, "train", str(folder / "train.toml"), *where, *resume, *record],
        "evaluate": [
            *[*base, "evaluate", "noise", "--data", str(folder / "pictures"), "--network", "paper-dcnn"],
            *["--out", str(folder / "out"), "--quiet", *record],
        ],
    }[name]  # fmt: skip


def steps_done(folder: Path) -> int:
    """Steps of the training that are kept."""
    path = folder / "out" / "state.safetensors"
    return json.loads(load_arrays(path, "state")[1]["state"])["step"] if path.exists() else 0


def findings_kept(folder: Path) -> list[str]:
    """Keys of the findings of an experiment that are kept, in order; the last line may be cut short."""
    path = folder / "out" / "finished.jsonl"
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [json.loads(line)["key"] for line in lines if line.startswith("{") and line.endswith("}")]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run", "render", "cost", "train", "evaluate"])
def test_killed_twenty_times(name, tmp_path):
    kills = int(os.environ.get("EDOFSIM_KILLS", "20"))
    rng = np.random.default_rng(len(name))
    shutil.copytree(SMALL, tmp_path, dirs_exist_ok=True)
    training = (SMALL / "train.toml").read_text()
    for short, long in LONGER.items():
        assert f"{short}\n" in training
        training = training.replace(f"{short}\n", f"{long}\n")
    (tmp_path / "train.toml").write_text(training)
    (tmp_path / "pictures").mkdir()
    for number in range(PICTURES):  # each at four levels of noise is a finding
        picture = data.astronaut()[20 * number : 20 * number + 200, :200]
        imsave(tmp_path / "pictures" / f"{number}.png", picture, check_contrast=False)
    complete: dict[str, float] = {}
    landed, whole, steps = 0, 15.0, 0
    known: list[str] = []
    while landed < kills:
        process = subprocess.Popen(
            command(name, tmp_path),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        begun = time.monotonic()
        try:
            process.wait(rng.uniform(0, whole))
            # it ended first: later moments are drawn from the time that it takes now that its parts are kept
            whole = time.monotonic() - begun
            assert process.returncode == 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            landed += 1
        if (tmp_path / "cache").is_dir():
            for entry in cache.ls(tmp_path / "cache"):
                stamp = entry.record["written"]
                assert complete.setdefault(entry.key, stamp) == stamp, "a finished view was rendered again"
        assert steps_done(tmp_path) >= steps, "steps that were kept are lost"
        steps = steps_done(tmp_path)
        found = findings_kept(tmp_path)
        assert found[: len(known)] == known, "findings that were kept are lost"
        assert len(set(found)) == len(found), "a finding that was kept was made again"
        known = found
    done = subprocess.run(command(name, tmp_path), capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "record.json").read_text())
    assert record["command"].startswith(name)
    if name == "evaluate":
        found = findings_kept(tmp_path)
        assert found[: len(known)] == known and len(set(found)) == len(found) == 4 * PICTURES
    if (tmp_path / "cache").is_dir():
        assert not cache.verify(tmp_path / "cache").damaged
        assert set(complete) <= {entry.key for entry in cache.ls(tmp_path / "cache")}
