"""A figure of one name is one figure: the same photo has the same scores whatever command prints them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage import data as pictures

import edofsim as package
from edofsim.core.progress import silent
from edofsim.experiments import camera_figures, cameras, cost_stages
from edofsim.experiments.failures import Failures
from edofsim.experiments.photographs import photographs
from edofsim.experiments.restorations import ByWiener
from edofsim.recipe import load_camera
from edofsim.restore import scores
from edofsim.restore.gains import RIVALS
from edofsim.restore.scores import image_psnr

pytestmark = pytest.mark.usefixtures("plots_left_out")
Command = Callable[..., tuple[int, str]]
SCENE = """\
name = "cat"
frame = { width_px = 40, height_px = 32, margin_px = 12 }
bands = { start_nm = 430, stop_nm = 700, count = 7 }

[source]
kind = "rgbd"
image = "cat.png"

[source.depth]
path = "depth.npy"
"""
CAMERA = """\
name = "NAME"
MASK
[sensor]
response = "paper"
saturation = true

[psf]
window_px = 24
"""
MASKS = {"clear": "", "cubic": '[mask]\nkind = "cubic"\nalpha_rad = 10.0\n'}
OF_THE_MACHINE = ("seconds", "peak_memory", "plan.seconds", "plan.share", "plan.full_seconds", "plan.memory")
SAME = 1e-9
"""dB between two commands that take the very same photo."""
ALIKE = 0.02
"""dB between photos in full through 6 x 6 and through 4 x 4 sub-apertures."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A cat on two slanted surfaces, one before the other, and two cameras."""
    depth = np.where(np.arange(64) < 30, 0.7, 1.6) + np.linspace(0, 0.1, 56)[:, None]
    np.save(tmp_path / "depth.npy", depth)
    Image.fromarray(pictures.chelsea()[100:156, 120:184]).save(tmp_path / "cat.png")
    (tmp_path / "cat.toml").write_text(SCENE)
    for name, mask in MASKS.items():
        (tmp_path / f"{name}.toml").write_text(CAMERA.replace("NAME", name).replace("MASK", mask))
    return tmp_path


def figures_of(edofsim: Command, folder: Path, camera: str, *command: str) -> dict[str, float]:
    """Those that a command prints for the cat through a camera."""
    said = folder / "said.json"
    name = "-".join(part.strip("-").replace("/", "_") for part in command)
    where = ("--camera", folder / f"{camera}.toml", "--out", folder / f"{camera}-{name}", "--json", said)
    words = [folder / "cat.toml" if word == "SCENE" else word for word in command]
    status, error = edofsim(*words, *where, "--quiet")
    assert status == 0, error
    return json.loads(said.read_text())["figures"]


def shared_figures(one: Mapping[str, float], other: Mapping[str, float]) -> list[str]:
    """Names that both have, but those of time and memory, which tell of the machine; all are equal."""
    shared = [name for name in one if name in other and not name.startswith(OF_THE_MACHINE)]
    assert {name: one[name] for name in shared} == {name: other[name] for name in shared}
    return shared


@pytest.mark.usefixtures("conditioned_once")
@pytest.mark.parametrize("camera", ["cubic", pytest.param("clear", marks=pytest.mark.slow)])
def test_commands_of_one_photo_agree(
    edofsim: Command, folder: Path, camera: str, monkeypatch: pytest.MonkeyPatch
):
    """`run`, `expose`, `cost` and Python take it by the same plan, and restore it alike."""
    run = figures_of(edofsim, folder, camera, "run", "SCENE")
    expose = figures_of(edofsim, folder, camera, "expose", "SCENE", "--accuracy", "restored")
    assert {"psnr_db.photo", "psnr_db_se.photo", "plan.psnr_db"} <= set(shared_figures(run, expose))
    camera_recipe = package.camera(folder / f"{camera}.toml")
    view = package.view(folder / "cat.toml", camera_recipe)
    photo = package.photograph(view, camera_recipe, accuracy="restored")
    assert image_psnr(photo.image, photo.ideal) == pytest.approx(run["psnr_db.photo"], abs=SAME)
    for rival in RIVALS:
        gain = run["psnr_db.restored"] - run[f"psnr_db.{rival}"]
        assert run[f"gain_db.over_{rival}"] == pytest.approx(gain, abs=SAME)
    monkeypatch.setattr(cost_stages, "shipped_checkpoints", dict)  # of other masks
    loaded = load_camera(str(folder / f"{camera}.toml"))
    points = cost_stages.figures(cost_stages.restore_points(view, loaded, folder, repeats=1))
    assert points["psnr_db.restore.Wiener"] == pytest.approx(run["psnr_db.wiener"], abs=SAME)
    assert points["psnr_db.restore.universal"] == pytest.approx(run["psnr_db.restored"], abs=SAME)


def test_experiments_on_deep_scenes_agree_with_run(edofsim: Command, folder: Path):
    """`evaluate scene3d` and `evaluate cameras` simulate more than a plan asks for: as `run` does in full."""
    full = figures_of(edofsim, folder, "clear", "run", "SCENE", "--network", "wiener", "--accuracy", "full")
    planned = figures_of(edofsim, folder, "clear", "run", "SCENE", "--network", "wiener")
    names = ("evaluate", "scene3d", "SCENE", "--system", "wiener")
    deep = figures_of(edofsim, folder, "clear", *names)
    ours = {
        "psnr_db.photo": "psnr_db.cat.sub_apertures.wiener.photo",
        "psnr_db.lens_alone": "psnr_db.cat.sub_apertures.lens_alone",
        "psnr_db.restored": "psnr_db.cat.sub_apertures.wiener",
        "ssim.photo": "ssim.cat.sub_apertures.wiener.photo",
        "ssim.restored": "ssim.cat.sub_apertures.wiener",
        **{
            f"gain_db.over_{r}": f"gain_db.cat.sub_apertures.wiener.over_{r}" for r in ("photo", "lens_alone")
        },
    }
    for one, other in ours.items():
        assert deep[other] == pytest.approx(full[one], abs=ALIKE), one
        assert full[one] == pytest.approx(planned[one], abs=0.1), one
    (camera_recipe,) = cameras.asked_for([str(folder / "clear.toml")])
    by = {cameras.WIENER: ByWiener()}
    judge = cameras.Judge(camera_recipe, by, Failures(), folder, 0, None)
    found = {what: level for what, (level, _) in judge.deep(str(folder / "cat.toml")).items()}
    figures = camera_figures.figures_of({"clear": {"cat": found}})
    for rival in (*RIVALS, "restored"):
        other = {"restored": "wiener"}.get(rival, f"wiener.{rival}")
        other = "lens_alone" if rival == "lens_alone" else other
        mine = figures[f"psnr_db.clear.cat.{'wiener' if rival == 'restored' else rival}"]
        assert mine == pytest.approx(deep[f"psnr_db.cat.sub_apertures.{other}"], abs=SAME), rival
    for rival in ("photo", "lens_alone"):
        mine = figures[f"gain_db.clear.cat.wiener.over_{rival}"]
        assert mine == pytest.approx(deep[f"gain_db.cat.sub_apertures.wiener.over_{rival}"], abs=SAME)


PAIRS = """\
name = "room-1"
cameras = ["cubic.toml"]
scenes = [{ recipe = "room.toml", members = 2, split = "test" }]
frame = { width_px = 40, height_px = 32 }
photos = { fidelity = { layers = 3, band_groups = 1, group_wavelengths = 1, occlusion = "none" } }
store = { precision = "float", keep_views = true }
"""


def test_every_command_scores_by_one_function(
    edofsim: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """Where that says 12.5 dB, so does each of them: `evaluate table` measures pictures as `cameras` does."""
    monkeypatch.setattr(scores, "_level", lambda *_: (12.5, 0.25))
    found = [figures_of(edofsim, folder, "cubic", "evaluate", "scene3d", "SCENE", "--system", "wiener")]
    (folder / "pairs.toml").write_text(PAIRS)
    (folder / "room.toml").write_text((Path(__file__).parents[1] / "small" / "room.toml").read_text())
    data = folder / "data"
    assert edofsim("benchmark", "make", folder / "pairs.toml", "--out", data, "--quiet")[0] == 0
    words = ("benchmark", "score", "photo", "wiener", "--data", data, "--out", folder / "scores", "--quiet")
    assert edofsim(*words)[0] == 0
    found.append(json.loads((folder / "scores" / "benchmark.json").read_text())["figures"])
    (taker,) = cameras.asked_for([str(folder / "cubic.toml")])
    judge = cameras.Judge(taker, {cameras.WIENER: ByWiener()}, Failures(), folder, 0, None)
    found.append({f"psnr_db.{k}": level for k, (level, _) in judge.deep(str(folder / "cat.toml")).items()})
    (folder / "flat").mkdir()
    Image.fromarray(pictures.chelsea()[:200, :200]).save(folder / "flat" / "cat.png")
    planes = judge.planes(photographs(folder / "flat"), silent)[0]
    found.append({f"psnr_db.{name}": level for name, level in planes.items()})
    for figures in found:
        levels = {name: value for name, value in figures.items() if name.startswith("psnr_db.")}
        levels = {name: value for name, value in levels.items() if not name.endswith((".low", ".high"))}
        assert len(levels) >= 3 and set(levels.values()) == {12.5}, levels
