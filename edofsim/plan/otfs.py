"""OTFs of a camera at depth nodes, as large as tiles, each made once."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..capture.band_groups import Gathering
from ..capture.fidelity import Fidelity, pupil_is_free, simpler_camera
from ..capture.prepare import kernels_of
from ..core.once import Once
from ..optics import Camera
from ..optics.sampling import sampled_alike

WINDOWS = 0.5, 0.75
"""Of a window, the smaller ones that are tried."""
NEARLY_ALL = 0.95
"""Share of a PSF's light that a smaller one must hold."""


@dataclass(frozen=True)
class Otfs:
    """Of a camera. side: of square tiles, in pixels; wider PSFs are cut."""

    camera: Camera
    side: int
    _known: Once = field(default_factory=Once, repr=False, compare=False)

    def reach(self, fidelity: Fidelity, gathering: Gathering, nodes: Tensor) -> int:
        """Side of the smallest window that holds nearly all of the light of each of these PSFs."""
        window = min(self.side, self.camera.recipe.psf.window_px)

        def held(side: int) -> Tensor:
            return self.at(fidelity.changed({"window_px": side}), gathering, nodes)[..., 0, 0].real

        enough = NEARLY_ALL * held(window)
        some = (2 * round(window * share / 2) for share in WINDOWS)
        return next((side for side in some if bool((held(side) >= enough).all())), window)

    def at(
        self,
        fidelity: Fidelity,
        gathering: Gathering,
        nodes: Tensor,
        among: Tensor | None = None,
        as_asked: bool = False,
        within: int | None = None,
    ) -> Tensor:
        """OTFs of groups at depth nodes, complex [node, group, y, x], without what lies outside the window.
        among: nodes whose OTFs are known, and hold these perhaps; as_asked: the pupil is sampled as the
        fidelity says, where else depths have the coarsest sampling that will do for them; within: side in
        pixels of what PSFs are computed in, None for the recipe's window."""
        if among is not None and nodes.numel() <= among.numel():
            at = torch.searchsorted(among, nodes - 1e-9).clamp_max(among.numel() - 1)
            if torch.allclose(among[at], nodes, rtol=0, atol=1e-9):
                return self.at(fidelity, gathering, among, within=within)[at]
        window = fidelity.window_px or self.camera.recipe.psf.window_px
        whole = fidelity.changed({"window_px": None})
        camera = simpler_camera(self.camera, whole)
        materials = (camera.lens.identity(), camera.mask_material.formula)
        about = (camera.recipe.model_dump_json(), materials, tuple(s.name for s in whole.simplifications))
        bands = (tuple(gathering.wavelengths.tolist()), gathering.groups)
        key = (*about, *bands, tuple(nodes.tolist()), as_asked, within)

        def psfs() -> Tensor:
            each: dict[int, Tensor] = {}
            reach = within or self.camera.recipe.psf.window_px
            groups = [(torch.arange(nodes.numel()), camera)]
            if not as_asked and pupil_is_free(self.camera):
                auto = camera.recipe.psf.pupil_sampling_um == "auto"
                groups = [
                    (some, camera if auto else camera.with_pupil_sampling(pitch))
                    for some, pitch in sampled_alike(camera, gathering.wavelengths, nodes, reach)
                ]
            for some, sampled in groups:
                kernels = kernels_of(sampled, gathering.wavelengths, nodes[some], reach)
                each |= {node: _cut(kernels.layer(k), self.side) for k, node in enumerate(some.tolist())}
            values = torch.stack([each[node] for node in range(nodes.numel())])
            return torch.einsum("gm,nmyx->ngyx", gathering.psfs.to(values), values)

        def otfs() -> Tensor:
            values = _cut(self._known.get(key, psfs), window)
            return torch.fft.rfft2(_around_origin(values, self.side))

        return self._known.get(("otf", window, *key), otfs)


def _cut(psfs: Tensor, side: int) -> Tensor:
    """PSFs [..., y, x] in no more than so many pixels, so that their middle stays at side // 2."""
    begin = psfs.shape[-1] // 2 - side // 2
    return psfs if begin <= 0 else psfs[..., begin : begin + side, begin : begin + side]


def _around_origin(psfs: Tensor, side: int) -> Tensor:
    """PSFs [..., y, x] in so many pixels, with their middle in the first; what lies before it is at the
    end."""
    before = psfs.shape[-1] // 2
    after = psfs.shape[-1] - before
    found = psfs.new_zeros(*psfs.shape[:-2], side, side)
    for y, there in ((slice(before, None), slice(after)), (slice(before), slice(side - before, side))):
        found[..., there, :after] = psfs[..., y, before:]
        found[..., there, side - before :] = psfs[..., y, :before]
    return found
