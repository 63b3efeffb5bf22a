"""Pictures of rendered scenes as training data, as planes at one depth."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from torch import Tensor

from ..capture.photograph import all_in_focus
from ..capture.prepare import channel_weights
from ..capture.sensor import automatic_exposure
from ..errors import InputError
from ..render import render
from .photographs import Photographs, PlaneSource, plane_source
from .reader import Wanted
from .sources import Images
from .views import scenes_of

BRIGHTEST = 2.0
"""Times full scale: brighter lamps are cut to this; `saturated_highlights` adds lamps of its own."""


class RenderedPictures(Photographs):
    """Scenes as they are rendered, all in focus, each picture a plane at one depth: the intensities and edges
    of rendered light, of which photographs show little. Views come from the cache, each rendered once."""

    slow: ClassVar[bool] = True

    kind: Literal["rendered"] = "rendered"
    scenes: Annotated[tuple[str, ...], Field(min_length=1)]
    """scene recipes: files or shipped names"""
    members: Annotated[int, Field(ge=0, le=100_000)] = 0
    """members of each scene's family, with seeds from `seed` on; 0: the scene itself"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] | None = None
    """seed of the first member; without it the scene recipe's"""
    most_noise: Annotated[float, Field(gt=0)] = 0.06
    """views whose noise is more than this share of their light are left out"""

    def open(self, wanted: Wanted) -> PlaneSource:
        pictures: list[Tensor] = []
        names: list[str] = []
        left_out: list[str] = []
        digest = hashlib.sha256()
        scenes = scenes_of(self, wanted.recipe.data.patch_px, 1.0, wanted.base)
        for index, (recipe, folder) in enumerate(scenes):
            if wanted.progress:
                wanted.progress(0.0, f"view {index + 1} of {len(scenes)}: {recipe.name}")
            view = render(recipe, folder, cache=wanted.cache)
            if view.noise > self.most_noise:
                left_out.append(recipe.name)
                continue
            light = all_in_focus(view, channel_weights(wanted.optics.camera, view.wavelengths))
            exposure = automatic_exposure(view.crop_margin(light), noisy=view.noise > 0)
            pictures.append((exposure * light).clamp_max(BRIGHTEST))
            names.append(recipe.name)
            digest.update(json.dumps(recipe.model_dump(mode="json"), sort_keys=True).encode())
        if left_out and len(pictures) < 2:
            raise InputError(
                f"{len(left_out)} of {len(scenes)} views have more noise than most_noise = "
                f"{self.most_noise:g} of their light: render them with more samples, or allow more"
            )
        images = Images(tuple(pictures), tuple(names), digest.hexdigest())
        found = plane_source(self, images, "rendered scenes", wanted.recipe, wanted.optics.window)
        about = {**self.model_dump(mode="json", include={"scenes", "members", "seed"}), "left_out": left_out}
        return replace(found, described={**found.described, **about})
