"""Scenes with depth as training data: random parts of views, photographed by the compositor."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol

import torch
from pydantic import Field
from torch import Tensor

from ..capture.crop import crop
from ..capture.sensor import automatic_exposure
from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS
from ..optics.field import relative_light
from ..optics.sampling import plan_sampling
from ..recipe.base import NotNegative, Positive
from ..recipe.load import load_scene
from ..recipe.scene import SceneRecipe
from ..render import render
from ..render.view import View
from ..scene.family import members
from .reader import TrainingReader, Wanted
from .shots import Shot, capture_view, captured_once
from .system import Captured, Scenes, captured
from .training_camera import TrainingCamera

LEAST_SPAN = 0.02
"""In 1/m: a view that spans less is one plane, and stays far."""


class Views(TrainingReader):
    """Scenes with their own depths through the compositor: rendered ones, and pictures with a depth map
    (scene recipes with a source of kind rgbd). Views come from the cache, each rendered once.

    Of members, the last are kept for validation, of a scene itself its lower part. A photo that is taken once
    has the veiling glare that errors of fabrication make in the mean, and a step is as cheap as one of
    photographs. For many cameras depths are stretched to each one's range, and bands are three.
    """

    slow: ClassVar[bool] = True

    kind: Literal["views"] = "views"
    scenes: Annotated[tuple[str, ...], Field(min_length=1)]
    """scene recipes: files or shipped names"""
    members: Annotated[int, Field(ge=0, le=100_000)] = 0
    """members of each scene's family, with seeds from `seed` on; 0: the scene itself"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] | None = None
    """seed of the first member; without it the scene recipe's"""
    bands: Literal["three", "all"] = "three"
    """"three": the paper's three colours; "all": all bands of the view through the sensor's response"""
    layers: Annotated[int, Field(ge=2, le=64)] = 6
    """depth nodes of the photos"""
    occlusion: Literal["none", "over", "normalised", "hidden"] = "hidden"
    """how depth edges are composited, as in `expose`"""
    sub_apertures: Annotated[int, Field(ge=1, le=8)] = 1
    """sub-apertures along each axis of the pupil, as in `expose`"""
    guess: bool = False
    """whether what is behind depth edges is guessed if a view does not hold it, as in `expose`; without,
    pictures with a depth map add all light there"""
    exposure: tuple[Positive, Positive] = (0.5, 1.0)
    """range of factors on the automatic exposure, drawn evenly in their logarithm"""
    white_balance: NotNegative = 0.0
    """how far the colours' gains vary, as of `natural`"""
    once: bool = False
    """whether each view is photographed once, and patches cut from that; for masks that do not learn"""

    def open(self, wanted: Wanted) -> ViewSource:
        doe = wanted.recipe.doe
        more = self.once or self.bands != "three" or self.sub_apertures > 1 or self.guess
        if wanted.recipe.cameras and more:
            raise InputError(
                "views for the many [cameras] are photographed by stored PSFs, anew each time: leave out "
                "once, bands, sub_apertures and guess"
            )
        if self.once and wanted.optics.varies:
            raise InputError(
                f"once = true: through the lens {wanted.optics.camera.lens.kind!r}, whose PSFs vary over the"
                " frame, parts of views are photographed, each at its place; leave it out"
            )
        if self.once and doe.learn and (doe.learning_rate_rad > 0 or doe.design_steps > 0):
            raise InputError(
                "once = true: photos of a mask that learns are soon of another mask; leave it out, or keep "
                "the mask (doe.learning_rate_rad = 0, no design_steps)"
            )
        data = wanted.recipe.data
        held_back = 1.0 if wanted.for_validation else data.validation
        how = wanted.base, wanted.cache, wanted.progress
        noise = doe.height_noise_nm * 1e-9
        depths = wanted.recipe.capture.inverse_depth_per_m if wanted.recipe.cameras else None
        return open_views(
            self, data.patch_px, held_back, wanted.optics, *how, height_noise=noise, stretched=depths
        )


@dataclass(frozen=True)
class ViewParts:
    """Parts of views, or of their photos, all of one size.

    factors: on the automatic exposure, [part, 3].
    """

    parts: tuple[View | Shot, ...]
    factors: Tensor
    table: Views

    def photograph(self, optics: TrainingCamera) -> Captured:
        """With layers, occlusion and hidden surfaces; each part by the PSFs of its middle's place."""
        shots: list[Shot] = []
        light: list[float] = []
        for part in self.parts:
            if isinstance(part, View) and optics.varies:
                y, x = part.axis_px
                seen_by = optics.seen_at(part.width / 2 - x, y - part.height / 2)
                light.append(relative_light(seen_by.camera))
                shots.append(capture_view(part, self.table, seen_by))
            else:
                shots.append(part if isinstance(part, Shot) else capture_view(part, self.table, optics))
        factors = self.factors.to(optics.device)[..., None, None]
        clean = torch.stack([shot.clean for shot in shots]).to(optics.device) * factors
        ideal = torch.stack([shot.ideal for shot in shots]).to(optics.device) * factors
        truncated = torch.stack([shot.truncated for shot in shots]).mean().to(optics.device)
        there = torch.tensor(light, device=optics.device) if light else None
        how = {"saturates": True, "broadband": self.table.bands == "all", "light": there}
        return captured(clean, ideal, truncated, **how)

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        return self


@dataclass(frozen=True)
class ViewSource:
    """Views of scenes, or their photos.

    held_back: those that are never trained on; where there are none, the lower part (in the picture) of each,
        a share `share_back` of its rows or more, is not trained on.
    """

    views: tuple[View | Shot, ...]
    held_back: tuple[View | Shot, ...]
    table: Views
    patch: int
    margin: int
    share_back: float
    described: Json
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        parts: list[View | Shot] = []
        for _ in range(count):
            view = self.views[int(torch.randint(len(self.views), (), generator=generator))]
            rows = view.height
            if not self.held_back:
                rows = training_rows(rows, self.patch, self.share_back)
            top = int(torch.randint(rows - self.patch + 1, (), generator=generator))
            left = int(torch.randint(view.width - self.patch + 1, (), generator=generator))
            parts.append(self._cut(view, top, left))
        low, high = self.table.exposure
        draws = torch.rand(count, 4, generator=generator)
        balance = (self.table.white_balance * (2 * draws[:, 1:] - 1)).exp()
        return ViewParts(tuple(parts), low * (high / low) ** draws[:, :1] * balance, self.table)

    def validation(self, count: int) -> list[Scenes]:
        """As they are, and at exposures spread evenly over the range in turn."""
        batches: list[Scenes] = []
        low, high = self.table.exposure
        kept = self.held_back or self.views
        for index in range(count):
            view = kept[index % len(kept)]
            turn, turns = index // len(kept), -(-count // len(kept))
            left = (view.width - self.patch) * turn // max(1, turns - 1)
            top = (view.height - self.patch) // (2 if self.held_back else 1)
            exposure = low * (high / low) ** ((index + 0.5) / count) if index % 2 else 1.0
            parts = (self._cut(view, top, left),)
            batches.append(ViewParts(parts, torch.full((1, 3), exposure), self.table))
        return batches

    def _cut(self, view: View | Shot, top: int, left: int) -> View | Shot:
        if isinstance(view, View):
            return crop(view, top, left, self.patch, self.patch, self.margin)
        rows, columns = slice(top, top + self.patch), slice(left, left + self.patch)
        return replace(view, clean=view.clean[:, rows, columns], ideal=view.ideal[:, rows, columns])


def training_rows(height: int, patch: int, held_back: float) -> int:
    """Rows of a view that are trained on: all but the lowest, of which one patch at least is kept."""
    return height - max(patch, round(held_back * height))


def open_views(
    table: Views,
    patch: int,
    held_back: float,
    optics: TrainingCamera,
    base: Path,
    cache: Path | None,
    progress: Progress | None,
    *,
    height_noise: float = 0.0,
    stretched: tuple[float, float] | None = None,
) -> ViewSource:
    """Render or fetch the views of a source.

    optics: with the mask's height map, where views are photographed once.
    base: where relative scene files start.
    held_back: share that is never trained on, of each scene's members, or of each view's rows.
    height_noise: standard deviation in metres of the errors of fabrication.
    stretched: inverse depths for `normalise_depth_range`.

    Raises InputError for scenes that cannot be used.
    """

    views: tuple[list[View | Shot], list[View | Shot]] = ([], [])
    digest = hashlib.sha256()
    wanted = scenes_of(table, patch, held_back, base)
    kept = math.ceil(held_back * table.members)
    for index, (recipe, folder) in enumerate(wanted):
        if progress:
            progress(0.0, f"view {index + 1} of {len(wanted)}: {recipe.name}")
        view = render(recipe, folder, cache=cache)
        digest.update(json.dumps(recipe.model_dump(mode="json"), sort_keys=True).encode())
        view = in_colours(view) if table.bands == "three" else view
        if stretched is not None:
            view = normalise_depth_range(view, stretched)
        elif not table.once:
            _check_sampling(view, optics, recipe.name)
        last = held_back == 1 or (table.members > 0 and index % table.members >= table.members - kept)
        views[last].append(captured_once(view, table, optics, height_noise) if table.once else view)
    described = {
        "kind": "views",
        "scenes": list(table.scenes),
        "members": table.members,
        "seed": table.seed,
        "sha256": digest.hexdigest(),
    }
    training, validating = map(tuple, views)
    return ViewSource(
        training, validating, table, patch, optics.window // 2, held_back, described, described["sha256"]
    )


def normalise_depth_range(view: View, depths: tuple[float, float]) -> View:
    """A view for many cameras: exposed automatically, what it spans in depth stretched to `depths` (least,
    largest inverse depth in 1/m). So does a camera's range end where what it photographs does."""
    low, high = view.inverse_depth.aminmax()
    share = (view.inverse_depth - low) / (high - low).clamp_min(LEAST_SPAN)
    exposure = automatic_exposure(view.crop_margin(view.all_in_focus()), noisy=view.noise > 0)
    stretched = replace(view, inverse_depth=depths[0] + (depths[1] - depths[0]) * share)
    return stretched.with_light(exposure * view.radiance)


def _check_sampling(view: View, optics: TrainingCamera, name: str) -> None:
    """Raises InputError for a pupil that is sampled too coarsely for one of the depths that parts of the view
    see, before any step: what is near may be drawn late, or by validation alone."""
    whole = crop(view, 0, 0, view.height, view.width, min(view.margin, optics.window // 2))
    ends = torch.stack(whole.inverse_depth.aminmax()).double()
    try:
        plan_sampling(optics.camera, view.wavelengths.double(), ends, optics.window)
    except InputError as error:
        raise InputError([f"scene {name!r}: {problem}" for problem in error.problems]) from None


class NamesScenes(Protocol):
    """A table of scenes, with members of their families from a seed on."""

    @property
    def scenes(self) -> tuple[str, ...]: ...

    @property
    def members(self) -> int: ...

    @property
    def seed(self) -> int | None: ...


def scenes_of(table: NamesScenes, patch: int, held_back: float, base: Path) -> list[tuple[SceneRecipe, Path]]:
    """The scenes of a source, each with the folder that its files start from, before anything is rendered.

    Raises InputError, all problems together, for frames that hold no patch, for training and, above it or in
    a member of its own, for validation.
    """
    found: list[tuple[SceneRecipe, Path]] = []
    problems: list[str] = []
    for name in table.scenes:
        loaded = load_scene(base / name if (base / name).is_file() else name)
        recipes = members(loaded.recipe, table.members, table.seed) if table.members else [loaded.recipe]
        frame = loaded.recipe.frame
        shared = not table.members and held_back < 1  # by training and validation
        rows = training_rows(frame.height_px, patch, held_back) if shared else frame.height_px
        if frame.width_px < patch or rows < patch:
            problems.append(
                f"scene {name!r}: a view of {frame.width_px} x {frame.height_px} pixels holds no patch of "
                f"{patch}"
                + (" for training above one for validation" if shared else "")
                + "; use smaller patches or a larger frame"
            )
        found += [(recipe, loaded.base) for recipe in recipes]
    if problems:
        raise InputError(problems)
    return found


def in_colours(view: View) -> View:
    """The view at the paper's three wavelengths, its bands interpolated linearly. Raises InputError for a
    view whose bands do not reach them."""
    bands = view.wavelengths
    if float(bands.min()) > float(PAPER_COLOURS.min()) or float(bands.max()) < float(PAPER_COLOURS.max()):
        low, high = (1e9 * float(end) for end in (bands.min(), bands.max()))
        raise InputError(f"a view of {low:.0f} to {high:.0f} nm does not hold the paper's 482 to 611 nm")
    upper = torch.searchsorted(bands, PAPER_COLOURS).clamp(1, len(bands) - 1)
    share = (PAPER_COLOURS - bands[upper - 1]) / (bands[upper] - bands[upper - 1])
    share = share.to(view.radiance)[:, None]
    radiance = view.radiance[upper - 1] * (1 - share) + view.radiance[upper] * share
    return view.with_light(radiance, PAPER_COLOURS.clone())
