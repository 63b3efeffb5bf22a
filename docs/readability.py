"""How easily pages read: `python docs/readability.py [COMMIT] [PAGE...]`.

Prints the Flesch reading ease (R. Flesch, "A new readability yardstick", Journal of Applied Psychology 32,
1948) and the words per sentence of each page, at a commit and now. The scale is from 0 (hard) to 100 (easy);
60 and more is plain English. Code, tables, headings and marks of figures do not count. Syllables are groups
of vowels, without a silent e. The package textstat looks syllables up, and gives 0 to 16 points more.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
BEFORE = "3aa4aa1"
"""The last commit before words were edited."""
PAGES = (
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(f"docs/howto/{name}.md" for name in ("photo", "restore", "train", "many", "camera")),
    "docs/ideas/planning.md",
    "docs/results/restoration.md",
)
SKIPPED = re.compile(
    r"```.*?```|<!--.*?-->|^\|.*?$|^#.*?$|^!\[.*?$|^\{.*?$|\$\$.*?\$\$", re.DOTALL | re.MULTILINE
)


def prose(page: str) -> list[str]:
    """The sentences of a page; an entry of a list without a stop is one."""
    text = SKIPPED.sub("", page)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "name", text)  # a name is a word
    text = re.sub(r"[*_]", "", text)
    parts = re.split(r"\n\s*\n|\n(?=- |\d+\. )", text)
    sentences = [each for part in parts for each in re.split(r"(?<=[.!?:])\s+(?=[A-Z`(\d])", part)]
    return [" ".join(each.split()) for each in sentences if len(re.findall(r"[A-Za-z]{2,}", each)) > 2]


def syllables(word: str) -> int:
    plain = re.sub(r"[^a-z]", "", word.lower())
    silent = (plain.endswith("e") and not plain.endswith(("le", "ee"))) or plain.endswith("ed")
    return max(1, len(re.findall(r"[aeiouy]+", plain)) - silent)


def ease(page: str) -> tuple[float, float]:
    """Flesch reading ease, and words per sentence."""
    sentences = prose(page)
    words = [word for each in sentences for word in re.findall(r"[A-Za-z][A-Za-z'-]*", each)]
    length = len(words) / len(sentences)
    return 206.835 - 1.015 * length - 84.6 * sum(map(syllables, words)) / len(words), length


def at(commit: str, page: str) -> str:
    asked = ["git", "-C", str(ROOT), "show", f"{commit}:{page}"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout


def main() -> int:
    commit, *pages = sys.argv[1:] or [BEFORE]
    named = pages or PAGES
    rows = [
        (page, *ease(at(commit, page)), *ease((ROOT / page).read_text(encoding="utf-8"))) for page in named
    ]
    means = [sum(row[k] for row in rows) / len(rows) for k in range(1, 5)]
    print(f"| page | ease at {commit} | words a sentence | ease now | words a sentence |")
    print("|---|---|---|---|---|")
    for name, *values in (*rows, ("mean", *means)):
        print(f"| {name} | " + " | ".join(f"{value:.0f}" for value in values) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
