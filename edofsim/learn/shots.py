"""Photos of views for training: each time anew, or once, and kept."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..capture import Fidelity, capture
from ..capture.blurring import Blurring
from ..capture.crop import crop
from ..capture.occlusion import OCCLUSIONS
from ..capture.photograph import glare_of
from ..capture.prepare import channel_weights, depth_nodes
from ..core.sources import code_of_rooms
from ..core.store import Store, user_folder
from ..optics import Camera, PsfField
from ..optics import cache as bank_cache
from ..optics.fabrication import unscattered_fraction
from ..render.view import View
from ..restore.light import with_other_glare
from .training_camera import StoredPsfs, TrainingCamera

if TYPE_CHECKING:
    from .views import Views


@dataclass(frozen=True)
class Shot:
    """A view's photo: clean, ideal as of `Captured`, [3, y, x], not clipped; truncated: scalar."""

    clean: Tensor
    ideal: Tensor
    truncated: Tensor

    @property
    def height(self) -> int:
        return self.clean.shape[-2]

    @property
    def width(self) -> int:
        return self.clean.shape[-1]


def capture_view(view: View, table: Views, optics: TrainingCamera) -> Shot:
    """A view as a source\'s table says; of one of many cameras, with `normalise_depth_range`."""
    if optics.stored is not None:
        part = crop(view, 0, 0, view.height, view.width, optics.window // 2).to(optics.device)
        clean, truncated = by_stored_psfs(part, optics.stored, table.layers, table.occlusion)
        return Shot(clean, part.crop_margin(part.all_in_focus()), truncated.mean())
    camera = _camera(optics.camera, table.bands)
    fidelity = Fidelity(
        layers=table.layers,
        occlusion=table.occlusion,
        sub_apertures=table.sub_apertures,
        window_px=optics.window,
        hidden_surfaces=table.guess,
        field_step_px=0,  # a part is seen from one place
    )
    photo = capture(view, camera, fidelity, device=optics.device)
    return Shot(photo.clean, photo.ideal, photo.truncated)


def by_stored_psfs(view: View, stored: StoredPsfs, layers: int, occlusion: str) -> tuple[Tensor, Tensor]:
    """A view of the three colours whose depths are among those drawn: unexposed photo without noise, [3, y,
    x], and the fraction of light that left the PSFs' window, [3]."""
    nodes = depth_nodes(view.inverse_depth, layers, 0.0)
    psfs = PsfField(stored.at(nodes), nodes, view.wavelengths)
    gap = (stored.drawn[1] - stored.drawn[0]) / stored.widest
    blurring = Blurring(psfs, torch.eye(3, device=stored.values.device), gap)
    image = OCCLUSIONS[occlusion](view, blurring)
    glare, truncated = glare_of(view, blurring)
    return view.crop_margin(image) + glare[:, None, None], truncated


@torch.no_grad()
def captured_once(view: View, table: Views, optics: TrainingCamera, height_noise: float) -> Shot:
    """The view by the mask as designed, its pupil sampled as finely as the nearest of its surfaces asks for.
    Of its light, what errors of fabrication scatter is spread evenly over the photo, as it is in the mean
    over masks: errors of single samples would be smoothed on a finer pupil, and scatter less."""
    recipe = optics.camera.recipe
    psf = recipe.psf.model_copy(update={"pupil_sampling_um": "auto"})
    optics = replace(optics, camera=replace(optics.camera, recipe=recipe.model_copy(update={"psf": psf})))
    key = _shot_key(view, table, optics)
    known = SHOTS.find(key, _folder())
    if known is None:
        known = capture_view(view, table, optics)
        SHOTS.keep(key, known, _folder())
    shot = Shot(*(tensor.to(optics.device) for tensor in (known.clean, known.ideal, known.truncated)))
    if optics.camera.height_map is None:
        return shot
    camera, bands = _camera(optics.camera, table.bands), view.wavelengths.double()
    scattered = 1 - unscattered_fraction(bands, height_noise, camera.mask_material)
    glare = channel_weights(camera, bands).to(scattered) @ scattered
    return replace(shot, clean=with_other_glare(shot.clean, torch.zeros_like(glare), glare))


def _shot_key(view: View, table: Views, optics: TrainingCamera) -> str:
    """SHA-256 of all that decides a photo."""
    how = table.model_dump(mode="json", include={"bands", "layers", "occlusion", "sub_apertures"})
    how |= {"guess": True} if table.guess else {}
    ends = torch.stack(view.inverse_depth.aminmax()).double().cpu()
    psfs = bank_cache.key(optics.camera, view.wavelengths, ends, optics.window, None, torch.float32)
    said = {
        "code": code_of_rooms("capture", "core", "optics"),
        "how": how,
        "psfs": psfs,
        "sensor": optics.camera.recipe.sensor,
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode())
    for field in fields(view):
        value = getattr(view, field.name)
        if isinstance(value, Tensor):
            digest.update(field.name.encode() + value.cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def _folder() -> Path:
    return user_folder() / "training-photos"


def _write_shot(shot: Shot, path: Path) -> None:
    save_file({field.name: getattr(shot, field.name).cpu().contiguous() for field in fields(shot)}, path)


def _read_shot(path: Path) -> Shot:
    return Shot(**load_file(path))


SHOTS = Store("{}.safetensors", _read_shot, _write_shot, most_files=1000)
"""Photos of views that a training takes once: taking them again would cost seconds each."""


def _camera(camera: Camera, bands: str) -> Camera:
    """With three bands each channel sees one of them, as in the paper."""
    if bands == "all":
        return camera
    sensor = camera.recipe.sensor.model_copy(update={"response": "lines"})
    return replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))
