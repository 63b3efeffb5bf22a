"""How the command line answers: interrupts, silence, help, completion."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from edofsim import console
from edofsim.cli import invoke

Run = Callable[..., tuple[int, str]]
ROOT = Path(__file__).parents[2]
SMALL = ROOT / "tests" / "small"
"""A scene and a camera that take a second."""


@pytest.mark.parametrize("name", ["render", pytest.param("evaluate", marks=pytest.mark.slow)])
def test_an_interrupt_ends_with_its_own_status_and_says_what_is_kept(name: str, tmp_path: Path):
    """A real SIGINT to a real process, as Ctrl-C sends it: 128 + 2, as shells expect."""
    scene = (SMALL / "small.toml").read_text().replace("samples = 16", "samples = 65536")
    (tmp_path / "scene.toml").write_text(scene)
    words = {
        "render": ["render", str(tmp_path / "scene.toml"), "--cache", str(tmp_path / "cache")],
        "evaluate": ["evaluate", "stability", "--out", str(tmp_path / "out")],
    }[name]
    process = subprocess.Popen(
        [sys.executable, "-m", "edofsim", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # a shell's background jobs ignore it, and so would what they start
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stderr is not None
    said = ""
    while "%" not in said:  # the forecast comes before the first progress
        line = process.stderr.readline()
        assert line, f"it ended before: {said}"
        said += line
    process.send_signal(signal.SIGINT)
    said += process.communicate(timeout=300)[1]
    assert process.returncode == 130, said
    assert "edofsim: interrupted; repeat the command to resume" in said
    assert "Traceback" not in said


def test_quiet_commands_say_nothing_on_the_error_channel(edofsim: Run, tmp_path: Path):
    line = ("render", SMALL / "small.toml", "--cache")
    assert edofsim(*line, tmp_path / "one", "--quiet") == (0, "")
    status, said = edofsim(*line, tmp_path / "other")
    assert status == 0 and "render: " in said
    psf = ("psf", "paper-clear", "--depths", "1", "--wavelengths", "543", "--out", tmp_path / "psf")
    assert edofsim(*psf, "--quiet") == (0, "")
    assert edofsim(*psf)[1]


def test_a_command_lists_what_it_wrote_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "diary.txt").touch()
    line = ("psf", "paper-clear", "--depths", "1,inf", "--wavelengths", "543", "--out", "out", "--quiet")
    assert console.exit_status(lambda: invoke([*line])) == 0
    said = capfd.readouterr().out
    assert "diary" not in said
    files = [path.name for path in sorted((tmp_path / "out").iterdir()) if path.name != "diary.txt"]
    assert files == ["mtf.exr", "psf.csv", "psf.exr", "psf.png"]
    assert all(f"out/{name}" in said for name in files)
    rows = (tmp_path / "out" / "psf.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["psf", "1m.543nm", "infinity.543nm"]


def test_the_help_lists_experiments_without_importing_them():
    code = (
        "import sys; from edofsim.cli import invoke; invoke(['evaluate', '--help']); "
        "assert not {'mitsuba', 'drjit', 'torch', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    from edofsim.experiments import EXPERIMENTS

    for name in EXPERIMENTS:
        about = EXPERIMENTS.about(name).split()
        assert f"  {name}  " in done.stdout and " ".join(about[:3]) in done.stdout, name


COMPLETE = "import sys; sys.argv = ['edofsim']; from edofsim.cli import main; main()"


@pytest.fixture
def reader(tmp_path: Path) -> Path:
    """A folder with files of the reader's own."""
    (tmp_path / "kept").mkdir()
    for name in ("mystery.toml", "mynet.safetensors", "kept/another.toml", "kept/another.txt"):
        (tmp_path / name).touch()
    return tmp_path


def asked_of(typed: str) -> dict[str, str]:
    """What a shell sets where Tab is pressed behind these words."""
    words = f"edofsim {typed}"
    return {"_EDOFSIM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}


@pytest.mark.parametrize(
    "typed, offered",
    [
        ("evaluate ban", ["bandwidth"]),
        ("run mot", ["motorcycle"]),
        ("run my", ["mystery.toml"]),
        ("run ./my", ["./mystery.toml"]),
        ("run kept/", ["kept/another.toml"]),
        ("run no-such-folder/", []),
        ("expose desk --camera paper-le", ["paper-learned", "paper-levin"]),
        ("psf pho", ["phone-5mm-f2"]),
        ("restore photo.exr --network wi", ["wiener"]),
        ("run desk --network my", ["mynet.safetensors"]),
        ("train univ", ["universal"]),
        ("evaluate table --network levin", ["levin-dcnn"]),
        ("evaluate predictions --mask le", ["learned"]),
        ("evaluate scene3d mot", ["motorcycle"]),
        ("run desk --without sp", ["spherical-aberration"]),
        ("expose desk --occlusion ov", ["over"]),
    ],
)
def test_shells_complete_commands_names_and_files(
    reader: Path,
    typed: str,
    offered: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(reader)
    monkeypatch.setattr(sys, "argv", ["edofsim"])
    monkeypatch.setattr(sys.modules["__main__"], "__package__", None)  # as of a script of that name
    for name, value in asked_of(typed).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit) as ended:
        invoke()
    assert capfd.readouterr().out.split() == offered
    assert not ended.value.code


@pytest.mark.parametrize(
    "typed, offered",
    [
        ("run my", ["mystery.toml"]),
        pytest.param("evaluate predictions --mask le", ["learned"], marks=pytest.mark.slow),
    ],
)
def test_shells_complete_by_a_process(reader: Path, typed: str, offered: list[str]):
    done = subprocess.run(
        [sys.executable, "-c", COMPLETE],
        env=os.environ | asked_of(typed) | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        cwd=reader,
    )
    assert done.stdout.split() == offered, done.stderr
    assert done.returncode == 0


def test_a_command_ends_although_a_library_left_a_thread_waiting():
    """Of a pool that nobody closed; what libraries do at the end is done, what was printed is there."""
    code = (
        "import atexit, sys; from concurrent.futures import ThreadPoolExecutor as Pool; pool = Pool(1); "
        "pool.submit(int).result(); sys.argv = ['edofsim', 'psf', 'no-such-camera']; "
        "from edofsim import cli; real = cli.invoke; "
        "cli.invoke = lambda: (atexit.register(print, 'tidied up'), real()); cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stdout.split() == ["tidied", "up"] and "no-such-camera" in done.stderr
