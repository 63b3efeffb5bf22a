"""How many public functions of arrays say what their arguments are: `python docs/documented.py [LIST]`.

Counted are functions and methods without `_` that take a Tensor or an array. One is documented if each of its
arrays has a line of its own in the docstring, which begins with its name and holds its shape, as in

    photo: linear image, [channel, y, x], full scale 1.

The other count is of those in which every argument has such a line. `LIST` names those that have not.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1] / "edofsim"
ARRAY = re.compile(r"\b(Tensor|ndarray|ArrayLike)\b")


class Function(NamedTuple):
    """A public function, its arguments, and those of them that are arrays."""

    place: str
    arguments: list[str]
    arrays: list[str]
    text: str

    def missing(self, *, arrays: bool) -> list[str]:
        """Arguments without a line of their own; of arrays also those whose line has no shape."""
        lines: dict[str, str] = {}
        for line in re.split(r"\n(?=\s*\w[\w, ]*: )|(?<=\.)\n", self.text):
            names, colon, rest = line.strip().partition(": ")
            if colon and re.fullmatch(r"\w+(, \w+)*", names):
                lines |= dict.fromkeys(names.split(", "), rest)
        if arrays:
            return [name for name in self.arrays if "[" not in lines.get(name, "")]
        return [name for name in self.arguments if name not in lines]


def functions(package: Path = PACKAGE) -> Iterator[Function]:
    """All public functions of arrays."""
    for path in sorted(package.rglob("*.py")):
        inner = path.relative_to(package.parent)
        if any(part.startswith("_") for part in inner.parts if part != "__init__.py"):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for owner in [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]:
            prefix = f"{owner.name}." if isinstance(owner, ast.ClassDef) else ""
            for node in owner.body:
                public = isinstance(node, ast.FunctionDef) and not f"{prefix}{node.name}".startswith("_")
                if public and not node.name.startswith("_"):
                    yield from _function(f"{inner}:{node.lineno}: {prefix}{node.name}", node)


def _function(place: str, node: ast.FunctionDef) -> Iterator[Function]:
    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    every = [each for each in every if each.arg not in ("self", "cls")]
    arrays = [a.arg for a in every if a.annotation and ARRAY.search(ast.unparse(a.annotation))]
    if arrays:
        yield Function(place, [each.arg for each in every], arrays, ast.get_docstring(node) or "")


def main() -> int:
    every = list(functions())
    shaped = [each for each in every if not each.missing(arrays=True)]
    whole = [each for each in every if not each.missing(arrays=False)]
    if sys.argv[1:]:
        for each in every:
            if gone := each.missing(arrays=True):
                print(f"{each.place}: {', '.join(gone)}")
    print(f"arrays with shapes: {len(shaped)} of {len(every)}; every argument: {len(whole)} of {len(every)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
