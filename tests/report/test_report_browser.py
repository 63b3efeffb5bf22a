"""The page of a run in a real browser: nothing sticks out on a desktop or a phone, and the slider works."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from edofsim.capture import Fidelity
from edofsim.pipeline import Run
from edofsim.plan import Decision, Plan
from edofsim.report import run_page, write_page
from edofsim.report.words import distance
from edofsim.restore.places import Method

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


def long_run(made_run: Callable[..., Run]) -> Run:
    """Long names and many rows: what could stick out."""
    made = made_run(60, 80, restored_by=Method("a network with a long name, trained on something"))
    long = made.scene.recipe.model_copy(
        update={
            "name": "a-scene-with-a-name-that-is-as-long-as-a-recipe-allows-it-to-be-0123",
            "purpose": "A purpose. " * 12,
        }
    )
    why = "because/of/a/path/without/any/blank/" * 4
    plan = Plan((Decision("an effect", True, "", why, error=(0.01,) * 3, seconds=3.0),), Fidelity())
    path = Path("/a/very/long/path" * 12) / "scene.toml"
    scene = replace(made.scene, recipe=long, path=path, text="x = " + "1234567890" * 40)
    return replace(made, scene=scene, plan=plan, plan_lens_alone=plan)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_page_in_a_browser(tmp_path: Path, made_run: Callable[..., Run]):
    run = long_run(made_run)
    ideal = run.photo.ideal
    focused = {0.5: ideal, 1.0: run.photo.image, 100.0: 0.5 * ideal}
    page = write_page(tmp_path / "report.html", run_page(run, focused))
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
        place, light = entry["values"].split(" · ")[:2]
        x, y = 50, 24  # 0.631 of 80 and 0.408 of 60
        assert place == f"x {x}, y {y}, {1 / float(run.view.mean_inverse_depth()[y, x]):.3g} m"
        found_light = [float(value) for value in light.removeprefix("Ideal ").replace("≥ ", "").split()]
        assert found_light == pytest.approx(ideal[:, y, x].tolist(), abs=0.005)
        kinds = ("data:image/png", "data:image/png", "data:image/svg+xml", "data:text/csv")
        assert all(link.startswith(kind) for (_, link), kind in zip(entry["saved"], kinds, strict=True))
        assert [name.rpartition(".")[2] for name, _ in entry["saved"]] == ["png", "png", "svg", "csv"]
