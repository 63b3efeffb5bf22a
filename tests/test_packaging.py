"""What is imported is declared, what is declared is imported, and what is installed is pinned."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import tomllib
import types
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
PROGRAMS = {"pytest-cov", "pytest-xdist", "pyrefly", "ruff"}  # commands and plugins: nothing imports them
BY_BENCHOPT = {"benchopt"}
"""What `benchopt install` installs for its solvers, as their `requirements` say."""
UNPINNED = {"deepinv"}
"""What needs PyPI's torch: it is in no environment of ours (see `pyproject.toml`)."""
FOR_PRYSM = {"setuptools"}  # prysm needs it and does not declare it
CALLED = {"colour": "colour-science", "PIL": "pillow", "skimage": "scikit-image"}
# torch on a machine with an NVIDIA card brings its libraries, each pinned by torch itself
OF_TORCH = re.compile("nvidia-|cuda-|triton")


def imported(path: Path) -> set[str]:
    """First parts of the absolute names that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module or "")
    return {name.split(".")[0] for name in names}


def packages(folder: str) -> set[str]:
    """The distributions whose modules are imported in a folder; those of Python and our own left out."""
    files = sorted((ROOT / folder).rglob("*.py"))
    own = {part for path in files for part in (path.stem, path.parent.name) if folder == "tests"}
    names = set[str]().union(*map(imported, files)) - own
    outside = names - set(sys.stdlib_module_names) - {"edofsim", "benchmarks"}
    return {canonicalize_name(CALLED.get(name, name)) for name in outside}


def named(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(text).name) for text in requirements} - {"edofsim"}


def test_the_package_imports_what_it_declares_and_nothing_else():
    """Those of the extra `data` are imported by their names (`data.kept.needed`)."""
    extras = [text for name in ("benchmark", "cluster", "cubes", "flip", "gds") for text in EXTRAS[name]]
    declared = named([*PROJECT["dependencies"], *extras])
    assert packages("edofsim") == declared


def test_the_benchmarks_and_tests_import_what_their_extras_declare():
    base = named(PROJECT["dependencies"])
    assert packages("benchmarks") - base - BY_BENCHOPT == named(EXTRAS["bench"]) - FOR_PRYSM
    extras = named([text for extra in EXTRAS.values() for text in extra])
    assert packages("tests") - base <= extras
    assert named(EXTRAS["test"]) - PROGRAMS <= packages("tests")


def installed(name: str, extras: Iterable[str], seen: set[str]) -> set[str]:
    """Names of a distribution and of all that it needs on this machine."""
    if (name := canonicalize_name(name)) in seen or OF_TORCH.match(name):
        return seen
    seen.add(name)
    for text in metadata.requires(name) or ():
        need = Requirement(text)
        if any(need.marker is None or need.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            installed(need.name, need.extras, seen)
    return seen


def test_everything_that_gets_installed_is_pinned():
    pins = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())
    needed = set[str]()
    for text in [*PROJECT["dependencies"], *(text for extra in EXTRAS.values() for text in extra)]:
        need = Requirement(text)
        if need.name not in {"edofsim", *UNPINNED}:
            installed(need.name, need.extras, needed)
    assert needed == {canonicalize_name(name) for name in pins}


@pytest.mark.parametrize("extra", EXTRAS)
def test_pins_are_within_what_is_declared(extra: str):
    pins = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())
    pins = {canonicalize_name(name): version for name, version in pins.items()}
    for text in [*PROJECT["dependencies"], *EXTRAS[extra]]:
        need = Requirement(text)
        if need.name not in {"edofsim", *UNPINNED}:
            assert need.specifier.contains(pins[canonicalize_name(need.name)]), text


def test_type_checkers_of_others_read_our_types():
    """PEP 561: the marker lies in the package, from where it goes into the wheel."""
    assert (ROOT / "edofsim" / "py.typed").exists()


def test_package_indexes_get_no_picture_that_they_cannot_show(monkeypatch: pytest.MonkeyPatch):
    """All but pictures that lie in the source is there; the hook is loaded without Hatchling."""
    plugin = types.ModuleType("hatchling.metadata.plugin.interface")
    monkeypatch.setattr(plugin, "MetadataHookInterface", object, raising=False)
    monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
    hook = runpy.run_path(str(ROOT / "docs" / "package_readme.py"))["CustomMetadataHook"]()
    hook.root = str(ROOT)
    metadata: dict = {}
    hook.update(metadata)
    given, shown = (ROOT / "README.md").read_text(), metadata["readme"]["text"]
    assert "](scenes/pictures/" in given and "![" not in shown
    captions = re.findall(r"^!\[.*\n\n(\*.*\*)$", given, re.MULTILINE)
    assert len(captions) == given.count("![")
    left = [line for line in given.splitlines() if line and "![" not in line and line not in captions]
    assert left == [line for line in shown.splitlines() if line]
