"""What an effect may look at to say whether it matters: cheap facts of a scene and a camera."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import torch
from torch import Tensor

from ..capture.fidelity import Fidelity, coarsest_pupil_um, edge_pixels, full_fidelity, pupil_is_free
from ..capture.field import CHANGE_STEP_PX, frame_of
from ..capture.guessed import guessed_fragments, with_guessed
from ..capture.imaging import spectrum_of
from ..capture.occlusion.slabs import Hides, cuts, hides
from ..capture.photograph import all_in_focus, depths_of
from ..capture.prepare import blur_per_dioptre, channel_weights
from ..capture.sensor import automatic_exposure
from ..core.once import Once
from ..optics import Camera
from ..optics.field import STEPS, errors_by_step
from ..optics.terms import HALF
from ..recipe import SceneRecipe
from ..render.view import View
from .coarse import Coarse, coarse_of
from .effect import overall
from .places import without_field
from .shape import Shape, shape_of
from .spectra import Spectra, spectra_of

SAME_DEPTH_PX = 0.01
"""Depths between which the blur changes by less are one: rounding, or a wall far away."""
MASKED = {"name", "purpose", "mask", "fabrication"}
"""Tables of a camera's recipe that its mask decides."""
FIELD_DB = 60.0
"""Errors between places in the field are looked at until they are as small, or smaller than is allowed."""
CHANGED = 20.0
"""Contrast of a photo over what sub-apertures change in it, where their work is counted."""
FEW_DEPTHS = 48
"""Distinct depths up to which a view has depths, and no range of them."""


@dataclass(frozen=True)
class Facts:
    """Of one scene (or view) through one camera.

    view: the view itself, or a preview of it: the same frame with few samples.
    recipe: the scene's, None where only a view is known.
    full: the simulation that leaves nothing out.
    edges: pixels on depth edges.
    response: [channel, band].
    spectrum: [band], the light of the whole view.
    ideal: [channel, y, x], all in focus, unexposed.
    exposure: of the photo.
    ends: least and largest inverse depth in 1/m.
    depths: the distinct ones where they are few, else None.
    hides: which fragments hide which.
    cuts: inverse depths at which the view is cut into slabs.
    shape: the view, counted.
    fingerprint: of all that it holds.
    bounce_errors: error of each channel if paths end after this many bounces.
    glass_error: if glass does not disperse, both from small renderings.
    noise_ratio: the view's noise over that of the samples asked for.
    allowed: root mean square error that the photo may have: how much more something errs is of no account.
    """

    view: View
    camera: Camera
    full: Fidelity
    edges: int
    response: Tensor
    spectrum: Tensor
    ideal: Tensor
    exposure: float
    ends: tuple[float, float]
    depths: Tensor | None
    hides: Hides
    cuts: Sequence[float]
    shape: Shape
    fingerprint: str = ""
    recipe: SceneRecipe | None = None
    bounce_errors: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    glass_error: tuple[float, ...] = ()
    noise_ratio: float = 1.0
    allowed: float = math.inf

    @cached_property
    def spectra(self) -> Spectra:
        """What changes of PSFs are seen in."""
        return spectra_of(self, self.full.changed({"pupil_sampling_um": self.quick_pupil_um}))

    @cached_property
    def coarse(self) -> Coarse:
        """What occlusion is seen in."""
        return coarse_of(self.view, self.camera, self.exposure, self.quick_pupil_um is not None)

    @cached_property
    def joined(self) -> Mapping[int, float]:
        """By `field_step_px`, what photos err by at most; steps of half by a quarter, once that is little;
        and all of them where the axis alone will do."""
        view, enough = self.view, min(self.allowed, 10 ** (-FIELD_DB / 20))
        frame = frame_of([view])
        bounds = errors_by_step(self.camera, frame, view.wavelengths, self.ends)
        if overall(self._without_field) < self.allowed < math.inf:
            most = next(bounds)[1]
            way = math.hypot(view.height, view.width) / 2
            return {0: most} | {step: most * min(1.0, step / way) ** 2 for step in STEPS}
        found = dict.fromkeys((0, *STEPS), 0.0)
        for step, error in bounds:
            found[step] = error
            if error < enough:
                break
        for step, half in pairwise(STEPS):
            found[half] = found[half] or found[step] / 4
        return found

    def without_places(self, step: int) -> tuple[float, ...]:
        """What each channel errs by with places in the field that are `step` pixels apart; 0: with the axis
        alone, which is measured all over the frame. Errors of steps are in the ratio of the bounds."""
        share = self.joined[step] / self.joined[0] if step and self.joined[0] else 1.0
        return tuple(share * error for error in self._without_field)

    @cached_property
    def _without_field(self) -> tuple[float, ...]:
        return without_field(self.spectra, frame_of([self.view]))

    def step_of(self, fidelity: Fidelity) -> int:
        """Pixels between the places in the field that PSFs are computed at, 0 for one place.

        fidelity: whose `field_step_px`, or else `layers_db`, decides.
        """
        if not self.camera.lens.varies or fidelity.field_step_px is not None:
            return fidelity.field_step_px or 0
        least = 10 ** (-fidelity.layers_db / 20)
        return next((step for step in STEPS if self.joined[step] < least), STEPS[-1])

    def step_of_parts(self, fidelity: Fidelity, step: int) -> int:
        """Likewise of sub-apertures, by what they are taken to change: see `change_over_field`."""
        if not step:
            return 0
        least, enough = max(step, CHANGE_STEP_PX), CHANGED * HALF**0.5 * 10 ** (-fidelity.layers_db / 20)
        found = self.joined.items()
        return next((apart for apart, error in found if error < enough or 0 < apart <= least), least)

    @cached_property
    def averaging(self) -> tuple[float, ...]:
        """What blur leaves of independent noise in each channel."""
        return tuple(self.spectra.energy().sqrt().tolist())

    @cached_property
    def monte_carlo_noise(self) -> tuple[float, ...]:
        """The noise of each channel that rendering leaves in the photo at the recipe's samples: that of a
        pixel, averaged by the PSF as independent noise is. The view's noise is relative to the mean of its
        bands and alike in all of them."""
        own = max(0.0, self.view.noise) / self.noise_ratio
        return tuple((own * self.levels_of_light * torch.tensor(self.averaging)).tolist())

    def layers_of(self, layers: int | None) -> int:
        """Depth nodes that this many layers come to; the full simulation's for None.

        layers: wanted; None for the full simulation's.
        """
        if layers is None:
            return self._finest_layers
        return layers if self.depths is None else min(layers, int(self.depths.numel()))

    @cached_property
    def _finest_layers(self) -> int:
        return int(depths_of([self.view], self.camera, self.full)[0].numel())

    @property
    def scene(self) -> SceneRecipe:
        """The recipe, where effects of rendering ask for it. Raises ValueError where only a view is known."""
        if self.recipe is None:
            raise ValueError("only a view is known, and not what it was rendered from")
        return self.recipe

    @property
    def hidden(self) -> int:
        """Hidden fragments that are known, or guessed."""
        return int(self.view.hidden.sum())

    @property
    def guessed(self) -> int:
        """Those of them that are guessed."""
        return guessed_fragments(self.view)

    @property
    def blur_spread(self) -> float:
        """Change of the blur's diameter from the nearest to the farthest depth, in pixels."""
        far, near = self.ends
        return (near - far) * blur_per_dioptre(self.camera)

    @property
    def depth_count(self) -> int | None:
        """Number of distinct depths where they are few, else None."""
        if self.full.layers is not None:
            return self.full.layers
        return None if self.depths is None else int(self.depths.numel())

    @property
    def levels_of_light(self) -> Tensor:
        """Mean of the ideal image, [channel], in sensor units."""
        pixels = self.view.padded_shape[0] * self.view.padded_shape[1]
        return self.response.double() @ self.spectrum.double() / pixels * self.exposure

    @cached_property
    def blurred(self) -> Tensor:
        """How bright the photo is, [channel, pixel]: a simulation with little in it but blur."""
        few = {"band_groups": 1, "group_wavelengths": 1, "layers": 5}
        plain = self.full.changed({**few, "occlusion": "none", "sub_apertures": 1})
        return self.coarse.photo(plain).flatten(1).double()

    @property
    def bands_a_channel(self) -> int:
        """Bands that the channel with the broadest response sees."""
        return int((self.response > 1e-3 * self.response.max()).sum(1).max())

    @property
    def quick_pupil_um(self) -> float | None:
        """Sampling of the pupil that other effects are measured with: height maps are sampled finely for the
        light that they scatter, which is little, at several times the cost."""
        map_given = self.camera.height_map is not None or self.camera.recipe.mask.kind == "height-map"
        if not map_given or not pupil_is_free(self.camera):
            return None
        quick = replace(self.camera, by_phase=True)
        return coarsest_pupil_um(quick, self.view.wavelengths, self.view.inverse_depth)

    def nm(self) -> str:
        """The span of wavelengths, as text."""
        nm = self.view.wavelengths * 1e9
        return f"{nm[0]:.0f} to {nm[-1]:.0f} nm"


def facts_of(
    view: View,
    camera: Camera,
    *,
    recipe: SceneRecipe | None = None,
    noise_ratio: float = 1.0,
) -> Facts:
    """Look at a view, with what is guessed behind its edges where that is not known.

    noise_ratio: its noise over that of the recipe's samples.
    """
    view = with_guessed(view, camera)
    response = channel_weights(camera, view.wavelengths)
    with ThreadPoolExecutor(1) as pool:
        pixels = pool.submit(_of_pixels, view, camera, response)
        facts = _facts(view, camera, response, pixels, recipe=recipe, noise_ratio=noise_ratio)
    if facts.blur_spread < SAME_DEPTH_PX:
        facts = replace(facts, full=facts.full.changed({"layers": 1}))
    return facts


def _of_pixels(view: View, camera: Camera, response: Tensor) -> tuple[int, str, Tensor, Tensor]:
    """The pixels on edges, the fingerprint of a view, its ideal image and its spectrum."""
    edges = edge_pixels(view, 1 / blur_per_dioptre(camera))
    return edges, _fingerprint(view), view.crop_margin(all_in_focus(view, response)), spectrum_of(view)


def _facts(
    view: View,
    camera: Camera,
    response: Tensor,
    pixels: Future[tuple[int, str, Tensor, Tensor]],
    *,
    recipe: SceneRecipe | None,
    noise_ratio: float,
) -> Facts:
    """The facts of a view with what is behind its edges; pixels: `_of_pixels`, which another thread finds."""
    wanted, gap = camera.recipe.sensor.exposure, 1 / blur_per_dioptre(camera)
    depth = view.inverse_depth.double()

    distinct = torch.unique(depth[:: max(1, depth.numel() // 2000)])
    if distinct.numel() <= FEW_DEPTHS:
        distinct = torch.unique(depth)
    hidden = hides(view, gap)
    cut = cuts(view, gap, hidden)
    shape = shape_of(view, camera, hidden, cut)
    edges, fingerprint, ideal, spectrum = pixels.result()
    return Facts(
        view=view,
        camera=camera,
        full=full_fidelity(camera, view, edges),
        edges=edges,
        response=response,
        spectrum=spectrum,
        ideal=ideal,
        exposure=automatic_exposure(ideal, noisy=view.noise > 0) if wanted == "auto" else float(wanted),
        ends=(float(depth.min()), float(depth.max())),
        depths=distinct if distinct.numel() <= FEW_DEPTHS else None,
        hides=hidden,
        cuts=cut,
        shape=shape,
        fingerprint=fingerprint,
        recipe=recipe,
        noise_ratio=noise_ratio,
    )


def through_mask_like(facts: Facts, camera: Camera) -> Facts:
    """The facts of the same view through a camera that differs in its mask alone: what was looked at in the
    view is not looked at again.

    Raises ValueError for a camera of another lens, focus or sensor.
    """
    before, after = (each.recipe.model_dump(exclude=MASKED) for each in (facts.camera, camera))
    if before != after:
        raise ValueError("another camera in more than its mask")
    full = full_fidelity(camera, facts.view, facts.edges).changed({"layers": facts.full.layers})
    shape = replace(facts.shape, counted=Once())  # the pupil's work is the mask's
    return replace(facts, camera=camera, full=full, shape=shape)


def _fingerprint(view: View) -> str:
    digest = hashlib.sha256()
    for tensor in (view.radiance, view.inverse_depth, view.pixel):
        digest.update(tensor.detach().cpu().contiguous().numpy().data)
    return digest.hexdigest()


def photo_changes(facts: Facts, changes: Sequence[Mapping[str, object]], **rest: object) -> list[Tensor]:
    """What each change of the fidelity changes in coarse photos, [channel, n] for `Effect.differences`: in
    the light of all channels, of which each has its share.

    rest: how else the rest is simulated than in 4 layers, with the pupil as a whole.
    """
    few = {"band_groups": 0, "group_wavelengths": 0, "layers": 4}
    few |= {"sub_apertures": 1, "sub_aperture_pixel": 2}
    usual, grey = facts.full.changed({**few, **rest}), facts.coarse.grey
    whole, level = grey.photo(usual), facts.levels_of_light.to(torch.float32)
    share = (level / level.mean().clamp_min(1e-30))[:, None] / whole.numel() ** 0.5
    return [(grey.photo(usual.changed(change)) - whole).flatten() * share for change in changes]


def rms(image: Tensor) -> tuple[float, ...]:
    """Root mean square of each channel of a difference [channel, n], see `Effect.differences`.

    image: [channel, n].
    """
    return tuple(torch.linalg.vector_norm(image.double(), dim=1).tolist())
