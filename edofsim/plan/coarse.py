"""A view in few large pixels, to photograph in a moment: what occlusion changes has little fine detail."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..capture.fidelity import Fidelity, coarsest_pupil_um
from ..capture.imaging import layout_within
from ..capture.occlusion.hidden import Layout
from ..capture.photograph import clean_photo, sub_aperture_change
from ..capture.prepare import blur_per_dioptre, channel_weights
from ..core.once import Once
from ..optics import Camera
from ..render.view import View
from .fragments import hat

PIXELS = 30_000
"""Pixels of the coarse frame with its surroundings, or somewhat more."""
BINS = 512
"""Over the view's inverse depths: what lies in one pixel and bin, seen or hidden, becomes one fragment."""


BANDS = 5
"""Of the light whose gathering is looked at, evenly over the view's."""
LAYERS = 4
TWICE = 2
"""As wide are the pixels in which this is looked at."""


@dataclass(frozen=True)
class Coarse:
    """times: how many of the view's pixels lie along one of these.

    pupil_um: how finely the pupil is sampled, None for automatically; sub-apertures as coarsely as may be.
    weights: [channel, band], in place of the sensor's response.
    """

    view: View
    camera: Camera
    times: int
    exposure: float
    pupil_um: float | None = None
    weights: Tensor | None = None
    _known: Once = field(default_factory=Once, repr=False, compare=False)

    def photo(self, fidelity: Fidelity) -> Tensor:
        """The clean photo [channel, y, x] by a fidelity of the whole view, with the PSFs of the axis."""
        change: dict[str, object] = {"field_step_px": 0}
        if fidelity.window_px is not None:
            change["window_px"] = _even(fidelity.window_px / self.times)
        if fidelity.margin_px is not None:
            change["margin_px"] = fidelity.margin_px // self.times
        if self.times > 1:
            change |= {"pupil_sampling_um": None, "oversampling": None}
        return self._clean(fidelity.changed(change))

    @property
    def grey(self) -> Coarse:
        """The same with the light of all channels as one band and one channel, in the middle of what they
        see: a photo of it takes one blur for three."""
        return self._known.get("grey", self._in_one_band)

    def _in_one_band(self) -> Coarse:
        view = self.view
        weights = channel_weights(self.camera, view.wavelengths).mean(0, keepdim=True)
        light, middle = weights.to(view.radiance) @ view.radiance, weights @ view.wavelengths.double()
        one = view.with_light(light, middle.to(view.wavelengths))
        return replace(self, view=one, weights=torch.ones(1, 1, dtype=torch.float64), _known=Once())

    def _clean(self, fidelity: Fidelity) -> Tensor:
        layout = self._layout if fidelity.occlusion == "hidden" else None
        how = {"exposure": self.exposure, "layout": layout, "weights": self.weights}

        def clean() -> Tensor:
            if fidelity.sub_apertures == 1:
                sampled = {"pupil_sampling_um": self.pupil_um} if self.pupil_um else {}
                return clean_photo(self.view, self.camera, fidelity.changed(sampled), **how)
            whole = self._clean(fidelity.changed({"sub_apertures": 1}))  # which others wait for
            return whole + sub_aperture_change(self.view, self.camera, fidelity, **how)

        return self._known.get(fidelity, clean)

    def by_gathering(self, full: Fidelity) -> float:
        """Root mean square of what one group of bands a channel changes only because surfaces hide others:
        where little is known of what lies behind, light is divided by its coverage, and the light and the
        coverage of a group are blurred alike, those of its bands are not."""

        def found() -> float:
            light = with_few_bands(self.view, self.camera)
            fine = replace(self, view=light, _known=Once())
            some = _in_large_pixels(fine, TWICE, coarsely=self.pupil_um is not None)
            usual = full.changed({"layers": LAYERS, "sub_apertures": 1, "sub_aperture_pixel": 1})
            change = torch.zeros(())
            for way, sign in (("hidden", 1), ("none", -1)):
                each = usual.changed({"occlusion": way})
                one = each.changed({"band_groups": 1, "group_wavelengths": 0})
                change = change + sign * (some.photo(one) - some.photo(each))
            return float(change.double().square().mean().sqrt())

        return self._known.get("gathering", found)

    @property
    def _layout(self) -> Layout:
        """In the slabs of the whole view: from the same gap on, its large pixels notwithstanding."""
        gap, window = 1 / (self.times * blur_per_dioptre(self.camera)), self.camera.recipe.psf.window_px
        return self._known.get("layout", lambda: layout_within(self.view, gap, window))


def coarse_of(view: View, camera: Camera, exposure: float, coarsely: bool = False) -> Coarse:
    """The view and the camera with pixels as large as `PIXELS` asks for.

    coarsely: whether its pupil is sampled as coarsely as may be, where else automatically.
    """
    rows, columns = view.padded_shape
    times = max(1, round(math.sqrt(rows * columns / PIXELS)))
    times = min(times, view.height, view.width)
    return _in_large_pixels(Coarse(view, camera, 1, exposure), times, coarsely)


def _in_large_pixels(fine: Coarse, times: int, coarsely: bool) -> Coarse:
    """The same in pixels `times` as wide; coarsely: see `coarse_of`."""
    if times == 1:
        return fine
    recipe, view = fine.camera.recipe, fine.view
    samples = recipe.psf.oversampling
    psf = {
        "window_px": _even(recipe.psf.window_px / times),
        "pupil_sampling_um": "auto",
        "oversampling": samples if samples == "auto" else samples * times,
    }
    larger = recipe.model_copy(
        update={
            "psf": recipe.psf.model_copy(update=psf),
            "sensor": recipe.sensor.model_copy(update={"pixel_um": recipe.sensor.pixel_um * times}),
        }
    )
    large = replace(fine.camera, recipe=larger, pixel=fine.camera.pixel * times, by_phase=True)
    pupil_um = coarsest_pupil_um(large, view.wavelengths, view.inverse_depth) if coarsely else None
    return Coarse(coarser(view, times), large, fine.times * times, fine.exposure, pupil_um)


def coarser(view: View, times: int) -> View:
    """The view with pixels `times` as wide, each with a fragment a depth; what is left over at its right and
    lower border is dropped. Hidden surfaces at one depth that cover a pixel more than once, one behind the
    other, cover it once, with their mean light."""
    columns = view.padded_shape[1]
    height, width, margin = view.height // times, view.width // times, view.margin // times
    y = torch.div(view.pixel // columns - view.margin, times, rounding_mode="floor") + margin
    x = torch.div(view.pixel % columns - view.margin, times, rounding_mode="floor") + margin
    inside = (y >= 0) & (y < height + 2 * margin) & (x >= 0) & (x < width + 2 * margin)
    low, high = view.inverse_depth.aminmax()
    farther = (high - view.inverse_depth) / (high - low).clamp_min(1e-12) * BINS
    place = (y * (width + 2 * margin) + x) * 2 + view.hidden
    place = place * BINS + farther.long().clamp_max(BINS - 1)  # by pixel, seen first, near first
    which = torch.nonzero(inside).squeeze(1)
    place, order = torch.sort(place[which])
    place, group, counts = torch.unique_consecutive(place, return_inverse=True, return_counts=True)
    which = which[order]
    first = which[counts.cumsum(0) - counts]
    group_of = torch.full_like(view.pixel, len(place))  # what is left over: one more, which is dropped
    group_of[which] = group

    def sums(values: Tensor) -> Tensor:
        out = values.new_zeros(*values.shape[:-1], len(place) + 1)
        return out.index_add_(-1, group_of, values)[..., :-1] / times**2

    covered = sums(view.coverage)
    once = covered.clamp_min(1)
    return replace(
        view,
        height=height,
        width=width,
        margin=margin,
        pixel=torch.div(place, 2 * BINS, rounding_mode="floor"),
        coverage=covered / once,
        inverse_depth=view.inverse_depth[first],
        radiance=sums(view.radiance) / once,
        half_difference=None,
        hidden=view.hidden[first],
        pixel_angle=view.pixel_angle * times,
    )


def with_few_bands(view: View, camera: Camera) -> View:
    """The view with `BANDS` bands at most, each the mean light of those around it, or, where a channel sees
    none of these, with all that the sensor sees."""
    weights = channel_weights(camera, view.wavelengths)
    there = torch.nonzero(weights.sum(0) > 0).squeeze(1)
    some = there[torch.linspace(0, len(there) - 1, min(len(there), BANDS)).round().long()]
    if not bool((weights[:, some].sum(1) > 0).all()):
        some = there
    shares = hat(view.wavelengths.double(), view.wavelengths[some].double())
    light = (shares / shares.sum(0)).T.to(view.radiance) @ view.radiance
    return view.with_light(light, view.wavelengths[some])


def _even(side: float) -> int:
    return max(2, 2 * round(side / 2))
