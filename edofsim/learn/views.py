"""Scenes with depth as training data: random parts of views, photographed by the compositor."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
from pydantic import Field
from torch import Tensor

from ..capture import Fidelity, capture
from ..capture.crop import crop
from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera
from ..recipe.base import NotNegative
from ..recipe.load import load_scene
from ..recipe.scene import SceneRecipe
from ..render.view import View
from ..scene.family import members
from .reader import TrainingReader, Wanted
from .system import Captured, Optics, Scenes, captured


class Views(TrainingReader):
    """Scenes with their own depths through the compositor: rendered ones, and pictures with a depth map
    (scene recipes with a source of kind rgbd). Views come from the cache, each rendered once.

    members: so many of each scene's family, with the seeds `seed`, `seed` + 1, ...; 0 for the scene itself.
    bands: the paper's three colours, or all of the view's bands through the sensor's response (slower by
    their number). layers, occlusion: as in `expose`. exposure: factors on the automatic exposure, drawn for
    each patch.
    """

    kind: Literal["views"] = "views"
    scenes: Annotated[tuple[str, ...], Field(min_length=1)]
    members: Annotated[int, Field(ge=0, le=100_000)] = 0
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    bands: Literal["three", "all"] = "three"
    layers: Annotated[int, Field(ge=2, le=64)] = 6
    occlusion: Literal["none", "over", "normalised", "hidden"] = "hidden"
    exposure: tuple[NotNegative, NotNegative] = (0.5, 1.0)

    def open(self, wanted: Wanted) -> ViewSource:
        data = wanted.recipe.data
        how = wanted.base, wanted.cache, wanted.progress
        return open_views(self, data.patch_px, data.validation, wanted.optics, *how)


@dataclass(frozen=True)
class ViewParts:
    """Parts of views, all of one size, each with its factor on the automatic exposure."""

    parts: tuple[View, ...]
    exposures: tuple[float, ...]
    table: Views

    def photograph(self, optics: Optics) -> Captured:
        """With layers, occlusion and hidden surfaces."""
        camera = _camera(optics.camera, self.table.bands)
        fidelity = Fidelity(layers=self.table.layers, occlusion=self.table.occlusion, window_px=optics.window)
        photos = [capture(part, camera, fidelity, device=optics.device) for part in self.parts]
        factors = torch.tensor(self.exposures, device=optics.device)[:, None, None, None]
        clean = torch.stack([photo.clean for photo in photos]) * factors
        ideal = torch.stack([photo.ideal for photo in photos]) * factors
        truncated = torch.stack([photo.truncated for photo in photos]).mean()
        return captured(clean, ideal, truncated, saturates=True)

    def reusing(self, psf: Tensor | None) -> Scenes:
        return self


@dataclass(frozen=True)
class ViewSource:
    """Views of scenes. Their lower part (in the picture) is kept for validation."""

    views: tuple[View, ...]
    table: Views
    patch: int
    margin: int
    held_back: float
    described: Json
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        parts: list[View] = []
        exposures: list[float] = []
        low, high = self.table.exposure
        for _ in range(count):
            view = self.views[int(torch.randint(len(self.views), (), generator=generator))]
            last = training_rows(view.height, self.patch, self.held_back) - self.patch
            top = int(torch.randint(last + 1, (), generator=generator))
            left = int(torch.randint(view.width - self.patch + 1, (), generator=generator))
            parts.append(crop(view, top, left, self.patch, self.patch, self.margin))
            exposures.append(low + (high - low) * float(torch.rand((), generator=generator)))
        return ViewParts(tuple(parts), tuple(exposures), self.table)

    def validation(self, count: int) -> list[Scenes]:
        batches: list[Scenes] = []
        for index in range(count):
            view = self.views[index % len(self.views)]
            turn, turns = index // len(self.views), -(-count // len(self.views))
            left = (view.width - self.patch) * turn // max(1, turns - 1)
            part = crop(view, view.height - self.patch, left, self.patch, self.patch, self.margin)
            batches.append(ViewParts((part,), (1.0,), self.table))
        return batches


def training_rows(height: int, patch: int, held_back: float) -> int:
    """Rows of a view that are trained on: all but the lowest, of which one patch at least is kept."""
    return height - max(patch, round(held_back * height))


def open_views(
    table: Views,
    patch: int,
    held_back: float,
    optics: Optics,
    base: Path,
    cache: Path | None,
    progress: Progress | None,
) -> ViewSource:
    """Render or fetch the views of a source. base: where relative scene files start; held_back: share of
    each view's rows that is never trained on.

    Raises InputError for scenes that cannot be used.
    """
    from ..render import render

    views: list[View] = []
    digest = hashlib.sha256()
    wanted = scenes_of(table, patch, held_back, base)
    for index, (recipe, folder) in enumerate(wanted):
        if progress:
            progress(0.0, f"view {index + 1} of {len(wanted)}: {recipe.name}")
        view = render(recipe, folder, cache=cache)
        digest.update(json.dumps(recipe.model_dump(mode="json"), sort_keys=True).encode())
        views.append(in_colours(view) if table.bands == "three" else view)
    described = {
        "kind": "views",
        "scenes": list(table.scenes),
        "members": table.members,
        "seed": table.seed,
        "sha256": digest.hexdigest(),
    }
    return ViewSource(
        tuple(views), table, patch, optics.window // 2, held_back, described, described["sha256"]
    )


def scenes_of(table: Views, patch: int, held_back: float, base: Path) -> list[tuple[SceneRecipe, Path]]:
    """The scenes of a source, each with the folder that its files start from, before anything is rendered.

    Raises InputError, all problems together, for frames that hold no patch for training above one for
    validation.
    """
    found: list[tuple[SceneRecipe, Path]] = []
    problems: list[str] = []
    for name in table.scenes:
        loaded = load_scene(base / name if (base / name).is_file() else name)
        recipes = members(loaded.recipe, table.members, table.seed) if table.members else [loaded.recipe]
        frame = loaded.recipe.frame
        if frame.width_px < patch or training_rows(frame.height_px, patch, held_back) < patch:
            problems.append(
                f"scene {name!r}: a view of {frame.width_px} x {frame.height_px} pixels holds no patch of "
                f"{patch} for training above one for validation; use smaller patches or a larger frame"
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
    return replace(view, radiance=radiance, wavelengths=PAPER_COLOURS.clone())


def _camera(camera: Camera, bands: str) -> Camera:
    """With three bands each channel sees one of them, as in the paper."""
    if bands == "all":
        return camera
    sensor = camera.recipe.sensor.model_copy(update={"response": "lines"})
    return replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))
