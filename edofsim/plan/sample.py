"""A small sample of a view, photographed with and without an effect.

Parts of the frame (tiles) stand for all of it: chosen where errors live, near depth edges and in detail, and
weighted by how likely each was to be chosen, so that sums over them estimate sums over the frame. Small
frames are taken whole. The sample shares the view's depths, exposure and spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from ..capture.crop import crop, with_margin
from ..capture.fidelity import Fidelity
from ..capture.imaging import Axes, imaging_of, spectrum_of, sub_aperture_imaging
from ..capture.kernels import HeldKernels, Kernels
from ..capture.photograph import all_in_focus, glare_of
from ..capture.prepare import blur_per_dioptre, channel_weights, kernels_of
from ..capture.sensor import automatic_exposure
from ..optics import Camera
from ..render.view import View

TILE = 96
PIXELS = 210_000
"""Pixels of the sample with its surroundings: four tiles of the default camera."""
FINEST_LAYERS = 49
"""Depth nodes that layers are judged by. 48 has many divisors: coarser nodes are among the finer ones."""


@dataclass(frozen=True)
class Sample:
    """tiles: views with a margin of half a PSF; weights: [tile], so that sum_t weight_t |x_t|^2 estimates the
    mean over the frame's pixels; exposure: of the whole view; spectrum: [band]; ends: nearest and farthest
    inverse depth; depths: the distinct ones where they are few."""

    camera: Camera
    tiles: tuple[View, ...]
    weights: Tensor
    exposure: float
    spectrum: Tensor
    ends: tuple[float, float]
    depths: Tensor | None
    response: Tensor
    _banks: dict[tuple, HeldKernels] = field(default_factory=dict, repr=False, compare=False)
    _photos: dict[Fidelity, Tensor] = field(default_factory=dict, repr=False, compare=False)

    def nodes(self, layers: int | None) -> Tensor:
        """Depth nodes [node] of the whole view."""
        layers = FINEST_LAYERS if layers is None else layers
        if self.depths is not None and self.depths.numel() <= layers:
            return self.depths
        low, high = self.ends
        if layers == 1:
            return torch.tensor([(low + high) / 2], dtype=torch.float64)
        return torch.linspace(low, high, layers, dtype=torch.float64)

    def photo(self, fidelity: Fidelity, snapped: bool = False) -> Tensor:
        """The sample's clean photo [channel, pixel], each pixel times the root of its weight: the sum of
        squares of a difference is the mean square error over the frame.

        snapped: every fragment is moved to the nearest depth node. Between nodes PSFs are mixtures, smoother
        than that of any depth, which hides errors where the nodes are few.
        """
        axes = self._axes(fidelity)
        imaging = imaging_of(self.camera, fidelity, axes, make=self._kernels)
        finer = sub_aperture_imaging(self.camera, fidelity, axes)
        images, glare = [], torch.zeros(())
        for tile, weight in zip(self.tiles, self.weights.tolist(), strict=True):
            view = tile
            if snapped:
                view = replace(view, inverse_depth=_nearest(view.inverse_depth, axes.nodes))
            light = imaging.light(view)
            image = imaging.image(light)
            if finer is not None:
                image = image + finer.change_by_sub_apertures(finer.light(view))
            images.append(image.flatten(1))
            own, _ = glare_of(light, imaging.blurring.kernels, imaging.blurring.response)
            glare = glare + own * (weight * images[-1].shape[1])  # a tile's share of the whole frame's glare
        roots = self.exposure * self.weights.sqrt()
        return torch.cat(
            [(image + glare[:, None]) * root for image, root in zip(images, roots.tolist(), strict=True)], 1
        )

    def exposed(self, fidelity: Fidelity) -> tuple[Tensor, Tensor]:
        """The sample's clean photo [channel, pixel] as it is, and the weights [pixel] of its pixels: they sum
        to 1 or thereabouts."""
        sizes = [view.height * view.width for view in self.tiles]
        weights = torch.repeat_interleave(self.weights, torch.tensor(sizes))
        if fidelity not in self._photos:
            self._photos[fidelity] = self.photo(fidelity).double() / weights.sqrt()
        return self._photos[fidelity], weights

    def _axes(self, fidelity: Fidelity, nodes: Tensor | None = None) -> Axes:
        """As the whole view's: the tiles share the PSFs."""
        nodes = self.nodes(fidelity.layers) if nodes is None else nodes
        return Axes(self.response, self.tiles[0].wavelengths, self.spectrum, self.ends, nodes)

    def _kernels(self, camera: Camera, wavelengths: Tensor, nodes: Tensor, window: int) -> Kernels:
        """PSFs at nodes, taken out of those at more nodes that were computed before, if there are."""
        materials = (camera.lens.identity(), camera.mask_material.formula)
        key = (camera.recipe.model_dump_json(), materials, tuple(wavelengths.tolist()), window)
        known = self._banks.get(key)
        if known is not None and known.nodes.numel() >= nodes.numel():
            where = torch.searchsorted(known.nodes, nodes - 1e-9).clamp_max(known.nodes.numel() - 1)
            if torch.allclose(known.nodes[where], nodes, rtol=0, atol=1e-8):
                return HeldKernels(known.values[where], nodes, wavelengths)
        made = kernels_of(camera, wavelengths, nodes, window)
        if isinstance(made, HeldKernels):
            self._banks[key] = made
        return made

    def narrow(self, fidelity: Fidelity, window: int, share: float) -> bool:
        """Whether PSFs of that window truncate less than `share` of the light at every depth, on average."""
        few = fidelity.changed({"window_px": window})
        imaging = imaging_of(self.camera, few, self._axes(few, self.nodes(5)), make=self._kernels)
        kernels = imaging.blurring.kernels
        return max(float(kernels.truncated(k).mean()) for k in range(kernels.nodes.numel())) < share

    def psf_energy(self, fidelity: Fidelity, nodes: Tensor) -> Tensor:
        """sum of psf^2 of each channel, mean over nodes, [channel]: how far independent noise averages."""
        imaging = imaging_of(self.camera, fidelity, self._axes(fidelity, nodes), make=self._kernels)
        kernels = imaging.blurring.kernels
        layers = [kernels.layer(k).square().sum((-2, -1)) for k in range(nodes.numel())]
        return imaging.gathering.response @ torch.stack(layers).mean(0).double()

    def forget(self) -> None:
        """Let the PSFs go."""
        self._banks.clear()


def _nearest(inverse_depth: Tensor, nodes: Tensor) -> Tensor:
    if nodes.numel() == 1:
        return inverse_depth
    middles = (nodes[1:] + nodes[:-1]) / 2
    return nodes[torch.searchsorted(middles, inverse_depth.double())].to(inverse_depth)


def sample_of(view: View, camera: Camera, seed: int = 0) -> Sample:
    """The sample of a view for a camera."""
    response = channel_weights(camera, view.wavelengths)
    ideal = view.crop_margin(all_in_focus(view, response))
    wanted = camera.recipe.sensor.exposure
    exposure = automatic_exposure(ideal) if wanted == "auto" else float(wanted)
    tiles, weights = _tiles(view, ideal, camera, seed)
    depth = view.inverse_depth.double()
    distinct = torch.unique(depth[:: max(1, depth.numel() // 2000)])
    if distinct.numel() < FINEST_LAYERS:
        distinct = torch.unique(depth)
    return Sample(
        camera=camera,
        tiles=tiles,
        weights=weights,
        exposure=exposure,
        spectrum=spectrum_of(view),
        ends=(float(depth.min()), float(depth.max())),
        depths=distinct if distinct.numel() < FINEST_LAYERS else None,
        response=response,
    )


def _tiles(view: View, ideal: Tensor, camera: Camera, seed: int) -> tuple[tuple[View, ...], Tensor]:
    reach = camera.recipe.psf.window_px // 2
    whole = with_margin(view, reach)
    if whole.padded_shape[0] * whole.padded_shape[1] <= PIXELS:
        return (whole,), torch.tensor([1 / (view.height * view.width)], dtype=torch.float64)
    rows, columns = max(1, round(view.height / TILE)), max(1, round(view.width / TILE))
    top = np.linspace(0, view.height, rows + 1).round().astype(int)
    left = np.linspace(0, view.width, columns + 1).round().astype(int)
    places = [
        (top[i], left[j], top[i + 1] - top[i], left[j + 1] - left[j])
        for i in range(rows)
        for j in range(columns)
    ]
    count = min(len(places), max(2, PIXELS // (TILE + 2 * reach) ** 2))
    chance = _chances(view, ideal, camera, places, count)
    generator = np.random.default_rng(seed)
    # systematic sampling: one start, equal steps along the cumulated chances
    ticks = (np.arange(count) + generator.random()) / count
    picked = np.searchsorted(np.cumsum(chance) / chance.sum(), ticks)
    tiles, weights = [], []
    for index, times in zip(*np.unique(picked, return_counts=True), strict=True):
        y, x, height, width = (int(v) for v in places[index])
        tiles.append(crop(view, y, x, height, width, reach))
        weights.append(times / (count * chance[index] / chance.sum()) / (view.height * view.width))
    return tuple(tiles), torch.tensor(weights, dtype=torch.float64)


def _chances(view: View, ideal: Tensor, camera: Camera, places: list[tuple], count: int) -> np.ndarray:
    """How often each part of the frame is to be chosen: a third evenly, the rest by detail and edges."""
    green = ideal.mean(0)
    detail = torch.zeros_like(green)
    detail[1:] += (green[1:] - green[:-1]).square()
    detail[:, 1:] += (green[:, 1:] - green[:, :-1]).square()
    depth = view.crop_margin(view.mean_inverse_depth()) * blur_per_dioptre(camera)
    edges = torch.zeros_like(green)
    edges[1:] += ((depth[1:] - depth[:-1]).abs() > 1).float()
    edges[:, 1:] += ((depth[:, 1:] - depth[:, :-1]).abs() > 1).float()
    area = np.array([h * w for _, _, h, w in places], float)
    shares = [area / area.sum()]
    for amount in (detail, edges):
        sums = np.array([float(amount[y : y + h, x : x + w].sum()) for y, x, h, w in places])
        shares.append(sums / sums.sum() if sums.sum() > 0 else shares[0])
    return sum(shares) / 3
