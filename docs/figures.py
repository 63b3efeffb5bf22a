"""Figures on the pages, and the JSON files that commands wrote: `python docs/figures.py` compares them.

A figure on a page stands behind a remark that nobody sees, which names a file of `docs/results/json` and a
figure in it: `<!-- table psnr_db.paper-dcnn.random -->30.46 dB`. It is rounded to as many decimals as are
there. `x100` behind the name multiplies it, for a percentage; a name with `*` stands for all figures that it
fits, from the least to the most: `<!-- predictions times_faster.desk.* -->6.0 to 23`; with `median:`,
`least:` or `most:` before it, for that one of them. On the pages of `COVERED` every figure is marked. What
is of no file says what it is: `<!-- quoted -->` what others measured, `<!-- given -->` what was asked for,
`<!-- of c774ccd -->` what code of that commit printed, which the page says too. The command that wrote a
figure stands on its page.

Tables and plots between `<!-- made: NAME -->` and `<!-- end -->` are made whole (`docs/tables.py`); a
paragraph of the results pages has at most two figures.

    python docs/figures.py                     # what does not agree, status 1 if anything
    python docs/figures.py --write             # the pages get the figures of the files
    python docs/figures.py --keep FILE NAME [FIGURE...]
                                               # what --json wrote becomes docs/results/json/NAME.json, all
                                               # figures or those that such names with * fit
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
from tables import ONE_OF, PLACE, RESULTS, block, is_drawn, one_of, plot, record

ROOT = Path(__file__).parents[1]
RUNS = "docs/results/runs.md"
"""The page that lists the files; all of it is made of them."""
RESULTS_PAGES = ("paper", "photos", "planning", "restoration", "stability")
COVERED = (
    "README.md",
    *(f"docs/results/{page}.md" for page in RESULTS_PAGES),
    *(f"docs/howto/{page}.md" for page in ("camera", "many", "photo")),
)
AWAITED: tuple[str, ...] = ()
"""Files that pages name and that are yet to be brought in: their figures are given, and fail no test."""
KEPT = ("command", "typed", "date", "commit", "versions", "machine", "seed", "figures")
FIGURES_IN_A_PARAGRAPH = 2
PLACES = {"--out", "--json", "--cache", "--quiet", "--jobs", "--cluster", "--shard", "--device"}
"""Options that change no figure."""
FLAGS = {"--quiet"}
NUMBER = r"-?\d+(?:\.\d+)?"
MARK = re.compile(rf"<!-- (?!of )(\S+) (\S+?)(?: x(\S+))? -->({NUMBER})(?: to ({NUMBER}))?")
OTHER = re.compile(rf"<!-- (?:quoted|given|of ([0-9a-f]{{7}})) -->{NUMBER}(?: to {NUMBER})?")
UNIT = r"\s?(?:dB|%|s|ms|min|h|MiB|GiB)(?!\w)|\s(?:times|seconds|minutes|hours)\b"
BARE = re.compile(rf"(?<![\w.-])(?:{NUMBER} to )?{NUMBER}(?:(?:{UNIT})|(?=\s*\|))")
TYPED = re.compile(r"`(?:edofsim|python -m) [^`]*`|\$ edofsim [^#\n]*")
CODE = re.compile(r"```.*?```|`[^`]*`|^[^\n]*\n(?=\| ?:?---)", re.DOTALL | re.MULTILINE)
"""Code, and the heads of tables."""


class Wrong(NamedTuple):
    """A sentence on a line of a page."""

    page: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def pages(root: Path) -> list[Path]:
    made = {"_build", "gallery"}
    found = (path for path in (root / "docs").rglob("*.md") if not made & set(path.parts))
    return [root / "README.md", *sorted(found)]


def check(root: Path = ROOT, passed_over: tuple[str, ...] = ()) -> list[Wrong]:
    """All that does not agree, on all pages; but for figures of files that are not there and passed over."""
    found = [wrong for page in pages(root) for wrong in _of_page(page, root, passed_over)]
    runs = root / RUNS
    if not runs.is_file() or runs.read_text(encoding="utf-8") != runs_page(root):
        found.append(Wrong(RUNS, 1, "is not what the files say; python docs/figures.py --write"))
    return found


def write(root: Path = ROOT) -> None:
    """The pages with the figures and tables of the files, as far as these have them."""
    for page in pages(root):
        text = page.read_text(encoding="utf-8")

        def figure(mark: re.Match[str]) -> str:
            found = _values(root, mark)
            if isinstance(found, str):
                return mark[0]
            head = mark[0][: mark.start(4) - mark.start()]
            return head + " to ".join(_said(value, mark[4 + k]) for k, value in enumerate(found))

        new = PLACE.sub(lambda place: _made(place, root), MARK.sub(figure, text))
        if new != text:
            page.write_text(new, encoding="utf-8")
    (root / RUNS).write_text(runs_page(root), encoding="utf-8")


def runs_page(root: Path = ROOT) -> str:
    """The page that lists the files: the command of each, its commit, day and machine."""
    rows = []
    for path in sorted((root / RESULTS).glob("*.json")):
        run = record(root, path.stem)
        machine = run["machine"]
        cores = machine.get("cores", 1)
        on = f"{machine.get('processor', 'unknown')}, {cores} core{'s' * (cores > 1)}"
        about = f"`{run['typed']}` | {run['commit']} | {run['date'][:10]} | {on}"
        rows.append(f"| [{path.stem}](json/{path.name}) | {about} |")
    head = (
        "# Runs that figures are of\n\n"
        "Each file is what a command wrote by `--json`: its figures, with the versions of what it ran on.\n"
        "This page is made of them by `python docs/figures.py --write`, as are the marked figures of README\n"
        "and results. Networks have their names of today: those who run a commit before 6caec39 type\n"
        "`told-dcnn` for `depth-dcnn`, and `any-bank` for `universal`.\n\n"
        "| file | command | commit | day | machine |\n|---|---|---|---|---|\n"
    )
    return head + "\n".join(rows) + "\n"


def keep(path: Path, name: str, root: Path = ROOT, wanted: Sequence[str] = ("*",)) -> Path:
    """What a command wrote, without what is long or of one machine's folders: all figures, or those that one
    of the names `wanted` fits. Raises ValueError for what was written by code that is in no commit of this
    branch."""
    record = json.loads(path.read_text(encoding="utf-8"))
    if record["commit"] == "unknown" or record["commit"].endswith("-dirty"):
        raise ValueError(f"{path}: made by code that is in no commit; commit it, then {record['typed']}")
    if not _is_before_head(record["commit"], root):
        raise ValueError(
            f"{path}: made by {record['commit']}, which is not in this branch; {record['typed']}"
        )
    small = {key: record[key] for key in KEPT}
    small["typed"] = " ".join(_words(_folded(record["typed"], root)))
    values = [
        item for item in record["figures"].items() if any(fnmatchcase(item[0], each) for each in wanted)
    ]
    small["figures"] = {each: v if isinstance(v, str) else float(f"{v:.6g}") for each, v in values}
    place = root / RESULTS / f"{name}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(json.dumps(small, indent=1) + "\n", encoding="utf-8")
    return place


def _folded(typed: str, root: Path) -> str:
    """A command whose `scenes/families/*.toml` the shell has expanded, as it was typed."""
    families = {path.name for path in root.glob("scenes/families/*.toml")}
    words = shlex.split(typed)
    named = [word for word in words if Path(word).name in families]
    if not families or {Path(word).name for word in named} != families:
        return typed
    first = words.index(named[0])
    rest = [word for word in words[first:] if word not in named]
    return shlex.join([*words[:first], "scenes/families/*.toml", *rest])


def _is_before_head(commit: str, root: Path) -> bool:
    """Whether the branch holds a commit; of a folder without a history nothing is known."""
    if not (root / ".git").exists():
        return True
    asked = ["git", "-C", str(root), "merge-base", "--is-ancestor", commit, "HEAD"]
    return subprocess.run(asked, capture_output=True, check=False).returncode == 0


def _made(place: re.Match[str], root: Path) -> str:
    """A table's place, filled in, with its plot drawn; as it is where the files do not have its figures."""
    try:
        plot(place[1], root)
        return block(place[1], root)
    except (ValueError, OSError):
        return place[0]  # `check` says why


def _of_tables(text: str, name: str, root: Path) -> Iterator[Wrong]:
    """What is wrong with tables and plots that are made, and paragraphs that should be tables."""
    for place in PLACE.finditer(text):
        line = text.count("\n", 0, place.start()) + 1
        try:
            if place[0] != block(place[1], root) or not is_drawn(place[1], root):
                yield Wrong(
                    name, line, f"{place[1]} is not what the files say; python docs/figures.py --write"
                )
        except (ValueError, OSError) as error:
            yield Wrong(name, line, str(error))
    if Path(name).parent == Path(RUNS).parent:
        for part in re.finditer(r"(?:^(?![|#]).+\n)+", _without(text, PLACE, CODE), re.MULTILINE):
            count = len(MARK.findall(part[0])) + len(OTHER.findall(part[0]))
            if count > FIGURES_IN_A_PARAGRAPH:
                line = text.count("\n", 0, part.start()) + 1
                yield Wrong(name, line, f"a paragraph of {count} figures; make a table of them")


def _without(text: str, *known: re.Pattern[str]) -> str:
    """A text with what is known blotted out, in as many letters and lines."""
    for each in known:
        text = each.sub(lambda match: re.sub(r"[^\n]", "~", match[0]), text)
    return text


def _of_page(page: Path, root: Path, passed_over: tuple[str, ...]) -> Iterator[Wrong]:
    text, name = page.read_text(encoding="utf-8"), str(page.relative_to(root))
    yield from _of_tables(text, name, root)
    commands = [_words(code.strip("`$ \n")) for code in TYPED.findall(text)]
    for mark in MARK.finditer(text):
        if mark[1] in passed_over and not (root / RESULTS / f"{mark[1]}.json").is_file():
            continue
        line, shown = text.count("\n", 0, mark.start()) + 1, mark[0].partition("-->")[2]
        found = _values(root, mark)
        if isinstance(found, str):
            yield Wrong(name, line, found)
            continue
        said = " to ".join(_said(value, mark[4 + k]) for k, value in enumerate(found))
        if said != shown:
            yield Wrong(name, line, f"{mark[1]}.json has {said} for {mark[2]}, the page {shown}")
        typed = record(root, mark[1])["typed"]
        if _words(typed) not in commands:
            yield Wrong(name, line, f"{shown} is of `{typed}`, which does not stand on the page")
    if name in COVERED:
        for other in OTHER.finditer(text):
            line = text.count("\n", 0, other.start()) + 1
            if other[1] and other[1] not in re.sub(r"<!--.*?-->", "", text):
                yield Wrong(name, line, f"{other[0]}: the page does not say that it is of commit {other[1]}")
        plain = _without(text, PLACE, MARK, OTHER, CODE)
        for bare in BARE.finditer(plain):
            line = plain.count("\n", 0, bare.start()) + 1
            yield Wrong(name, line, f"{bare[0]!r} names no file of {RESULTS} that it is from")


def _values(root: Path, mark: re.Match[str]) -> list[float] | str:
    """The value of a mark, or the least and the most; or why there is none."""
    name, key, factor = mark[1], mark[2], float(mark[3] or 1)
    try:
        figures = record(root, name)["figures"]
    except OSError:
        return f"there is no {RESULTS / name}.json"
    which, plain = one_of(key)
    found = [float(value) * factor for each, value in figures.items() if fnmatchcase(each, plain)]
    if not found:
        return f"{name}.json has no figure {key}"
    if which:
        found = [ONE_OF[which](found)]
    if (mark[5] is None) != (len(found) == 1):
        return f"{key} is {len(found)} figures of {name}.json; one stands alone, more as `least to most`"
    return found if len(found) == 1 else [min(found), max(found)]


def _said(value: float, shown: str) -> str:
    """A value with the decimals of what is shown."""
    return f"{value:.{len(shown.partition('.')[2])}f}"


def _words(command: str) -> list[str]:
    """A command's words without those that change no figure, and files and folders by their names."""
    words: list[str] = []
    given = iter(shlex.split(command))
    for word in given:
        if word in PLACES:
            if word not in FLAGS:
                next(given, None)
            continue
        words.append(Path(word).name if "/" in word and "*" not in word else word)
    return words


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare the figures on the pages with what commands wrote.")
    parser.add_argument("--write", action="store_true", help="put the figures of the files on the pages")
    parser.add_argument(
        "--keep", nargs="+", metavar="FILE NAME [FIGURE...]", help="take over what a command wrote"
    )
    given = parser.parse_args()
    if given.keep:
        file, name, *wanted = given.keep
        print(keep(Path(file), name, wanted=wanted or ("*",)))
        return 0
    if given.write:
        write()
    found = check()
    print("\n".join(map(str, found)) or "all figures agree")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
