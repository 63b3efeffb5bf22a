"""How much docstrings say of arrays and errors: `python docs/documented.py [LIST]`.

Counted are public functions and methods that take a Tensor or an array. One is documented if each of its
arrays has a line of its own in the docstring, which begins with its name and holds its shape, as in

    photo: linear image, [channel, y, x], full scale 1.

A method without a docstring has that of the method that it overrides (`inspect.getdoc`), and is not counted.
The second count is of those in which every argument has such a line. The third is of public functions that
raise InputError themselves, and say so. `LIST` names those that do not.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1] / "edofsim"
COMMAND = re.compile(r"/cli/|/experiments/\w+\.py:\d+: run$")
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


def public(package: Path = PACKAGE) -> Iterator[tuple[str, ast.FunctionDef]]:
    """All public functions and methods, with their place."""
    for path in sorted(package.rglob("*.py")):
        inner = path.relative_to(package.parent)
        if any(part.startswith("_") for part in inner.parts if part != "__init__.py"):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for owner in [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]:
            prefix = f"{owner.name}." if isinstance(owner, ast.ClassDef) else ""
            for node in owner.body:
                if not isinstance(node, ast.FunctionDef) or node.name[0] == "_" or prefix[:1] == "_":
                    continue
                yield f"{inner}:{node.lineno}: {prefix}{node.name}", node


def functions(package: Path = PACKAGE) -> Iterator[Function]:
    """All public functions of arrays, but for methods whose docstring is that of another class."""
    found = list(public(package))
    documented = _documented_methods(found)
    for place, node in found:
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        every = [each for each in every if each.arg not in ("self", "cls")]
        arrays = [a.arg for a in every if a.annotation and ARRAY.search(ast.unparse(a.annotation))]
        text = ast.get_docstring(node) or ""
        if arrays and (text or node.name not in documented):
            yield Function(place, [each.arg for each in every], arrays, text)


def raising(package: Path = PACKAGE) -> Iterator[tuple[str, bool]]:
    """All public functions that raise InputError themselves, but commands, whose docstrings are help texts;
    and whether they say so."""
    found = list(public(package))
    documented = _documented_methods(found)
    for place, node in found:
        text = ast.get_docstring(node) or ""
        thrown = [each.exc for each in ast.walk(node) if isinstance(each, ast.Raise) and each.exc]
        counts = not COMMAND.search(place) and (text or node.name not in documented)
        if counts and any("InputError" in ast.unparse(each) for each in thrown):
            yield place, re.search(r"\b[Rr]aises?\b", text) is not None


def _documented_methods(found: list[tuple[str, ast.FunctionDef]]) -> set[str]:
    """Names of methods that have a docstring somewhere, which others of the name inherit."""
    return {node.name for place, node in found if "." in place.rsplit(": ", 1)[1] and ast.get_docstring(node)}


def main() -> int:
    every = list(functions())
    shaped = [each for each in every if not each.missing(arrays=True)]
    whole = [each for each in every if not each.missing(arrays=False)]
    errors = list(raising())
    if sys.argv[1:]:
        for each in every:
            if gone := each.missing(arrays=True):
                print(f"{each.place}: {', '.join(gone)}")
        for place, said in errors:
            if not said:
                print(f"{place}: raises InputError")
    print(f"arrays with shapes: {len(shaped)} of {len(every)}; every argument: {len(whole)} of {len(every)}")
    print(f"raising InputError and saying so: {sum(said for _, said in errors)} of {len(errors)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
