"""Commands run in this process; small disks; caches of their own, as on a fresh machine; and one thread an
operation: tests take small tensors, whose threads would only wait for each other."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import pytest
import torch

from edofsim.recipe.kinds import MASKS, NETWORKS, SENSOR_EFFECTS

LARGE = 256 << 20
THREADS = torch.get_num_threads()


def pytest_configure(config: pytest.Config) -> None:
    """What earlier runs kept for this user is not seen. Matplotlib's list of fonts stays: it takes long."""
    if hasattr(config, "workerinput"):
        return  # of `-n`: as the process that started it
    os.environ.setdefault("MPLCONFIGDIR", matplotlib.get_cachedir())
    folder = tempfile.TemporaryDirectory(prefix="edofsim-tests-")
    config.add_cleanup(folder.cleanup)
    os.environ["XDG_CACHE_HOME"] = folder.name


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before all fixtures, those of modules too. Slow tests measure seconds and memory as they are for
    users."""
    torch.set_num_threads(THREADS if item.get_closest_marker("slow") else 1)


@pytest.fixture
def registered_for_a_test() -> Generator[None]:
    """Masks, networks and sensor effects that a test registers are gone after it."""
    yield
    for registry in (MASKS, NETWORKS, SENSOR_EFFECTS):
        registry._given.clear()
        registry.look_again()


@pytest.fixture
def plots_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have no plots, which take seconds: for tests of figures and photos that commands write beside
    them."""
    from edofsim.report.plot import Plot

    empty = '<svg xmlns="http://www.w3.org/2000/svg"/>'
    monkeypatch.setattr(Plot, "svg", lambda self, *, narrow=False: empty)


@pytest.fixture
def conditioned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What networks for any camera reckon from PSFs, for two seconds each time, is kept: where a test
    restores photos of one camera by several commands, it is not what the test is about."""
    from edofsim.restore.camera_bank import CameraBank, Conditioning

    whole, known = CameraBank.condition, {}

    def kept(self: CameraBank, psf: torch.Tensor, noise: float) -> Conditioning:
        key = (repr(self.settings()), tuple(psf.shape), psf.dtype, psf.cpu().numpy().tobytes(), noise)
        if key not in known:
            known[key] = whole(self, psf, noise)
        return known[key]

    monkeypatch.setattr(CameraBank, "condition", kept)


@pytest.fixture
def filters_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The filters that banks reckon from PSFs, for a second each time, do nothing: for tests that do not look
    at how well photos are restored."""
    from edofsim.restore import camera_bank, filter_bank

    def points(psf: torch.Tensor, support: int, groups: int, noise: float = 0.0) -> torch.Tensor:
        found = psf.new_zeros(groups, 3, 3, support, support)
        found[:, range(3), range(3), support // 2, support // 2] = 1
        return found

    for module in (camera_bank, filter_bank):
        monkeypatch.setattr(module, "local_filters", points)


@dataclass(frozen=True)
class Disk:
    """A file system of its own, in memory."""

    folder: Path

    def change(self, options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(self.folder)], check=True)

    def size(self, size: int) -> None:
        """Make it so many bytes large; what is on it must fit."""
        self.change(f"size={max(size, 4096)}")


@pytest.fixture
def disk(tmp_path: Path) -> Generator[Disk]:
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={LARGE}", "tmpfs", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no mount command here")
    if done.returncode:
        pytest.skip("mounting a small disk is not allowed here (it takes root)")
    yield Disk(folder)
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.fixture
def edofsim(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run a command in this process: (exit status, what it said on the error channel)."""
    from edofsim import console
    from edofsim.cli import invoke

    def run(*arguments: str | Path) -> tuple[int, str]:
        status = console.exit_status(lambda: invoke([str(a) for a in arguments]))
        return status, capfd.readouterr().err

    return run


@pytest.fixture
def workers_without_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Workers that load PyTorch fail, by the folder that is given: it takes a second, and rendering does
    without."""
    folder = tmp_path / "path"
    folder.mkdir()
    (folder / "torch.py").write_text("raise ImportError('rendering loads PyTorch')")
    monkeypatch.syspath_prepend(folder)
    return folder


class _Here(Executor):
    """Parts in this process, one after the other."""

    def __init__(self, *how: object, **more: object) -> None:
        pass

    def submit(self, work: Callable[..., object], *given: object) -> Future[object]:
        done: Future[object] = Future()
        try:
            done.set_result(work(*given))
        except Exception as error:
            done.set_exception(error)
        return done


@pytest.fixture
def workers_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """What workers do is done in this process: for tests of what commands make of their results."""
    from edofsim.render import spread

    monkeypatch.setattr(spread, "ProcessPoolExecutor", _Here)
