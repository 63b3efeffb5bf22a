"""How much work a simulation is, counted and not done: wave transforms, convolutions, fragments moved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

from ..capture.convolution import Grid
from ..capture.fidelity import Fidelity, of_sub_apertures, pupil_is_free, simpler_camera
from ..capture.layers import BLOCK_PIXELS
from ..capture.light import SMALLER
from ..optics import Camera
from ..optics.band_limited import band_limited_nodes
from ..optics.camera import defocus_per_dioptre
from ..optics.grid import PupilGrid, disc_coverage
from ..optics.height import natural_samples
from ..optics.psf import BETWEEN
from ..optics.sampling import plan_sampling, sampled_alike
from ..optics.sub_apertures import coarse_oversampling, coarse_window, partition, windows_along
from .shape import Shape, Slabs, shape_of

STAGES = ("prepare", "psf", "blur", "sub_apertures", "sensor")
PART_AMOUNTS = 5
OPTICS = (
    "oversampling",
    "pupil_sampling_um",
    "spherical_aberration",
    "lens_dispersion",
    "doe_dispersion",
    "fabrication",
    "simplifications",
)
"""Fields of a fidelity that change the camera, see `simpler_camera`."""
PARTS = (
    "sub_apertures",
    "sub_aperture_pixel",
    "group_wavelengths",
    "occlusion",
)
"""And those that change how sub-apertures are composited."""
EVEN = 0.25
"""Of the work of PSFs is left where the pupil is its own mirror image, as without a mask."""
COVERAGES = 3
"""Images of coverage that are blurred for each depth: one a channel."""

__all__ = ["STAGES", "Shape", "Work", "shape_of", "work_of"]


@dataclass(frozen=True)
class Work:
    """Amounts that a stage's time is proportional to, by stage; bytes: of PSFs, light and transforms."""

    amounts: dict[str, tuple[float, ...]]
    bytes: float


def work_of(shape: Shape, camera: Camera, fidelity: Fidelity, layers: int, groups: int, colours: int) -> Work:
    """The work of a photo.

    layers: depth nodes; groups: images that are blurred for each of them; colours: wavelengths of PSFs.
    """
    window = fidelity.window_px or camera.recipe.psf.window_px
    margin = window // 2
    padded = (shape.height + 2 * margin) * (shape.width + 2 * margin)
    outer = math.prod(shape.padded_shape)
    fragments = shape.fragments * padded / outer
    gathered = groups if fidelity.band_groups else 0
    how = (fidelity.occlusion, window, layers, groups)
    blur = shape.counted.get(("blur", *how), lambda: _blur_of(shape, *how))
    samples = _pupil_samples(camera, fidelity, window, shape)
    relief = camera.height_map is not None or camera.recipe.mask.kind != "clear"
    half, out = samples / 2, _half_out(camera, fidelity, window, shape)
    known = waves_between(camera, shape, layers)
    waves = known * colours * (1.0 if relief else EVEN)
    of_parts = tuple(getattr(fidelity, name) for name in (*OPTICS, *PARTS))
    parts, held = shape.counted.get(
        ("parts", window, layers, samples, *of_parts),
        lambda: _parts_of(shape, camera, fidelity, layers, samples),
    )
    return Work(
        {
            "prepare": (
                1.0,
                shape.fragments * shape.bands,
                shape.fragments * gathered + fragments * groups,
                0.0 if shape.one_each else shape.fragments + fragments,
                3.0 * shape.height * shape.width,
                float(gathered),
            ),
            "psf": (
                1.0,
                float(colours),
                samples**2,
                colours * samples**2,
                colours * samples**2 if relief else 0.0,
                samples**2 if relief else 0.0,
                waves * (out * half**2 + out**2 * half),
                waves * (half**2 + out**2),
                layers * colours * window**2,
            ),
            "blur": blur.amounts(layers * (groups + COVERAGES) * window**2 if blur.covers else 0.0),
            "sub_apertures": parts,
            "sensor": (
                1.0,
                3.0 * shape.height * shape.width,
                fragments * groups,
                layers * groups * window**2,
                fragments if layers > 1 else 0.0,
            ),
        },
        4.0 * layers * (colours + gathered) * window**2
        + 4.0 * fragments * (shape.bands + groups)
        + 24.0 * min(groups, max(1, BLOCK_PIXELS // blur.largest)) * blur.largest
        + held,
    )


def waves_between(camera: Camera, shape: Shape, layers: int) -> int:
    """Depths at which the PSFs of so many layers are computed, at the wavelength in the middle."""
    middle = (shape.wavelengths[0] + shape.wavelengths[-1]) / 2
    return min(layers, len(band_limited_nodes(*shape.ends, defocus_per_dioptre(camera, middle), BETWEEN)))


def _parts_of(
    shape: Shape, camera: Camera, fidelity: Fidelity, layers: int, samples: int
) -> tuple[tuple[float, ...], float]:
    """Amounts of compositing sub-apertures, and the bytes of their PSFs and light."""
    across = fidelity.sub_apertures
    if across == 1 or fidelity.occlusion != "hidden" or not shape.edges.numel():
        return (0.0,) * PART_AMOUNTS, 0.0
    coarse = of_sub_apertures(fidelity)
    window = fidelity.window_px or camera.recipe.psf.window_px
    layers = 1 if shape.ends[0] == shape.ends[1] else min(layers, coarse.layers or layers)
    colours = min(shape.bands, COVERAGES * coarse.group_wavelengths)
    count = parts_of_disc(across)
    grids = ((layers, samples),)
    if coarse.pupil_sampling_um is None and pupil_is_free(camera):
        grids = _coarse_grids(
            _named(simpler_camera(camera, coarse)), window, layers, shape.ends, shape.wavelengths
        )
    side = coarse.sub_aperture_pixel
    width = coarse_window(window, side)
    fine = fidelity.oversampling or camera.oversampling(min(shape.wavelengths))
    out = (width * coarse_oversampling(fine, side) + 2) / 2
    margin = window // 2
    work = _Composites()
    for part, slabs in [(tile, shape.slabs(tile)) for tile in shape.tiles] or [(shape, shape.whole)]:
        rows, columns = (math.ceil((size + 2 * margin) / side) for size in (part.height, part.width))
        for slab, extent in enumerate(slabs.extents):
            spans = (math.ceil(own / side) + 2 * (width // 2) for own in extent)
            high, wide = (min(both) for both in zip(spans, (rows, columns), strict=True))
            box = (high, wide) if high * wide < SMALLER * rows * columns else (rows, columns)
            work.add(*box, width, slabs.nodes_used(layers, slab))
        work.largest = max(work.largest, work.held)
        work.held = 0.0
    along = [
        across * colours * (samples**2 + depths * out * (samples / 2) ** 2)
        + count * colours * depths * out**2 * samples / 2
        for depths, samples in grids
    ]
    amounts = (
        float(count),
        sum(along),
        count * layers * colours * (out**2 + width**2),
        count * work.transforms + work.light,
        count * work.products,
    )
    held = 4.0 * layers * width**2 * count * (COVERAGES + colours) + 8.0 * work.largest
    return amounts, held


@lru_cache(maxsize=4096)
def _transform_size(rows: int, columns: int, window: int) -> int:
    """Pixels of the Fourier transforms of a part with its margin."""
    return math.prod(Grid(rows, columns, window // 2, window).transform)


@dataclass
class _Composites:
    """Work of one sub-aperture, added up tile by tile.

    transforms: in pixels times their logarithm; light: those that all parts share; products: pixels of
    spectra that are multiplied; held: bytes of the spectra of a tile's light, and largest: of the tile that
    has most of them.
    """

    transforms: float = 0.0
    products: float = 0.0
    light: float = 0.0
    held: float = 0.0
    largest: float = 0.0

    def add(self, rows: int, columns: int, window: int, nodes: int) -> None:
        """A slab, in the part of a tile with its margin that its blur reaches; nodes: that its light has a
        share in."""
        size = _transform_size(rows, columns, window)
        one = size * math.log2(size)
        self.transforms += (nodes + 2) * COVERAGES * one
        self.products += nodes * 2 * COVERAGES * size
        self.light += nodes * (COVERAGES + 1) * one
        self.held += 4.0 * nodes * (COVERAGES + 1) * size


@lru_cache(maxsize=16)
def parts_of_disc(across: int) -> int:
    """Parts of a pupil that is open everywhere."""
    grid = PupilGrid(32 * across, 1 / (16 * across), 1.0)
    return len(partition(windows_along(grid, across), disc_coverage(grid, 1.0)))


@dataclass
class _Blur:
    """Work of blurring, added up part by part.

    blurs: images of channels that are made; visits: of depth nodes for them; transforms: fast Fourier
    transforms, in pixels times their logarithm; products: pixels of spectra that are multiplied; moved:
    fragments, times images; scanned: fragments that are looked through; largest: pixels of one transform.
    """

    blurs: float = 0.0
    visits: float = 0.0
    transforms: float = 0.0
    products: float = 0.0
    moved: float = 0.0
    scanned: float = 0.0
    largest: int = 1
    covers: bool = False

    def add(
        self, rows: int, columns: int, window: int, nodes: int, images: int, fragments: float, lights: int = 0
    ) -> None:
        """One blur of some fragments at some depth nodes, in a frame with its margin. lights: of which there
        are images, where they are fewer."""
        lights = lights or images
        size = _transform_size(rows, columns, window)
        self.largest = max(self.largest, size)
        self.blurs += 1
        self.visits += nodes
        self.transforms += (nodes * (images + lights) + 3) * size * math.log2(size)
        self.products += (nodes * (images + 3) + 3) * size
        self.moved += 2 * fragments * lights

    def amounts(self, opaque: float) -> tuple[float, ...]:
        whole = (1.0, self.blurs, self.visits, self.transforms, self.products)
        return (*whole, self.moved, self.scanned, opaque)


def _blur_of(shape: Shape, occlusion: str, window: int, layers: int, groups: int) -> _Blur:
    work = _Blur()
    margin = window // 2
    layers = 1 if shape.ends[0] == shape.ends[1] else layers
    rows, columns = shape.height + 2 * margin, shape.width + 2 * margin
    scale = rows * columns / math.prod(shape.padded_shape)
    visible, nodes = shape.visible * scale, shape.whole.nodes_used(layers)
    if occlusion in ("over", "normalised"):
        work.covers = True
        for _ in range(nodes):  # each fragment is at one of them
            work.add(rows, columns, window, 1, groups, visible / nodes)
            work.add(rows, columns, window, 1, COVERAGES, visible / nodes, 1)
        work.scanned += visible * nodes
        return work
    tiles = shape.tiles if occlusion == "hidden" else []
    if occlusion == "none" or tiles or not shape.edges.numel():
        work.add(rows, columns, window, nodes, groups, visible)
    if occlusion == "none":
        return work
    work.scanned += shape.fragments * scale
    if not shape.edges.numel():
        return work
    work.covers = True
    if not tiles:
        _composite(work, shape.whole, rows, columns, window, layers, groups, scale)
    for tile in tiles:
        rows, columns = tile.height + 2 * margin, tile.width + 2 * margin
        around = (tile.height + 2 * shape.reach) * (tile.width + 2 * shape.reach)
        _composite(work, shape.slabs(tile), rows, columns, window, layers, groups, rows * columns / around)
        work.scanned += rows * columns
    return work


def _composite(
    work: _Blur, slabs: Slabs, rows: int, columns: int, window: int, layers: int, groups: int, scale: float
) -> None:
    for slab, count in enumerate(slabs.fragments):
        nodes = slabs.nodes_used(layers, slab)
        high, wide = (own + 2 * (window // 2) for own in slabs.extents[slab])
        high, wide = min(rows, high), min(columns, wide)
        part = (high, wide) if high * wide < SMALLER * rows * columns else (rows, columns)
        work.add(*part, window, nodes, groups, count * scale)
        work.add(*part, window, nodes, COVERAGES, count * scale, 1)
        work.scanned += sum(slabs.fragments) * scale


def _half_out(camera: Camera, fidelity: Fidelity, window: int, shape: Shape) -> float:
    """Samples along half an axis of the window that PSFs are computed on."""
    return (window * (fidelity.oversampling or camera.oversampling(min(shape.wavelengths))) + 2) / 2


def _pupil_samples(camera: Camera, fidelity: Fidelity, window: int, shape: Shape) -> int:
    optics = tuple(getattr(fidelity, name) for name in OPTICS)
    return shape.counted.get(
        ("pupil", window, *optics), lambda: _count_samples(camera, fidelity, window, shape)
    )


def _count_samples(camera: Camera, fidelity: Fidelity, window: int, shape: Shape) -> int:
    return _samples(_named(simpler_camera(camera, fidelity)), window, shape.ends, shape.wavelengths)


def _named(camera: Camera) -> _Named:
    recipe = camera.recipe.model_dump_json(exclude={"name", "purpose", "sensor"})
    across = None if camera.height_map is None else camera.height_map.shape[-1]
    return _Named(camera, f"{recipe} {camera.lens.identity()} {camera.mask_material.formula} {across}")


class _Named:
    """A camera that is told from others by its recipe and the size of its height map."""

    def __init__(self, camera: Camera, name: str) -> None:
        self.camera, self.name = camera, name

    def __hash__(self) -> int:
        return hash(self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Named) and self.name == other.name


@lru_cache(maxsize=512)
def _samples(named: _Named, window: int, ends: tuple[float, float], bands: tuple[float, ...]) -> int:
    wavelengths = torch.tensor(bands, dtype=torch.float64)
    depths = torch.tensor(ends, dtype=torch.float64)
    return plan_sampling(named.camera, wavelengths, depths, window).grid.samples


@lru_cache(maxsize=512)
def _coarse_grids(
    named: _Named, window: int, layers: int, ends: tuple[float, float], bands: tuple[float, ...]
) -> tuple[tuple[int, int], ...]:
    """Depths that share a grid of the pupil, and samples across it, as `sub_aperture_psfs` has them."""
    wavelengths = torch.tensor(bands, dtype=torch.float64)
    depths = torch.linspace(*ends, layers, dtype=torch.float64)
    alike = sampled_alike(named.camera, wavelengths, depths, window)
    return tuple((len(some), natural_samples(named.camera, pitch)) for some, pitch in alike)
