"""Pages of experiments: their index, and all of them run one after the other."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from edofsim.commands import paper_all
from edofsim.commands.base import Done

from edofsim.errors import EdofsimError, InputError
from edofsim.experiments.planes import save_png
from edofsim.report import Gallery, Key, Keys, Page, Section, picture, write_page
from edofsim.report.experiments_index import write_index


def page(folder: Path, name: str, value: str) -> Path:
    shown = picture(torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(0)), "a", "b")
    keys = Keys((Key("loss <of> it", value, "dB", "a remark"),))
    content = Page(f"About {name}", "What it is for.", (Section("S", (Gallery((shown,)),)),), (keys,))
    return write_page(folder / name / f"{name}.html", content)


def test_the_index_has_a_card_for_each_page(tmp_path: Path) -> None:
    page(tmp_path, "noise", "1.25")
    page(tmp_path, "scene3d", "30.10")
    (tmp_path / "other").mkdir()
    (tmp_path / "other/foreign.html").write_text("<html><title>not ours</title></html>")
    write_page(tmp_path / "mtf/mtf.html", Page("No picture in it", "But a plot beside it."))
    save_png(tmp_path / "mtf/mtf.png", torch.rand(3, 40, 60))
    text = write_index(tmp_path).read_text()
    assert "About noise" in text and "About scene3d" in text and "What it is for." in text
    assert "noise/noise.html" in text and "1.25 dB" in text and "30.10 dB" in text
    assert "not ours" not in text and "Figures: loss &lt;of&gt; it 1.25 dB." in text
    assert text.count("data:image/png") == 3
    # the index itself is no page of its own
    assert write_index(tmp_path).read_text() == text


def test_an_index_over_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no pages of experiments"):
        write_index(tmp_path)


def setting(tmp_path: Path) -> paper_all.Setting:
    return paper_all.Setting(tmp_path, None, None, None, False, 0, None)


def test_one_that_fails_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> Done:
        raise InputError("the data are not there")

    def works(s: paper_all.Setting, out: Path, progress: object) -> Done:
        return Done(outputs={"x.html": page(out.parent, out.name, "3")})

    steps = (paper_all.Step("first", fails), paper_all.Step("second", works))
    monkeypatch.setattr(paper_all, "STEPS", steps)
    with pytest.raises(EdofsimError, match="first: failed"):
        paper_all.evaluate_paper(setting(tmp_path), (), lambda *_: None)
    assert "About second" in (tmp_path / "index.html").read_text()
    done = paper_all.evaluate_paper(setting(tmp_path), ("second",), lambda *_: None)
    assert done.outputs["index"] == tmp_path / "index.html"


def test_experiments_are_chosen_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no experiment 'tabel'; there are bandwidth, mtf, table"):
        paper_all.evaluate_paper(setting(tmp_path), ("tabel",), lambda *_: None)
    done = paper_all.evaluate_paper(setting(tmp_path), ("bandwidth",), lambda *_: None)
    assert (tmp_path / "bandwidth/bandwidth.html").is_file() and done.outputs["bandwidth"].is_file()
    assert "Bandwidth of defocus" in done.outputs["index"].read_text()
