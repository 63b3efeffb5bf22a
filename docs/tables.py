"""Tables and plots of results, made of kept figures: `python docs/figures.py --write` puts them on the pages.

A page has a place for a table, which is filled in between two remarks: `<!-- made: NAME -->` and
`<!-- end -->`. `docs/results/tables.toml` says what NAME is made of:

    [NAME]
    files = ["table-kodak", "table-kodak-others"]   # of docs/results/json; a cell is of the first that has it
    head = "network"                                # above the names of the rows
    rows = "psnr_db.{}.random"                      # all that fit; or [[label, name, file or ""], ...]
    columns = [["at 1 m / dB", "psnr_db.{}.1m"]]    # {} is the row's name; a third word is another format
    format = ".2f"                                  # of Python
    plot = "PSNR / dB"                              # also dots, a row each: `docs/_static/results/NAME.svg`
    plotted = ["at 1 m / dB"]                       # of these columns; without it, of all

A column `FILE psnr_db.{}` names its file; `median:`, `least:` or `most:` before a figure with `*` takes that
one of all that fit. Below a table stand the commands that printed it.
"""

from __future__ import annotations

import hashlib
import json
import re
import statistics
import sys
import tomllib
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))  # also where the package is not installed
from edofsim.core.shipped import RENAMED

SPEC = Path("docs/results/tables.toml")
RESULTS = Path("docs/results/json")
PLOTS = Path("docs/_static/results")
PLACE = re.compile(r"<!-- made: (\S+) -->\n.*?<!-- end -->", re.DOTALL)
RENAMED_FIGURES = {".told.": ".known-depth.", '"foretold.': '"predicted.'}
"""Parts of names of figures, as earlier versions wrote them."""
ONE_OF = {"median": statistics.median, "least": min, "most": max}


class Table(NamedTuple):
    """A table: heads, rows of a label and values, the same as words, and the files that they are of."""

    heads: list[str]
    labels: list[str]
    values: list[list[float | None]]
    cells: list[list[str]]
    files: list[str]


def table(name: str, root: Path) -> Table:
    """Raises ValueError for a table that is not in the list, or whose files do not have what it asks for."""
    if name not in (specs := _specs(root)):
        raise ValueError(f"{SPEC} has no table {name!r}")
    spec = specs[name]
    default, usual = spec.get("files", []), spec.get("format", ".2f")
    rows = spec["rows"] if isinstance(spec["rows"], list) else _fitting(spec["rows"], default, root)
    used: list[str] = []
    values: list[list[float | None]] = []
    cells: list[list[str]] = []
    for _, who, *more in rows:
        files = [more[0]] if more and more[0] else default
        values.append([])
        cells.append([])
        for _, key, *form in spec["columns"]:
            file, _, plain = key.rpartition(" ")
            found = _found(plain.replace("{}", who), [file] if file else files, root)
            if found and found[0] not in used:
                used.append(found[0])
            how = form[0] if form else more[1] if len(more) > 1 else usual
            values[-1].append(found[1][0] if found and len(found[1]) == 1 else None)
            cells[-1].append(" to ".join(f"{value:{how}}" for value in found[1]) if found else "")
        if not any(cells[-1]):
            raise ValueError(f"{name}: no file has a figure of {who}")
    if not rows:
        raise ValueError(f"{name}: no figure fits {spec['rows']}")
    heads = [spec.get("head", ""), *(column[0] for column in spec["columns"])]
    return Table(heads, [row[0] for row in rows], values, cells, used)


def block(name: str, root: Path) -> str:
    """What stands between the two remarks of a page, them included."""
    made = table(name, root)
    lines = ["| " + " | ".join(made.heads) + " |", "|---|" + "---:|" * (len(made.heads) - 1)]
    lines += [
        f"| {label} | " + " | ".join(row) + " |" for label, row in zip(made.labels, made.cells, strict=True)
    ]
    if "plot" in _specs(root)[name]:
        lines += ["", f"![The table as dots](../_static/results/{name}.svg)"]
    runs = [record(root, file) for file in made.files]
    said = dict.fromkeys(f"`{run['typed']}` ({run['date'][:10]}, {run['commit']})" for run in runs)
    foot = "Printed by " + ",\n".join(said) + "."
    return "\n".join([f"<!-- made: {name} -->", *lines, "", foot, "<!-- end -->"])


def plot(name: str, root: Path) -> None:
    """The plot of a table, drawn anew where its figures are not those that it was drawn of."""
    spec = _specs(root)[name]
    if "plot" not in spec or is_drawn(name, root):
        return
    from edofsim.report.plot import MARKERS, SERIES, WIDE_IN, Figure, Plot, new_figure

    made = table(name, root)
    shown = [made.heads.index(head) - 1 for head in spec.get("plotted", made.heads[1:])]
    rows = [
        row for row in zip(made.labels, made.values, strict=True) if any(row[1][k] is not None for k in shown)
    ]

    def paint() -> Figure:
        figure = new_figure(WIDE_IN, 1 + 0.26 * len(rows))
        axes = figure.add_subplot()
        for at, k in enumerate(shown):
            points = [(row[1][k], -y) for y, row in enumerate(rows) if row[1][k] is not None]
            axes.plot(
                [x for x, _ in points], [y for _, y in points], linestyle="none",
                color=SERIES[at], marker=MARKERS[at], label=made.heads[k + 1].replace("`", ""),
            )  # fmt: skip
        axes.set_yticks([-y for y in range(len(rows))], [label.replace("`", "") for label, _ in rows])
        axes.set_xlabel(spec["plot"])
        figure.legend(loc="outside upper center", ncols=len(shown))
        return figure

    place = root / PLOTS / f"{name}.svg"
    place.parent.mkdir(parents=True, exist_ok=True)
    svg = Plot(paint, spec["plot"], "").svg()
    place.write_text(f"{svg.rstrip()}\n<!-- {_digest(name, root)} -->\n", encoding="utf-8")


def is_drawn(name: str, root: Path) -> bool:
    """Whether a table has no plot, or one of the figures of today."""
    place = root / PLOTS / f"{name}.svg"
    if "plot" not in _specs(root)[name]:
        return True
    said = f"<!-- {_digest(name, root)} -->\n"
    return place.is_file() and place.read_text(encoding="utf-8").endswith(said)


def _digest(name: str, root: Path) -> str:
    """Of all that a plot is drawn of."""
    drawn = (table(name, root), _specs(root)[name])
    return hashlib.sha256(repr(drawn).encode()).hexdigest()[:16]


def _specs(root: Path) -> dict:
    return tomllib.loads((root / SPEC).read_text(encoding="utf-8"))


def _fitting(pattern: str, files: list[str], root: Path) -> list[list[str]]:
    """Names, without a dot, in the place of {}: [label, name], in the order of the files."""
    known = re.compile(re.escape(pattern).replace(r"\{\}", r"([^.]+)"))
    names = [m[1] for file in files for key in record(root, file)["figures"] if (m := known.fullmatch(key))]
    return [[f"`{name}`", name] for name in dict.fromkeys(names)]


def _found(key: str, files: list[str], root: Path) -> tuple[str, list[float]] | None:
    """The first file that has a figure, and its value, or the least and the most of those that fit."""
    which, plain = one_of(key)
    for file in files:
        figures = record(root, file)["figures"]
        fit = [plain] if plain in figures else [each for each in figures if fnmatchcase(each, plain)]
        values = [float(figures[each]) for each in fit]
        if values and which:
            return file, [float(ONE_OF[which](values))]
        if values:
            return file, values if len(values) == 1 else [min(values), max(values)]
    return None


def one_of(key: str) -> tuple[str, str]:
    """(`median`, `least` or `most`, or nothing; the rest) of the name of a figure."""
    which, _, plain = key.partition(":")
    return (which, plain) if which in ONE_OF else ("", key)


def record(root: Path, name: str) -> dict:
    """What a command wrote, with the names that networks and figures have today."""
    path = root / RESULTS / f"{name}.json"
    return _read(path, path.stat().st_mtime_ns)


@cache
def _read(path: Path, changed: int) -> dict:
    text = path.read_text(encoding="utf-8")
    for old, new in (RENAMED | RENAMED_FIGURES).items():
        text = text.replace(old, new)
    return json.loads(text)
