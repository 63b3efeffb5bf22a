"""The pages: whole, escaped, readable without a network, for any run that there can be."""

from __future__ import annotations

import html.parser
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture import Fidelity
from edofsim.errors import InputError
from edofsim.plan import Decision, Plan
from edofsim.report import (
    Column,
    Compare,
    Gallery,
    ImageScore,
    Link,
    Page,
    Section,
    Shown,
    Table,
    image_page,
    index_page,
    page_html,
    picture,
    run_page,
    verdict,
    write_page,
)
from edofsim.restore.places import Method
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


def image_score(image: torch.Tensor, ideal: torch.Tensor, depth: torch.Tensor) -> ImageScore:
    return ImageScore(*score_by_depth(image, ideal, "none", depth))


@pytest.fixture(scope="module")
def written(tmp_path_factory, made_run) -> Path:
    path = tmp_path_factory.mktemp("page") / "out" / "report.html"
    return write_page(path, run_page(made_run(384, 512), {}))


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
    assert all(text in page.words for text in ("table", "paper-cubic", "512 × 384 px", "sensor 3"))
    assert "dB above the photo" in page.words and "Restored" in page.words and "Lens alone" in page.words
    assert "up to 0.60 m" in page.words and "beyond 3.0 m" in page.words
    assert all(text in page.words for text in ("hidden surfaces", "0.012", "Below half of the noise."))
    assert all(text in page.words for text in ("812 MiB", "GiB", "edofsim run table.toml", "--seed 3"))


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


def test_same_run_same_bytes(tmp_path, made_run):
    pages = [write_page(tmp_path / name, run_page(made_run(24, 32), {})) for name in ("a.html", "b.html")]
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_text_from_recipes_stays_text(made_run):
    evil = '</code></pre></script><script>alert("x")</script><img src=x onerror=alert(1)>&amp;'
    made = made_run(24, 32, restored_by=Method(evil), seconds={evil: 1.0})
    recipe = made.scene.recipe.model_copy(update={"purpose": evil})
    plan = Plan((Decision(evil, True, evil, evil),), Fidelity(), target=evil)
    view = replace(made.view, metadata={"holes filled": evil})
    scene = replace(made.scene, recipe=recipe, text=evil)
    evils = replace(made, scene=scene, plan=plan, plan_lens_alone=plan, view=view)
    read = Reader(page_html(run_page(evils, {})))
    assert read.open == []
    assert len(read.all("script")) == 1
    assert not any("onerror" in attributes for _, attributes in read.tags)
    assert read.words.count("alert(1)") >= 10


@pytest.mark.usefixtures("plots_left_out")
def test_plan_without_predictions_has_no_empty_columns(made_run):
    decisions = (Decision("occlusion", True, "", "edges"), Decision("noise", False, "", "none asked for"))
    plan = Plan(decisions, Fidelity())
    read = Reader(page_html(run_page(made_run(24, 32, plan=plan, plan_lens_alone=plan), {})))
    heads = {a["data-column"] for _, a in read.tags if "data-column" in a}
    assert {"Effect", "Simulated", "Why"} <= heads and not {"Error if left out", "Time"} & heads


@pytest.mark.usefixtures("plots_left_out")
def test_no_value_is_a_dash_and_equal_images_are_infinite(made_run):
    whole = Score(math.inf, math.nan, 1)
    ranges = (
        DepthScore(0.0, 0.6, Score(math.nan, math.nan, 0)),
        DepthScore(0.6, 1.0, Score(math.inf, 1.0, 5)),
    )
    made = made_run(24, 32, scores={"photo": whole}, by_depth={"photo": ranges})
    nan, zero = (math.nan,) * 3, (0.0,) * 3
    decisions = (
        Decision("a", False, "", "", error=nan, seconds=math.inf),
        Decision("b", True, "", "", error=zero),
    )
    plan = Plan(decisions, Fidelity())
    read = Reader(page_html(run_page(replace(made, plan=plan, plan_lens_alone=plan), {})))
    assert "∞" in read.words and "–" in read.words
    assert not re.search(r"\bnan\b", read.words, re.IGNORECASE)


@pytest.mark.usefixtures("plots_left_out")
def test_pixels_without_value_are_told(made_run):
    made = made_run(24, 32)
    restored = made.restored.clone()
    restored[0, 3, 4:9] = math.nan
    read = Reader(page_html(run_page(replace(made, restored=restored), {})))
    assert "Restored (a network): 5 pixels hold values that are not numbers" in read.words


@pytest.mark.parametrize("depth", [1.0, 0.0])
@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (40, 30)])
def test_smallest_page_of_any_size(depth, shape):
    """One depth, infinity among them, and nothing known but two images."""
    image, depths = (
        torch.rand(3, *shape, generator=torch.Generator().manual_seed(2)),
        torch.full(shape, depth),
    )
    scores = {"photo": image_score(image, image, depths)}
    shown = Shown("t", "c", {"ideal": image, "photo": image}, depths, scores=scores)
    read = Reader(page_html(image_page(shown, "", {})))
    assert read.open == []
    assert "Scene: " in read.words and "Farthest" not in read.words
    assert verdict(scores) == ""


def test_enlarged_parts_are_scored_without_the_noise_of_the_rendering():
    """A grey image, 20 dB off, whose truth has noise of 20 dB: without it, 20 dB in every square, not 17."""
    grey, depth = torch.full((3, 90, 90), 0.5), torch.ones(90, 90)
    noise, half = (0.1 * torch.randn(3, 90, 90, generator=torch.Generator().manual_seed(n)) for n in (1, 2))
    images = {"ideal": grey + noise, "photo": grey + 0.1}
    found = []
    for noises in ({}, {"photo": Noise(half, torch.zeros_like(half))}):
        page = image_page(Shown("t", "c", images, depth, noises=noises), "", {})
        galleries = [
            block
            for section in page.sections
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
    assert verdict(scored).replace("\u00a0", " ") == (
        "Restored is 1.0 dB below the photo and 3.5 dB above the lens alone. "
        "The photo is better than the restored image."
    )
    scored |= {"restored": ImageScore(Score(26.5, 0.9, 1)), "wiener": ImageScore(Score(26.52, 0.9, 1))}
    assert verdict(scored).replace("\u00a0", " ") == (
        "Restored is 1.5 dB above the photo, 6.0 dB above the lens alone and as good as Wiener deconvolution."
    )


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
