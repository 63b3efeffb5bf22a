"""Broken occlusion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from importlib import import_module
from unittest.mock import patch

import torch
from torch import Tensor

from edofsim.capture import blurring, imaging, photograph
from edofsim.capture.blurring import Blurring
from edofsim.capture.occlusion import OCCLUSIONS, layers, none, slabs
from edofsim.capture.occlusion.slabs import Hides
from edofsim.optics import Camera, PsfField
from edofsim.render.view import View

from .mutant import Mutant, scaled, swapped, together

hidden = import_module("edofsim.capture.occlusion.hidden")  # the package holds a function of that name
sub_apertures = import_module("edofsim.capture.occlusion.sub_apertures")
plain = import_module("edofsim.capture.occlusion.none")
HIDING = ("coverage", "occlusion")
Compose = Callable[[View, Blurring], Tensor]
Slabs = Iterable[tuple[Tensor, Tensor]]
Merged = tuple[Tensor, Tensor]


def _composed(compose: Compose, *names: str) -> Callable[[], AbstractContextManager[object]]:
    """These kinds of occlusion composed otherwise, without what sub-apertures would change."""

    def composed(view: View, blurring: Blurring, layout: object = None) -> Tensor:
        return compose(view, blurring)

    def broken() -> AbstractContextManager[object]:
        ways = patch.dict(OCCLUSIONS, dict.fromkeys(names, composed))
        return together(ways, scaled(imaging, "change_by_sub_apertures", 0.0))

    return broken


def _dark(view: View, blurring: Blurring) -> Tensor:
    return 0 * none(view, blurring)


def _all_told(camera: Camera, across: int) -> float:
    return 1.0


def _reversed(inner: Callable[..., Merged]) -> Callable[..., Merged]:
    return lambda slabs, *how: inner(reversed(list(slabs)), *how)


def _visible_alone() -> AbstractContextManager[object]:
    inner = hidden.slabs_of

    def seen(view: View, at: list[float]) -> list[Tensor]:
        found = [which[~view.hidden[which]] for which in inner(view, at)]
        return [which for which in found if which.numel()]

    return together(swapped(hidden, "slabs_of", seen), swapped(sub_apertures, "slabs_of", seen))


def _merged_as(
    merge: Callable[[list[tuple[Tensor, Tensor]]], Tensor],
) -> Callable[[], AbstractContextManager[object]]:
    def merged(slabs: Slabs, count: int, behind: Tensor | None = None) -> Merged:
        image = merge(list(slabs))
        return image, image

    return lambda: together(swapped(hidden, "merged", merged), swapped(sub_apertures, "merged", merged))


def _unfilled(slabs: list[tuple[Tensor, Tensor]]) -> Tensor:
    image = slabs[0][0]
    for light, blocked in slabs[1:]:
        image = light + (1 - blocked.clamp(0, 1)) * image
    return image


def _added(slabs: list[tuple[Tensor, Tensor]]) -> Tensor:
    return torch.stack([light for light, _ in slabs]).sum(0)


def _half_opaque(slabs: list[tuple[Tensor, Tensor]]) -> Tensor:
    image = slabs[0][0]
    for light, blocked in slabs[1:]:
        image = light + (1 - 0.5 * blocked.clamp(0, 1)) * image
    return image


def _hard_edges(slabs: list[tuple[Tensor, Tensor]]) -> Tensor:
    image = slabs[0][0]
    for light, blocked in slabs[1:]:
        image = light + (blocked < 0.5) * image
    return image


def _lossy_psfs(psfs: PsfField, response: Tensor) -> PsfField:
    values = torch.einsum("cb,nbyx->ncyx", response, psfs.values)
    colours = (response @ psfs.wavelengths.to(response)) / response.sum(1)
    return PsfField(values, psfs.inverse_depths, colours)


def _nothing_hides(view: View, gap: float) -> Hides:
    none_at_all = torch.zeros(0, dtype=torch.int64)
    return Hides(none_at_all, none_at_all)


def _as_it_is(view: View, camera: Camera) -> View:
    return view


def _every_fragment(view: View) -> Tensor:
    return torch.arange(view.pixel.numel())


def _far_to_near() -> AbstractContextManager[object]:
    inner = layers._layers

    def reversed_layers(view: View, blurring: Blurring) -> Iterator[tuple[Tensor, Tensor]]:
        return reversed(list(inner(view, blurring)))

    return swapped(layers, "_layers", reversed_layers)


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "black where composited",
        "photos with occlusion are black",
        HIDING,
        _composed(_dark, "over", "normalised", "hidden"),
    ),
    Mutant("plain blur", "nothing hides anything", HIDING, _composed(none, "over", "normalised", "hidden")),
    Mutant("plain blur for hidden surfaces", "they are left out", HIDING, _composed(none, "hidden")),
    Mutant("hidden fragments ignored", "what a blur uncovers is filled from around", HIDING, _visible_alone),
    Mutant(
        "back before front",
        "slabs are merged from near to far",
        HIDING,
        lambda: together(
            *(swapped(room, "merged", _reversed(room.merged)) for room in (hidden, sub_apertures))
        ),
    ),
    Mutant("light added up", "slabs are added, not merged", HIDING, _merged_as(_added)),
    Mutant("half opaque", "surfaces let half of the light by", HIDING, _merged_as(_half_opaque)),
    Mutant("edges without blur", "a pixel sees one slab or the other", HIDING, _merged_as(_hard_edges)),
    Mutant(
        "holes left dark",
        "what is not known behind a slab is not filled",
        ("coverage",),
        _merged_as(_unfilled),
    ),
    Mutant(
        "coverage not normalised",
        "surfaces are as transparent as light leaves the windows",
        ("coverage",),
        lambda: swapped(blurring, "white_psfs", _lossy_psfs),
    ),
    Mutant(
        "edges not found",
        "no fragment is taken to hide another",
        HIDING,
        lambda: swapped(hidden, "hides", _nothing_hides),
    ),
    Mutant(
        "as few cuts as can be",
        "a surface is cut through where that parts two others as well",
        ("occlusion",),
        lambda: scaled(slabs, "crossed", 0.0),
    ),
    Mutant(
        "hidden light shown",
        "without occlusion hidden surfaces shine too",
        ("coverage",),
        lambda: swapped(plain, "seen", _every_fragment),
    ),
    Mutant(
        "layers from behind", "`over` and `normalised` begin with the farthest", ("coverage",), _far_to_near
    ),
    Mutant(
        "normalised as over",
        "no division by what is behind",
        ("coverage",),
        _composed(layers.over, "normalised"),
    ),
    Mutant(
        "nothing guessed",
        "behind the edges of a view that does not know what lies there is nothing",
        ("occlusion",),
        lambda: swapped(photograph, "with_guessed", _as_it_is),
    ),
    Mutant(
        "sub-apertures change nothing",
        "the pupil is always taken as a whole",
        ("occlusion",),
        lambda: scaled(imaging, "change_by_sub_apertures", 0.0),
    ),
    Mutant(
        "sub-apertures change twice as much",
        "as they should",
        ("occlusion",),
        lambda: scaled(imaging, "change_by_sub_apertures", 2.0),
    ),
    Mutant(
        "sub-apertures taken for all",
        "what a few sub-apertures show of a change is not made up for what they cannot tell",
        ("occlusion",),
        lambda: swapped(imaging, "between_part_variance", _all_told),
    ),
    Mutant(
        "sub-apertures given up",
        "the whole pupil stands in for those with half of their light outside the window",
        ("occlusion",),
        lambda: swapped(sub_apertures, "HELD_SHARE", 0.5),
    ),
)
