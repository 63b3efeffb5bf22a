"""What is simulated, as one record: every effect of a plan sets a field or two of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch

from ..errors import InputError
from ..optics import Camera
from ..optics.height import design_wavelength
from ..optics.materials import Material
from ..optics.sampling import coarsest_pitch
from ..recipe import CameraRecipe, SceneRecipe
from ..recipe.surfaces import GlassSurface
from ..render.view import View
from . import SensorEffects
from .prepare import blur_per_dioptre

FULL_DB = 70.0
"""The full simulation has so many depth nodes that interpolating between them errs by less than this."""
FULL_PARTS = 6
"""Parts of the pupil along each axis in the full fidelity, where diffraction lets so many be told apart."""
PART_LAYERS = 13
"""Depth nodes at most for what parts of the pupil change."""
FINEST = 2
"""Samples along a pixel's side in the full simulation; a recipe may ask for more."""


@dataclass(frozen=True)
class Fidelity:
    """How a photo is simulated. The defaults leave nothing out that a recipe holds.

    groups: the light of each channel is gathered in so many groups of bands, 0: every band on its own;
    colours: wavelengths at which a group's PSF is computed, 0: all of its bands;
    layers: depth nodes, None: as many as `FULL_DB` asks for;
    occlusion: one of `expose`'s ways; method: likewise; tolerance_db: of `low_rank`;
    pupil_parts: along each axis, that `hidden` composites one by one, in few bands and layers (`in_parts`);
    window: side of the PSFs in pixels, None: the recipe's; oversampling: samples along a pixel's side;
    pupil_um: sampling of the pupil, None: the recipe's, which may be automatic;
    exact_lens, lens_dispersion, doe_dispersion, fabrication, read_noise, shot_noise, quantisation,
    saturation, mosaic: whether the camera has them; margin: pixels around the frame that light comes from,
    None: all that there are.
    """

    groups: int = 0
    colours: int = 0
    layers: int | None = None
    occlusion: str = "hidden"
    pupil_parts: int = 1
    method: str = "layered"
    tolerance_db: float = FULL_DB
    window: int | None = None
    oversampling: int = FINEST
    pupil_um: float | None = None
    exact_lens: bool = True
    lens_dispersion: bool = True
    doe_dispersion: bool = True
    fabrication: bool = True
    read_noise: bool = True
    shot_noise: bool = True
    quantisation: bool = True
    saturation: bool = True
    mosaic: bool = True
    margin: int | None = None
    samples: int | None = None
    bounces: int | None = None
    hidden_pass: bool = True
    glass_dispersion: bool = True

    def __post_init__(self) -> None:
        if self.layers is not None and self.layers < 1:
            raise InputError(f"{self.layers} depth layers: give a whole number of at least 1")

    def changed(self, change: dict[str, object]) -> Fidelity:
        """The same but for some fields."""
        return replace(self, **change)


def full_fidelity(camera: Camera, view: View) -> Fidelity:
    """Everything that a camera and a view have."""
    known = "hidden" if bool(view.hidden.any()) else "normalised"
    occlusion = known if edge_pixels(view, 1 / blur_per_dioptre(camera)) else "none"
    parts = parts_told_apart(camera, view) if occlusion == "hidden" else 1
    finest = max(FINEST, camera.recipe.psf.oversampling)
    return Fidelity(oversampling=finest, occlusion=occlusion, pupil_parts=parts)


def parts_told_apart(camera: Camera, view: View) -> int:
    """Parts of the pupil along each axis that a full simulation has, 1 where they would have nothing to tell.

    Surfaces that are D apart in inverse depth are moved against each other, from one part of width w to the
    next, by w D times the distance of the sensor, and diffraction at a part spreads light by wavelength / w
    times it: parts are no narrower than sqrt(wavelength / D). Two along an axis are no better than one, as
    their windows overlap by half of the pupil.
    """
    low, high = (float(end) for end in view.inverse_depth.double().aminmax())
    wavelength = camera.recipe.focus.wavelength_nm * 1e-9
    across = math.floor(2 * camera.aperture_radius * math.sqrt((high - low) / wavelength))
    return min(across, FULL_PARTS) if across > 2 else 1


def in_parts(fidelity: Fidelity) -> Fidelity:
    """What parts of the pupil change in a photo is simulated so: in one group of bands a channel and few
    layers, whatever the photo itself has. It is a small part of the photo, and costs a composite each."""
    layers = PART_LAYERS if fidelity.layers is None else min(fidelity.layers, PART_LAYERS)
    colours = 1 if (fidelity.groups, fidelity.colours) == (1, 1) else 2
    return replace(fidelity, groups=1, colours=colours, layers=layers, method="layered")


def edge_pixels(view: View, gap: float) -> int:
    """Pixels that see two surfaces, or whose neighbour below or to the right is nearer or farther by `gap`
    (1/m), where blurs begin to differ."""
    rows, columns = view.padded_shape
    seen = torch.bincount(view.pixel[~view.hidden], minlength=rows * columns).reshape(rows, columns)
    edge = seen > 1
    depth = view.mean_inverse_depth()
    edge[1:] |= (depth[1:] - depth[:-1]).abs() > gap
    edge[:, 1:] |= (depth[:, 1:] - depth[:, :-1]).abs() > gap
    return int(edge.sum())


def pupil_is_free(camera: Camera) -> bool:
    """Whether the pupil's sampling is ours to choose: neither recipe nor squares of a made mask say."""
    recipe = camera.recipe
    made = recipe.fabrication is not None and recipe.fabrication.pitch_um is not None
    return recipe.psf.pupil_sampling_um == "auto" and not made


def coarsest_pupil_um(camera: Camera, wavelengths: torch.Tensor, inverse_depths: torch.Tensor) -> float:
    """The coarsest pitch in micrometres that the bound on defocus and the replicas of the PSF allow."""
    return coarsest_pitch(camera, wavelengths, inverse_depths, camera.recipe.psf.window_px) * 1e6


def simpler_camera(camera: Camera, fidelity: Fidelity) -> Camera:
    """The camera without what is left out."""
    recipe = camera.recipe
    at = recipe.focus.wavelength_nm * 1e-9
    glass, relief = camera.glass, camera.mask_material
    changes: dict[str, object] = {}
    if not fidelity.exact_lens:
        changes["lens"] = recipe.lens.model_copy(update={"thickness": "parabolic"})
    if not fidelity.lens_dispersion:
        glass = _without_dispersion(glass, at)
        lens = changes.get("lens", recipe.lens)
        changes["lens"] = lens.model_copy(update={"material": glass.name})
    if not fidelity.doe_dispersion:
        relief = _without_dispersion(relief, design_wavelength(camera))
        if hasattr(recipe.mask, "material"):
            changes["mask"] = recipe.mask.model_copy(update={"material": relief.name})
    if not fidelity.fabrication:
        changes["fabrication"] = None
    psf: dict[str, object] = {"oversampling": fidelity.oversampling}
    # without dispersion a lens may be farther out of focus, and need a finer pupil than was found for it
    if fidelity.pupil_um is not None and pupil_is_free(camera) and fidelity.lens_dispersion:
        psf["pupil_sampling_um"] = fidelity.pupil_um
    changes["psf"] = recipe.psf.model_copy(update=psf)
    changed: CameraRecipe = recipe.model_copy(update=changes)
    return replace(camera, recipe=changed, glass=glass, mask_material=relief)


def simpler_recipe(recipe: SceneRecipe, fidelity: Fidelity) -> SceneRecipe:
    """The scene recipe without what is left out of rendering."""
    render: dict[str, object] = {}
    if fidelity.samples is not None:
        render["samples"] = min(fidelity.samples, recipe.render.samples)
    if fidelity.bounces is not None:
        render["max_depth"] = min(fidelity.bounces, recipe.render.max_depth)
    if not fidelity.hidden_pass:
        render["hidden"] = False
    changes: dict[str, object] = {}
    if render:
        changes["render"] = recipe.render.model_copy(update=render)
    if fidelity.margin is not None and fidelity.margin < recipe.frame.margin_px:
        changes["frame"] = recipe.frame.model_copy(update={"margin_px": fidelity.margin})
    if not fidelity.glass_dispersion:
        changes["objects"] = tuple(_of_plain_glass(thing) for thing in recipe.objects)
    return recipe.model_copy(update=changes) if changes else recipe


def disperses(recipe: SceneRecipe) -> tuple[str, ...]:
    """Names of the objects whose glass bends each wavelength differently."""
    return tuple(thing.name for thing in recipe.objects if _of_plain_glass(thing) is not thing)


def _of_plain_glass(thing: Any) -> Any:
    surfaces = {
        name: value.model_copy(update={"dispersion": False})
        for name, value in thing
        if isinstance(value, GlassSurface) and value.dispersion
    }
    return thing.model_copy(update=surfaces) if surfaces else thing


def _without_dispersion(material: Material, wavelength: float) -> Material:
    """Another name for another glass: PSFs are remembered by it."""
    index = float(material.index(wavelength))
    name = f"{material.name} as at {wavelength * 1e9:g} nm"
    return Material(name, material.source, material.shortest, material.longest, cauchy=(index, 0.0, 0.0))


def sensor_effects(camera: Camera, fidelity: Fidelity) -> SensorEffects:
    """What the sensor does, without what is left out."""
    sensor = camera.recipe.sensor
    return SensorEffects(
        saturation=sensor.saturation and fidelity.saturation,
        full_well=sensor.full_well_electrons if fidelity.shot_noise else None,
        read_noise=sensor.read_noise if fidelity.read_noise else 0.0,
        bits=sensor.bits if fidelity.quantisation else None,
        bayer=sensor.bayer if fidelity.mosaic else None,
    )
