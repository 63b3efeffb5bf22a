"""A reference photo of a part of a scene, by name."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ..capture.band_groups import gathered_view
from ..capture.checks import check_pixel_angle
from ..capture.fidelity import Fidelity
from ..capture.imaging import gathering_of
from ..capture.photograph import axes_of
from ..capture.prepare import channel_weights
from ..core.progress import Progress
from ..errors import InputError
from ..optics import Camera
from ..optics.camera import focus_distance
from ..optics.masks.clear import ClearMask
from ..recipe import SceneRecipe
from ..render.view import View
from ..scene import build_scene
from .clipped_pupil import check_crop, clipped_pupil
from .pinhole import Crop
from .thin_lens import thin_lens

THIN_LENS, PUPIL = "thinlens", "pupil"
REFERENCES = (THIN_LENS, PUPIL)


def crop_of(text: str) -> Crop:
    """`X,Y,WIDTH,HEIGHT` in pixels from the frame's top left corner. Raises InputError for anything else."""
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--crop {text}: give X,Y,WIDTH,HEIGHT in whole pixels, such as 200,150,64,64"
        ) from None
    return Crop(top, left, height, width)


def check_reference(name: str, camera: Camera) -> None:
    """Refuse what a reference cannot show. Raises InputError."""
    if name not in REFERENCES:
        raise InputError(f"reference {name!r} is not known: choose one of {', '.join(REFERENCES)}")
    if name == THIN_LENS and not isinstance(camera.recipe.mask, ClearMask):
        raise InputError(
            f"the thin lens is geometric and has no mask, and {camera.recipe.name} has a "
            f"{camera.recipe.mask.kind} mask: use --reference pupil, or --camera paper-clear"
        )


def reference_photo(
    name: str,
    view: View,
    recipe: SceneRecipe,
    base: Path,
    camera: Camera,
    where: Crop,
    *,
    groups: int | None = None,
    samples: int = 1024,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Tensor:
    """Noise-free, unexposed photo of a part of the frame: [channel, y, x], float64.

    name: one of `REFERENCES`.
    view: of the recipe's scene. The pupil takes the light of the view; the thin lens renders, with `samples`
        a pixel.
    groups: that the pupil gathers each channel's bands in, as photos do, each with the PSFs of its mean
        wavelength; None for every band.

    The thin lens always has every band. Raises InputError for a crop outside the frame, and for what the
    reference cannot show.
    """
    check_reference(name, camera)
    check_crop(view, where)
    check_pixel_angle(view, camera.pixel_angle)
    model = build_scene(recipe, base)
    if name == PUPIL:
        how = {"cache": cache, "device": device, "progress": progress}
        if groups is None:
            return clipped_pupil(view, model, camera, where, **how)
        weights = channel_weights(camera, view.wavelengths)
        fidelity = Fidelity(band_groups=groups, group_wavelengths=1)
        gathering = gathering_of(camera, fidelity, axes_of([view], camera, fidelity, weights))
        light, response = gathered_view(view, gathering), gathering.response
        return clipped_pupil(light, model, camera, where, response=response, **how)
    image = thin_lens(
        model,
        view,
        where,
        aperture_radius=camera.aperture_radius,
        focus_distances=focus_distance(camera, view.wavelengths).tolist(),
        samples=samples,
        max_depth=recipe.render.max_depth,
        seed=recipe.seed,
        device=device,
        progress=progress,
    )
    return torch.einsum("cb,byx->cyx", channel_weights(camera, view.wavelengths), image)
