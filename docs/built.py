"""What is asked of the site once it is built: links that lead somewhere, and the same bytes each time.

    python docs/built.py links HTML          # links inside of the site: files and anchors are there
    python docs/built.py same HTML AGAIN     # two buildings are the same, but for what TIMES names

Status 1 if anything is wrong. Neither needs a network: links to other sites are not followed.
"""

from __future__ import annotations

import argparse
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

TIMES = ("gallery/times.txt",)
"""Files that say how long something took, and differ."""


class Links(HTMLParser):
    """Anchors of a page, and what it leads to, with the line of each link."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.targets: list[tuple[int, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            elif name in ("href", "src") and not (tag == "link" and "canonical" in dict(attrs).values()):
                self.targets.append((self.getpos()[0], value))


def read(page: Path) -> Links:
    found = Links()
    found.feed(page.read_text(encoding="utf-8"))
    return found


def broken(html: Path) -> list[str]:
    """A sentence for each link inside of the site that leads nowhere."""
    pages = {page.resolve(): read(page) for page in sorted(html.rglob("*.html"))}
    wrong = []
    for page, links in pages.items():
        for line, target in links.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            anchor = unquote(parts.fragment)
            here = f"{page.relative_to(html.resolve())}:{line}: {target}"
            if not file.is_file():
                wrong.append(f"{here}: no such file")
            elif anchor and file in pages and anchor not in pages[file].anchors | {"top"}:
                wrong.append(f"{here}: no such place on that page")
    return wrong


def differences(html: Path, again: Path) -> list[str]:
    """Files of two buildings that are not the same in both."""

    def files(folder: Path) -> dict[str, Path]:
        return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}

    one, other = files(html), files(again)
    found = [f"{name}: is in one of them only" for name in sorted(one.keys() ^ other.keys())]
    for name in sorted(one.keys() & other.keys()):
        if name not in TIMES and one[name].read_bytes() != other[name].read_bytes():
            found.append(f"{name}: differs")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description="Check the site that was built.")
    parser.add_argument("what", choices=("links", "same"))
    parser.add_argument("html", type=Path, nargs="+")
    given = parser.parse_args()
    if given.what == "links":
        wrong, fine = broken(*given.html), "all links inside of the site lead somewhere"
    else:
        wrong = differences(*given.html)
        fine = f"both buildings are the same, byte by byte, but for {', '.join(TIMES)}"
    print("\n".join(wrong) or fine)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
