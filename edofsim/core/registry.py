"""Kinds of things that people add: by one line in this package, or by an entry point of another one."""

from __future__ import annotations

import ast
import hashlib
import inspect
import os
import sys
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, Generic, TypeVar, get_args
from uuid import uuid4

from ..errors import InputError

T = TypeVar("T")
TRIED = "EDOFSIM_PLUGINS"
THIS_SESSION = uuid4().hex


def _imported(place: str) -> Any:  # pyrefly: ignore[explicit-any] - whatever stands at `module:attribute`
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)


def _modules(names: str) -> Iterator[ModuleType]:
    """Modules with commas between their names, and all that are in those that are packages. Raises InputError
    for one that cannot be imported."""
    for name in filter(None, map(str.strip, names.split(","))):
        if os.getcwd() not in sys.path:
            sys.path.insert(0, os.getcwd())
        try:
            module = import_module(name)
            inside = [each.name for each in iter_modules(getattr(module, "__path__", ()), name + ".")]
            yield from (module, *map(import_module, inside))
        except (Exception, SystemExit) as error:  # someone's import can end in any way
            raise InputError(f"{TRIED}={name}: cannot be imported ({error})") from error


class Registry(Mapping[str, T], Generic[T]):
    """Things of one kind by name, in the order they were added; imported when they are first asked for.

    group: of the entry points that other packages add, such as `edofsim.masks`.
    kind: what one of them is called in messages.
    own: this package's, name to `module:attribute`.
    base: where the class is that each of them derives from, or is an instance of, likewise. A name of this
        package cannot be taken by another one.

    Modules and packages that the environment variable EDOFSIM_PLUGINS names, with commas between them, are
    looked through for such things too, in the working directory first: to try one without installing it.
    """

    def __init__(self, group: str, kind: str, own: Mapping[str, str], base: str) -> None:
        self.group = group
        self.kind = kind
        self.base = base
        self._own = dict(own)
        self._loaded: dict[str, T] = {}
        self._given: dict[str, T] = {}

    @cached_property
    def _places(self) -> dict[str, str]:
        added = {point.name: point.value for point in entry_points(group=self.group)} | self._tried()
        for name, thing in self._given.items():
            added[name] = f"{thing.__module__}:{getattr(thing, '__qualname__', name)}"
        return self._own | {name: value for name, value in added.items() if name not in self._own}

    def _tried(self) -> dict[str, str]:
        """What the modules of EDOFSIM_PLUGINS add here. Raises InputError for one that cannot be imported."""
        found: dict[str, str] = {}
        for module in _modules(os.environ.get(TRIED, "")):
            for attribute, thing in vars(module).items():
                if self._holds(thing) and thing is not _imported(self.base):
                    place = f"{module.__name__}:{attribute}"
                    if isinstance(thing, type):  # where it is defined, for `code_of`
                        place = f"{thing.__module__}:{thing.__qualname__}"
                    found |= dict.fromkeys(self.names_of(thing), place)
        return found

    def names_of(self, thing: object) -> tuple[str, ...]:
        """What a class or an effect of a plan is called in recipes: its `kind`, or its `name`."""
        field = getattr(thing, "model_fields", {}).get("kind")
        if field is not None:
            return get_args(field.annotation)
        name = getattr(thing, "kind", None) or getattr(thing, "name", None)
        return (name,) if isinstance(name, str) else ()

    def take(self, thing: T) -> bool:
        """Whether this is a thing of this registry, which has it by its `kind` from now on: in this process,
        whatever it had by that name. Raises InputError for one without a `kind`, or with one of ours."""
        if not self._holds(thing):
            return False
        names = self.names_of(thing)
        taken = [name for name in names if name in self._own]
        if taken or not names:
            said = f"kind {taken[0]!r} is this package's" if taken else "it has no `kind`"
            raise InputError(f"the {self.kind} {getattr(thing, '__name__', thing)}: {said}; give another")
        self._given |= dict.fromkeys(names, thing)
        self.look_again()
        return True

    def _holds(self, thing: object) -> bool:
        base = _imported(self.base)
        return issubclass(thing, base) if isinstance(thing, type) else isinstance(thing, base)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        # what this package adds is known before modules of others are imported, which may import this package
        return name in self._own or name in self._places

    def about(self, name: str) -> str:
        """The docstring of a thing, or of its module if it is no function or class, read from the source
        without importing it; empty where there is none."""
        module, _, attribute = self._places[name].partition(":")
        try:
            spec = find_spec(module)  # imports the packages around it alone
            tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8")) if spec and spec.origin else None
        except (ImportError, OSError, SyntaxError, ValueError):
            return ""
        if tree is None:
            return ""
        found = (node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef)))
        named = next((node for node in found if node.name == attribute), tree)
        return ast.get_docstring(named) or ""

    def __getitem__(self, name: str) -> T:
        """The thing of that name. Raises InputError for an unknown name, and for what another package adds
        that cannot be imported or is none."""
        if name not in self._loaded:
            if name not in self._places:
                raise InputError(self.unknown(name))
            try:
                found = self._given[name] if name in self._given else _imported(self._places[name])
            except (Exception, SystemExit) as error:  # another package's import can end in any way
                if name in self._own:
                    raise
                raise InputError(
                    f"the {self.kind} {name!r} of another package cannot be loaded from "
                    f"{self._places[name]} ({error}): mend or remove that package"
                ) from error
            if name not in self._own and not self._holds(found):
                raise InputError(
                    f"the {self.kind} {name!r} of another package is no {self.base.partition(':')[2]}: "
                    f"{self._places[name]} is {found!r}"
                )
            self._loaded[name] = found
        return self._loaded[name]

    def unknown(self, name: str) -> str:
        """A sentence about a name that there is none of, with the nearest that there is."""
        near = get_close_matches(name, self._places, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return f"unknown {self.kind} {name!r}; {hint}known: {', '.join(self._places)}"

    def look_again(self) -> None:
        """Forget what other packages add: who asks next finds those that are there by then."""
        self.__dict__.pop("_places", None)
        self._loaded = {name: thing for name, thing in self._loaded.items() if name in self._own}

    def of_another(self, name: str) -> bool:
        """Whether another package adds what is called so."""
        return name in self._places and name not in self._own

    def place(self, name: str) -> str:
        """Where a thing is, `module:attribute`."""
        return self._places[name]

    def code_of(self, name: str) -> str:
        """SHA-256 of the file that another package defines a thing in, for keys of what is kept of it; empty
        for a thing of this package, whose keys carry versions of their own."""
        if name not in self or name in self._own:
            return ""
        if name in self._given and not hasattr(
            sys.modules.get(self._places[name].partition(":")[0]), "__file__"
        ):
            return THIS_SESSION  # typed into a notebook: nothing tells it from what is typed later
        file = inspect.getsourcefile(import_module(self._places[name].partition(":")[0]))
        return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
