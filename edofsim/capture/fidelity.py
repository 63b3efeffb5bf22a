"""What is simulated, and how finely, as one record: every effect of a plan sets a field or two of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import NamedTuple, TypeVar, cast

import torch
from pydantic import BaseModel

from ..errors import InputError
from ..optics import Camera
from ..optics.height import design_wavelength
from ..optics.materials import Material
from ..optics.sampling import sampled_alike
from ..recipe import CameraRecipe, SceneRecipe
from ..recipe.surfaces import GlassSurface
from ..render.view import View
from .fidelity_file import read_fidelity, write_fidelity
from .prepare import blur_per_dioptre

FULL_DB = 70.0
"""The full simulation has enough depth nodes that interpolating between them errs by less than this."""
FULL_SUB_APERTURES = 6
"""Sub-apertures along each axis in the full simulation, where diffraction lets them be distinguished."""
SUB_APERTURE_LAYERS = 13
"""Depth nodes for what sub-apertures change, unless the blur changes so much that it asks for more."""
COARSE_LAYERS = 9
"""The same where that is found in pixels of more than one."""
SUB_APERTURE_STEP_PX = 8.0
"""Change of the blur's diameter from one of these nodes to the next, at most. Leaves through 35 mm at f/4
with a cubic mask came within 49 dB with 9 nodes, whose steps were 22 pixels, and come within 60."""
MOST_SUB_APERTURE_LAYERS = 25
"""All PSFs of all sub-apertures are held at once."""
MOST_LAYERS = 4096
"""Depth nodes that a photo can be asked for; 475 are the depths of the paper's scene."""
FINEST = 2
"""Samples along a pixel's side in the full simulation; a recipe may ask for more."""


RENDERED = ("samples", "bounces", "scene_dispersion")
"""Fields of a `Fidelity` for rendering alone, see `simpler_recipe`: no photo of a view can have them."""

T = TypeVar("T")
Model = TypeVar("Model", bound=BaseModel)


def _knob(default: T, effect: str, unit: str, meaning: str) -> T:
    """A field of `Fidelity`: which effect of a plan it belongs to, its unit, what it means to leave it
    out."""
    return field(default=default, metadata={"effect": effect, "unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class Simplification:
    """Something of a camera that is left out, for effects that other packages add.

    apply: the camera without it; a function of a module, distinguished from others by its name.
    """

    name: str
    apply: Callable[[Camera], Camera] = field(repr=False, compare=False)


@dataclass(frozen=True)
class Fidelity:
    """How a photo is simulated. The defaults leave nothing out that recipe and view hold, but that the pupil
    is taken as a whole. Where a view does not hold what lies behind its edges, that is guessed: continued
    from their surroundings.

    `describe` lists the fields with unit, default and meaning. Read-only; `changed` gives another one. Raises
    InputError for values that no photo can be simulated with.
    """

    band_groups: int = _knob(
        0,
        "bands",
        "1",
        "groups that each channel's bands are gathered in, each blurred once; 0: every band",
    )
    group_wavelengths: int = _knob(
        0, "bands", "1", "wavelengths at which the PSF of a group is computed; 0: all of its bands"
    )
    layers: int | None = _knob(
        None, "depth layers", "1", "depth nodes, light between them is shared; None: as `layers_db` asks for"
    )
    occlusion: str = _knob(
        "hidden", "occlusion", "", "`none` adds all light; `over`, `normalised` know visible surfaces only"
    )
    sub_apertures: int = _knob(
        1,
        "sub-apertures",
        "1",
        "along each axis of the pupil, composited one by one at depth edges; 1: the whole",
    )
    sub_aperture_pixel: int = _knob(
        1,
        "sub-apertures",
        "px",
        "side of the pixels in which their change is found; above 1 with fewer nodes and wavelengths",
    )
    layers_db: float = _knob(
        FULL_DB, "depth layers", "dB", "PSNR that depth nodes keep where `layers` is None"
    )
    field_step_px: int | None = _knob(
        None,
        "field dependence",
        "px",
        "between places with PSFs of their own, of a lens that varies; None: by `layers_db`; 0: one place",
    )
    field_terms: bool = _knob(
        True,
        "field dependence",
        "",
        "PSFs of places are sums of few kernels, with weights for each source; False: each place has its own",
    )
    window_px: int | None = _knob(
        None, "PSF window", "px", "side of the PSFs, light beyond is veiling glare; None: the recipe's"
    )
    oversampling: int | None = _knob(
        None,
        "pixel integration",
        "1",
        "samples along a pixel's side that PSFs are summed over; None: the recipe's",
    )
    pupil_sampling_um: float | None = _knob(
        None, "pupil sampling", "um", "pitch of the pupil where the recipe leaves it free; None: the recipe's"
    )
    spherical_aberration: bool = _knob(
        True, "spherical aberration", "", "False: the lens has the phase of a parabola"
    )
    lens_dispersion: bool = _knob(
        True, "dispersion of the lens", "", "False: the lens has one index for all wavelengths"
    )
    doe_dispersion: bool = _knob(
        True, "dispersion of the DOE", "", "False: the DOE has one index for all wavelengths"
    )
    fabrication: bool = _knob(True, "fabrication error", "", "False: the mask is as designed")
    read_noise: bool = _knob(True, "read noise", "", "False: the sensor is read without noise")
    shot_noise: bool = _knob(True, "shot noise", "", "False: light is not counted in electrons")
    quantisation: bool = _knob(
        True, "quantisation", "", "False: values are not rounded to the converter's bits"
    )
    saturation: bool = _knob(True, "saturation", "", "False: pixels hold more than full scale")
    mosaic: bool = _knob(True, "Bayer mosaic", "", "False: every pixel sees every channel")
    margin_px: int | None = _knob(
        None,
        "light from outside",
        "px",
        "around the frame that light comes from; None: all that the view has",
    )
    samples: int | None = _knob(
        None, "render samples", "1", "rays a pixel when the view is rendered; None: the recipe's"
    )
    bounces: int | None = _knob(
        None, "interreflection", "1", "length of light paths when it is rendered; None: the recipe's"
    )
    hidden_surfaces: bool = _knob(
        True, "hidden surfaces", "", "False: what lies behind edges is neither rendered nor guessed"
    )
    scene_dispersion: bool = _knob(
        True, "dispersion of scene glass", "", "False: glass in the scene bends all wavelengths alike"
    )
    without_sensor: tuple[str, ...] = _knob(
        (), "", "", "kinds of the sensor's effects, of those in `sensor.effects`, that are left out"
    )
    simplifications: tuple[Simplification, ...] = _knob(
        (), "", "", "what else is left out of the camera, by effects of other packages"
    )

    def __post_init__(self) -> None:
        problems = []
        if self.layers is not None and not 1 <= self.layers <= MOST_LAYERS:
            problems.append(f"{self.layers} depth layers: give a whole number from 1 to {MOST_LAYERS}")
        if self.sub_aperture_pixel < 1:
            problems.append(
                f"sub_aperture_pixel = {self.sub_aperture_pixel}: give a whole number of at least 1"
            )
        if self.sub_apertures < 1:
            problems.append(f"{self.sub_apertures} sub-apertures: give a whole number of at least 1")
        if self.field_step_px is not None and self.field_step_px < 0:
            problems.append(f"field_step_px = {self.field_step_px}: give a whole number of at least 0")
        if not self.layers_db > 0:
            problems.append(f"layers_db = {self.layers_db}: give a positive number of decibels")
        if problems:
            raise InputError(problems)

    @property
    def uncovers(self) -> bool:
        """Whether what lies behind edges is composited."""
        return self.occlusion == "hidden" and self.hidden_surfaces

    def changed(self, change: Mapping[str, object]) -> Fidelity:
        """The same but for some fields; simplifications and kinds are added to those that are there.

        change: values by field.
        """
        change = dict(change)
        for name in ("simplifications", "without_sensor"):
            if name in change:
                change[name] = (*getattr(self, name), *cast(tuple[object, ...], change[name]))
        return replace(self, **change)

    def of_photo(self) -> Fidelity:
        """The same without what rendering alone knows, `RENDERED`: how a rendered view is photographed."""
        return replace(self, **{name: getattr(Fidelity, name) for name in RENDERED})

    def save(self, path: str | Path) -> Path:
        """Write all fields as JSON. Returns the path; raises InputError where it cannot be written."""
        return write_fidelity(Path(path), self)

    @staticmethod
    def load(path: str | Path) -> Fidelity:
        """The fidelity of a file that `save`, `edofsim run --json` or `edofsim plan --json` wrote, or of TOML
        with these fields. Raises InputError, naming every field, for what is no fidelity."""
        return read_fidelity(Path(path), Fidelity)


class Knob(NamedTuple):
    """A field of `Fidelity`, described."""

    name: str
    default: object
    effect: str
    unit: str
    meaning: str


def describe() -> tuple[Knob, ...]:
    """All fields of `Fidelity` with default, the effect of a plan that sets them, unit and meaning."""
    return tuple(Knob(each.name, each.default, **each.metadata) for each in fields(Fidelity))


def full_fidelity(camera: Camera, view: View, edges: int | None = None) -> Fidelity:
    """Everything that a camera and a view have.

    edges: its `edge_pixels`, where they are known.
    """
    edges = edge_pixels(view, 1 / blur_per_dioptre(camera)) if edges is None else edges
    occlusion = "hidden" if edges else "none"
    across = resolved_sub_apertures(camera, view) if occlusion == "hidden" else 1
    finest = max(FINEST, camera.oversampling(float(view.wavelengths.min())))
    return Fidelity(oversampling=finest, occlusion=occlusion, sub_apertures=across)


def resolved_sub_apertures(camera: Camera, view: View) -> int:
    """Sub-apertures along each axis of the pupil that a full simulation has, 1 where they would have nothing
    to tell.

    Surfaces that are D apart in inverse depth are moved against each other, from one sub-aperture of width w
    to the next, by w D times the distance of the sensor, and diffraction at it spreads light by wavelength /
    w times that distance: sub-apertures are no narrower than sqrt(wavelength / D). Two along an axis are no
    better than one, as their windows overlap by half of the pupil.
    """
    if camera.lens.measured:  # of its pupil nothing is known
        return 1
    low, high = (float(end) for end in view.inverse_depth.double().aminmax())
    wavelength = camera.recipe.focus.wavelength_nm * 1e-9
    across = math.floor(2 * camera.aperture_radius * math.sqrt((high - low) / wavelength))
    return min(across, FULL_SUB_APERTURES) if across > 2 else 1


def of_sub_apertures(fidelity: Fidelity, camera: Camera, span: float) -> Fidelity:
    """How that which sub-apertures change in a photo is simulated: in one group of bands a channel and few
    layers, whatever the photo itself has. It is a small part of the photo, and costs a composite each. In
    coarse pixels it has fewer layers and wavelengths, too, but for a mask that is wrapped as it is made: its
    blur is another one a few nanometres on. Their pupil may be sampled as coarsely as may be, where recipe
    and fidelity leave it free: a fine one is for the light that a height map scatters far, next to nothing of
    the change.

    span: of all inverse depths, 1/m.
    """
    coarse = fidelity.sub_aperture_pixel > 1
    least = COARSE_LAYERS if coarse else SUB_APERTURE_LAYERS
    steps = math.ceil(span * blur_per_dioptre(camera) / SUB_APERTURE_STEP_PX)
    most = max(least, min(1 + steps, MOST_SUB_APERTURE_LAYERS))
    layers = most if fidelity.layers is None else min(fidelity.layers, most)
    made = camera.recipe.fabrication if fidelity.fabrication else None
    wrapped = made is not None and made.wrap_wavelength_nm is not None
    wavelengths = 1 if coarse and not wrapped else 2
    return replace(fidelity, band_groups=1, group_wavelengths=wavelengths, layers=layers)


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
    """The coarsest pitch in micrometres that the bound on defocus and the replicas of the PSF allow, between
    the wavelengths [band] too, where groups of bands have theirs.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    camera: its aperture, mask and window of PSFs.
    """
    ends = torch.stack([inverse_depths.min(), inverse_depths.max()])
    alike = sampled_alike(camera, wavelengths, ends, camera.recipe.psf.window_px)
    return min(pitch for _, pitch in alike) * 1e6


def simpler_camera(camera: Camera, fidelity: Fidelity) -> Camera:
    """The camera without what is left out."""
    recipe = camera.recipe
    at = recipe.focus.wavelength_nm * 1e-9
    lens, mask_material = camera.lens, camera.mask_material
    changes: dict[str, object] = {}
    if not fidelity.spherical_aberration:
        lens = lens.without_spherical_aberration()
    if not fidelity.lens_dispersion:
        lens = lens.without_dispersion(at)
    if not fidelity.doe_dispersion:
        mask_material = _without_dispersion(mask_material, design_wavelength(camera))
    if not fidelity.fabrication:
        changes["fabrication"] = None
    psf: dict[str, object] = {}
    if fidelity.oversampling is not None:
        psf["oversampling"] = fidelity.oversampling
    # without dispersion a lens may be farther out of focus, and need a finer pupil than was found for it
    if fidelity.pupil_sampling_um is not None and pupil_is_free(camera) and fidelity.lens_dispersion:
        psf["pupil_sampling_um"] = fidelity.pupil_sampling_um
    changes["psf"] = recipe.psf.model_copy(update=psf)
    changed: CameraRecipe = recipe.model_copy(update=changes)
    return simplified(replace(camera, recipe=changed, lens=lens, mask_material=mask_material), fidelity)


def simplified(camera: Camera, fidelity: Fidelity) -> Camera:
    """The camera without what effects of other packages leave out."""
    for each in fidelity.simplifications:
        camera = each.apply(camera)
    return camera


def simpler_recipe(recipe: SceneRecipe, fidelity: Fidelity) -> SceneRecipe:
    """The scene recipe without what is left out of rendering."""
    render: dict[str, object] = {}
    if fidelity.samples is not None:
        render["samples"] = min(fidelity.samples, recipe.render.samples)
    if fidelity.bounces is not None:
        render["max_depth"] = min(fidelity.bounces, recipe.render.max_depth)
    if not fidelity.hidden_surfaces:
        render["hidden"] = False
    changes: dict[str, object] = {}
    if render:
        changes["render"] = recipe.render.model_copy(update=render)
    if fidelity.margin_px is not None and fidelity.margin_px < recipe.frame.margin_px:
        changes["frame"] = recipe.frame.model_copy(update={"margin_px": fidelity.margin_px})
    if not fidelity.scene_dispersion:
        changes["objects"] = tuple(_of_plain_glass(thing) for thing in recipe.objects)
    return recipe.model_copy(update=changes) if changes else recipe


def disperses(recipe: SceneRecipe) -> tuple[str, ...]:
    """Names, or kinds where they have none, of the objects whose glass bends each wavelength differently."""
    return tuple(thing.name or thing.kind for thing in recipe.objects if _of_plain_glass(thing) is not thing)


def _of_plain_glass(thing: Model) -> Model:
    surfaces = {
        name: value.model_copy(update={"dispersion": False})
        for name, value in thing
        if isinstance(value, GlassSurface) and value.dispersion
    }
    return thing.model_copy(update=surfaces) if surfaces else thing


def _without_dispersion(material: Material, wavelength: float) -> Material:
    index = float(material.index(wavelength))
    return replace(material, sellmeier=(), cauchy=(index, 0.0, 0.0))
