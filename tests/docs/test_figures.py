"""Figures on the pages are those that commands wrote."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("figures", ROOT / "docs" / "figures.py")
assert spec and spec.loader
figures = importlib.util.module_from_spec(spec)
spec.loader.exec_module(figures)

PAGE = """# Page

`edofsim evaluate table --data kodak`

| what | figure |
|---|---|
| restored | <!-- table psnr_db.a -->30.46 dB |
| all | <!-- table times.* -->6.0 to 23 |
| in the middle | <!-- table median:times.* -->14.32, at most <!-- table most:times.* -->22.6 |
| of them | <!-- table share.b x100 -->85.2 % |
| elsewhere | <!-- quoted -->26.26 dB |
| of code of commit abc1234, at <!-- given -->50 dB | <!-- of abc1234 -->3.5 to 4 s |

A line of 20 dioptres, `--accuracy 45dB`, and 160 x 128 pixels.
"""
RECORD = {
    "command": "evaluate table",
    "typed": "edofsim evaluate table --data /some/where/kodak --out /else/where --quiet",
    "date": "2026-01-01T00:00:00Z",
    "commit": "abc1234",
    "versions": {},
    "machine": {},
    "seed": 0,
    "inputs": {"data": "/some/where"},
    "figures": {"psnr_db.a": 30.4567891234, "times.x": 22.6, "times.y": 6.04, "share.b": 0.8519, "e": "inf"},
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text(PAGE)
    written = tmp_path / "written.json"
    written.write_text(json.dumps(RECORD))
    figures.keep(written, "table", tmp_path)
    figures.write(tmp_path)
    return tmp_path


def test_the_figures_on_our_pages_are_those_that_commands_wrote():
    found = figures.check(ROOT, figures.AWAITED)
    assert not found, "\n".join(map(str, found))
    there = {path.stem for path in (ROOT / figures.RESULTS).glob("*.json")}
    assert not there & set(figures.AWAITED), "a file that is there is not awaited"


def test_what_a_command_wrote_is_kept_without_its_folders(checkout: Path):
    kept = json.loads((checkout / figures.RESULTS / "table.json").read_text())
    assert kept["typed"] == "edofsim evaluate table --data kodak" and kept["commit"] == "abc1234"
    assert kept["figures"]["psnr_db.a"] == 30.4568 and "inputs" not in kept
    (checkout / "dirty.json").write_text(json.dumps({**RECORD, "commit": "abc1234-dirty"}))
    with pytest.raises(ValueError, match="in no commit"):
        figures.keep(checkout / "dirty.json", "dirty", checkout)


def test_a_page_that_agrees(checkout: Path):
    assert figures.check(checkout) == []


@pytest.mark.parametrize(
    "right, wrong, said",
    [
        ("30.46 dB", "30.47 dB", "README.md:7: table.json has 30.46 for psnr_db.a, the page 30.47"),
        ("6.0 to 23", "6.1 to 23", "table.json has 6.0 to 23"),
        ("6.0 to 23", "6.0", "2 figures"),
        ("14.32", "14.33", "table.json has 14.32 for median:times.*"),
        ("median:", "mean:", "no figure mean:times.*"),
        ("85.2 %", "8.5 %", "85.2"),
        ("psnr_db.a", "psnr_db.c", "no figure psnr_db.c"),
        ("table psnr", "tables psnr", "no docs/results/json/tables.json"),
        ("--data kodak", "--data bsds", "does not stand on the page"),
        ("<!-- quoted -->", "", "'26.26 dB' names no file"),
        ("<!-- table times.* -->", "", "'6.0 to 23' names no file"),
        ("A line", "It took 3.5 s. A line", "README.md:14: '3.5 s' names no file"),
        ("<!-- given -->", "", "'50 dB' names no file"),
        ("of code of commit abc1234", "of code of before", "does not say that it is of commit abc1234"),
        ("abc1234 -->", "abc123 -->", "'3.5 to 4 s' names no file"),
    ],
)
def test_what_does_not_agree_is_named(checkout: Path, right: str, wrong: str, said: str):
    (checkout / "README.md").write_text(PAGE.replace(right, wrong, 1))
    found = figures.check(checkout)
    assert found and any(said in str(each) for each in found), found


def test_the_page_of_runs_is_made_of_the_files(checkout: Path):
    page = checkout / figures.RUNS
    row = "| [table](json/table.json) | `edofsim evaluate table --data kodak` | abc1234 | 2026-01-01 |"
    assert row in page.read_text()
    page.write_text(page.read_text().replace("abc1234", "abc1235"))
    assert "runs.md" in str(figures.check(checkout)[0])


def test_patterns_that_a_shell_expanded_are_kept_as_they_were_typed(checkout: Path):
    (checkout / "scenes" / "families").mkdir(parents=True)
    for name in ("alley", "blocks"):
        (checkout / "scenes" / "families" / f"{name}.toml").touch()
    folder = "/some/where/scenes/families"
    for named, kept in (
        (f"{folder}/alley.toml {folder}/blocks.toml", "scenes/families/*.toml"),
        (f"{folder}/alley.toml", "alley.toml"),
    ):
        record = {**RECORD, "typed": f"edofsim evaluate predictions {named} --members 1"}
        (checkout / "written.json").write_text(json.dumps(record))
        file = figures.keep(checkout / "written.json", "of-families", checkout, ("times.*",))
        record = json.loads(file.read_text())
        assert record["typed"] == f"edofsim evaluate predictions {kept} --members 1"
        assert set(record["figures"]) == {"times.x", "times.y"}


def test_figures_are_written_to_the_pages(checkout: Path):
    page = checkout / "README.md"
    page.write_text(PAGE.replace("30.46", "10.00").replace("6.0 to 23", "1.0 to 2").replace("85.2", "0.0"))
    figures.write(checkout)
    assert page.read_text() == PAGE


PLACE = """# Results

What it shows.

<!-- made: all -->
<!-- end -->
"""
SPEC = """
[all]
head = "PSNR / dB"
files = ["table"]
rows = "times.{}"
columns = [
  ["times", "times.{}", ".1f"],
  ["least", "table least:times.*"],
  ["all", "times.*", ".0f"],
  ["no", "psnr_db.{}"],
]
plot = "times"
plotted = ["times"]
"""


@pytest.fixture
def with_table(checkout: Path) -> Path:
    page = checkout / "docs" / "results" / "page.md"
    page.write_text(PLACE)
    (page.parent / "tables.toml").write_text(SPEC)
    figures.write(checkout)
    return page


def test_tables_are_made_of_the_files_with_their_command_below(with_table: Path, checkout: Path):
    assert "| PSNR / dB | times | least | all | no |\n" in (text := with_table.read_text())
    assert "| `x` | 22.6 | 6.04 | 6 to 23 |  |\n| `y` | 6.0 | 6.04 | 6 to 23 |  |\n" in text
    assert "Printed by `edofsim evaluate table --data kodak` (2026-01-01, abc1234).\n<!-- end -->" in text
    drawn = checkout / "docs" / "_static" / "results" / "all.svg"
    assert figures.check(checkout) == [] and drawn.is_file()
    before = drawn.read_bytes()
    figures.write(checkout)
    assert drawn.read_bytes() == before and with_table.read_text() == text


def test_tables_and_plots_of_other_figures_are_named_and_made_anew(with_table: Path, checkout: Path):
    def said() -> str:
        return " ".join(map(str, figures.check(checkout)))

    record = checkout / figures.RESULTS / "table.json"
    drawn = checkout / "docs" / "_static" / "results" / "all.svg"
    before = drawn.read_text()
    record.write_text(record.read_text().replace("22.6", "22.7"))
    assert "page.md:5: all is not what the files say" in said()
    figures.write(checkout)
    assert "| `x` | 22.7 |" in with_table.read_text() and drawn.read_text() != before
    drawn.write_text(before)
    assert "page.md:5: all is not what the files say" in said()
    with_table.write_text(with_table.read_text().replace("made: all", "made: none"))
    assert "page.md:5: docs/results/tables.toml has no table 'none'" in said()
    (with_table.parent / "tables.toml").write_text(
        SPEC.replace('"times.{}"\n', '[["z", "z"]]\n').replace("*", "q")
    )
    with_table.write_text(PLACE)
    figures.write(checkout)
    assert with_table.read_text() == PLACE and "all: no file has a figure of z" in said()


def test_a_paragraph_of_many_figures_is_to_be_a_table(checkout: Path):
    page = checkout / "docs" / "results" / "page.md"
    page.write_text(
        "Text of <!-- given -->1 dB,\n<!-- given -->2 dB and <!-- given -->3 dB.\n\n| <!-- given -->1 |\n"
    )
    assert [str(each) for each in figures.check(checkout)] == [
        "docs/results/page.md:1: a paragraph of 3 figures; make a table of them"
    ]


def test_networks_and_figures_have_the_names_of_today(checkout: Path):
    record = checkout / figures.RESULTS / "table.json"
    record.write_text(record.read_text().replace("psnr_db.a", "psnr_db.told-dcnn.told.chart.1m"))
    assert "psnr_db.depth-dcnn.known-depth.chart.1m" in figures.record(checkout, "table")["figures"]
