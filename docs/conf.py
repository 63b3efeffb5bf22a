"""The site: `make docs`. Needs no network, neither to build nor to read."""

from __future__ import annotations

import inspect
import json
import os
import re
import sys
import warnings
from pathlib import Path

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import edofsim

sys.path.insert(0, str(Path(__file__).parent))
import recipe_keys

recipe_keys.write()
os.environ.setdefault("MPLBACKEND", "agg")
os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "error")
warnings.filterwarnings("ignore", message=".*non-interactive.*")

project = "edofsim"
author = "the edofsim authors"
copyright = "the edofsim authors, Apache-2.0"
release = version = edofsim.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "sg_execution_times.rst", "tutorials/README.rst", "tutorials/*.py"]
suppress_warnings = ["config.cache"]
nitpicky = False

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True

sphinx_gallery_conf = {
    "examples_dirs": "tutorials",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,  # their page asks the network for its table
    "capture_repr": ("_repr_html_",),
    "min_reported_time": float("inf"),  # in times.txt instead, so that pages are the same each time
    "show_signature": False,
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "plot_gallery": os.environ.get("DOCS_RUN", "1") == "1",
    "default_thumb_file": str(Path(__file__).parents[1] / "scenes" / "pictures" / "desk.jpg"),
    "image_scrapers": ("matplotlib",),
    "reset_modules": ("matplotlib",),
    "matplotlib_animations": False,
}

html_theme = "furo"
html_title = "edofsim"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
copybutton_prompt_text = "$ "


RAN = sphinx_gallery_conf["plot_gallery"]
GALLERY = Path(__file__).parent / "gallery"
ZIP = re.compile(r"\n    \.\. container:: sphx-glr-download sphx-glr-download-zip\n\n      :download:.*\n")
"""A third way to download a tutorial, whose bytes hold the time of day."""

if RAN:  # seconds that plans predict are those of the rates that ship, on any machine
    from edofsim.plan import rates

    rates.paces = lambda repeats=4: rates.SHIPPED[rates.PACE]
    rates._corrections = dict


def _two_downloads(app: Sphinx) -> None:
    """Tutorials as script and as notebook."""
    for page in sorted(GALLERY.glob("[0-9]*.rst")):
        text = page.read_text(encoding="utf-8")
        if ZIP.search(text):
            page.write_text(ZIP.sub("", text), encoding="utf-8")


def _times(app: Sphinx, failed: Exception | None) -> None:
    """How long each tutorial took, in a file of its own: all that differs from one building to the next."""
    took = []
    for path in sorted(GALLERY.glob("[0-9]*.cost.json")):
        seconds = json.loads(path.read_text(encoding="utf-8"))["time"]
        took.append(f"{path.name.removesuffix('.cost.json'):24}{seconds:6.1f} s")
    place = Path(app.outdir) / "gallery" / "times.txt"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text("\n".join(took) + "\n" if RAN else "The tutorials were not run.\n", encoding="utf-8")


def _math(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(latex2mathml.tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def _display(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math">{latex2mathml.tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def _plain(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: names in single backquotes are code, and what stands behind the name of a
    parameter and a colon is about that parameter."""
    try:
        names = "|".join(sorted(inspect.signature(obj).parameters, key=len, reverse=True))
    except (TypeError, ValueError):
        names = ""
    given = re.compile(rf"(?:^|(?<=[.;,] )|(?<=\n))((?:{names})(?:, (?:{names}))*): ")
    found: list[str] = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
        text = re.sub(r"\n\s*", "\n", paragraph.strip()).replace("``", "`").replace("`", "``")
        text, _, raises = text.partition("Raises ")
        if names and given.match(text):
            parts = [" ".join(part.split()) for part in given.split(text)]
            pairs = zip(parts[1::2], parts[2::2], strict=True)
            found += [f":param {name}: {said}" for each, said in pairs for name in each.split(", ")] + [""]
        elif text:
            found += [*text.replace("with_,", "``with_``,").split("\n"), ""]
        if raises:
            found += [*f"Raises {raises}".split("\n"), ""]
    lines[:] = found


def setup(app: Sphinx) -> None:
    """Equations as MathML, which browsers draw by themselves; pages of tutorials are the same each time."""
    app.add_html_math_renderer("mathml", (_math, None), (_display, None))
    app.connect("autodoc-process-docstring", _plain)
    app.connect("builder-inited", _two_downloads, priority=900)  # after the gallery has written its pages
    app.connect("build-finished", _times)
