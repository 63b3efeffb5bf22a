"""How long the package is: `python docs/sizes.py` prints lines by room, and how many of them are code; files
above 400 lines and functions above 60, with their docstrings."""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST_FILE = 400
LONGEST_FUNCTION = 60
_NO_CODE = (
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
    *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
)


def files(root: Path = ROOT) -> dict[str, str]:
    """Texts of the package's files, by their paths from the root."""
    every = sorted((root / "edofsim").rglob("*.py"))
    return {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in every}


def rooms(
    texts: dict[str, str], length: Callable[[str], int] = lambda text: len(text.splitlines())
) -> Counter[str]:
    """Lines of each folder of the package, and of its files outside any, by the length of a text."""
    found: Counter[str] = Counter()
    for path, text in texts.items():
        parts = path.split("/")
        found[parts[1] if len(parts) > 2 else "."] += length(text)
    return found


def code(text: str) -> int:
    """Lines of a file without comments, blank lines, and texts that stand by themselves, as docstrings do."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and node.end_lineno:
            lines.difference_update(range(node.lineno, node.end_lineno + 1))
    return len(lines)


def long_files(texts: dict[str, str]) -> dict[str, int]:
    """Lines of files that have too many."""
    lines = {path: len(text.splitlines()) for path, text in texts.items()}
    return {path: count for path, count in lines.items() if count > LONGEST_FILE}


def long_functions(texts: dict[str, str], docstrings: bool = True) -> dict[str, int]:
    """Lines of functions that have too many, as `file:function`, with their docstrings or without."""
    found = {}
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
                said = ast.get_docstring(node, clean=False) if not docstrings else None
                found[f"{path}:{node.name}"] = node.end_lineno - node.lineno + 1
                found[f"{path}:{node.name}"] -= 0 if said is None else len(said.splitlines())
    return {name: count for name, count in found.items() if count > LONGEST_FUNCTION}


def main() -> None:
    texts = files()
    lines, of_code = rooms(texts), rooms(texts, code)
    print(" lines  code")
    for room, count in sorted(lines.items()):
        print(f"{count:6d} {of_code[room]:5d} {room}")
    print(f"{lines.total():6d} {of_code.total():5d} in all")
    for kind, found in (("file", long_files(texts)), ("function", long_functions(texts))):
        for name, count in sorted(found.items(), key=lambda item: -item[1]):
            print(f"{count:6d} {kind} {name}")


if __name__ == "__main__":
    main()
