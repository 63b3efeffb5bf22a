"""One word a meaning: words that need two readings stay out of pages, help texts, messages and docstrings."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EVERYWHERE = {
    r"told(?!:)": "given, reported, conditioned on",  # `told:` names a field
    r"so many": "this many, N",
    r"of before": "earlier, of earlier versions",
    r"lacks": "does not have, is without",
    r"foretells?|foretold": "predicts, predicted",
    r"besides?(?!:)": "next to, with, in addition to, as well",
}
"""Words that no text holds, and what to write instead (docs/glossary.md)."""
ROOT_PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
SINCE = "2026-11-27T07:30:00Z"
"""Subjects of commits are checked from here on."""


def found(text: str, words: dict[str, str]) -> list[str]:
    """Each banned word of a text with what stands around it. Code in backticks does not count."""
    text = re.sub(r"`[^`\n]*`|<!--.*?-->|\]\([^)]*\)", "", text, flags=re.DOTALL)
    return [
        f"...{text[max(0, hit.start() - 30) : hit.end() + 20]!r}: write {instead}"
        for word, instead in words.items()
        for hit in re.finditer(rf"(?<![\w.\-])(?:{word})(?![\w\-])", text, re.IGNORECASE)
    ]


def pages() -> list[Path]:
    made = {"_build", "gallery"}
    every = [*(ROOT / name for name in ROOT_PAGES), *(ROOT / "docs").rglob("*.md")]
    return [
        path for path in every if not made & set(path.parts) and path.name not in ("glossary.md", "runs.md")
    ]


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_pages_have_one_word_a_meaning(path: Path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert not found(text, EVERYWHERE)


def test_code_says_the_same_words():
    """Docstrings, help texts and messages: every string of two words or more."""
    problems = []
    for path in sorted((ROOT / "edofsim").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
                hits = found(node.value, EVERYWHERE)
                problems += [f"{path.relative_to(ROOT)}:{node.lineno}: {hit}" for hit in hits]
    assert not problems, "\n".join(problems)


NAMES = {
    "told",
    "tells",
    "looks",
    "looked",
    "lies",
    "taker",
    "takers",
    "contestant",
    "relief",
    "photographed",
    "beside",
}
"""Words that no name of a module, class, function, field or variable holds."""
MEANINGLESS = {"SOME", "BETWEEN", "EVEN", "SMALLER", "WORTH"}
"""Names of constants that do not say what they hold."""


def defined(path: Path) -> list[tuple[int, str]]:
    """Modules, classes, functions, parameters, fields and variables that a file defines, with their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = [(1, path.stem)]
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.append((node.lineno, node.name))
        elif isinstance(node, ast.arg):
            found.append((node.lineno, node.arg))
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.append((node.lineno, node.id))
    return found


def test_names_say_the_same_words():
    problems = []
    for path in sorted((ROOT / "edofsim").rglob("*.py")):
        for line, name in defined(path):
            parts = set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().split("_"))
            if parts & NAMES or name in MEANINGLESS:
                problems.append(f"{path.relative_to(ROOT)}:{line}: {name}")
    assert not problems, "\n".join(problems)


def test_the_ban_catches_its_words():
    said = "A net that is told, so many of before, lacks it; `told` and depth-dcnn are names, told: a field."
    assert len(found(said, EVERYWHERE)) == 4


def test_a_version_of_the_changes_fits_a_page():
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    for version in versions:
        entries = re.findall(r"^- ", version, re.MULTILINE)
        assert 0 < len(entries) <= 25, version.partition("\n")[0]


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_subjects_of_commits_fit_a_line():
    asked = ["git", "-C", str(ROOT), "log", "--no-merges", f"--since={SINCE}", "--format=%h %s"]
    log = subprocess.run(asked, capture_output=True, text=True, check=False)
    if log.returncode:
        pytest.skip("not a checkout of git")
    long = [line for line in log.stdout.splitlines() if len(line.split(" ", 1)[1]) > 72]
    assert not long, f"subjects of more than 72 characters: {long}"
