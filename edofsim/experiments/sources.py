"""Where the systems of a comparison come from: what users type after `--system`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..optics import Camera
from ..recipe.camera import CameraRecipe
from ..recipe.load import Loaded, load_camera, shipped, shipped_folder
from ..restore import usual_network
from ..restore.checkpoint import (
    Checkpoint,
    camera_with_mask,
    find_checkpoint,
    fits,
    load_checkpoint,
    trained_camera,
)
from ..restore.functions import names_function
from .restorations import WITHOUT_WEIGHTS, ByNetwork, ByWiener, Restoration, digest_of, restoration
from .training import Training, training_of

WITHOUT_TRAINING = ("paper-clear", "paper-cubic")
"""Shipped cameras that Wiener deconvolution restores, unless something else is named."""
WIDEST_SHIPPED_PX = 128
"""The default window of PSFs, that networks are judged with unless they were trained with a wider one."""


@dataclass(frozen=True)
class Source:
    """A system as it was typed.

    name: in figures.
    own: the camera's recipe, None where none is named.
    mask: the checkpoint whose mask the camera has.
    """

    name: str
    restoration: Restoration
    own: Loaded[CameraRecipe] | None = None
    mask: Checkpoint | None = None

    @property
    def names_camera(self) -> bool:
        """Whether it has a camera of its own."""
        return self.own is not None or self.mask is not None

    @property
    def training(self) -> Training | None:
        """Of its network; None where nothing was trained."""
        by = self.restoration
        return training_of(by.checkpoint.card) if isinstance(by, ByNetwork) else None

    def camera(
        self, given: Loaded[CameraRecipe] | None, default: Loaded[CameraRecipe] | None = None
    ) -> Camera:
        """Its camera, with the mask as designed.

        given: what photographs otherwise, and in which the mask of a checkpoint is put if that was trained
            for such a lens.
        default: in place of `given` for a system without a camera, which needs one of them.

        Raises InputError as `Camera.from_recipe` does.
        """
        if self.own is not None:
            return Camera.from_recipe(self.own.recipe, self.own.base)
        if self.mask is None:
            known = given or default
            assert known is not None
            return Camera.from_recipe(known.recipe, known.base)
        if given is not None and fits(self.mask, given.recipe):
            return camera_with_mask(given.recipe, self.mask, given.base)
        trained = trained_camera(self.mask)
        psf = CameraRecipe(name="default").psf
        window = max(WIDEST_SHIPPED_PX, trained.psf.window_px)
        recipe = trained.model_copy(update={"psf": psf.model_copy(update={"window_px": window})})
        return camera_with_mask(recipe, self.mask)


def system_of(text: str | Path) -> Source:
    """A system as typed: what restores, a camera, or both as CAMERA+RESTORATION.

    What restores: a checkpoint (file or shipped name), which with a mask is a camera as well; `wiener`;
    `wiener-depth`, which knows the distance of each pixel; a function, `module:function` or
    `file.py:function`. A camera: a recipe or a shipped name, which is restored by its usual network; a
    checkpoint, for its mask. Raises InputError for anything else.
    """
    source = str(text)
    camera, plus, by = source.rpartition("+")
    if plus and camera and by and not Path(source).exists():
        return _both(camera, by)
    if _is_camera(source):
        loaded = load_camera(source)
        usual = None if source in WITHOUT_TRAINING else usual_network(loaded)
        chosen = ByWiener() if usual is None else ByNetwork(usual, digest_of(usual.path or usual.name))
        return Source(f"{loaded.recipe.name}+{chosen.name}", chosen, loaded)
    found = _restoration(source)
    network = found.checkpoint if isinstance(found, ByNetwork) and not found.any_camera else None
    return Source(found.name, found, None, network)


def systems_of_all(texts: Sequence[str]) -> list[Source]:
    """`system_of` each. Raises InputError for two of one name."""
    found = [system_of(text) for text in dict.fromkeys(texts)]
    one_of_each([each.name for each in found])
    return found


def one_of_each(names: Sequence[str]) -> None:
    """Raise InputError for a name that is there twice."""
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise InputError(f"two systems are called {twice[0]!r}; rename one, or evaluate them in two --out")


def _both(camera: str, by: str) -> Source:
    found = restoration(by)
    if _is_camera(camera):
        loaded = load_camera(camera)
        if isinstance(found, ByNetwork):
            load_checkpoint(by, loaded.recipe)  # refuses another lens
        return Source(f"{loaded.recipe.name}+{found.name}", found, loaded)
    checkpoint = load_checkpoint(camera)
    return Source(f"{checkpoint.name}+{found.name}", found, None, checkpoint)


def _is_camera(source: str) -> bool:
    return source.endswith(".toml") or source in shipped(shipped_folder("scenes") / "cameras")


def _restoration(source: str) -> Restoration:
    if source not in WITHOUT_WEIGHTS and not names_function(source):
        try:
            find_checkpoint(source)
        except InputError as error:
            raise InputError(
                f"{error.problems[0]}. A system is also wiener, wiener-depth, a camera recipe, a function as "
                "module:function or file.py:function, or CAMERA+RESTORATION"
            ) from None
    return restoration(source)
