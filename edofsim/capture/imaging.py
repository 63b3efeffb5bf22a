"""What stands between a view and the sensor: PSFs of band groups at depth nodes, and how surfaces hide
others.

`Imaging` forms the image of a view, or of any part of it, as a fidelity says. Everything that is photographed
anywhere comes through here: whole frames, tiles that stand for a frame, patches of a training.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path

import torch
from torch import Tensor

from ..optics import Camera, PsfField, between_part_variance, defocus, sub_aperture_psfs
from ..optics.field import psf_field
from ..render.view import View
from .band_groups import Gathering, every_band, gathered, gathered_view
from .band_limit import BandLimit
from .blurring import Blurring
from .checks import check_view
from .crop import crop, with_margin
from .fidelity import (
    Fidelity,
    of_sub_apertures,
    pupil_is_free,
    simpler_camera,
)
from .occlusion import OCCLUSIONS
from .occlusion.hidden import Layout, layout_of
from .occlusion.sub_apertures import change_by_sub_apertures
from .prepare import blur_per_dioptre


@dataclass(frozen=True)
class Axes:
    """What images of one view, or of several, share: response [channel, band] and wavelengths [band] of the
    bands, in metres; spectrum [band], their light, that groups of bands are weighted by.

    ends: least and largest inverse depth in 1/m.
    nodes: [node] ascending inverse depths at which PSFs are computed.
    between: how light between them is blurred, None: the two next to it share it.
    """

    response: Tensor
    wavelengths: Tensor
    spectrum: Tensor
    ends: tuple[float, float]
    nodes: Tensor
    between: BandLimit | None = None


@dataclass(frozen=True)
class Imaging:
    """The optics of a fidelity, with their PSFs at hand.

    window: side of the PSFs in pixels.
    widest: of the recipe's.
    reach: pixels around the frame that light comes from.
    gathering: bands to groups.
    blurring: with the groups' PSFs.
    sub_aperture_gain: share of the variance of places in the pupil that the sub-apertures hold
        (`between_part_variance`). `image` and `light` may be called for any view of the axes.
    """

    fidelity: Fidelity
    window: int
    widest: int
    gathering: Gathering
    blurring: Blurring
    sub_apertures: tuple[PsfField, ...] = field(default=(), repr=False)
    sub_aperture_gain: float = 1.0

    @property
    def reach(self) -> int:
        margin = self.fidelity.margin_px
        return self.window // 2 if margin is None else min(margin, self.window // 2)

    def light(self, view: View) -> View:
        """The view with groups in its bands' place and a margin that holds the blur; outermost pixels are
        repeated where it has none. Raises InputError for values that are not light or depth."""
        # few groups are quicker to check and to cut than many bands; what is not finite stays so
        light = gathered_view(view, self.gathering) if self.fidelity.band_groups else view
        check_view(light)
        return with_margin(with_part_of_margin(light, self.reach), self.window // 2)

    def layout(self, view: View) -> Layout | None:
        """How a view is composited: the same by PSFs of all widths. None where it is not."""
        if self.fidelity.occlusion != "hidden":
            return None
        return layout_within(view, self.blurring.gap, self.widest)

    def image(self, light: View, layout: Layout | None = None) -> Tensor:
        """Unexposed image of what `light` gives, [channel, y, x] of the frame, without the veiling glare.

        layout: of the view; None to choose it by what `light` shows.
        """
        way = OCCLUSIONS[self.fidelity.occlusion]
        return light.crop_margin(way(light, self.blurring, *([] if layout is None else [layout])))

    def change_by_sub_apertures(self, light: View, layout: Layout | None = None) -> Tensor:
        """What compositing each place of the pupil by itself changes in the image, [channel, y, x] of the
        frame, estimated from these sub-apertures."""
        side = self.fidelity.sub_aperture_pixel
        change = change_by_sub_apertures(light, self.blurring, self.sub_apertures, side, layout)
        return light.crop_margin(change) / self.sub_aperture_gain


def layout_within(view: View, gap: float, window: int) -> Layout:
    """How a view is composited by PSFs that are at most `window` pixels wide.

    gap: see `layout_of`.
    """
    reach = window // 2
    return layout_of(with_margin(with_part_of_margin(view, reach), reach), gap, reach)


def imaging_of(
    camera: Camera,
    fidelity: Fidelity,
    axes: Axes,
    *,
    field_step: float | None = None,
    held: bool = True,
    cache: Path | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Imaging:
    """The optics of a camera for views of these axes.

    field_step, held, cache: see `psf_field`.
    """
    window = fidelity.window_px or camera.recipe.psf.window_px
    gathering = gathering_of(camera, fidelity, axes)
    psfs = psf_field(
        simpler_camera(camera, fidelity),
        gathering.wavelengths,
        axes.nodes,
        window_px=window,
        field_step=field_step,
        held=held,
        cache=cache,
        dtype=dtype,
        device=device,
    )
    return Imaging(
        fidelity,
        window,
        camera.recipe.psf.window_px,
        gathering,
        Blurring(
            psfs.grouped(gathering.psfs) if fidelity.band_groups else psfs,
            gathering.response.to(device, dtype),
            gap=1 / blur_per_dioptre(camera),
            between=axes.between,
        ),
    )


def sub_aperture_imaging(
    camera: Camera,
    fidelity: Fidelity,
    axes: Axes,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Imaging:
    """The optics that tell what sub-apertures change, as `of_sub_apertures` says."""
    coarse = of_sub_apertures(fidelity, camera, float(axes.nodes[-1] - axes.nodes[0]))
    window = coarse.window_px or camera.recipe.psf.window_px
    gathering, nodes = gathering_of(camera, coarse, axes), some_nodes(axes.nodes, coarse)
    through = sub_aperture_psfs(
        simpler_camera(camera, coarse),
        gathering.wavelengths,
        nodes,
        coarse.sub_apertures,
        window_px=window,
        side=coarse.sub_aperture_pixel,
        coarsely=coarse.pupil_sampling_um is None and pupil_is_free(camera),
        dtype=dtype,
        device=device,
    )
    parts = list(through)
    whole = reduce(torch.add, parts)
    each = (PsfField(values, nodes, gathering.wavelengths) for values in (whole, *parts))
    pupil, *held = (psfs.grouped(gathering.psfs) if coarse.band_groups else psfs for psfs in each)
    blurring = Blurring(pupil, gathering.response.to(device, dtype), gap=1 / blur_per_dioptre(camera))
    gain = between_part_variance(camera, coarse.sub_apertures)
    return Imaging(coarse, window, camera.recipe.psf.window_px, gathering, blurring, tuple(held), gain)


def some_nodes(nodes: Tensor, fidelity: Fidelity) -> Tensor:
    """As many nodes from the first to the last as a fidelity has layers, or all if they are no more.

    nodes: [node], 1/m.
    fidelity: whose `layers` count.
    """
    if fidelity.layers is None or nodes.numel() <= fidelity.layers:
        return nodes
    return torch.linspace(float(nodes[0]), float(nodes[-1]), fidelity.layers, dtype=nodes.dtype)


def gathering_of(camera: Camera, fidelity: Fidelity, axes: Axes) -> Gathering:
    """How a fidelity gathers bands in groups."""
    wavelengths = axes.wavelengths.cpu()
    if fidelity.band_groups == 0:
        return every_band(wavelengths, axes.response)
    place = defocus(camera, wavelengths, sum(axes.ends) / 2)
    return gathered(
        wavelengths, axes.response, axes.spectrum, place, fidelity.band_groups, fidelity.group_wavelengths
    )


def spectrum_of(view: View) -> Tensor:
    """Light of the whole frame in each band, [band], float64."""
    return (view.radiance @ (~view.hidden).to(view.radiance)).double().cpu().detach()


def with_part_of_margin(view: View, margin: int | None) -> View:
    """The view with no more margin than that; None for all of it."""
    if margin is None or margin >= view.margin:
        return view
    return crop(view, 0, 0, view.height, view.width, margin)
