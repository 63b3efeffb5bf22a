"""Pages of experiments: their index, and all of them run one after the other."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import pytest
import torch

from edofsim.cli import evaluate
from edofsim.core.images import write_png
from edofsim.core.progress import silent
from edofsim.errors import EdofsimError, InputError
from edofsim.experiments import EXPERIMENTS
from edofsim.experiments.experiment import Experiment, Findings, Paper
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
    write_png(tmp_path / "mtf/mtf.png", torch.rand(3, 40, 60))
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


def test_one_that_fails_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> Findings:
        raise InputError("the data are not there")

    def works(folder: Path, progress: object) -> Findings:
        return Findings({"loss_db": 3.0}, Page("About second", "What it is for."))

    both = {name: Experiment(run, lambda paper: {}) for name, run in (("first", fails), ("second", works))}
    monkeypatch.setattr(evaluate, "EXPERIMENTS", {**both, "third": works})  # which is not the paper's
    with pytest.raises(EdofsimError, match="first: failed"):
        evaluate.paper(out=tmp_path, quiet=True)
    assert "About second" in (tmp_path / "index.html").read_text()
    assert json.loads((tmp_path / "second/second.json").read_text())["figures"] == {"loss_db": 3.0}
    done = evaluate.paper(only=["second"], out=tmp_path, quiet=True)
    assert done.outputs["index"] == tmp_path / "index.html"
    assert not (tmp_path / "third").exists()


def test_experiments_are_chosen_by_name(tmp_path: Path) -> None:
    known = "bandwidth, mtf, table, noise, fabrication, broadband, scene3d, bench-scene"
    with pytest.raises(InputError, match=f"no experiment 'tabel'; there are {known}"):
        evaluate.paper(only=["tabel"], out=tmp_path, quiet=True)
    done = evaluate.paper(only=["bandwidth"], out=tmp_path, quiet=True)
    assert (tmp_path / "bandwidth/bandwidth.html").is_file() and done.outputs["bandwidth"].is_file()
    assert "Bandwidth of defocus" in done.outputs["index"].read_text()


def test_each_experiment_of_the_paper_takes_the_options_that_it_is_given_there() -> None:
    """A small run and a full one; what a misspelt option would be found by."""
    for paper in (Paper(), Paper(Path("photos"), Path("chart"), Path("cubes"), True, 3, Path("cache"))):
        for experiment in EXPERIMENTS.values():
            if (options := Experiment.of(experiment).in_paper) is not None:
                inspect.signature(experiment.run).bind(Path(), silent, **options(paper))
