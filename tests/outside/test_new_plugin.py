"""`edofsim new plugin`: the package that it writes works in all commands, before it is installed."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from edofsim.cli import invoke
from edofsim.errors import InputError
from edofsim.restore.checkpoint import load_checkpoint

from .conftest import EXAMPLE, REGISTRIES


@pytest.fixture
def hers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Its folder, in which its module is tried; frame, PSFs and training are small."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    invoke(["new", "plugin", "Her-optics"])
    folder = tmp_path / "Her-optics"
    monkeypatch.chdir(folder)
    small = {"width_px = 128": "width_px = 32\nmargin_px = 8", "height_px = 96": "height_px = 24"}
    small |= {
        "window_px = 64": "window_px = 16",
        "patch_px = 64": "patch_px = 32",
        "samples = 16": "samples = 4",
    }
    small |= {"steps = 20": "steps = 2"}
    for name in ("scene", "camera", "train"):
        path = folder / f"{name}.toml"
        text = path.read_text()
        for large, little in small.items():
            text = text.replace(large, little)
        path.write_text(text)
    monkeypatch.setenv("EDOFSIM_PLUGINS", "her_optics")
    for registry in REGISTRIES:
        registry.look_again()
    yield folder
    monkeypatch.undo()
    for name in [name for name in sys.modules if name.partition(".")[0] == "her_optics"]:
        del sys.modules[name]
    for registry in REGISTRIES:
        registry.look_again()


@pytest.mark.usefixtures("plots_left_out")
def test_a_new_package_goes_through_the_commands(hers: Path):
    """Network and data in `train`; mask, lens, object, sensor effect and effect of plans in `run`; the
    experiment in `evaluate`."""
    assert "QuarticMask" in (hers / "her_optics" / "mask.py").read_text()
    assert 'name = "Her-optics"' in (hers / "pyproject.toml").read_text()
    invoke(["train", "train.toml", "--out", "trained"])
    checkpoint = "trained/example.safetensors"
    # 1 / (1 + (n / 0.01)^2) of the middle of the range of noise, 0.001 to 0.015
    assert float(load_checkpoint(checkpoint).network.trust) == pytest.approx(1 / 1.64)
    again = ["run", "scene.toml", "--camera", "camera.toml", "--seed", "3", "--accuracy", "45dB"]
    again += ["--without", "bands", "--network", checkpoint, "--raw-colours"]
    invoke([*again, "--json", "run.json"])
    assert " ".join(["edofsim", *again]) in Path("out/example/report.html").read_text()
    run = json.loads(Path("run.json").read_text())
    (dark,) = [each for each in run["plan"] if each["effect"] == "dark current"]
    assert run["restored_by"] == "example" and dark["chosen"] == "counted"
    assert dark["why"].startswith("100 electrons of the dark")
    invoke(["evaluate", "width", "--camera", "camera.toml", "--json", "width.json"])
    assert json.loads(Path("width.json").read_text())["figures"]["width_um"] > 6


OFF_AXIS = 'kind = "off-axis"\ncoma = 20\nshadow = 1.0'


@pytest.mark.slow
@pytest.mark.usefixtures("plots_left_out")
def test_what_accuracy_costs_by_a_new_package(hers: Path):
    invoke(["cost", "scene.toml", "--camera", "camera.toml", "--repeats", "1", "--json", "cost.json"])
    assert json.loads(Path("cost.json").read_text())["figures"]


@pytest.mark.slow
@pytest.mark.usefixtures("plots_left_out")
def test_a_lens_that_varies_goes_through_the_commands_or_is_refused(hers: Path):
    """Its network is conditioned on one set of PSFs: a training says that it takes none that vary."""
    camera = (hers / "camera.toml").read_text()
    (hers / "camera.toml").write_text(
        camera.replace('kind = "seidel"', OFF_AXIS).replace("waves = 0.25\n", "")
    )
    invoke(["run", "scene.toml", "--camera", "camera.toml", "--network", "wiener", "--json", "run.json"])
    run = json.loads(Path("run.json").read_text())
    (field,) = [each for each in run["plan"] if each["effect"] == "field dependence"]
    assert field["called_for"] and run["figures"]["psnr_db.restored"] > 0
    invoke(["evaluate", "width", "--camera", "camera.toml", "--out", "width"])
    with pytest.raises(InputError, match="'off-axis' vary over the frame, and network.kind = 'unsharp-mask'"):
        invoke(["train", "train.toml", "--out", "trained"])


@pytest.mark.slow
def test_pip_installs_a_new_package(hers: Path, tmp_path: Path):
    """Into a folder, without its dependency; its entry points are those of the example."""
    where = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(where), str(hers)]
    subprocess.run(pip, check=True, env=os.environ | {"EDOFSIM_PLUGINS": ""})
    (told,) = where.glob("*.dist-info/entry_points.txt")
    groups = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    assert {line.strip("[]") for line in told.read_text().splitlines() if line[:1] == "["} == set(groups)


@pytest.mark.parametrize(
    ("name", "said"),
    [("3d", "letters, digits"), ("class", "letters, digits"), ("json", "another"), ("edofsim", "another")],
)
def test_names_that_no_package_can_have_are_refused(name: str, said: str, tmp_path: Path):
    with pytest.raises(InputError, match=f"'{name}'.*{said}"):
        invoke(["new", "plugin", str(tmp_path / name)])
    assert not any(tmp_path.iterdir())


def test_a_folder_that_is_there_is_left_alone(tmp_path: Path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError, match="is there already"):
        invoke(["new", "plugin", str(tmp_path / "mine")])
    assert not any((tmp_path / "mine").iterdir())


def test_the_example_imports_what_is_public():
    """What keeps its meaning between minor versions: `edofsim` and `edofsim.plugins`."""
    for path in EXAMPLE.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        names = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
        names |= {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        ours = {name for name in names if name and name.split(".")[0] == "edofsim"}
        assert ours <= {"edofsim", "edofsim.plugins"}, path
