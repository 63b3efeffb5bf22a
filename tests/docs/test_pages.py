"""The site and the README: their examples run, links lead somewhere, and it builds without a warning."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread

import edofsim
from edofsim.core.images import write_png
from edofsim.recipe import SceneRecipe

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    path
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")]
    if not {"_build", "gallery"} & set(path.parts)
)
TUTORIALS = sorted((DOCS / "tutorials").glob("*.py"))
SLOW = {"09", "12"}
"""Those that take more than about ten seconds, or start processes."""


def blocks(path: Path, language: str) -> str:
    """All code of a language on a page, one after the other, as a reader would type it."""
    return "\n".join(re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL))


def named(paths: list[Path], slow: set[str] = frozenset()) -> list:
    return [
        pytest.param(
            path,
            id=str(path.relative_to(ROOT)),
            marks=pytest.mark.slow if path.name[:2] in slow else (),
        )
        for path in paths
    ]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, filters_left_out: None) -> None:
    """Frames and PSFs of a few pixels, whatever a page asks for: its code runs just the same."""
    from edofsim import api

    from_image, camera, framed = edofsim.View.from_image, edofsim.camera, api.framed

    def cut(values: object) -> object:
        return values[:48, :64] if isinstance(values, np.ndarray) and values.ndim > 1 else values

    def cut_frame(recipe: SceneRecipe, *how: object) -> SceneRecipe:
        smaller = {"frame": recipe.frame.model_copy(update={"width_px": 64, "height_px": 48})}
        return framed(recipe.model_copy(update=smaller), *how)

    def image(rgb: object, depth: object, **how: object) -> edofsim.View:
        return from_image(cut(rgb), cut(depth), **{"margin": 16, **how})

    monkeypatch.setattr(edofsim.View, "from_image", image)
    monkeypatch.setattr(edofsim, "camera", lambda *given, **how: camera(*given, **{"window": 32, **how}))
    monkeypatch.setattr(api, "framed", cut_frame)


@pytest.mark.usefixtures("registered_for_a_test", "small")
@pytest.mark.parametrize("path", named([path for path in PAGES if blocks(path, "python")]))
def test_the_python_on_a_page_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In a folder with the reader's own picture and its depth map."""
    monkeypatch.chdir(tmp_path)
    write_png(tmp_path / "photo.png", np.random.default_rng(0).random((3, 48, 64)))
    np.save(tmp_path / "depth.npy", np.linspace(0.6, 3.0, 64) * np.ones((48, 1)))
    monkeypatch.setenv("MPLBACKEND", "agg")
    exec(compile(blocks(path, "python"), str(path), "exec", dont_inherit=True), {"__name__": path.stem})


@pytest.mark.parametrize("path", named(PAGES))
def test_no_line_begins_with_a_remark_that_nobody_sees(path: Path):
    """On the site such a line ends its paragraph, and what follows in it is shown as it was typed. The ends
    of tables that are made (`docs/tables.py`) hold nothing else, and stand outside of paragraphs."""
    lines = ["", *path.read_text(encoding="utf-8").splitlines()]
    for before, line in pairwise(lines):
        made = re.fullmatch(r"<!-- (made: \S+|end) -->", line)
        assert not line.lstrip().startswith("<!--") or (made and (made[1] == "end" or not before.strip()))


@pytest.mark.parametrize("path", named([path for path in PAGES if blocks(path, "toml")]))
def test_the_recipes_on_a_page_are_toml(path: Path):
    assert tomllib.loads(blocks(path, "toml"))


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("path", named(TUTORIALS, SLOW))
def test_a_tutorial_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """From another folder than the checkout, as a notebook that was downloaded does."""
    from matplotlib import pyplot

    if path.name.startswith("12"):
        pytest.importorskip("distributed")
        run = [sys.executable, str(path)]  # its cluster's workers import it
        subprocess.run(run, check=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
        return
    monkeypatch.chdir(tmp_path)
    pyplot.switch_backend("agg")
    runpy.run_path(str(path), run_name="__main__")
    pyplot.close("all")


def test_there_is_a_tutorial_of_each_kind():
    assert [path.name[:2] for path in TUTORIALS] == [f"{number:02d}" for number in range(1, 13)]


@pytest.mark.parametrize("path", named(PAGES))
def test_links_on_a_page_lead_to_files_that_are_there(path: Path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target or target.startswith("#"):
            continue
        file = (path.parent / target.partition("#")[0]).resolve()
        if file.parent.name == "gallery":  # made from the tutorial of that name
            file = DOCS / "tutorials" / f"{file.stem}.py" if file.stem != "index" else DOCS / "tutorials"
        assert file.exists(), f"{path.name} leads to {target}"


def test_commands_on_pages_and_their_options_exist():
    """`$ edofsim NAME --option`: each name is a command, and each long option one of its."""
    import typer

    from edofsim.cli import app

    known = typer.main.get_command(app)
    for path in PAGES:
        for line in re.findall(r"^\$ edofsim ([^#\n]*)", path.read_text(encoding="utf-8"), re.MULTILINE):
            words = line.split()
            command = known.commands.get(words[0]) if not words[0].startswith("-") else known
            assert command is not None, f"{path.name}: {line}"
            options = {name for each in command.params for name in each.opts} | {"--install-completion"}
            if hasattr(command, "commands"):
                continue
            assert {word for word in words if word.startswith("--")} <= options, f"{path.name}: {line}"


def test_the_chart_is_that_of_the_kept_run(tmp_path: Path):
    """Drawn again by this version of Matplotlib it is the picture that README shows."""
    chart = runpy.run_path(str(DOCS / "chart.py"))
    kept, drawn = chart["CHART"], chart["chart"]().save(tmp_path / "cost.png")
    pixels = [np.asarray(imread(path)).astype(int) for path in (kept, drawn)]
    assert pixels[0].shape == pixels[1].shape
    assert (abs(pixels[0] - pixels[1]) > 8).mean() < 1e-3


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning")
def test_the_site_builds_without_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    """Without running the tutorials, which other tests do."""
    pytest.importorskip("sphinx_gallery")
    from sphinx.cmd.build import main

    copy, html = tmp_path / "checkout", tmp_path / "html"
    copy.mkdir()
    for name in ("CONTRIBUTING.md", "CHANGELOG.md"):
        shutil.copy(ROOT / name, copy)
    (copy / "scenes").symlink_to(ROOT / "scenes")
    (copy / "tests").symlink_to(ROOT / "tests")  # pages show its example of a package
    shutil.copytree(DOCS, copy / "docs", ignore=shutil.ignore_patterns("_build", "gallery", "sg_*"))
    settings = {"DOCS_RUN": "0", "MPLBACKEND": "agg", "DASK_LOGGING__DISTRIBUTED": "error"}
    for name, value in settings.items():  # the last two are set by `conf.py`: undone after the test
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "path", list(sys.path))
    # the theme's list of all pages on each page; Sphinx checks the tables of contents that it is made of
    monkeypatch.setattr("furo._compute_navigation_tree", lambda context: "")
    done = main(["-q", "-W", "--keep-going", "-b", "html", str(copy / "docs"), str(html)])
    sys.modules.pop("recipe_keys", None)  # of the copy
    assert done == 0, capfd.readouterr().err
    assert "<math" in (html / "ideas" / "psfs.html").read_text()
    wrong = runpy.run_path(str(DOCS / "built.py"))["broken"](html)
    assert not wrong, wrong
    pages = "".join(path.read_text() for path in html.rglob("*.html"))
    assert not re.findall(r'<(?:script|link)[^>]*(?:src|href)="https?://', pages), "a page needs a network"
