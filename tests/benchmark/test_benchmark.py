"""The benchmark: what entries are given, how they are scored, and what is said of those that fail."""

from __future__ import annotations

import csv
import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

import edofsim as package
from edofsim.benchmark import entries, score
from edofsim.benchmark.definition import Benchmark
from edofsim.benchmark.score import regions_of
from edofsim.benchmark.statistics import differences, interval
from edofsim.capture.files import write_image
from edofsim.recipe.load import load_dataset, shipped_folder
from edofsim.restore.scores import level_and_error, psnr, within_scale
from edofsim.restore.truth import Truth

Run = Callable[..., tuple[int, str]]
ROOM = (Path(__file__).parents[1] / "small" / "room.toml").read_text()
CAMERA = 'name = "NAME"\n[mask]\nMASK\n[sensor]\nread_noise = 0.01\n[psf]\nwindow_px = 32\n'
RECIPE = """
name = "test-1"
cameras = ["cubic.toml"]
[[scenes]]
recipe = "room.toml"
members = 2
split = "test"
[frame]
width_px = 48
height_px = 40
[photos]
noise_seeds = 2
saturation = true
rendering_noise = true
fidelity = { layers = 3, band_groups = 1, group_wavelengths = 1 }
[store]
precision = "float"
keep_views = true
"""
CLEAR, CUBIC = 'kind = "clear"', 'kind = "cubic"\nalpha_rad = 20'


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small benchmark, made by its command."""
    from edofsim import console
    from edofsim.cli import invoke

    folder = tmp_path_factory.mktemp("benchmark")
    (folder / "room.toml").write_text(ROOM)
    for name, mask in (("clear", CLEAR), ("cubic", CUBIC)):
        (folder / f"{name}.toml").write_text(CAMERA.replace("NAME", name).replace("MASK", mask))
    (folder / "test.toml").write_text(RECIPE)
    command = ["benchmark", "make", str(folder / "test.toml"), "--out", str(folder / "data"), "--quiet"]
    assert console.exit_status(lambda: invoke(command)) == 0
    return folder


def figures(path: Path) -> dict[str, float]:
    return json.loads(path.read_text())["figures"]


@pytest.mark.usefixtures("plots_left_out")
def test_entries_of_each_kind_are_scored_by_the_same_figures(
    edofsim: Run, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The photo as it is: once as a system, once as a folder of its files; and the skeleton of the page."""
    monkeypatch.chdir(tmp_path)
    benchmark = Benchmark(place / "data")
    images = tmp_path / "images"
    for metas in benchmark.scenes.values():
        for meta in metas:
            write_image(images / f"{meta['key']}.exr", benchmark.shot(meta).photo)
    assert edofsim("benchmark", "enter", "mine")[0] == 0
    assert edofsim("benchmark", "enter", "mine")[0] == 2
    command = ["benchmark", "score", "photo", "wiener", images, "mine.py", f"{place / 'clear.toml'}+photo"]
    command += ["--data", place / "data", "--out", tmp_path / "out", "--quiet"]
    assert edofsim(*command)[0] == 0
    found = figures(tmp_path / "out" / "benchmark.json")
    assert found["scenes"] == 2 and found["photos"] == 4
    assert all(
        found[f"failures.{name}"] == 0 for name in ("photo", "wiener", "images", "mine", "clear+photo")
    )
    # of the same images: FLIP is the same; the folder's PSNR has the noise of 8 samples a pixel
    assert found["flip.images.whole"] == found["flip.photo.whole"]
    expected = np.mean([level(shot.photo, shot.ideal) for shot in shots(benchmark)])
    assert found["psnr_db.images.whole"] == pytest.approx(expected, abs=1e-9)
    assert expected < found["psnr_db.photo.whole"] < expected + 1
    assert found["psnr_db.wiener.whole"] > found["psnr_db.photo.whole"] + 1
    assert found["psnr_db.clear+photo.whole"] != found["psnr_db.photo.whole"]
    assert (
        found["psnr_db.photo.whole.low"] <= found["psnr_db.photo.whole"] <= found["psnr_db.photo.whole.high"]
    )
    assert found["difference_db.photo.wiener.high"] < 0
    assert {name for name in found if name.startswith("psnr_db.mine.depth")}
    assert {name for name in found if name.startswith("psnr_db.mine.edge")}
    assert (tmp_path / "out" / "benchmark.html").is_file()
    rows = list(csv.DictReader((tmp_path / "out" / "scores.csv").read_text().splitlines()))
    assert len(rows) > 5 * 4
    # standard errors are those of `expose`, by the noise of the rendering
    errors = [float(r["psnr_db_se"]) for r in rows if (r["entry"], r["region"]) == ("photo", "whole")]
    own = [Truth(shot.ideal, shot.noise).compared(shot.photo, shot.noise.image) for shot in shots(benchmark)]
    assert errors == pytest.approx([level_and_error(*each)[1] for each in own], rel=1e-3) and min(errors) > 0
    said = json.loads((tmp_path / "out" / "benchmark.json").read_text())
    assert said["benchmark"] == benchmark.identity and len(said["benchmark"]["data"]) == 64
    assert {each["name"]: each["track"] for each in said["entries"]}["clear+photo"] == "joint"
    # again: nothing is done anew, and the figures are those of before, seconds too
    assert edofsim(*command)[0] == 0
    assert figures(tmp_path / "out" / "benchmark.json") == found


@pytest.mark.usefixtures("plots_left_out")
def test_seconds_are_without_set_up_and_the_counting_of_products_and_memory_is_the_peak(
    edofsim: Run, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Slow(FlopCounterMode):
        def __enter__(self) -> FlopCounterMode:
            until = time.process_time() + 0.2
            while time.process_time() < until:
                pass
            return super().__enter__()

    monkeypatch.setattr(score, "FlopCounterMode", Slow)
    monkeypatch.chdir(tmp_path)
    Path("large.py").write_text(
        "import time\nimport torch\n\nCALLS = []\n\n\ndef restore(photo, psfs, info):\n"
        "    CALLS.append(photo)\n"
        "    until = time.process_time() + 0.2 * (len(CALLS) % 2 == 0)\n"  # as if it set something up
        "    while time.process_time() < until:\n"
        "        pass\n"
        "    large = torch.ones(4, 1024, 1024)\n"  # 16 MiB
        "    square = torch.ones(100, 100)\n"
        "    return photo + 0 * float(large[0, 0, 0]) * float((square @ square)[0, 0])\n"
    )
    command = ["benchmark", "score", "large.py", "--data", place / "data", "--out", tmp_path / "out"]
    assert edofsim(*command, "--quiet")[0] == 0
    found = figures(tmp_path / "out" / "benchmark.json")
    assert found["seconds.large"] < 0.15
    assert found["gmacs.large"] == pytest.approx(100**3 / 1e9)
    assert 15 < found["peak_mib.large"] < 40


@pytest.mark.usefixtures("plots_left_out")
def test_a_camera_like_that_of_the_benchmark_restores_its_photos(
    edofsim: Run, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def camera(name: str, mask: str, more: str = "") -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(CAMERA.replace("NAME", name).replace("MASK", mask) + more)
        return path

    benchmark = Benchmark(place / "data")
    others = [
        camera("other", CUBIC.replace("20", "19")),
        camera("near", CUBIC, "[focus]\ndistance_m = 1.4\n"),
    ]
    for path in others:
        assert not benchmark.takes_the_photos_of(package.camera(path), path.name, "cubic")
    alike = camera("alike", CUBIC)
    alike.write_text(alike.read_text().replace("window_px = 32", "window_px = 30"))

    def expose(*_: object) -> None:
        raise AssertionError("a photo is taken anew")

    monkeypatch.setattr(score, "expose", expose)
    command = ["benchmark", "score", f"{alike}+wiener", "wiener", "--data", place / "data", "--quiet"]
    assert edofsim(*command, "--out", tmp_path / "out")[0] == 0
    found = figures(tmp_path / "out" / "benchmark.json")
    assert found["psnr_db.alike+wiener.whole"] == pytest.approx(found["psnr_db.wiener.whole"], abs=0.01)


def level(image: torch.Tensor, truth: torch.Tensor) -> float:
    """PSNR within full scale, rendering noise and all."""
    return psnr(within_scale(image), within_scale(truth))


def shots(benchmark: Benchmark) -> list:
    return [benchmark.shot(meta) for metas in benchmark.scenes.values() for meta in metas]


def test_regions_cover_the_frame_once(place: Path):
    shot = shots(Benchmark(place / "data"))[0]
    regions = regions_of(shot)
    for kind in ("depth", "edge"):
        masks = [mask for name, mask in regions.items() if name.startswith(kind)]
        assert len(masks) > 1 and bool((torch.stack(masks).sum(0) == 1).all())


@pytest.mark.usefixtures("plots_left_out")
def test_failures_are_named_and_scored_as_black_images(
    edofsim: Run, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    benchmark = Benchmark(place / "data")
    images = tmp_path / "broken"
    _, small, missing = shots(benchmark)[:3]
    for shot in shots(benchmark):
        write_image(images / f"{shot.key}.exr", shot.photo)
    write_image(images / f"{small.key}.exr", small.photo[:, :-1])
    (images / f"{missing.key}.exr").unlink()
    (tmp_path / "nan.py").write_text(
        "def restore(photo, psfs, info):\n    return photo * info.inverse_depth\n"
    )
    monkeypatch.chdir(tmp_path)
    command = ["benchmark", "score", images, "nan.py", "--data", place / "data", "--out", tmp_path / "out"]
    status, said = edofsim(*command, "--quiet")
    assert status == 1
    said = " ".join(said.split())
    assert "48 x 39 pixels" in said and f"{missing.key}.exr or .png is missing" in said and "NaN" in said
    found = figures(tmp_path / "out" / "benchmark.json")
    assert found["failures.broken"] == 2
    assert found["failures.nan"] == 4  # the true distances are not uses to who did not declare them
    levels = [level(shot.photo, shot.ideal) for shot in shots(benchmark)]
    levels[1:3] = [level(torch.zeros_like(shot.ideal), shot.ideal) for shot in (small, missing)]
    assert found["psnr_db.broken.whole"] == pytest.approx(float(np.mean(levels)), abs=0.1)
    (tmp_path / "nan.py").write_text((tmp_path / "nan.py").read_text() + 'USES = ("depth",)\n')
    (tmp_path / "wrong.py").write_text('USES = ("time",)\ndef restore(photo, psfs, info): return photo\n')
    again = ["benchmark", "score", "nan.py", "--data", place / "data", "--out", tmp_path / "again", "--quiet"]
    assert edofsim(*again)[0] == 0
    status, said = edofsim(*again[:2], "wrong.py", *again[3:])
    assert status == 2 and "USES has 'time'" in said
    (images / "more.exr").write_bytes(b"")
    status, said = edofsim(*command, "--quiet")
    assert status == 2 and "more.exr" in said


def test_a_benchmark_that_is_not_whole_is_refused(edofsim: Run, place: Path, tmp_path: Path):
    copy = tmp_path / "copy"
    shutil.copytree(place / "data", copy)
    view = next((copy / "views").glob("*.exr"))
    view.write_bytes(view.read_bytes()[:-1])
    status, said = edofsim(
        "benchmark", "score", "photo", "--data", copy, "--out", tmp_path / "out", "--quiet"
    )
    assert status == 2 and "damaged" in said
    status, said = edofsim("benchmark", "score", "photo", "--data", tmp_path / "none", "--quiet")
    assert status == 2 and "no data set" in said


def test_intervals_are_those_of_closed_forms():
    """Of normal values the interval of a mean is 1.96 standard errors to each side; what all entries share
    cancels in their difference."""
    rng = np.random.default_rng(0)
    scenes = rng.normal(30, 3, (400, 1))
    values = scenes + rng.normal(0, 1, (400, 2))
    found = interval(values)
    error = np.sqrt(3**2 / 400 + 2 * 1**2 / 2 / 400)  # noise seeds are drawn again, beside the scenes
    assert found.mean == pytest.approx(values.mean(), abs=1e-12) and found.scenes == 400
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * error, rel=0.1)
    apart = differences({"a": values, "b": values - 0.1})["a", "b"]
    assert (apart.low, apart.mean, apart.high) == pytest.approx((0.1, 0.1, 0.1), abs=1e-9)
    holes = values.copy()
    holes[:3] = np.nan
    assert interval(holes).scenes == 397
    assert np.isnan(interval(values[:1]).low) and interval(values[:1] * np.nan).scenes == 0


@pytest.mark.usefixtures("plots_left_out")
def test_entries_of_deepinv_are_left_out_with_a_sentence_where_it_is_not_installed(
    edofsim: Run, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(entries, "deepinv_version", lambda: "")
    monkeypatch.setattr(entries, "SHIPPED", ("photo",))
    command = ["benchmark", "score", "--data", place / "data", "--out", tmp_path / "out", "--quiet"]
    status, said = edofsim(*command, "deepinv-tv")
    assert status == 2 and "deepinv-tv: needs deepinv" in said and "edofsim[benchmark]" in said
    assert [entry.name for entry in entries.entries_of(())] == ["photo"]
    assert edofsim(*command)[0] == 0


def test_deepinv_is_given_the_mean_psf_and_mirror_images():
    """Its Wiener filter in closed form, by NumPy; total variation comes nearer to a picture of bars."""
    pytest.importorskip("deepinv")
    from edofsim.benchmark.by_deepinv import BEYOND_PX, SMOOTHNESS, deepinv_tv, deepinv_wiener

    rng = np.random.default_rng(0)
    sharp = np.repeat(np.repeat(rng.random((3, 6, 8)), 8, 1), 8, 2)
    around = ((0, 0), *[(BEYOND_PX, BEYOND_PX)] * 2)
    psfs = rng.random((4, 3, 8, 8)) * np.exp(-np.square(np.indices((8, 8)) - 4).sum(0) / 4)
    mean = psfs.mean(0) / psfs.mean(0).sum((-2, -1), keepdims=True)

    def transfer(kernel: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(kernel), *np.pad(sharp, around).shape[1:]))
        whole[:, : kernel.shape[1], : kernel.shape[2]] = kernel
        return np.fft.fft2(np.roll(whole, [-(n // 2) for n in kernel.shape[1:]], (1, 2)))

    def cut(spectrum: np.ndarray) -> np.ndarray:
        return np.fft.ifft2(spectrum).real[:, BEYOND_PX:-BEYOND_PX, BEYOND_PX:-BEYOND_PX]

    period = np.fft.fft2(np.pad(sharp, around, "symmetric"))
    photo = cut(period * transfer(mean)) + 0.005 * rng.normal(size=sharp.shape)
    seen = np.fft.fft2(np.pad(photo, around, "symmetric"))
    penalty = SMOOTHNESS * np.abs(transfer(np.array([[[0, -1, 0], [-1, 4, -1], [0, -1, 0]]]))) ** 2
    blur = transfer(mean)
    expected = cut(seen * blur.conj() / (np.abs(blur) ** 2 + penalty))
    given = torch.from_numpy(photo).float(), torch.from_numpy(psfs).float(), None
    np.testing.assert_allclose(deepinv_wiener(*given).numpy(), expected, atol=1e-4)
    by_tv, truth = deepinv_tv(*given), torch.from_numpy(sharp).float()
    assert psnr(by_tv, truth) > psnr(given[0], truth) + 3


@pytest.mark.parametrize("size", ["tiny", "small", "full"])
def test_shipped_definitions_are_what_they_say(size: str):
    from edofsim.data.parts import parts_of

    recipe = load_dataset(size).recipe
    parts = parts_of(load_dataset(size))
    families = {part.family for part in parts}
    assert len(families) == len(list((shipped_folder("scenes") / "families").glob("*.toml"))) >= 8
    photos = len(parts) * recipe.photos.noise_seeds * len(recipe.cameras)
    assert photos == {"tiny": 20, "small": 100, "full": 1000}[size]
    assert {part.split for part in parts} == {"test"} and recipe.store.keep_views
    # trainings draw their members from the families' own seeds on, a few thousand at most
    assert min(part.scene.recipe.seed for part in parts) > 600_000
