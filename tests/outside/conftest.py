"""The example package as pip would install it, without pip: its folder on the path, with its entry points."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from edofsim.experiments import EXPERIMENTS
from edofsim.plan import EFFECTS
from edofsim.recipe import kinds

EXAMPLE = Path(__file__).parents[1] / "example_package"
REGISTRIES = [
    *(value for value in vars(kinds).values() if isinstance(value, kinds.Registry)),
    EFFECTS,
    EXPERIMENTS,
]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the path of Python that says what is installed, as pip writes it."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    folder = tmp_path_factory.mktemp("site")
    told = folder / f"edofsim_example-{project['version']}.dist-info"
    told.mkdir()
    (told / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [
        line
        for group, points in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in points.items()))
    ]
    (told / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def installed(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The example package in this process."""
    for folder in (EXAMPLE, site):
        monkeypatch.syspath_prepend(str(folder))
    for registry in REGISTRIES:
        registry.look_again()
    yield EXAMPLE
    monkeypatch.undo()
    for registry in REGISTRIES:
        registry.look_again()
