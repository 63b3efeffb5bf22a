"""The page of a run in a real browser: nothing sticks out on a desktop or a phone, and the slider works."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

from edofsim.report import ImageScore, PlanRow, Psfs, RunReport, write_report
from edofsim.report.words import distance
from edofsim.restore.scores import score_by_depth

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--virtual-time-budget=5000",
    "--window-size=1800,1000",
)
PROBE = """<script>
addEventListener("load", () => {
  const range = document.querySelector(".compare input"), stage = document.querySelector(".compare .stage");
  const found = { width: innerWidth, content: document.documentElement.scrollWidth };
  const at = () => stage.style.getPropertyValue("--at");
  range.value = 25;
  range.dispatchEvent(new Event("input"));
  found.typed = at();
  const box = stage.getBoundingClientRect();
  const place = { clientX: box.left + 0.75 * box.width, pointerId: 1 };
  stage.dispatchEvent(new PointerEvent("pointerdown", place));
  found.dragged = at();
  const left = document.querySelector("select.left");
  left.selectedIndex = 0;
  left.dispatchEvent(new Event("change"));
  found.left = stage.querySelector("img").alt;
  found.spoken = range.getAttribute("aria-valuetext");
  const sweep = document.querySelector(".sweep"), slider = sweep.querySelector("input");
  slider.value = 2;
  slider.dispatchEvent(new Event("input"));
  found.focused = sweep.querySelector("output").textContent;
  const seen = [...sweep.querySelectorAll(".stage img")].filter((each) => each.offsetHeight);
  found.seen = seen.map((each) => each.alt);
  const picture = document.querySelector("#images-all img[data-label]");
  const frame = picture.getBoundingClientRect();
  const pointed = { clientX: frame.left + 0.631 * frame.width, clientY: frame.top + 0.408 * frame.height };
  picture.dispatchEvent(new PointerEvent("pointermove", pointed));
  found.values = document.querySelector("#images-all .values").textContent;
  const saved = (where) => {
    const link = document.querySelector(where + " .save");
    link.addEventListener("click", (event) => event.preventDefault());
    link.click();
    return [link.download, decodeURIComponent(link.href).slice(0, 60)];
  };
  found.saved = [".picture", ".sweep", ".plot", "table"].map(saved);
  parent.postMessage(found, "*");
});
</script></body>"""
WRAPPER = """<!doctype html><body><pre id="found"></pre>
<iframe src="report.html" style="width:1280px;height:900px"></iframe>
<iframe src="report.html" style="width:390px;height:844px"></iframe>
<script>
const all = [];
addEventListener("message", (event) => {
  all.push(event.data);
  document.getElementById("found").textContent = JSON.stringify(all);
});
</script>"""


def long_report() -> RunReport:
    """Long names and many rows: what could stick out."""
    random = torch.Generator().manual_seed(0)
    ideal = torch.rand(3, 60, 80, generator=random)
    depth = torch.linspace(0, 2, 60)[:, None].expand(60, 80).contiguous()
    photo = ideal + 0.05 * torch.randn(ideal.shape, generator=random)
    scored = ImageScore(*score_by_depth(photo, ideal, "none", depth))
    depths = tuple(0.5 + 0.2 * i for i in range(12))
    return RunReport(
        title="a-scene-with-a-name-that-is-as-long-as-a-recipe-allows-it-to-be-0123",
        purpose="A purpose. " * 12,
        camera="a-camera-with-a-long-name-too",
        ideal=ideal, photo=photo, restored=photo, lens_alone=photo, inverse_depth=depth,
        focused={0.5: ideal, 1.0: photo, 100.0: 0.5 * ideal},
        scores={"photo": scored, "restored": scored, "lens_alone": scored},
        psfs=Psfs(torch.full((12, 3, 65, 65), 1 / 65**2), depths, 6.0),
        plan=(PlanRow("an effect", True, 0.01, 3.0, "because/of/a/path/without/any/blank/" * 4),),
        seconds={"render": 100.0, "expose": 3.0},
        recipes={"scene.toml": "x = " + "1234567890" * 40},
        command="edofsim run " + "/a/very/long/path" * 12,
        figures={"psnr_db." + "by_depth_" * 9: 1.0},
        machine={"processor": "Some(R) Processor(TM) with a long name @ 2.50GHz " * 2},
        restored_label="Restored (a network with a long name, trained on something)",
    )  # fmt: skip


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_page_in_a_browser(tmp_path: Path):
    page = write_report(tmp_path / "report.html", long_report())
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE), encoding="utf-8")
    (tmp_path / "wrapper.html").write_text(WRAPPER, encoding="utf-8")
    command = [CHROMIUM, *SWITCHES, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
    command.append((tmp_path / "wrapper.html").as_uri())
    home = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=home)
    shown = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert shown and shown.group(1), done.stderr[-2000:]
    found = {entry["width"]: entry for entry in json.loads(html.unescape(shown.group(1)))}
    assert set(found) == {1280, 390}
    for width, entry in found.items():
        assert entry["content"] <= width, f"{entry['content']} pixels of content on {width}"
        assert entry["typed"] == "25%"
        assert float(entry["dragged"].rstrip("%")) == pytest.approx(75, abs=0.5)
        assert entry["left"].startswith("Ideal")
        assert "% Ideal" in entry["spoken"]
        assert entry["focused"] == distance(100.0) and len(entry["seen"]) == 1
        assert f"focused at {distance(100.0)}" in entry["seen"][0]
        report = long_report()
        place, light = entry["values"].split(" · ")[:2]
        x, y = 50, 24  # 0.631 of 80 and 0.408 of 60
        assert place == f"x {x}, y {y}, {1 / float(report.inverse_depth[y, x]):.3g} m"
        found_light = [float(value) for value in light.removeprefix("Ideal ").replace("≥ ", "").split()]
        assert found_light == pytest.approx(report.ideal[:, y, x].tolist(), abs=0.005)
        kinds = ("data:image/png", "data:image/png", "data:image/svg+xml", "data:text/csv")
        assert all(link.startswith(kind) for (_, link), kind in zip(entry["saved"], kinds, strict=True))
        assert [name.rpartition(".")[2] for name, _ in entry["saved"]] == ["png", "png", "svg", "csv"]
