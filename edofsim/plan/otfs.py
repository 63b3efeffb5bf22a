"""OTFs of groups of bands at depth nodes, as large as tiles, each made once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..capture.band_groups import Gathering
from ..capture.fidelity import Fidelity, pupil_is_free, simpler_camera
from ..capture.prepare import depth_nodes
from ..core.once import Once
from ..optics import Camera, psf_bank
from ..optics.camera import defocus_per_dioptre
from ..optics.sampling import sampled_alike
from ..render.view import View

WINDOWS = 0.5, 0.75
"""Of a window, the smaller ones that are tried."""
ENCIRCLED_SHARE = 0.95
"""Share of a PSF's light that a smaller one must hold."""

FINE_NODES = 25
"""Depths that depth layers are judged by: nodes of 2, 3, 4, 5, 7, 9 and 13 layers are among them."""
FINE_DB = 35.0
"""These are doubled until light between two of them is blurred right to about this many decibels: a fast lens
is sharp between two of few."""
MOST_FINE = 193

MakeOtfs: TypeAlias = Callable[..., Tensor]
"""`otfs_of` of a camera, for tiles of a size."""


def otfs_of(
    known: Once,
    camera: Camera,
    side: int,
    fidelity: Fidelity,
    gathering: Gathering,
    nodes: Tensor,
    as_asked: bool = False,
    within: int | None = None,
) -> Tensor:
    """OTFs of groups at depth nodes, complex [node, group, y, x], without what lies outside the window.

    known: those that were made before.
    side: of square tiles, in pixels; wider PSFs are cut.
    nodes: [node], 1/m.
    as_asked: the pupil is sampled as the fidelity says, where else each depth has the coarsest sampling that
        its phases allow.
    within: side in pixels of what PSFs are computed in, None for the recipe's window.
    """
    recipe = camera.recipe.psf
    window, reach = fidelity.window_px or recipe.window_px, within or recipe.window_px
    whole = fidelity.changed({"window_px": None})
    simpler = simpler_camera(camera, whole)
    materials = (simpler.lens.identity(), simpler.mask_material.formula)
    about = (simpler.recipe.model_dump_json(), materials, tuple(s.name for s in whole.simplifications))
    bands = (tuple(gathering.wavelengths.tolist()), gathering.groups)
    key = ("otf", window, *about, *bands, tuple(nodes.tolist()), as_asked, within)

    def otfs() -> Tensor:
        groups = [(torch.arange(nodes.numel()), simpler)]
        if not as_asked and pupil_is_free(camera):
            auto, quick = simpler.recipe.psf.pupil_sampling_um == "auto", replace(simpler, by_phase=True)
            odd = reach | 1  # as windows of PSFs are that stand for mirrored ones
            groups = [
                (some, quick if auto else quick.with_pupil_sampling(pitch))
                for some, pitch in sampled_alike(quick, gathering.wavelengths, nodes, odd)
            ]
        held = min(side, window, reach)
        begin = reach // 2 - held // 2
        of_groups = [
            psf_bank(sampled, gathering.wavelengths, nodes[some], window_px=reach).values
            for some, sampled in groups
        ]
        order = torch.cat([some for some, _ in groups]).argsort()
        psfs = torch.cat(of_groups)[order, :, begin : begin + held, begin : begin + held]
        psfs = torch.einsum("gm,nmyx->ngyx", gathering.psfs.to(psfs), psfs)
        middle, beyond = held // 2, side - held
        return torch.fft.rfft2(pad(psfs, (0, beyond, 0, beyond)).roll((-middle, -middle), (-2, -1)))

    return known.get(key, otfs)


def fine_nodes_of(camera: Camera, view: View, ends: tuple[float, float]) -> int:
    """Depths that depth layers are judged by: `FINE_NODES`, and more for a fast lens.

    ends: least and largest inverse depth of the view in 1/m.
    """
    per_dioptre = defocus_per_dioptre(camera, float(view.wavelengths.min()))
    fine = torch.linspace(*ends, 2 * MOST_FINE, dtype=torch.float64)
    enough = depth_nodes(fine, "auto", per_dioptre, FINE_DB)
    count = FINE_NODES
    while count < min(enough.numel(), MOST_FINE):
        count = 2 * count - 1
    return count


def reach_of(make: MakeOtfs, fidelity: Fidelity, gathering: Gathering, nodes: Tensor, window: int) -> int:
    """Side of the smallest window that holds nearly all of the light of each PSF in a `window`.

    nodes: [node], 1/m.
    """
    otfs = make(fidelity.changed({"window_px": window}), gathering, nodes)
    size = otfs.shape[-2]
    psfs = torch.fft.irfft2(otfs, s=(size, size)).roll((window // 2, window // 2), (-2, -1))

    def held(side: int) -> Tensor:
        some = slice(window // 2 - side // 2, window // 2 + side // 2)
        return psfs[..., some, some].sum((-2, -1))

    enough = ENCIRCLED_SHARE * held(window)
    some = (2 * round(window * share / 2) for share in WINDOWS)
    return next((side for side in some if bool((held(side) >= enough).all())), window)
