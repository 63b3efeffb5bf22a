"""What an effect may look at to say whether it matters: cheap facts of a scene and a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..capture.fidelity import Fidelity, coarsest_pupil_um, edge_pixels, full_fidelity, pupil_is_free
from ..capture.prepare import blur_per_dioptre
from ..optics import Camera
from ..recipe import SceneRecipe
from ..render.view import View
from .sample import Sample, sample_of

SAME_DEPTH_PX = 0.01
"""Depths between which the blur changes by less are one: rounding, or a wall far away."""


@dataclass(frozen=True)
class Facts:
    """Of one scene (or view) through one camera.

    view: the view itself, or a sketch of it: the same frame with few samples; final: whether it is the view
    itself, so that nothing of rendering is left to decide; recipe: the scene's, None where only a view is
    known; full: the simulation that leaves nothing out; sample: of the view; edges: pixels on depth edges;
    shorter: error of each channel if paths end after so many bounces, and plain_glass: if glass does not
    disperse, both from small renderings; grain: likewise of each channel, the noise that rendering leaves in
    the photo at the recipe's samples; averaging: what blur leaves of independent noise in each channel.
    """

    view: View
    camera: Camera
    full: Fidelity
    sample: Sample
    edges: int
    final: bool = True
    recipe: SceneRecipe | None = None
    shorter: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    plain_glass: tuple[float, ...] = ()
    grain: tuple[float, ...] = (0.0, 0.0, 0.0)
    averaging: tuple[float, ...] = (1.0, 1.0, 1.0)

    @property
    def hidden(self) -> int:
        """Hidden fragments that are known."""
        return int(self.view.hidden.sum())

    @property
    def blur_spread(self) -> float:
        """Change of the blur's diameter from the nearest to the farthest depth, in pixels."""
        near, far = self.sample.ends[1], self.sample.ends[0]
        return (near - far) * blur_per_dioptre(self.camera)

    @property
    def depth_count(self) -> int | None:
        """Number of distinct depths where they are few, else None."""
        if self.full.layers is not None:
            return self.full.layers
        return None if self.sample.depths is None else int(self.sample.depths.numel())

    @property
    def levels_of_light(self) -> Tensor:
        """Mean of the ideal image, [channel], in sensor units."""
        light = self.sample.spectrum.double()
        pixels = self.view.padded_shape[0] * self.view.padded_shape[1]
        return self.sample.response.double() @ light / pixels * self.sample.exposure

    @property
    def blurred(self) -> Fidelity:
        """A simulation with little in it but blur: how bright the photo is."""
        return self.full.changed({"band_groups": 1, "group_wavelengths": 1, "layers": 5, "occlusion": "none"})

    @property
    def bands_a_channel(self) -> int:
        """Bands that the channel with the broadest response sees."""
        return int((self.sample.response > 1e-3 * self.sample.response.max()).sum(1).max())

    @property
    def quick_pupil_um(self) -> float | None:
        """Sampling of the pupil that other effects are measured with: height maps are sampled finely for the
        light that they scatter, which is little, at several times the cost."""
        map_given = self.camera.height_map is not None or self.camera.recipe.mask.kind == "height-map"
        if not map_given or not pupil_is_free(self.camera):
            return None
        return coarsest_pupil_um(self.camera, self.view.wavelengths, self.view.inverse_depth)

    def nm(self) -> str:
        """The span of wavelengths, as text."""
        nm = self.view.wavelengths * 1e9
        return f"{nm[0]:.0f} to {nm[-1]:.0f} nm"


def facts_of(
    view: View,
    camera: Camera,
    *,
    recipe: SceneRecipe | None = None,
    final: bool = True,
    **rendering: object,
) -> Facts:
    """Look at a view. rendering: what was found about rendering (`shorter`, `plain_glass`)."""
    sample = sample_of(view, camera)
    facts = Facts(
        view=view,
        camera=camera,
        full=full_fidelity(camera, view),
        sample=sample,
        edges=edge_pixels(view, 1 / blur_per_dioptre(camera)),
        final=final,
        recipe=recipe,
        **rendering,
    )
    if facts.blur_spread < SAME_DEPTH_PX:
        facts = replace(facts, full=facts.full.changed({"layers": 1}))
    return _with_grain(facts)


def _with_grain(facts: Facts) -> Facts:
    """Noise of rendering in the photo: that of a pixel, averaged by the PSF as independent noise is.

    The view's noise is relative to the mean of its bands and alike in all of them.
    """
    channels = facts.full.changed({"band_groups": 1, "group_wavelengths": 1, "window_px": None})
    kept = facts.sample.psf_energy(channels, facts.sample.nodes(5)).sqrt()
    grain = max(0.0, facts.view.noise) * facts.levels_of_light * kept
    return replace(facts, grain=tuple(grain.tolist()), averaging=tuple(kept.tolist()))


def metres(inverse_depth: float) -> str:
    """A depth as text."""
    return "infinity" if inverse_depth <= 0 else f"{1 / inverse_depth:.2f} m"


def rms(image: Tensor) -> tuple[float, ...]:
    """Root mean square of each channel of a weighted difference [channel, pixel] of the sample."""
    return tuple(torch.linalg.vector_norm(image.double(), dim=1).tolist())
