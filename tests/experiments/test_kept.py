"""What is kept of an experiment is for exactly the code and the inputs that it was made with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from edofsim.core.progress import silent
from edofsim.experiments import kept, noise
from edofsim.experiments.kept import Kept, code_of, key_of
from edofsim.experiments.systems import EvaluatedSystem


def test_another_line_of_code_is_other_code(tmp_path: Path):
    """In any file, and by its name; what Python writes beside sources does not count."""
    (tmp_path / "room").mkdir()
    for name in ("a.py", "room/b.py"):
        (tmp_path / name).write_text("x = 1\n")
    first = code_of(tmp_path)
    (tmp_path / "room" / "a.pyc").write_bytes(b"compiled")
    code_of.cache_clear()
    assert code_of(tmp_path) == first
    (tmp_path / "room" / "b.py").write_text("x = 2\n")
    code_of.cache_clear()
    changed = code_of(tmp_path)
    (tmp_path / "room" / "b.py").write_text("x = 1\n")
    (tmp_path / "a.py").rename(tmp_path / "c.py")
    code_of.cache_clear()
    assert len({first, changed, code_of(tmp_path)}) == 3


def test_a_key_says_everything(monkeypatch: pytest.MonkeyPatch):
    first = key_of(seed=0, picture="a")
    assert first == key_of(picture="a", seed=0) and first != key_of(seed=1, picture="a")
    monkeypatch.setattr(kept, "code_of", lambda folder: "another line")
    assert key_of(seed=0, picture="a") != first


@pytest.mark.usefixtures("coarse")
def test_a_changed_line_of_code_makes_kept_results_be_made_anew(
    folder: Path,
    tmp_path: Path,
    echo: Callable[..., EvaluatedSystem],
    only: Callable[[EvaluatedSystem], None],
    monkeypatch: pytest.MonkeyPatch,
):
    calls: list[int] = []
    only(echo(restore=lambda photo, glare=None: calls.append(1) or photo))
    for expected in (24, 24):  # frame and whole of three pictures at four noises, once
        noise.run(tmp_path, silent, folder)
        assert len(calls) == expected
    monkeypatch.setattr(kept, "code_of", lambda folder: "another line")
    noise.run(tmp_path, silent, folder)
    assert len(calls) == 48


def test_a_line_that_was_cut_short_is_passed_over(tmp_path: Path):
    path = tmp_path / "finished.jsonl"
    Kept(path).put("one", {"db": 1.0})
    with path.open("a") as file:
        file.write('{"key": "two", "fou')
    again = Kept(path)
    again.put("three", {"db": 3.0})
    assert [Kept(path).get(key) for key in ("one", "two", "three")] == [{"db": 1.0}, None, {"db": 3.0}]
