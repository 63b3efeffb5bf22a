"""Photos taken anew, of views that are kept, each time that they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from ..capture.depth_edges import edge_distance
from ..capture.framing import seen_through
from ..core.json_values import Json
from ..recipe.dataset import DatasetRecipe
from ..recipe.load import Loaded
from ..recipe.toml import validate
from ..render import render
from .pairs import Pair
from .parts import Work, understood
from .taken import expose, sensor_image


class Live(IterableDataset[Pair]):
    """Pairs of `work`, photographed anew in each epoch; see `live`. Set `epoch` before each."""

    def __init__(self, work: Work, cache: Path | None = None) -> None:
        self.work, self.cache, self.epoch = work, cache, 0
        self.shots = [
            (part, camera, frame)
            for part in work.parts
            for camera, frame in zip(work.cameras(part), work.frames(part), strict=True)
        ]
        for part, _, frame in self.shots:  # before any worker starts: they read them
            render(frame, part.scene.base, cache=cache)

    def __len__(self) -> int:
        return len(self.shots)

    def __iter__(self) -> Iterator[Pair]:
        info, recipe = get_worker_info(), self.work.recipe
        mine, count = (0, 1) if info is None else (info.id, info.num_workers)
        order = np.random.default_rng([recipe.seed, self.epoch]).permutation(len(self.shots))
        for number in order[mine::count]:
            part, camera, frame = self.shots[number]
            view = seen_through(camera, frame, render(frame, part.scene.base, cache=self.cache))[1]
            key = f"{part.name}_{camera.recipe.name}_{self.epoch}"
            exposed = expose(view, camera, recipe, key)
            photo = sensor_image(exposed, recipe, f"{key}_0")[0]
            images = {"photo": photo, "clean": exposed.photo.clean, "ideal": exposed.photo.ideal}
            planes = {"inverse_depth": view.crop_margin(view.mean_inverse_depth())}
            planes["edge_px"] = torch.as_tensor(edge_distance(view, camera))
            found: Pair = {name: each.detach().cpu().float() for name, each in (images | planes).items()}
            yield {"key": key, "camera": str(camera.recipe.name), **found}


def live(
    families: Sequence[str],
    cameras: Sequence[str],
    *,
    members: int = 8,
    size: tuple[int, int] = (256, 256),
    photos: Json | None = None,
    seed: int = 0,
    cache: Path | None = None,
) -> Live:
    """A PyTorch data set whose photos are new in each epoch: other exposures and noise of the same views.

    families: scene recipes, files or shipped names, of each of which there are `members`.
    cameras: that photograph each member, files or shipped names.
    members: of each family; 0: the scenes themselves.
    size: rows and columns of the frame, pixels.
    photos: what varies, as the table `photos` of a dataset recipe: `exposure`, `read_noise`, `fidelity`.
    seed: of members' order, exposures and noise, together with the data set's `epoch`.
    cache: folder of views, None for the default one. Views are rendered here, at once.

    Returns pairs as `Pairs` does, one after another, a worker of a loader its share. Raises InputError for
    scenes and cameras that cannot be used.
    """
    asked: Json = {
        "name": "live",
        "seed": seed,
        "scenes": [{"recipe": str(name), "members": members} for name in families],
        "cameras": [str(name) for name in cameras],
        "frame": {"height_px": size[0], "width_px": size[1]},
        "photos": photos or {},
    }
    recipe = validate(DatasetRecipe, asked)
    return Live(understood(Loaded(recipe, Path.cwd() / "live", "")), cache)
