"""The systems of the paper's comparisons: an aperture with what restores its photos."""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ..optics import PAPER_COLOURS, Camera
from ..optics import cache as bank_cache
from ..recipe.fabrication import Fabrication
from ..recipe.load import load_camera
from ..restore import wiener
from ..restore.checkpoint import comparison_checkpoints, comparisons_left_out, shipped_checkpoints
from ..restore.light import without_glare
from .failures import Failures
from .restorations import Restoration, known_of
from .sources import WITHOUT_TRAINING, one_of_each, system_of
from .training import Training

LOG = logging.getLogger(__name__)
READ_NOISE = 0.005
NEAREST_PER_M = 2.0


@dataclass(frozen=True)
class EvaluatedSystem:
    """A system for photos of planes.

    camera: with the mask as designed.
    restore: a photo [3, y, x] and the part of its light that is veiling glare [3] to [3, y, x], as
        everybody's photos are restored.
    digest: SHA-256 of what it consists of.
    training: None where nothing was trained.
    at: in place of `restore` with the plane's inverse depth in 1/m as well, for what may know it.
    """

    name: str
    camera: Camera
    restore: Callable[[Tensor, Tensor], Tensor]
    digest: str
    training: Training | None = None
    at: Callable[[Tensor, Tensor, float], Tensor] | None = None

    def restored(self, photo: Tensor, glare: Tensor, inverse_depth: float) -> Tensor:
        """What it makes of the photo of a plane.

        photo: [3, y, x], full scale 1.
        glare: [3], part of the light.
        """
        return self.at(photo, glare, inverse_depth) if self.at else self.restore(photo, glare)


def evaluated_systems(
    names: Sequence[str | Path] | None, *, every: bool = False, camera: str | None = None
) -> list[EvaluatedSystem]:
    """Systems as `system_of` names them; None for all that ship, with the clear and the cubic aperture, and
    with `every` also those that were trained for comparison.

    camera: of what names none, default the paper's with a clear aperture.

    Raises InputError for what is no system, and for two systems of one name.
    """
    found, failures = usable_systems(names, every=every, camera=camera)
    failures.check(0)
    return found


def usable_systems(
    names: Sequence[str | Path] | None, *, every: bool = False, camera: str | None = None
) -> tuple[list[EvaluatedSystem], Failures]:
    """The same, and what is wrong with those that are none. Raises InputError where all are."""
    trained = shipped_checkpoints() | (comparison_checkpoints() if every else {})
    if every and not names and (left_out := comparisons_left_out()):
        LOG.warning("%s", left_out)
    found: list[EvaluatedSystem] = []
    failures = Failures()
    for name in names or (*trained, *WITHOUT_TRAINING):
        with failures.of(str(name)):
            found.append(evaluated_system(name, camera=camera))
    failures.check(len(found))
    one_of_each([system.name for system in found])
    return found, failures


def evaluated_system(
    source: str | Path, wavelengths: Tensor | None = None, *, camera: str | None = None
) -> EvaluatedSystem:
    """A system (see `system_of`) for photos of planes.

    wavelengths: [band] in metres, that the sensor adds up to its colours; None for the three of the paper's
        training.
    camera: of a restoration without one, a recipe; None for the paper's with a clear aperture.

    The default sampling of PSFs is used for the camera of a checkpoint. Raises InputError for what is no
    system.
    """
    system = system_of(source)
    default = load_camera(camera or WITHOUT_TRAINING[0])
    optics = system.camera(default if camera else None, default)
    name = system.name if system.names_camera else f"{optics.recipe.name}+{system.name}"
    found = with_restoration(name, optics, system.restoration, wavelengths)
    return replace(found, training=system.training)


def with_restoration(
    name: str,
    camera: Camera,
    restoration: Restoration,
    wavelengths: Tensor | None = None,
    nearest_per_m: float = NEAREST_PER_M,
) -> EvaluatedSystem:
    """What restores photos of planes by a camera, for a range of inverse depths from 0 to `nearest_per_m`.

    wavelengths: [band], metres, as in `evaluated_system`.
    """
    digest = hashlib.sha256(f"{camera_digest(camera)} {restoration.digest}".encode()).hexdigest()
    seeing = camera.with_read_noise(READ_NOISE)
    if wavelengths is None:
        seeing = of_three_lines(seeing)
    bands = PAPER_COLOURS if wavelengths is None else wavelengths
    none = torch.zeros(3)  # the glare has what leaves the windows
    whole = known_of(seeing, bands, torch.tensor([0.0, nearest_per_m]), none, none, none)

    def restore_at(photo: Tensor, glare: Tensor, inverse_depth: float) -> Tensor:
        true = torch.full(photo.shape[-2:], inverse_depth)
        return restoration(photo, replace(whole, glare=glare, inverse_depth=true)).clamp(0, 1)

    def restore(photo: Tensor, glare: Tensor) -> Tensor:
        return restore_at(photo, glare, math.nan)

    return EvaluatedSystem(name, camera, restore, digest, at=restore_at)


def camera_digest(camera: Camera) -> str:
    """SHA-256 of everything that a camera's photos depend on, the files of its recipe by their content."""
    bank = bank_cache.key(camera, PAPER_COLOURS, torch.zeros(1), 0, None, torch.float32)
    digest = hashlib.sha256(bank.encode() + camera.recipe.sensor.model_dump_json().encode())
    table = camera.base / camera.recipe.sensor.response
    if table.is_file():
        digest.update(table.read_bytes())
    return digest.hexdigest()


def of_three_lines(camera: Camera) -> Camera:
    """The same camera with a sensor whose colours are three wavelengths."""
    sensor = camera.recipe.sensor.model_copy(update={"response": "lines"})
    return replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))


def made(camera: Camera, fabrication: Fabrication) -> Camera:
    """The camera with its mask as it is made. Masks without a height map have nothing to make."""
    if not hasattr(camera.recipe.mask, "design_wavelength_nm"):
        return camera
    return replace(camera, recipe=camera.recipe.model_copy(update={"fabrication": fabrication}))


def paper_test(seed: int) -> Fabrication:
    """A mask as the paper tests it: at 3 um, with a height error of 30 nm."""
    return Fabrication(preset="paper-test", seed=fabrication_seed(seed))


def fabrication_seed(seed: int) -> int:
    """The 31 bits of a seed that a fabrication has."""
    return seed % 2**31


def described(fabrication: Fabrication) -> str:
    """A fabrication as text, for keys."""
    return json.dumps(fabrication.model_dump(mode="json"), sort_keys=True)


def filtered(photo: Tensor, stack: Tensor, glare: Tensor) -> Tensor:
    """A photo [3, y, x], of whose light the part `glare` [3] is veiling glare, after Wiener deconvolution by
    PSFs [depth, 3, y, x] of depths that are equally likely, in [0, 1].

    photo: [3, y, x], full scale 1.
    stack: [depth, 3, y, x].
    glare: [3], part of the light.
    """
    within = (stack / stack.sum((-1, -2), keepdim=True)).to(photo)
    return wiener(without_glare(photo, glare), within, READ_NOISE).clamp(0, 1)


def truncated_share(psf: Tensor) -> Tensor:
    """The part of the light that the window of PSFs [.., y, x] truncates, [..]: it is veiling glare. That of
    a made mask is nearly the same whatever its errors are drawn like: how finely it is made decides it, which
    is known of a camera.

    psf: [..., y, x].
    """
    return 1 - psf.sum((-1, -2))
