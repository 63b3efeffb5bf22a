"""OTFs of a camera at depth nodes, as large as tiles, each made once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..capture.band_groups import Gathering
from ..capture.fidelity import Fidelity, coarsest_pupils_um, pupil_is_free, simpler_camera
from ..capture.prepare import kernels_of
from ..core.once import Once
from ..optics import Camera

COARSER = 1.3
"""How much coarser a pupil must do for depths to have one of their own."""


@dataclass(frozen=True)
class Otfs:
    """Of a camera. side: of square tiles, in pixels; wider PSFs are cut."""

    camera: Camera
    side: int
    _known: Once = field(default_factory=Once, repr=False, compare=False)

    def at(
        self,
        fidelity: Fidelity,
        gathering: Gathering,
        nodes: Tensor,
        among: Tensor | None = None,
        as_asked: bool = False,
    ) -> Tensor:
        """OTFs of groups at depth nodes, complex [node, group, y, x], without what lies outside the window.
        among: nodes whose OTFs are known, and hold these perhaps; as_asked: the pupil is sampled as the
        fidelity says, where else depths have the coarsest sampling that will do for them."""
        if among is not None and nodes.numel() <= among.numel():
            at = torch.searchsorted(among, nodes - 1e-9).clamp_max(among.numel() - 1)
            if torch.allclose(among[at], nodes, rtol=0, atol=1e-9):
                return self.at(fidelity, gathering, among)[at]
        window = fidelity.window_px or self.camera.recipe.psf.window_px
        whole = fidelity.changed({"window_px": None})
        camera = simpler_camera(self.camera, whole)
        materials = (camera.lens.identity(), camera.mask_material.formula)
        about = (camera.recipe.model_dump_json(), materials, tuple(s.name for s in whole.simplifications))
        bands = (tuple(gathering.wavelengths.tolist()), gathering.groups)
        key = (*about, *bands, tuple(nodes.tolist()), as_asked)

        def psfs() -> Tensor:
            each: dict[int, Tensor] = {}
            groups = [(torch.arange(nodes.numel()), camera)]
            if not as_asked and pupil_is_free(self.camera):
                groups = _sampled_alike(camera, gathering.wavelengths, nodes)
            for some, sampled in groups:
                kernels = kernels_of(
                    sampled, gathering.wavelengths, nodes[some], self.camera.recipe.psf.window_px
                )
                each |= {node: _resized(kernels.layer(k), self.side) for k, node in enumerate(some.tolist())}
            values = torch.stack([each[node] for node in range(nodes.numel())])
            return torch.einsum("gm,nmyx->ngyx", gathering.psfs.to(values), values)

        def otfs() -> Tensor:
            values = self._known.get(key, psfs)
            if window < self.side:
                values = _resized(_resized(values, window), self.side)
            return torch.fft.rfft2(torch.fft.ifftshift(values, dim=(-2, -1)))

        return self._known.get(("otf", window, *key), otfs)


def _sampled_alike(camera: Camera, wavelengths: Tensor, nodes: Tensor) -> list[tuple[Tensor, Camera]]:
    """Depth nodes, by number, whose PSFs need a pupil about as finely sampled, and the camera for them: those
    farthest out of focus need the finest, by which the PSFs of all would take long."""
    enough = torch.tensor(coarsest_pupils_um(camera, wavelengths, nodes))
    finely = enough < COARSER * enough.min()
    found = []
    for some in (torch.nonzero(finely).flatten(), torch.nonzero(~finely).flatten()):
        if not some.numel():
            continue
        psf = camera.recipe.psf
        if psf.pupil_sampling_um != "auto":
            psf = psf.model_copy(update={"pupil_sampling_um": float(enough[some].min())})
        found.append((some, replace(camera, recipe=camera.recipe.model_copy(update={"psf": psf}))))
    return found


def _resized(values: Tensor, side: int) -> Tensor:
    """PSFs [..., y, x] cut, or with zeros around, so that their middle stays at side // 2."""
    now = values.shape[-1]
    if side <= now:
        begin = now // 2 - side // 2
        return values[..., begin : begin + side, begin : begin + side]
    before = side // 2 - now // 2
    after = side - now - before
    return torch.nn.functional.pad(values, (before, after, before, after))
