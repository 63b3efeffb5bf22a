"""The pages: whole, escaped, readable without a network, for any run that there can be."""

from __future__ import annotations

import html.parser
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data

from edofsim.errors import InputError
from edofsim.report import (
    Column,
    Compare,
    Gallery,
    ImageScore,
    Link,
    Page,
    PlanRow,
    Psfs,
    RunReport,
    Section,
    Table,
    index_page,
    page_html,
    picture,
    report_page,
    verdict,
    write_page,
    write_report,
)
from edofsim.restore.scores import DepthScore, Noise, Score, score_by_depth

VOID = {"meta", "img", "input", "source", "br", "link"}


class Reader(html.parser.HTMLParser):
    """Tags with their attributes, text, and whether all that was opened was closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, {k: v or "" for k, v in attributes}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, text):
        if not self.open or self.open[-1] not in ("style", "script"):
            self.text.append(text)

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))


def photographs(rows: int, columns: int) -> torch.Tensor:
    """A linear photograph of scikit-image, [3, y, x]."""
    encoded = torch.from_numpy(np.ascontiguousarray(data.astronaut()[:rows, :columns])).permute(2, 0, 1) / 255
    return encoded.float() ** 2.2


BARE = {"psfs": None, "height_m": None, "mask_width_m": None}  # quicker to write


def image_score(image: torch.Tensor, ideal: torch.Tensor, depth: torch.Tensor) -> ImageScore:
    return ImageScore(*score_by_depth(image, ideal, "none", depth))


def report(rows: int = 96, columns: int = 128, **changes) -> RunReport:
    """A run with everything on its page: a photograph on three depths, with noise for a photo."""
    random = torch.Generator().manual_seed(0)
    ideal = photographs(rows, columns)
    depth = torch.full((rows, columns), 1 / 4.46)
    depth[: rows // 3] = 0.0
    depth[rows // 2 :] = 2.0
    photo = ideal + 0.05 * torch.randn(ideal.shape, generator=random)
    restored = ideal + 0.02 * torch.randn(ideal.shape, generator=random)
    lens = ideal.roll(2, -1)
    psf = torch.zeros(3, 3, 33, 33)
    psf[..., 12:21, 12:21] = 1 / 81
    depths = (0.5, 1.5, math.inf)
    images = {"photo": photo, "restored": restored, "lens_alone": lens}
    made = RunReport(
        title="table",
        purpose="A scene for tests.",
        camera="paper-cubic",
        ideal=ideal,
        photo=photo,
        restored=restored,
        lens_alone=lens,
        inverse_depth=depth,
        scores={name: image_score(image, ideal, depth) for name, image in images.items()},
        psfs=Psfs(psf, depths, 6.0),
        height_m=torch.rand(8, 8, generator=random) * 1e-6,
        mask_width_m=5e-3,
        focus_m=1.5,
        plan=(
            PlanRow("hidden surfaces", True, 0.012, 3.1, "edges"),
            PlanRow("fabrication", False, None, None, ""),
        ),
        target="Below half of the noise.",
        seconds={"render": 12.0, "expose": 0.4},
        peak_memory_mib=812.3,
        recipes={"table.toml": 'name = "table"\n'},
        command="edofsim run table.toml",
        facts={"Seed": "0"},
        figures={"psnr_db.photo": 26.0},
        versions={"edofsim": "0"},
        machine={"processor": "some", "memory_gib": 3.9},
    )
    return replace(made, **changes)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_report(tmp_path_factory.mktemp("page") / "out" / "report.html", report(384, 512))


@pytest.fixture(scope="module")
def page(written) -> Reader:
    return Reader(written.read_text(encoding="utf-8"))


def test_every_tag_is_closed(page):
    assert page.open == []


def test_nothing_is_loaded_from_elsewhere(page):
    for tag, attributes in page.tags:
        for name in ("src", "srcset", "href", "poster", "action"):
            if name in attributes:
                assert attributes[name].startswith(("data:", "#")), (tag, attributes[name][:60])
    assert not {"link", "iframe", "object", "embed", "base"} & {tag for tag, _ in page.tags}
    assert any("default-src 'none'" in m.get("content", "") for m in page.all("meta"))


def test_styles_and_script_name_no_address(written):
    text = re.sub(r"data:[a-z+/]+;base64,[A-Za-z0-9+/=]+", "", written.read_text(encoding="utf-8"))
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", text)


def test_every_picture_has_a_text_and_every_figure_a_caption(page):
    images = page.all("img")
    assert len(images) >= 4 + 4 + 4
    assert all(len(image.get("alt", "")) > 15 for image in images)
    kinds = [tag for tag, _ in page.tags]
    assert kinds.count("figcaption") == kinds.count("figure")


def test_page_is_small_enough_to_send(written):
    assert written.stat().st_size < 8e6


def test_page_says_what_the_run_found(page):
    assert all(text in page.words for text in ("table", "paper-cubic", "512 × 384 px", "Seed 0"))
    assert "dB above the photo" in page.words and "Restored" in page.words and "Lens alone" in page.words
    assert "up to 0.60 m" in page.words and "beyond 3.0 m" in page.words
    assert all(text in page.words for text in ("hidden surfaces", "0.012", "Below half of the noise."))
    assert all(text in page.words for text in ("812 MiB", "3.9 GiB", "edofsim run table.toml"))


def test_menu_leads_to_sections(page):
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    targets = [a["href"][1:] for a in page.all("a")]
    assert len(targets) > 5 and set(targets) <= ids


def test_slider_finds_its_gallery(page):
    (slider,) = [a for a in page.all("figure") if a.get("class") == "compare"]
    labels = [a["data-label"] for a in page.all("img") if "data-label" in a]
    assert slider["data-gallery"] in {a.get("id") for a in page.all("figure")}
    assert slider["data-left"] in labels and slider["data-right"] in labels
    (divider,) = page.all("input")
    assert divider["type"] == "range"  # moves with the arrow keys


def test_same_report_same_bytes(tmp_path):
    small = report(24, 32, **BARE)
    assert (
        write_report(tmp_path / "a.html", small).read_bytes()
        == write_report(tmp_path / "b.html", small).read_bytes()
    )


def test_text_from_recipes_stays_text(tmp_path):
    evil = '</code></pre></script><script>alert("x")</script><img src=x onerror=alert(1)>&amp;'
    mapping = {name: {evil: evil} for name in ("recipes", "versions", "facts", "machine", "figures")}
    words = {name: evil for name in ("title", "purpose", "camera", "command", "restored_label", "target")}
    plan = (PlanRow(evil, True, why=evil),)
    made = report(24, 32, **words, **mapping, **BARE, notes=(evil,), plan=plan, seconds={evil: 1.0})
    read = Reader(write_report(tmp_path / "report.html", made).read_text(encoding="utf-8"))
    assert read.open == []
    assert len(read.all("script")) == 1
    assert not any("onerror" in attributes for _, attributes in read.tags)
    assert read.words.count("alert(1)") >= 10


def test_plan_without_predictions_has_no_empty_columns():
    reasons = (PlanRow("occlusion", True, why="edges"), PlanRow("noise", False, why="none asked for"))
    read = Reader(page_html(report_page(report(24, 32, **BARE, plan=reasons))))
    heads = {a["data-column"] for _, a in read.tags if "data-column" in a}
    assert {"Effect", "Simulated", "Why"} <= heads and not {"Error if left out", "Time"} & heads


def test_no_value_is_a_dash_and_equal_images_are_infinite(tmp_path):
    whole = Score(math.inf, math.nan, 1)
    ranges = (
        DepthScore(0.0, 0.6, Score(math.nan, math.nan, 0)),
        DepthScore(0.6, 1.0, Score(math.inf, 1.0, 5)),
    )
    made = report(
        24,
        32,
        **BARE,
        scores={"photo": ImageScore(whole, ranges)},
        figures={"a": math.nan, "b": "inf"},
        plan=(PlanRow("a", False, math.nan, math.inf), PlanRow("b", True, 0.0, 0.0)),
    )
    read = Reader(write_report(tmp_path / "report.html", made).read_text(encoding="utf-8"))
    assert "∞" in read.words and "–" in read.words
    assert not re.search(r"\bnan\b", read.words, re.IGNORECASE)


def test_pixels_without_value_are_told(tmp_path):
    restored = report(24, 32).restored.clone()
    restored[0, 3, 4:9] = math.nan
    read = Reader(
        write_report(tmp_path / "report.html", report(24, 32, restored=restored, **BARE)).read_text()
    )
    assert "Restored: 5 pixels hold values that are not numbers" in read.words


@pytest.mark.parametrize("depth", [1.0, 0.0])
@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (40, 30)])
def test_smallest_report_of_any_size(tmp_path, depth, shape):
    """One depth, infinity among them, and nothing known but two images."""
    image = torch.rand(3, *shape, generator=torch.Generator().manual_seed(2))
    made = RunReport(
        "t",
        "",
        "c",
        image,
        image,
        torch.full(shape, depth),
        scores={"photo": image_score(image, image, torch.full(shape, depth))},
    )
    read = Reader(write_report(tmp_path / "report.html", made).read_text(encoding="utf-8"))
    assert read.open == []
    assert "Scene: " in read.words and "Farthest" not in read.words
    assert verdict(made) == ""


def test_enlarged_parts_are_scored_without_the_noise_of_the_rendering():
    """A grey image, 20 dB off, whose truth has noise of 20 dB: without it, 20 dB in every square, not 17."""
    grey = torch.full((3, 90, 90), 0.5)
    noise, half = (0.1 * torch.randn(3, 90, 90, generator=torch.Generator().manual_seed(n)) for n in (1, 2))
    made = report(90, 90, ideal=grey + noise, photo=grey + 0.1, restored=None, lens_alone=None)
    found = []
    for noises in ({}, {"photo": Noise(half, torch.zeros_like(half))}):
        galleries = [
            block
            for section in report_page(replace(made, noises=noises)).sections
            for block in section.blocks
            if isinstance(block, Gallery) and block.pixels
        ]
        notes = [each.note for gallery in galleries for each in gallery.pictures if each.note]
        found.append([float(note.split("\u00a0")[0]) for note in notes])
    assert found[0] and found[0] == pytest.approx([17.0] * len(found[0]), abs=0.3)
    assert found[1] == pytest.approx([20.0] * len(found[1]), abs=0.5)


def test_verdict_tells_losses_too():
    scored = {
        n: ImageScore(Score(p, 0.9, 1))
        for n, p in (("photo", 25.0), ("restored", 24.0), ("lens_alone", 20.5))
    }
    sentence = verdict(report(24, 32, scores=scored)).replace("\u00a0", " ")
    assert sentence == (
        "Restored is 1.0 dB below the photo and 3.5 dB above the lens alone. "
        "The photo is better than the restored image."
    )
    scored |= {"restored": ImageScore(Score(26.5, 0.9, 1)), "wiener": ImageScore(Score(26.52, 0.9, 1))}
    sentence = verdict(report(24, 32, scores=scored)).replace("\u00a0", " ")
    assert sentence == (
        "Restored is 1.5 dB above the photo, 6.0 dB above the lens alone and as good as Wiener deconvolution."
    )


def test_images_of_different_shapes_are_refused():
    with pytest.raises(ValueError, match="photo has the shape"):
        report(24, 32, photo=torch.zeros(3, 24, 31))
    with pytest.raises(ValueError, match="depth, 3, y, x"):
        Psfs(torch.zeros(2, 3, 5, 5), (1.0,), 6.0)


def test_a_place_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_page(tmp_path / "file" / "report.html", Page("a"))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_tables_mark_the_best_and_keep_units():
    table = Table(
        columns=(
            Column("system"),
            Column("PSNR", "dB", best="largest"),
            Column("time", "s", best="smallest"),
        ),
        rows=(("a", 30.0, 2.0), ("b", math.nan, 1.0), ("c", 31.24, None)),
    )
    read = Reader(page_html(Page("t", sections=(Section("s", (table,)),))))
    marked = [a.get("class") for tag, a in read.tags if tag in ("td", "th") and "data-column" in a]
    assert marked == [
        "words",
        "number",
        "number",
        "words",
        "number",
        "number best",
        "words",
        "number best",
        "number",
    ]
    assert "(dB)" in read.words and "31.2" in read.words and "–" in read.words
    with pytest.raises(ValueError, match="2 cells in a table of 3"):
        replace(table, rows=(("a", 1.0),))


def test_index_page_links_to_its_pages():
    thumbnail = picture(torch.rand(3, 4, 4), "a", "What the page shows, small.")
    links = (Link("noise/page.html", "Noise", "How much", thumbnail), Link("javascript:alert(1)", "Bad"))
    read = Reader(page_html(index_page("Experiments", "All of them.", links)))
    hrefs = [a["href"] for a in read.all("a")]
    assert "noise/page.html" in hrefs
    assert not any(h.startswith("javascript:") for h in hrefs)


def test_pages_of_experiments_share_the_parts():
    pictures = tuple(
        picture(torch.rand(3, 8, 8), f"sigma {s}", f"Photo with noise {s}.") for s in (0.005, 0.02)
    )
    made = Page(
        "Noise",
        "How much of it the restoration bears.",
        sections=(
            Section(
                "Pictures",
                (Compare("all", "sigma 0.005", "sigma 0.02"), Gallery(pictures, "Photos.", name="all")),
            ),
        ),
        back=Link("index.html", "All experiments"),
    )
    read = Reader(page_html(made))
    assert read.open == [] and "All experiments" in read.words
