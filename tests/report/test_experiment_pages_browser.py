"""Pages of the paper's experiments in a browser: nothing sticks out, nothing is loaded, alts are there."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.core.images import write_png
from edofsim.experiments import broadband_page, fabrication, noise, robustness, table
from edofsim.experiments.broadband import DEPTHS_M, CubeScore, Result
from edofsim.experiments.chromatic import BANDS_M, Chromatic
from edofsim.experiments.photographs import Photographs, one
from edofsim.experiments.planes import RANDOM, PictureScore, Shown, averages
from edofsim.experiments.training import Training
from edofsim.report.experiments_index import write_index
from edofsim.report.page import Page, write_page

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
SYSTEMS = ("paper-dcnn", "paper-cubic+wiener", "a-network-with-a-long-name", "zernike-wiener", "rings-dcnn")
PICTURES = ("kodim01.png", "a-picture-whose-name-goes-on-and-on-and-on-0123456789.png")
PROBE = """<script>addEventListener("load", () => parent.postMessage({
  page: document.title, width: innerWidth, content: document.documentElement.scrollWidth,
  unnamed: [...document.images].filter((image) => !image.alt).length,
  broken: [...document.images].filter((image) => !image.naturalWidth).length }, "*"));</script></body>"""


def shown(folder: Path) -> Shown:
    random = torch.Generator().manual_seed(0)
    paths = [write_png(folder / f"{n}.png", torch.rand(3, 60, 60, generator=random)) for n in "abc"]
    return Shown(*paths)


def rows(
    conditions: list[str], folder: Path, pictures: tuple[str, ...] = PICTURES
) -> tuple[PictureScore, ...]:
    files = shown(folder)
    return tuple(
        PictureScore(
            system,
            picture,
            condition,
            1.0,
            20.0,
            30.0 - 0.5 * place,
            20.0,
            29.0 - 0.5 * place,
            None if condition == RANDOM else files,
        )
        for system in SYSTEMS
        for picture in pictures
        for place, condition in enumerate(conditions)
    )


def robust(conditions: list[str], folder: Path) -> robustness.Result:
    found = rows(conditions, folder)
    figures = averages(found) | {f"loss_db.{system}": 1.5 for system in SYSTEMS}
    return robustness.Result(found, data(), PICTURES, figures)


def data() -> Photographs:
    pixels = torch.zeros(3, 4, 4, dtype=torch.uint8)
    problem = "/a/very/long/path/" * 6 + "b.png: cannot be read as a picture (cut short); mend or remove it"
    return Photographs(tuple(one(name, pixels, i) for i, name in enumerate(PICTURES)), "/data", (problem,))


def tables(folder: Path) -> table.Result:
    fixed = ["0.5m", "0.8m", "1m"]
    found = rows([RANDOM, *fixed], folder)
    db = (30.0, 29.0, 31.0)
    chart = tuple(
        replace(row, channels_db=db, known_depth_db=(30.0, *db))
        for row in rows(fixed, folder, ("USAF-1951",))
    )
    trainings = dict.fromkeys(SYSTEMS, Training(1000, 0, None))
    figures = averages(found) | table.chart_figures(chart)
    return table.Result(chart, found, data(), PICTURES, figures, trainings)


def broad(folder: Path) -> Result:
    files, bands, random = shown(folder), len(BANDS_M), torch.Generator().manual_seed(0)

    def some(*size: int) -> torch.Tensor:
        return torch.rand(*size, generator=random, dtype=torch.float64) + 0.1

    optics = Chromatic(
        *(BANDS_M, some(3, bands), some(17, bands), some(17, bands), torch.linspace(0, 2, 17)),
        *(torch.linspace(1, -0.2, bands), some(3, bands, 2), some(3, bands, 2)),
        some(3, 2),
    )
    db = (30.0, 29.0, 31.0, 30.0)
    found = [
        CubeScore(s, c, depth, db, db, 33.0, 29.0, tuple(some(bands).tolist()), files)
        for s in SYSTEMS[:2]
        for c in ("toy", "a-cube-with-a-long-name-that-goes-on-and-on")
        for depth in DEPTHS_M
    ]
    nm = {row.cube: tuple((BANDS_M * 1e9).tolist()) for row in found}
    return Result(tuple(found), {SYSTEMS[0]: optics}, nm, dict.fromkeys(nm, (0.1, 0.0, 0.02)), (), {})


def pages(folder: Path) -> dict[str, Page]:
    noises = list(noise.STUDY.labels)
    errors = [*fabrication.STUDY.labels, fabrication.DEVICE]
    return {
        "table": table.page(tables(folder)),
        "noise": robustness.page(noise.STUDY, robust(noises, folder)),
        "fabrication": robustness.page(fabrication.STUDY, robust(errors, folder)),
        "broadband": broadband_page.page(broad(folder)),
    }


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_pages_in_a_browser(tmp_path: Path) -> None:
    written = [
        write_page(tmp_path / name / f"{name}.html", page)
        for name, page in pages(tmp_path / "pictures").items()
    ]
    written.append(write_index(tmp_path))
    for path in written:
        text = path.read_text(encoding="utf-8")
        assert not re.search(r'(src|href)="(https?:)?//', text)  # nothing from a network
        path.write_text(text.replace("</body>", PROBE), encoding="utf-8")
    frames = "".join(
        f'<iframe src="{path.relative_to(tmp_path)}" style="width:{width}px;height:900px"></iframe>'
        for path in written
        for width in (1280, 390)
    )
    script = """<script>const all = []; addEventListener("message", (event) => { all.push(event.data);
    document.getElementById("found").textContent = JSON.stringify(all); });</script>"""
    wrapper = tmp_path / "wrapper.html"
    wrapper.write_text(f'<!doctype html><body><pre id="found"></pre>{script}{frames}', encoding="utf-8")
    command = [
        *(CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"),
        *("--disable-background-networking", "--disable-component-update", "--window-size=1800,1000"),
        *("--virtual-time-budget=8000", f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"),
        wrapper.as_uri(),
    ]
    home = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=home)
    answer = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert answer and answer.group(1), done.stderr[-2000:]
    found = json.loads(html.unescape(answer.group(1)))
    assert len(found) == 2 * len(written)
    for entry in found:
        assert entry["content"] <= entry["width"], entry
        assert not entry["unnamed"] and not entry["broken"], entry
