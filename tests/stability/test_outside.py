"""Nothing that is read can run, write elsewhere, or reach files that it was not given."""

from __future__ import annotations

import ast
import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import edofsim
from edofsim import console
from edofsim.cli import app
from edofsim.core.measurements import read_numbers
from edofsim.errors import InputError
from edofsim.recipe.load import load_camera, load_scene, load_train, shipped_folder
from edofsim.restore.checkpoint import load_arrays
from edofsim.scene.mesh_files import read_mesh

NAMES = ["../up", "/etc/x", "a/b", "a\\b", "..", ".", "", ".hidden", "a.b", "a\nb", "a\n", "a b", "-x", "é"]
NAMES += ["x" * 65]
RECIPES = {
    "scene": (shipped_folder("scenes") / "bench.toml", load_scene),
    "camera": (shipped_folder("scenes") / "cameras" / "paper-clear.toml", load_camera),
    "train": (shipped_folder("train") / "paper-dcnn.toml", load_train),
}


class Trap:
    """Opened by pickle, it leaves a file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.system, (f"touch {self.folder / 'ran'}",)


@pytest.mark.parametrize("kind", RECIPES)
@pytest.mark.parametrize("name", NAMES)
def test_names_that_would_lead_elsewhere_are_refused(kind: str, name: str, tmp_path: Path):
    """Files are called after a recipe's name."""
    shipped, load = RECIPES[kind]
    lines = shipped.read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("name = "))
    lines[at] = f"name = {json.dumps(name)}"
    (tmp_path / "recipe.toml").write_text("\n".join(lines))
    with pytest.raises(InputError, match="name"):
        load(tmp_path / "recipe.toml")
    lines[at] = 'name = "good-Name_1"'
    (tmp_path / "recipe.toml").write_text("\n".join(lines))
    assert load(tmp_path / "recipe.toml").recipe.name == "good-Name_1"


def test_a_command_writes_where_it_is_told_and_nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
    monkeypatch.chdir(work)
    scene = work / "small.toml"
    scene.write_text(
        'name = "small"\ncamera = "paper-clear"\n[frame]\nwidth_px = 16\nheight_px = 12\nmargin_px = 2\n'
        "pixel_angle_mrad = 0.1626126\n[bands]\ncount = 3\n[render]\nsamples = 4\n[[objects]]\n"
        'kind = "wall"\ndepth_m = 2.0\n[[lights]]\nkind = "sky"\n'
    )
    line = ["render", scene, "--out", tmp_path / "out", "--cache", tmp_path / "kept", "--quiet"]
    status = console.exit_status(lambda: app([str(each) for each in line], standalone_mode=False))
    assert status == 0
    written = {path.relative_to(tmp_path).parts[0] for path in tmp_path.rglob("*") if path.is_file()}
    assert written <= {"out", "kept", "home", "work"}
    assert [path.name for path in work.rglob("*")] == ["small.toml"]
    # caches of libraries: compiled kernels, fonts
    assert {path.relative_to(home).parts[0] for path in home.iterdir()} <= {"cache", ".config", ".drjit"}


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_arrays_of_objects_are_not_unpickled(suffix: str, tmp_path: Path):
    path = tmp_path / f"depth{suffix}"
    objects = np.array([[Trap(tmp_path)]], dtype=object)
    np.save(path, objects) if suffix == ".npy" else np.savez(path, depth=objects)
    with pytest.raises(InputError, match="depth"):
        read_numbers(path.name, None, tmp_path, "depth")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "write", [lambda t, p: p.write_bytes(pickle.dumps(t)), lambda t, p: torch.save(t, p)]
)
def test_a_training_state_is_not_unpickled(write, tmp_path: Path):
    path = tmp_path / "state.safetensors"
    write(Trap(tmp_path), path)
    with pytest.raises(InputError, match="state.safetensors"):
        load_arrays(path, "training state")
    assert not (tmp_path / "ran").exists()


UNPICKLERS = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "yaml"}
SAFE = {"torch.load": ("weights_only", True), "np.load": ("allow_pickle", False)}


def test_nothing_in_the_package_unpickles_or_runs_what_it_reads():
    """No module imports an unpickler, calls eval, exec or a shell, or torch.load or np.load unguarded."""
    found = []
    for path in sorted(Path(edofsim.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            where = f"{path.name}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
                found += [where for name in names if name.split(".")[0] in UNPICKLERS]
            elif isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                given = {each.arg: ast.unparse(each.value) for each in node.keywords}
                name, value = SAFE.get(called, ("", None))
                found += [where] if name and given.get(name) != str(value) else []
                found += [where] if called in ("eval", "exec", "os.system", "os.popen") else []
                found += [where] if given.get("shell") == "True" else []
    assert not found


def gltf(folder: Path, prefix: str) -> Path:
    """A triangle whose numbers lie in files that are named `prefix` and a number."""
    parts = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(file_type="gltf")
    tree = json.loads(parts["model.gltf"])
    for number, each in enumerate(tree["buffers"]):
        (folder / f"{prefix}{number}.bin").write_bytes(parts[each["uri"]])
        each["uri"] = f"{prefix}{number}.bin"
    path = folder / "mesh.gltf"
    path.write_text(json.dumps(tree))
    return path


def test_a_mesh_does_not_reach_outside_its_folder_unless_allowed(tmp_path: Path):
    folder = tmp_path / "scene"
    folder.mkdir()
    assert len(read_mesh(gltf(folder, "inside"), "mesh").faces) == 1
    path = gltf(folder, "../secret")
    with pytest.raises(InputError, match="outside its folder.*allow_outside"):
        read_mesh(path, "mesh")
    assert len(read_mesh(path, "mesh", allow_outside=True).faces) == 1
