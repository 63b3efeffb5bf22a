"""What a user insists on against a plan, checked before any time is spent."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

from ..capture.fidelity import Fidelity
from ..capture.occlusion import OCCLUSIONS
from ..errors import InputError
from .effect import Values
from .effects import EFFECTS, GONE, RENAMED

LOG = logging.getLogger(__name__)


def checked_overrule(overrule: Values | None) -> Values:
    """The settings that are given, see `plan_photo`.

    Raises InputError for an effect, a way to composite or a method that is not known, and for what
    contradicts itself."""
    given = {name: value for name, value in (overrule or {}).items() if value is not None}
    effects = list(EFFECTS)
    for option in ("with_", "without"):
        if option in given:
            given[option] = [_today(name) for name in given[option] if not _gone(name)]
    added, left = given.get("with_", ()), given.get("without", ())
    problems = [_unknown("effect", name, effects) for name in (*added, *left) if name not in effects]
    problems += [f"--with and --without {name!r}: ask for one of them" for name in sorted({*added} & {*left})]
    if given.get("occlusion", "hidden") not in OCCLUSIONS:
        problems.append(_unknown("occlusion", given["occlusion"], OCCLUSIONS))
    if "method" in given:
        problems += _without_method(given)
    way = given.get("occlusion", "hidden")
    if given.get("sub_apertures", 1) != 1 and way in OCCLUSIONS and way != "hidden":
        problems.append(f"sub-apertures belong to the occlusion `hidden` alone, not to {way!r}")
    if problems:
        raise InputError(problems)
    return given


def _without_method(given: dict[str, Any]) -> list[str]:  # pyrefly: ignore[explicit-any]
    """Take out `method`, which photos had a choice of, and say in one line what stands in its place; problems
    where nothing does."""
    match given.pop("method"):
        case "layered":
            LOG.warning("--method layered: all photos are made so; leave it out")
        case "constant":
            LOG.warning("--method constant is --layers 1 now")
            given["layers"] = 1
        case "brute":
            return ["there is no --method brute any more: it is for tests; leave it out"]
        case unknown:
            return [f"there is no --method {unknown} any more: leave it out, plans gather bands in groups"]
    return []


def insisted_rendering(overrule: Values) -> Fidelity:
    """How a view is rendered where a user insists on leaving out effects of rendering."""
    found = Fidelity()
    for name in overrule.get("without", ()):
        found = found.changed(EFFECTS[name].cuts)
    return found


def _today(name: str) -> str:
    """The name of an effect, which may be typed with hyphens or `_` for spaces; of one that was renamed, what
    it is called now, said in one line; others as they are."""
    name = {_loosely(each): each for each in (*RENAMED, *EFFECTS)}.get(_loosely(name), name)
    if name not in RENAMED:
        return name
    LOG.warning("the effect %r is called %r now", name, RENAMED[name])
    return RENAMED[name]


def _loosely(name: str) -> str:
    return name.lower().replace("-", " ").replace("_", " ")


def _gone(name: str) -> bool:
    """Whether there is no such effect any more, said in one line."""
    if name in GONE:
        LOG.warning("there is no effect %r any more: %s", name, GONE[name])
    return name in GONE


def _unknown(what: str, name: str, known: Iterable[str]) -> str:
    return f"{what} {name!r} is not known: choose one of {', '.join(known)}"
