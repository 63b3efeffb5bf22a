"""A benchmark as it lies in a folder: a data set whose views are kept, whole to the last byte."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from safetensors import safe_open
from torch import Tensor

from ..capture.noise import NoiseState, PhotoNoise
from ..core.json_values import Json
from ..data.kept import SUMS, about, problems_of, read_sample
from ..data.pairs import Pairs
from ..data.taken import NOISE
from ..errors import InputError
from ..experiments.restorations import Known
from ..optics import PAPER_COLOURS, Camera, psf_bank
from ..recipe.camera import CameraRecipe
from ..recipe.dataset import DatasetRecipe
from ..recipe.load import shipped_folder
from ..render.view import View

ALIKE = 1e-3
"""Part of the light that lands elsewhere by PSFs that take the same photos: 60 dB."""


@dataclass(frozen=True)
class Shot:
    """A photo to be restored, and what is known of it.

    key: the pair's name.
    photo, ideal: [channel, y, x].
    inverse_depth, edge_px: [y, x].
    truncated: [channel].
    noise: of the rendering.
    seed: of the sensor's noise.
    """

    key: str
    family: str
    camera: str
    photo: Tensor
    ideal: Tensor
    inverse_depth: Tensor
    edge_px: Tensor
    truncated: Tensor
    noise: PhotoNoise
    seed: int


@dataclass(frozen=True)
class Benchmark:
    """A benchmark's folder. Raises InputError where it is not one, or not whole."""

    path: Path

    def check(self) -> None:
        """Raise InputError naming every file that is damaged, missing or extra."""
        problems = problems_of(self.path)[1]
        if not self.recipe.store.keep_views:
            problems.append(f"{self.path}: its views are not kept, so that no other camera can enter")
        if problems:
            raise InputError(problems)

    @cached_property
    def recipe(self) -> DatasetRecipe:
        """What it was made of."""
        return DatasetRecipe.model_validate(about(self.path)["recipe"])

    @cached_property
    def pairs(self) -> Pairs:
        """Its photos."""
        return Pairs(self.path, "test")

    @property
    def identity(self) -> dict[str, str]:
        """Hashes of its definition and of all its data."""
        data = hashlib.sha256((self.path / SUMS).read_bytes()).hexdigest()
        return {"name": self.recipe.name, "definition": str(about(self.path)["digest"]), "data": data}

    @cached_property
    def ends(self) -> Tensor:
        """Least and largest inverse depth of all its photos in 1/m, float64 [2]: the range that entries are
        given."""
        every = [end for meta in self.pairs.metas for end in meta["inverse_depths"]]
        return torch.tensor([min(every), max(every)], dtype=torch.float64)

    @cached_property
    def known(self) -> dict[str, Known]:
        """What is known of the photos of each camera that took any, kept from scene to scene."""
        return {}

    @cached_property
    def alike(self) -> dict[tuple[str, str], bool]:
        """Found by `takes_the_photos_of`."""
        return {}

    def takes_the_photos_of(self, camera: Camera, digest: str, name: str) -> bool:
        """Whether a camera of that digest takes the photos of one of the benchmark's: all but the mask's
        description is the same, and PSFs differ by a thousandth of their light at most."""
        if (digest, name) not in self.alike:
            one, other = camera, self.camera(name)
            same = _without_mask(one) == _without_mask(other)
            if same:
                window = min(one.recipe.psf.window_px, other.recipe.psf.window_px)
                banks = (psf_bank(c, PAPER_COLOURS, self.ends, window_px=window).values for c in (one, other))
                apart = torch.sub(*banks).abs().sum((-2, -1)) / 2
                same = float(apart.max()) <= ALIKE
            self.alike[digest, name] = same
        return self.alike[digest, name]

    @cached_property
    def scenes(self) -> dict[str, list[Json]]:
        """Metadata of the photos of each scene, in their order."""
        found: dict[str, list[Json]] = {}
        for meta in self.pairs.metas:
            found.setdefault(str(meta["scene"]), []).append(meta)
        return found

    def shot(self, meta: Json) -> Shot:
        """A photo of its own."""
        planes = {
            name: torch.from_numpy(values).float()
            for name, values in read_sample(self.path / "samples" / f"{meta['key']}.exr")[0].items()
        }
        states: dict[str, NoiseState] = {"kept": "taken out", "none": "none"}
        state = states.get(str(meta["rendering_noise"]), "included")
        noise = PhotoNoise(state, *(planes.get(name) for name in NOISE))
        return Shot(
            str(meta["key"]),
            str(meta["family"]),
            str(meta["camera"]),
            planes["photo"],
            planes["ideal"],
            planes["inverse_depth"],
            planes["edge_px"],
            torch.tensor(meta["truncated"]),
            noise,
            int(meta["noise_seed"]),
        )

    def view(self, meta: Json) -> View:
        """The view of a photo."""
        return View.load(self.path / "views" / str(meta["view"]))

    def camera(self, name: str) -> Camera:
        """One of its cameras. Raises InputError."""
        path = self.path / "cameras" / f"{name}.safetensors"
        with safe_open(path, "pt") as file:
            recipe = CameraRecipe.model_validate_json(file.metadata()["recipe"])
            names = ("height_map", "amplitude")
            height, amplitude = (file.get_tensor(n) if n in set(file.keys()) else None for n in names)
        made = Camera.from_recipe(recipe, shipped_folder("scenes") / "cameras")
        return made.with_height(height).with_amplitude(amplitude)


def _without_mask(camera: Camera) -> Json:
    """What a camera's recipe says, but for its names, its mask, and how PSFs are computed."""
    left_out = {"name": True, "purpose": True, "mask": True, "psf": True, "sensor": {"saturation"}}
    return camera.recipe.model_dump(exclude=left_out)
