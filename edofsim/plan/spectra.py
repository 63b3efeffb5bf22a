"""What a change of PSFs changes in a photo, from Fourier spectra of parts of the view's light: nothing is
photographed.

A photo is the sum over depths and bands of light convolved with PSFs. Where PSFs change by d, it changes by
what has the spectrum sum OTF(d) spectrum(light). The light of square tiles, as wide as the PSFs, under a
window (Welch 1967), is transformed once; every change of PSFs is then a product of spectra, of which the part
in the frame counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ..capture.band_groups import Gathering, every_band
from ..capture.fidelity import Fidelity
from ..capture.imaging import Axes, gathering_of
from ..capture.occlusion.slabs import Hides
from ..core.once import Once
from ..optics import Camera
from ..optics.terms import cubic
from ..render.view import View
from .fragments import Fragments, Tiled, at_nodes, hat, in_tiles, light_by_depth, together
from .otfs import FINE_NODES, MakeOtfs, fine_nodes_of, otfs_of, reach_of
from .passing import Passing, passing
from .tiles import Tiles, choose_tiles

if TYPE_CHECKING:
    from .facts import Facts

SIDES_PX = (64, 256)
"""Least and largest side of a tile; PSFs that are wider are cut."""
NODES = 7
"""Depths at which changes of PSFs are looked at; light is moved to the nearest."""
FEW_NODES = 3
"""The same where PSFs take long, through a finely sampled pupil, and nothing is focused elsewhere."""
EVENLY = 0.3
"""Share of these that is spread evenly over the view's inverse depths; the rest is where its light is. Chosen
on small versions of `clutter`, `foliage`, `night`, `stilllife` and `hallway`."""
CELLS = 2000
"""Of the view's inverse depths, to find that."""
BANDS = 11
"""Wavelengths at which these are looked at, evenly over the view's bands."""
FOUND_DB = 45.0
"""Spectra of light are distinguished by as many components as leave less than this of them: 1 to 10 on most
shipped scenes, nearly every band where each has noise of its own."""


@dataclass(frozen=True)
class Spectra:
    """Tiles of a view.

    cuts: inverse depths between the view's slabs.
    seen: the fragments that lie in tiles.
    behind, before: those that are hidden there, at their own depth and at that of what hides them; other
        fields as in `Facts`, response times exposure.
    """

    view: View
    camera: Camera
    full: Fidelity
    response: Tensor
    spectrum: Tensor
    ends: tuple[float, float]
    depths: Tensor | None
    cuts: Sequence[float]
    tiles: Tiles
    seen: Fragments
    behind: Fragments
    before: Fragments
    otfs: MakeOtfs
    _known: Once = field(default_factory=Once, repr=False, compare=False)

    def nodes(self, count: int, distinct: int | None = None) -> Tensor:
        """`count` inverse depths evenly from far to near, or the view's own, no more than `distinct`."""
        if self.depths is not None and self.depths.numel() <= (count if distinct is None else distinct):
            return self.depths
        low, high = self.ends
        if count == 1:
            return torch.tensor([(low + high) / 2], dtype=torch.float64)
        return torch.linspace(low, high, count, dtype=torch.float64)

    def nodes_of_light(self, count: int) -> Tensor:
        """`count` inverse depths or fewer between which lies about as much of the tiles' light each, without
        the mean, the nearest and the farthest among them: what PSFs lose grows steeply where they are widest.
        The view's own where these are no more."""
        if self.depths is not None and self.depths.numel() <= count:
            return self.depths
        return self._known.get(("of light", count), lambda: self._spread_by_light(count))

    def _spread_by_light(self, count: int) -> Tensor:
        low, high = self.ends
        cell = (self.seen.depth - low) / max(high - low, 1e-12) * CELLS
        amount = (self.response.sum(0).to(self._seen) @ self._seen).abs().double()
        light = torch.zeros(CELLS, dtype=torch.float64)
        light.index_add_(0, cell.long().clamp(0, CELLS - 1), amount)
        evenly = torch.full_like(light, EVENLY / CELLS)
        below = (evenly + (1 - EVENLY) * light / light.sum().clamp_min(1e-30)).cumsum(0)
        places = torch.linspace(0, 1, count, dtype=torch.float64) * below[-1]
        found = torch.searchsorted(below, places).clamp_max(CELLS - 1).unique()
        return low + (found + 0.5) / CELLS * (high - low)

    def by_bands(self, fidelity: Fidelity) -> Tensor:
        """What gathering bands changes, as a vector (see `Tiles.vector`): against each band on its own."""
        nodes = self.nodes_of_light(NODES)
        weights, components = self._components
        light = self.light("components", components, nodes)
        gathering = self._gathering_of(fidelity, nodes)
        few, shares = self._some_bands()
        between = hat(gathering.wavelengths, few.wavelengths)
        shared = torch.einsum(
            "cg,gk,gw->ckw", gathering.response, gathering.light @ weights, gathering.psfs @ between
        )
        change = shared - (shares @ weights).transpose(1, 2)
        otfs = self.otfs(self.full, few, nodes)
        spectra = _mixed(change.flatten(0, 1), otfs).unflatten(1, (len(change), -1))
        return self.tiles.vector(self.image(nodes, spectra, light))

    def by_layers(self, layers: int) -> Tensor:
        """What so few depth layers change: against one for every depth."""

        def changed() -> Tensor:
            (fine, gathering, exact), nodes = self._fine, self.nodes(layers)
            between = hat(fine, nodes, snapped=self.full.occlusion == "normalised")
            if fine is self.depths:  # which lie anywhere
                coarse = _mixed(between, self.otfs(self.full, gathering, nodes, within=self._reach)[None])[0]
            else:
                through = cubic((nodes - fine[0]) / (fine[1] - fine[0]), len(fine))
                coarse = _mixed(between @ through, exact[None])[0]
            return self._by_channel(gathering, fine, coarse - exact, shared=True)

        return self._known.get(("layers", layers), changed)

    def by_psfs(self, fidelity: Fidelity, reference: Fidelity) -> Tensor:
        """What other PSFs change: those of a fidelity against those of another, in every band; or at one
        wavelength a channel where the pupil is sampled more finely than for other estimates, and then at
        few depths where its focus stays. Of samples within pixels each band errs in its own way: no few
        stand for all."""
        quick = reference.pupil_sampling_um == self.full.pupil_sampling_um
        refocused = fidelity.lens_dispersion != reference.lens_dispersion
        nodes = self.nodes_of_light(NODES if quick or refocused else FEW_NODES)
        alike = fidelity.oversampling == reference.oversampling
        gathering, shares = self._some_bands(BANDS if alike else self.view.bands)
        if not quick:
            gathering = self.gathering(1, nodes)
        other, same = (
            self.otfs(each, gathering, nodes, as_asked=not quick) for each in (fidelity, reference)
        )
        change = other - same
        if not quick:
            return self._by_channel(gathering, nodes, change)
        weights, components = self._components
        light = self.light("components", components, nodes)
        of_each = (shares @ weights).transpose(1, 2)
        spectra = _mixed(of_each.flatten(0, 1), change).unflatten(1, (len(of_each), -1))
        found = self.image(nodes, spectra, light)
        reach = min(f.window_px or self.camera.recipe.psf.window_px for f in (fidelity, reference)) // 2
        return self.tiles.vector(found + self._of_mean(change, shares, nodes, reach))

    def energy(self) -> Tensor:
        """sum of psf^2 of each channel, mean over depths, [channel]: how far independent noise averages."""
        nodes = self.nodes_of_light(NODES)
        gathering, shares = self._some_bands()
        light = shares @ self.spectrum
        otfs = _mixed(light / light.sum(1, keepdim=True), self.otfs(self.full, gathering, nodes))
        each = torch.fft.irfft2(otfs, s=(self.tiles.side, self.tiles.side)).square().sum((-2, -1))
        return each.double().mean(0)

    @cached_property
    def fine_nodes(self) -> int:
        """Depths that depth layers are judged by."""
        return fine_nodes_of(self.camera, self.view, self.ends)

    def make_fine_psfs(self) -> None:
        """Those of the fine nodes, by all threads, before each of these asks for them."""
        _ = self._fine

    @cached_property
    def _fine(self) -> tuple[Tensor, Gathering, Tensor]:
        """The fine nodes, two wavelengths a channel, and OTFs of these."""
        nodes = self.nodes(self.fine_nodes, 2 * self.fine_nodes)
        gathering = self.gathering(2, nodes)
        return nodes, gathering, self.otfs(self.full, gathering, nodes, within=self._reach)

    @cached_property
    def _reach(self) -> int:
        """Side of the window that PSFs of many depths are computed in."""
        window = min(self.tiles.side, self.camera.recipe.psf.window_px)
        return reach_of(self.otfs, self.full, self._some_bands()[0], self.nodes_of_light(NODES), window)

    def _some_bands(self, most: int = BANDS) -> tuple[Gathering, Tensor]:
        """Bands that stand for all, those between by linear interpolation; and what each channel sees of each
        band by the PSFs of one of these, [channel, few, band] float64."""
        bands = self.view.wavelengths.double()
        some = torch.linspace(0, bands.numel() - 1, min(bands.numel(), most)).round().long()
        between = hat(bands, bands[some])
        return every_band(bands[some], self.response[:, some]), torch.einsum(
            "cb,bw->cwb", self.response.double(), between
        )

    def gathering(self, wavelengths: int, nodes: Tensor) -> Gathering:
        """One group a channel, of this many wavelengths. nodes: [node], 1/m."""
        one = self.full.changed({"band_groups": 1, "group_wavelengths": wavelengths})
        return self._gathering_of(one, nodes)

    def _gathering_of(self, fidelity: Fidelity, nodes: Tensor) -> Gathering:
        axes = Axes(self.response, self.view.wavelengths, self.spectrum, self.ends, nodes)
        return gathering_of(self.camera, fidelity, axes)

    def light(self, name: str, radiance: Tensor, nodes: Tensor, shared: bool = False) -> Tiled:
        """Spectra of light [k, n] of all fragments at nodes, see `at_nodes`, under the window."""
        return self._known.get(
            ("spectrum", name, shared, tuple(nodes.tolist())),
            lambda: at_nodes(
                together(self.seen, self.behind, self.before), radiance, nodes, self.tiles, shared
            ).transformed(self.tiles.taper),
        )

    def _cover(self, nodes: Tensor, shared: bool = False) -> Tiled:
        """What covers pixels, at nodes."""
        cover = self.view.coverage[self.seen.which][None]
        return self._known.get(
            ("cover", shared, tuple(nodes.tolist())),
            lambda: at_nodes(self.seen, cover, nodes, self.tiles, shared),
        )

    @property
    def mean(self) -> Tensor:
        """Of the view's light, [band]."""
        rows, columns = self.view.padded_shape
        return self.spectrum / (rows * columns)

    @cached_property
    def _hidden(self) -> Tensor | None:
        """Light of the fragments that are hidden [band, n], without the view's mean, as far as it counts;
        None where nothing is."""
        if self._passing is None:
            return None
        return self._without_mean(self.behind) * self._passing.shown(self.behind)

    def _mixed_light(self, weights: Tensor) -> Tensor:
        """Weights [k, band] of the light of all that counts, [k, n]; negative before what is hidden (see
        `passing`)."""
        seen = weights.to(self._seen) @ self._seen
        if self._hidden is None:
            return seen
        behind = weights.to(self._hidden) @ self._hidden
        return torch.cat([seen, behind, -behind], 1)

    @cached_property
    def _seen(self) -> Tensor:
        """Light of the fragments that are seen [band, n], without the view's mean."""
        return self._without_mean(self.seen)

    def _without_mean(self, fragments: Fragments) -> Tensor:
        mean = self.mean.to(self.view.radiance)[:, None]
        light = self.view.radiance.index_select(1, fragments.which)
        return torch.addmm(light, mean, self.view.coverage[fragments.which][None], alpha=-1)

    @cached_property
    def _passing(self) -> Passing | None:
        """What dims light, if anything in the tiles hides another."""
        if not len(self.behind):
            return None
        nodes, _, otfs = self._fine
        step = 1 if nodes is self.depths else (self.fine_nodes - 1) // (FINE_NODES - 1)
        nodes, otfs = nodes[::step].contiguous(), otfs[::step].mean(1)
        between = torch.tensor(sorted(self.cuts), dtype=torch.float64)
        return passing(self._cover(nodes), otfs, nodes, between, len(self.tiles.shares))

    def image(self, nodes: Tensor, change: Tensor, light: Tiled) -> Tensor:
        """What spectra of light at nodes become in a photo by a change of OTFs, complex [node, channel, k, y,
        x], dimmed by what is in front: [tile, channel, y, x]."""
        size = (self.tiles.side, self.tiles.side)
        image = torch.zeros(len(self.tiles.shares), change.shape[1], *size)
        slabs = torch.zeros_like(light.node)
        if self._passing is not None:
            slabs = self._passing.slabs(nodes)[light.node]
        begin = 0
        of_slabs = slabs.unique_consecutive(return_counts=True)
        for slab, count in zip(*(found.tolist() for found in of_slabs), strict=True):
            tiles, spectra = light.part(begin, count).summed(change)
            seen = torch.fft.irfft2(spectra, s=size)
            if self._passing is not None:
                seen = seen * self._passing.passed[slab, tiles][:, None]
            image.index_add_(0, tiles, seen)
            begin += count
        return image

    @cached_property
    def _components(self) -> tuple[Tensor, Tensor]:
        """The light as few components: what each adds to each band, [band, component] float64, and
        [component, n]; weighted by what the sensor sees of a band."""
        seen = self.response.square().sum(0).sqrt()
        products = (self._seen @ self._seen.T).double()
        if self._hidden is not None:  # once behind, and once before it
            products += 2 * (self._hidden @ self._hidden.T).double()
        power, axes = torch.linalg.eigh(seen[:, None] * products * seen)
        power, axes = power.flip(0).clamp_min(0), axes.flip(1)
        left = power.sum() - power.cumsum(0)
        enough = int((left > 10 ** (-FOUND_DB / 10) * power.sum()).sum()) + 1
        axes = axes[:, :enough]
        weights = axes / seen.clamp_min(1e-12)[:, None] * (seen > 0)[:, None]
        return weights, self._mixed_light(axes.T * seen)

    @cached_property
    def channels(self) -> Tensor:
        """The light that each channel sees, [channel, n]."""
        return self._mixed_light(self.response)

    def _by_channel(
        self, gathering: Gathering, nodes: Tensor, change: Tensor, shared: bool = False
    ) -> Tensor:
        """change: of the OTFs of one group a channel, complex [node, channel, y, x]."""
        light = self.light("channels", self.channels, nodes, shared)
        alike = replace(light, values=light.values[:, None])
        found = self.image(nodes, change[:, :, None], alike)
        shares = gathering.response[:, :, None] * gathering.light
        return self.tiles.vector(found + self._of_mean(change, shares, nodes, self.view.margin))

    def _of_mean(self, change: Tensor, shares: Tensor, nodes: Tensor, reach: int) -> Tensor:
        """What becomes of the view's mean light, and of veiling glare, under the window: [tile, channel, y,
        x]. change: of OTFs [node, group, y, x]; shares: of each channel's bands that each group's PSFs blur,
        [channel, group, band]; reach: pixels around the frame that light comes from.

        On a slanted surface its blur changes from place to place. Where surfaces hide others, light that is
        the same everywhere is blurred to itself, and a sum over depths would have steps that no photo has:
        only what PSFs truncate counts. That becomes veiling glare, all over the frame.
        """
        truncated = change[..., 0, 0].real.to(shares)
        there = self._known.get(
            ("depths", reach, tuple(nodes.tolist())), lambda: light_by_depth(self.view, nodes, reach)
        )
        glare = torch.einsum("cgb,bn,ng->c", shares, there, truncated)
        level = shares @ self.mean
        cover = self._cover(nodes, shared=True)
        if self.full.occlusion == "none":
            changed = _mixed(level, change) - glare.to(change)[:, None, None]
            if float(changed.abs().max()) < 1e-6:
                return torch.zeros(())
            spectra = self._known.get(("spectrum", "cover", tuple(nodes.tolist())), cover.transformed)
            tiles, spectra = spectra.summed(changed[:, :, None])
            found = torch.fft.irfft2(spectra, s=(self.tiles.side, self.tiles.side))
        else:
            changed = (truncated @ level.T - glare).to(cover.values)
            tiles, found = cover.summed(changed[:, :, None, None, None])
        image = found.new_zeros(len(self.tiles.shares), *found.shape[1:])
        image[tiles] = found
        return image * self.tiles.taper[:, None]


def spectra_of(facts: Facts, full: Fidelity) -> Spectra:
    """What changes of a full simulation's PSFs are seen in: tiles of the view of the facts."""
    view, camera, hidden = facts.view, facts.camera, facts.hides
    side = min(max(camera.recipe.psf.window_px, SIDES_PX[0]), SIDES_PX[1])
    tiles = choose_tiles(view, facts.ideal, camera, side)
    seen = torch.nonzero(~view.hidden).squeeze(1)
    if full.occlusion == "none":
        hidden = Hides(seen[:0], seen[:0])
    (visible,) = in_tiles(view, seen, [seen], tiles)
    behind, before = in_tiles(view, hidden.behind, [hidden.behind, hidden.front], tiles)
    return Spectra(
        view,
        camera,
        full,
        facts.response * facts.exposure,
        facts.spectrum,
        facts.ends,
        facts.depths,
        facts.cuts,
        tiles,
        visible,
        behind,
        before,
        partial(otfs_of, Once(), camera, side),
    )


def _mixed(weights: Tensor, spectra: Tensor) -> Tensor:
    """Real weights [k, n] of complex spectra [node, n, ...]: [node, k, ...]."""
    parts = torch.view_as_real(spectra).flatten(2)  # a real product is half the work of a complex one
    mixed = weights.to(parts) @ parts
    return torch.view_as_complex(mixed.reshape(len(parts), len(weights), *spectra.shape[2:], 2))
