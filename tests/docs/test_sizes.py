"""Files and functions stay short: `python docs/sizes.py`."""

from __future__ import annotations

import importlib.util
from pathlib import Path

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("sizes", ROOT / "docs" / "sizes.py")
assert spec is not None and spec.loader is not None
sizes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sizes)

MOST_LONG_FUNCTIONS = 4
"""Without their docstrings, which may grow."""


def test_files_and_functions_of_the_package_are_short():
    texts = sizes.files()
    assert len(texts) > 100
    assert not sizes.long_files(texts)
    long = sizes.long_functions(texts, docstrings=False)
    assert len(long) <= MOST_LONG_FUNCTIONS, long


def test_what_is_too_long_is_found():
    body = "    pass\n"
    texts = {
        "edofsim/a.py": f"def f():\n{60 * body}",
        "edofsim/room/b.py": f"def g():\n{59 * body}" + 341 * "\n",
    }
    assert sizes.long_functions(texts) == {"edofsim/a.py:f": 61}
    said = {"edofsim/c.py": f'def f():\n    """It."""\n{60 * body}'}
    assert list(sizes.long_functions(said).values()) == [62]
    assert list(sizes.long_functions(said, docstrings=False).values()) == [61]
    assert sizes.long_files(texts) == {"edofsim/room/b.py": 401}
    assert sizes.rooms(texts) == {".": 61, "room": 401}


def test_lines_of_code_are_those_that_do_something():
    text = '''"""A file."""

import a  # a remark
NAME = """two
lines"""
"""What the name is."""


def f(
    x,
):
    """It."""
    # a remark
    return x
'''
    assert sizes.code(text) == 1 + 2 + 3 + 1
    assert sizes.rooms({"edofsim/room/a.py": text}, sizes.code) == {"room": 7}
