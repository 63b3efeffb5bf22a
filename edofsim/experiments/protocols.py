"""Ways to simulate a photo of a scene, from the paper's to ours, and the systems that take it.

The paper (Akpinar et al., section "3D Scene") takes a picture with a depth a pixel, in steps of 1 mm. Its
8-bit values are the intensities of three wavelengths, each depth's part is convolved with the PSF at that
depth (Eq. `Forwardmodel`), and the sum is the photo (Eq. `SensorImage`): nothing hides anything. Ours has the
linear light of all bands, every surface that a pixel sees at its own depth, and what lies behind its edges,
through sub-apertures. The ways between change one thing at a time.

Photos are clipped at full scale, as is the all-in-focus image that they are judged against.

Masks are as the paper tests them: made with a height error of 30 nm in samples of 3 um. What such errors
scatter spreads over a thousand pixels, beyond any window of a PSF; so that light, known in closed form (see
`unscattered_light`), becomes veiling glare: every surface gets its share of the picture's mean.

Depth layers are as many as the camera's defocus asks for; `converged_db` measures what twice as many change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import torch
from torch import Tensor

from ..capture import Fidelity, Photo, capture, full_fidelity, ideal_image
from ..capture.fidelity import MOST_LAYERS
from ..capture.noise import PhotoNoise, photo_noise
from ..capture.prepare import channel_weights, depth_nodes
from ..capture.sensor import automatic_exposure
from ..core.images import srgb_encode
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera
from ..optics.camera import defocus_per_dioptre
from ..optics.fabrication import unscattered_fraction
from ..recipe import CameraRecipe, Loaded
from ..render.view import View
from ..restore.scores import TruthNoise, psnr, within_scale
from ..restore.truth import Truth
from .failures import Failures
from .restorations import ByNetwork, ByWiener, Known, Restoration, known_of
from .sources import Source, systems_of_all
from .systems import of_three_lines

PAPER_DB = 30.76
"""The paper's PSNR of its one scene, an image of the TAU-Agent data set between 0.5 and 4.46 m."""
DEPTH_STEP_M = 1e-3
HEIGHT_ERROR_M = 30e-9
SAME_HEIGHT_M = 1e-12
"""Masks that differ by less are one: checkpoints hold one mask to different roundings."""
LENS_ALONE = "lens_alone"
LAYERS_DB, SNAPPED_DB = 70.0, 60.0
"""Depth layers keep this PSNR by the rule of `capture.prepare.depth_nodes`. The second is enough for layers
that surfaces snap to; elsewhere Wiener deconvolution of a phone's photo would be off by 0.2 dB."""


@dataclass(frozen=True)
class Way:
    """A way to simulate.

    flat: one depth a pixel, in steps of 1 mm, and three wavelengths.
    encoded: values of an 8-bit sRGB picture are taken for light.
    occlusion: see `expose`, "" for the most that the view allows: hidden surfaces where it has any.
    sub_apertures: along each axis of the pupil, as far as diffraction lets them be distinguished.
    layers: depth nodes, None for as many as the camera's defocus asks for.
    """

    name: str
    title: str
    occlusion: str
    flat: bool = False
    encoded: bool = False
    sub_apertures: int = 1
    layers: int | None = None


PAPER, OURS = "paper", "sub_apertures"
WAYS = (
    Way(PAPER, "The paper's: 8-bit values as light, 3 wavelengths, 1 mm steps", "none", True, True),
    Way("linear", "The same of linear light", "none", flat=True),
    Way("none", "All bands, nothing hides", "none"),
    # more of them hide each other where a surface is slanted, fewer blur it wrongly
    Way("over", "Four layers over each other", "over", layers=4),
    Way("normalised", "Layers over each other, normalised", "normalised"),
    Way("hidden", "All bands, hidden surfaces", ""),
    Way(OURS, "Ours: the same through sub-apertures", "", sub_apertures=4),
)


@dataclass(frozen=True)
class System:
    """What takes and restores photos.

    camera: with the system's mask.
    restoration: None where the photo is left as it is.
    designed: what Wiener deconvolution and functions take the camera for, where the mask was made otherwise.
    """

    name: str
    camera: Camera
    restoration: Restoration | None = None
    designed: Camera | None = None


@dataclass(frozen=True)
class Capture:
    """A photo, and the images to be judged against its ideal one, all [3, y, x]: `photo`, and of a system
    that restores `restored` and `wiener`.

    noise: the photo's.
    left: what is left of it in each image.
    """

    photo: Photo
    images: dict[str, Tensor]
    noise: PhotoNoise = PhotoNoise()
    left: Mapping[str, Tensor | None] = field(default_factory=dict)

    def compared(self, image: str) -> tuple[Tensor, Tensor, TruthNoise]:
        """An image, the truth and their noise, as `score_parts` takes them."""
        return Truth(self.photo.ideal, self.noise).compared(self.images[image], self.left.get(image))

    @property
    def truth(self) -> Tensor:
        """The all-in-focus image as a sensor of full scale 1 can hold it."""
        return within_scale(self.photo.ideal)


@dataclass(frozen=True)
class Lens:
    """Systems that share lens, focus and sensor, and so a view and the photo of the lens alone.

    name: of their camera.
    alone: the lens without a mask.
    recipes: texts by name of the file.
    """

    name: str
    alone: System
    systems: tuple[System, ...]
    recipes: Mapping[str, str]

    @property
    def every(self) -> tuple[System, ...]:
        """The lens alone, then the systems."""
        return (self.alone, *self.systems)


def systems_of(camera: Loaded[CameraRecipe], names: Sequence[str]) -> list[System]:
    """A lens alone, and the systems (see `sources.system_of`) with it, which must all be of one lens. Raises
    InputError for what is no system, and for two lenses."""
    lenses, failures = lenses_of(camera, systems_of_all(names))
    failures.check(0)
    if len(lenses) > 1:
        raise InputError(f"{', '.join(names)}: not all of one lens; take them one by one")
    return list(lenses[0].every)


def lenses_of(camera: Loaded[CameraRecipe], sources: Sequence[Source]) -> tuple[list[Lens], Failures]:
    """Systems by their lens, in the order of the first of each; and what is wrong with those that cannot be
    built.

    camera: of systems that name none. The first lens alone is called `LENS_ALONE`.
    """
    given = replace(camera, recipe=saturating(camera.recipe))
    found: dict[str, Lens] = {}
    failures = Failures()
    for source in sources:
        with failures.of(source.name):
            optics = source.camera(given)
            optics = replace(optics, recipe=saturating(optics.recipe))
            system = System(source.name, optics, source.restoration)
            alone, name = optics.without_mask(), optics.recipe.name
            key = _lens_key(alone)
            if key not in found:
                called = f"{LENS_ALONE}_{name}_{len(found) + 1}" if found else LENS_ALONE
                found[key] = Lens(name, System(called, alone), (), {})
            lens = found[key]
            texts = {**lens.recipes, **_texts(source, camera, optics)}
            found[key] = replace(lens, systems=(*lens.systems, system), recipes=texts)
    return list(found.values()), failures


def _texts(source: Source, camera: Loaded[CameraRecipe], optics: Camera) -> dict[str, str]:
    """The recipe of a system's camera, by the name of its file."""
    if source.own is None and optics.recipe.name == camera.recipe.name:
        return {camera.path.name: camera.text}
    if source.own is not None:
        return {source.own.path.name: source.own.text}
    return {f"camera of {source.name}": optics.recipe.model_dump_json(indent=1)}


def _lens_key(alone: Camera) -> str:
    """The same for cameras that differ in their masks alone."""
    return alone.recipe.model_dump_json(exclude={"name", "purpose", "schema_"}) + str(alone.base)


def saturating(recipe: CameraRecipe) -> CameraRecipe:
    """The same camera with a sensor that is full at full scale."""
    return recipe.model_copy(update={"sensor": recipe.sensor.model_copy(update={"saturation": True})})


def views_of(view: View, camera: Camera) -> dict[str, View]:
    """The view that each way photographs, by the way's name."""
    flat = {way.name: flattened(view, camera, encoded=way.encoded) for way in WAYS if way.flat}
    return {way.name: flat.get(way.name, view) for way in WAYS}


def capture_restored(
    view: View, way: Way, system: System, seed: int = 0, device: str = "cpu", like: Capture | None = None
) -> Capture:
    """A photo of the way's own view (see `views_of`), and its restorations.

    The exposure is the camera's; automatic for all bands, while the flat ways' values are exposed already.

    like: what a system with the same camera took so (see `same_photo`); its photo is not taken again.

    Raises InputError where it cannot be taken or restored.
    """
    camera = of_three_lines(system.camera) if way.flat else system.camera
    unscattered = unscattered_light(system.camera, view.wavelengths)
    if like is None:
        photo, noise = _photo(view, way, camera, unscattered, seed, device)
    else:
        photo, noise = like.photo, like.noise
    images, left = {"photo": photo.image}, {"photo": noise.image}
    if system.restoration is None:
        return Capture(photo, images, noise, left)
    truth = Truth(photo.ideal, noise)

    def restored(name: str, by: Restoration, known: Known) -> None:
        def work(image: Tensor) -> Tensor:
            return by(image, known).to(image)

        images[name] = work(photo.image)
        left[name] = truth.restored_noise(photo.image, images[name], work)

    # how finely the mask is made, and so the glare that its making leaves, is known of a camera
    glare = (1 - channel_weights(camera, view.wavelengths) @ unscattered).to(photo.image)
    camera_of_scores = system.designed or system.camera
    camera_of_scores = of_three_lines(camera_of_scores) if way.flat else camera_of_scores
    by_network = isinstance(system.restoration, ByNetwork)
    known = _known(view, camera if by_network else camera_of_scores, glare)
    restored("restored", system.restoration, known)
    if isinstance(system.restoration, ByWiener):
        images["wiener"], left["wiener"] = images["restored"], left["restored"]
    elif like is not None and "wiener" in like.images:
        images["wiener"], left["wiener"] = like.images["wiener"], like.left.get("wiener")
    else:
        restored("wiener", ByWiener(), _known(view, camera_of_scores, glare) if by_network else known)
    return Capture(photo, images, noise, left)


def _known(view: View, camera: Camera, glare: Tensor) -> Known:
    """What is known of a photo of a view."""
    ends = torch.stack(view.inverse_depth.double().cpu().aminmax())
    return known_of(camera, view.wavelengths, ends, glare, view.crop_margin(view.mean_inverse_depth()))


def converged_db(view: View, way: Way, system: System) -> float:
    """How far a photo of the way's own view is from convergence: PSNR in dB between it and that of twice as
    many depth layers, both without noise and sub-apertures, with one group of bands a channel. Infinite where
    all depths of the view are layers."""
    camera = of_three_lines(system.camera) if way.flat else system.camera
    how = _fidelity(view, way, camera)
    few = replace(how, band_groups=1, group_wavelengths=1, sub_apertures=1)
    ideal = view.crop_margin(ideal_image(view, camera, 1.0))
    exposure = automatic_exposure(ideal, noisy=view.noise > 0)
    per_dioptre = defocus_per_dioptre(camera, float(view.wavelengths.min()))
    nodes = depth_nodes(view.inverse_depth, few.layers or "auto", per_dioptre, few.layers_db)
    twice = replace(few, layers=min(2 * len(nodes), MOST_LAYERS))
    once, more = (capture(view, camera, how, exposure=exposure).clean for how in (few, twice))
    return psnr(once, more)


def same_photo(first: System, second: System) -> bool:
    """Whether both take the same photo, and know the same of it."""
    if first.designed is not second.designed:
        return False
    one, other = first.camera, second.camera
    return all(_same(getattr(one, f.name), getattr(other, f.name)) for f in fields(Camera))


def _same(one: object, other: object) -> bool:
    if not (isinstance(one, Tensor) and isinstance(other, Tensor)):
        return one is other or (not isinstance(one, Tensor) and one == other)
    return one.shape == other.shape and torch.allclose(one, other, rtol=0, atol=SAME_HEIGHT_M)


def _photo(
    view: View, way: Way, camera: Camera, unscattered: Tensor, seed: int, device: str
) -> tuple[Photo, PhotoNoise]:
    ideal = view.crop_margin(ideal_image(view, camera, 1.0))
    wanted = 1.0 if way.flat else camera.recipe.sensor.exposure
    exposure = automatic_exposure(ideal, noisy=view.noise > 0) if wanted == "auto" else float(wanted)
    fidelity, hazy = _fidelity(view, way, camera), with_glare(view, unscattered)
    photo = capture(hazy, camera, fidelity, exposure=exposure, seed=seed, device=device)
    noise = photo_noise(hazy, camera, fidelity, photo, device)
    if view.half_difference is not None:  # the truth has the light that the mask scatters
        off = ideal_image(view.with_light(view.half_difference), camera, exposure)
        noise = replace(noise, ideal=view.crop_margin(off))
    return replace(photo, ideal=ideal * exposure), noise


def _fidelity(view: View, way: Way, camera: Camera) -> Fidelity:
    full = full_fidelity(camera, view)
    occlusion = way.occlusion or full.occlusion
    return Fidelity(
        layers=way.layers,
        layers_db=LAYERS_DB if occlusion in ("none", "hidden") else SNAPPED_DB,
        occlusion=occlusion,
        sub_apertures=min(way.sub_apertures, full.sub_apertures),
    )


def unscattered_light(camera: Camera, wavelengths: Tensor) -> Tensor:
    """Part of the light that height errors of `HEIGHT_ERROR_M` leave in the PSF of the mask as designed,
    [band], float64. 1 without a height map, and where the recipe says how the mask is made.

    wavelengths: [band], metres.
    """
    recipe = camera.recipe
    if recipe.fabrication is not None or not hasattr(recipe.mask, "design_wavelength_nm"):
        return torch.ones_like(wavelengths, dtype=torch.float64)
    return unscattered_fraction(wavelengths.double(), HEIGHT_ERROR_M, camera.mask_material)


def with_glare(view: View, unscattered: Tensor) -> View:
    """The view with the light that a made mask scatters, 1 - `unscattered` [band], spread evenly over it.

    unscattered: [band], fraction of the light.
    """
    part = unscattered.to(view.radiance)[:, None]
    rows, columns = view.padded_shape
    mean = view.radiance[:, ~view.hidden].sum(1, keepdim=True) / (rows * columns)
    half = None if view.half_difference is None else view.half_difference * part.to(view.half_difference)
    radiance = view.radiance * part + mean * (1 - part) * view.coverage
    return replace(view, radiance=radiance, half_difference=half)


def flattened(view: View, camera: Camera, *, encoded: bool) -> View:
    """The view as a picture of the camera's three colours with one depth a pixel, in steps of 1 mm.

    The picture is exposed as the camera would, and clipped at full scale. A pixel has the depth of the
    surface that covers most of it.

    encoded: the picture's 8-bit sRGB values take the place of its light.
    """
    wanted, order = camera.recipe.sensor.exposure, torch.argsort(PAPER_COLOURS)  # bands ascend
    exposure = (
        float(wanted)
        if wanted != "auto"
        else automatic_exposure(view.crop_margin(ideal_image(view, camera, 1.0)), noisy=view.noise > 0)
    )

    def pictured(light: View) -> Tensor:
        values = ideal_image(light, camera, exposure).clamp(0, 1)
        if encoded:
            values = (srgb_encode(values) * 255).round() / 255
        return values.reshape(3, -1)[order].to(torch.float32)

    half = None
    if view.half_difference is not None:
        ends = (view.with_light(view.radiance + s * view.half_difference) for s in (1, -1))
        one, other = (pictured(each) for each in ends)
        half = (one - other) / 2
    picture, depth = pictured(view), quantised(_depth_of_most(view))
    return replace(
        view,
        pixel=torch.arange(len(depth)),
        coverage=torch.ones(len(depth)),
        inverse_depth=depth.to(torch.float32),
        radiance=picture,
        hidden=torch.zeros(len(depth), dtype=torch.bool),
        wavelengths=PAPER_COLOURS[order],
        half_difference=half,
    )


def quantised(inverse_depth: Tensor) -> Tensor:
    """Inverse depths in 1/m of depths rounded to whole steps of 1 mm; infinity stays.

    inverse_depth: any shape [...], 1/m.
    """
    steps = (inverse_depth.double().reciprocal() / DEPTH_STEP_M).round().clamp_min(1)
    return torch.where(torch.isfinite(steps), 1 / (steps * DEPTH_STEP_M), 0.0)


def _depth_of_most(view: View) -> Tensor:
    """Inverse depth of the surface that covers most of each pixel (the nearest of equals), [pixel], 1/m."""
    rows, columns = view.padded_shape
    which = ~view.hidden
    pixel, coverage = view.pixel[which], view.coverage[which]
    empty = coverage.new_full((rows * columns,), -math.inf)
    most = empty.scatter_reduce(0, pixel, coverage, "amax")
    first = coverage == most[pixel]
    return empty.scatter_reduce(0, pixel[first], view.inverse_depth[which][first], "amax").clamp_min(0)
