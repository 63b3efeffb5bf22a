"""What is asked of the site once it is built, on small sites."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("built", ROOT / "docs" / "built.py")
assert spec and spec.loader
built = importlib.util.module_from_spec(spec)
spec.loader.exec_module(built)

PAGE = """<html><head><link rel="stylesheet" href="_static/site.css?v=1"></head><body><p id="top-of-it">
<a href="#top-of-it">up</a> <a href="sub/other.html#there">other</a> <a href="https://a.org/no">away</a>
<img src="sub/a%20picture.png"> <a href="#">top</a> <a href="mailto:a@example.org">mail</a>
</p></body></html>"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    (tmp_path / "_static").mkdir()
    (tmp_path / "_static" / "site.css").touch()
    (tmp_path / "sub" / "a picture.png").write_bytes(b"png")
    (tmp_path / "index.html").write_text(PAGE)
    (tmp_path / "sub" / "other.html").write_text(
        '<h1 id="there">x</h1><a href="../index.html#top-of-it">i</a>'
    )
    return tmp_path


def test_links_that_lead_somewhere(site: Path):
    assert built.broken(site) == []


@pytest.mark.parametrize(
    "right, wrong, said",
    [
        ("#there", "#nowhere", "index.html:2: sub/other.html#nowhere: no such place on that page"),
        ('"#top-of-it"', '"#bottom"', "index.html:2: #bottom: no such place"),
        ("sub/other.html", "sub/another.html", "index.html:2: sub/another.html#there: no such file"),
        ("a%20picture", "picture", "index.html:3: sub/picture.png: no such file"),
        ("site.css", "style.css", "index.html:1: _static/style.css?v=1: no such file"),
        ("sub/other.html#there", "sub", "index.html:2: sub: no such file"),
    ],
)
def test_a_link_that_leads_nowhere_is_named(site: Path, right: str, wrong: str, said: str):
    (site / "index.html").write_text(PAGE.replace(right, wrong))
    found = built.broken(site)
    assert len(found) == 1 and found[0].startswith(said), found


def test_two_buildings_are_the_same_but_for_times(site: Path, tmp_path_factory: pytest.TempPathFactory):
    again = tmp_path_factory.mktemp("again") / "site"
    shutil.copytree(site, again)
    for folder, seconds in ((site, "1 s"), (again, "2 s")):
        (folder / "gallery").mkdir()
        (folder / "gallery" / "times.txt").write_text(seconds)
    assert built.differences(site, again) == []
    (again / "index.html").write_text(PAGE + " ")
    (again / "more.html").touch()
    assert built.differences(site, again) == ["more.html: is in one of them only", "index.html: differs"]
