"""How much work a simulation is, counted and not done: a few named kinds of it for each stage.

What a choice needs of it is which of two simulations is more work, and what is reported is that seconds are
right within a factor of 1.7: padding, what is kept from one transform to the next and the like are not
counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from ..capture.fidelity import Fidelity, of_sub_apertures, pupil_is_free, simpler_camera
from ..capture.layers import BLOCK_PIXELS
from ..capture.light import CROP_BELOW
from ..optics import Camera
from ..optics.band_limited import band_limited_nodes
from ..optics.camera import defocus_per_dioptre
from ..optics.field import Frame, places
from ..optics.grid import PupilGrid, disc_coverage
from ..optics.height import natural_samples
from ..optics.psf import INTERPOLATION_ERROR
from ..optics.sampling import plan_sampling, sampled_alike
from ..optics.sub_apertures import coarse_oversampling, coarse_window, partition, windows_along
from ..optics.terms import Grid
from .shape import Shape, nodes_used

STAGES = ("prepare", "psf", "blur", "sub_apertures", "sensor")
KINDS = ("calls", "products", "transforms", "elements", "moves")
"""Of work: calls of little operations, multiplications within products of matrices (waves), pixels of Fourier
transforms times their logarithm, elements that are reckoned with, fragments that are moved."""
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
SYMMETRIC_PUPIL_COST = 0.25
"""Of the work of PSFs is left where the pupil is its own mirror image, as without a mask."""
COVERAGES = 3
"""Images of coverage that are blurred for each depth: one a channel."""
LITTLE = 0.4
"""Of an element's work is that of one of a wave that is added to another."""
BLURRED = 20.0
"""Calls of a blur, in those of one depth node."""
MIRRORED = 6.0
"""Places of a round lens that share the PSFs of one, mirrored."""
KERNELS = 40
"""That make up the PSFs of a field."""
CORNERS = 8
"""Between which the factors of a fragment are looked up."""
TRACED = (160, 30)
"""Calls that a place in the field takes to be traced, and each wavelength of it."""
SOUGHT_AT = 15
"""Places that are looked at where the photo itself chooses how far apart they are, in three wavelengths."""
FEW = 4
"""Wavelengths that PSFs of places in the field are computed at, where terms make up those of all."""
FACTORS = 1.5
"""Elements of work for each pixel of a PSF whose factors are found."""
MOVED = 0.02
"""Of what looking through fragments takes is moving those of one image."""

Amounts = Mapping[str, float]
"""Of work, by `KINDS`."""


@dataclass(frozen=True)
class Work:
    """Amounts by stage.

    bytes: of PSFs, light and transforms.
    """

    amounts: Mapping[str, Amounts]
    bytes: float


def _psfs(samples: int, out: float, has_height: bool, pupils: int, between: float) -> Amounts:
    """What PSFs take. samples: across the pupil; out: along half an axis of their window; has_height:
    whether a mask changes the wave; pupils: grids of it that are made, one a wavelength; between: PSFs."""
    half, known = samples / 2, between * (1.0 if has_height else SYMMETRIC_PUPIL_COST)
    return {
        "calls": pupils,
        "elements": (pupils + 1 + has_height) * samples**2 + LITTLE * known * (half**2 + out**2),
        "products": known * (out * half**2 + out**2 * half),
    }


def work_of(
    shape: Shape,
    camera: Camera,
    fidelity: Fidelity,
    layers: int,
    groups: int,
    colours: int,
    step: int = 0,
    parts_step: int = 0,
) -> Work:
    """The work of a photo.

    layers: depth nodes.
    groups: images that are blurred for each of them.
    colours: wavelengths of PSFs.
    step: pixels between the places in the field that these are computed at, 0 for one place.
    parts_step: likewise for sub-apertures.
    """
    window = fidelity.window_px or camera.recipe.psf.window_px
    layers = 1 if shape.ends[0] == shape.ends[1] else layers
    optics = tuple(getattr(fidelity, name) for name in OPTICS)
    samples, finest = shape.counted.get(
        ("optics", window, *optics), lambda: _optics_of(shape, camera, fidelity, window)
    )
    has_height = camera.has_mask
    between = shape.counted.get(("between", layers), lambda: waves_between(camera, shape, layers)) * colours
    waves = _psfs(samples, (window * finest + 2) / 2, has_height, colours, between)
    how = (fidelity.occlusion, window, layers, groups)
    blur, largest = shape.counted.get(("blur", *how), lambda: _blur_of(shape, *how))
    coarse = of_sub_apertures(fidelity, camera, abs(shape.ends[1] - shape.ends[0]))
    few = min(layers, coarse.layers or layers)
    of_parts = (fidelity.occlusion, fidelity.sub_apertures, fidelity.sub_aperture_pixel)
    parts, held = shape.counted.get(
        ("parts", window, few, *of_parts, *optics),
        lambda: _parts_of(shape, camera, coarse, window, few, samples),
    )
    fragments = shape.fragments * _frame(shape, window) / math.prod(shape.padded_shape)
    pixels = 3.0 * shape.height * shape.width
    moved = 0.0 if shape.one_each else shape.fragments + fragments
    gathered = groups if fidelity.band_groups else 0
    mirrored = camera.lens.round and not has_height
    joined, wider = _over_field(shape, window, step)
    with_next = (joined**0.5 + 2) ** 2 if step else 0.0  # those next to the frame too
    psfs, blur = _times(waves, 1 + with_next / (MIRRORED if mirrored else 1.0)), _times(blur, wider)
    if step and fidelity.field_terms:
        few = min(FEW, colours)
        own = _psfs(samples, (window * finest + 2) / 2, True, few, layers * few)
        terms, blur = _terms_of(shape, fidelity, window, layers, groups, step, mirrored, own)
        psfs = _added(waves, terms)
    in_parts, parts_wider = (at + (parts_step > 0) for at in _over_field(shape, window, parts_step))
    block = min(groups, max(1.0, BLOCK_PIXELS // largest))
    return Work(
        {
            "prepare": {"calls": 1.0, "moves": moved, "elements": pixels},
            "psf": psfs,
            "blur": blur,
            "sub_apertures": _times(parts, parts_wider)
            | {kind: parts.get(kind, 0.0) * in_parts for kind in ("calls", "products")},
            "sensor": {"elements": pixels},
        },
        4.0 * layers * (colours + gathered) * window**2
        + 4.0 * fragments * (shape.bands + groups)
        + 24.0 * block * largest
        + held,
    )


def waves_between(camera: Camera, shape: Shape, layers: int) -> int:
    """Depths at which the PSFs of this many layers are computed, at the wavelength in the middle."""
    middle = (shape.wavelengths[0] + shape.wavelengths[-1]) / 2
    return min(
        layers, len(band_limited_nodes(*shape.ends, defocus_per_dioptre(camera, middle), INTERPOLATION_ERROR))
    )


def _optics_of(shape: Shape, camera: Camera, fidelity: Fidelity, window: int) -> tuple[int, int]:
    """Samples across the pupil, and along a pixel."""
    wavelengths = torch.tensor(shape.wavelengths, dtype=torch.float64)
    depths = torch.tensor(shape.ends, dtype=torch.float64)
    samples = plan_sampling(simpler_camera(camera, fidelity), wavelengths, depths, window).samples
    return samples, fidelity.oversampling or camera.oversampling(min(shape.wavelengths))


def _frame(shape: Shape, window: int) -> float:
    """Pixels of the frame with the margin that PSFs reach."""
    return (shape.height + 2.0 * (window // 2)) * (shape.width + 2.0 * (window // 2))


def _terms_of(
    shape: Shape,
    fidelity: Fidelity,
    window: int,
    layers: int,
    groups: int,
    step: int,
    mirrored: bool,
    own: Amounts,
) -> tuple[Amounts, Amounts]:
    """Amounts of finding kernels and factors, and of blurring by them. own: of the PSFs of a place; mirrored:
    whether those of others are the same."""
    middle = Frame(shape.height, shape.width, (shape.height / 2, shape.width / 2), 1.0)
    grid = Grid.around(middle, window // 2, step)
    steps = [(abs(y), abs(x)) for y in grid.down for x in grid.across]
    alone = len({tuple(sorted(each)) for each in steps} if mirrored else steps)
    calls = {"calls": float(TRACED[0] + TRACED[1] * FEW)}
    sought = 0 if fidelity.field_step_px else SOUGHT_AT * (TRACED[0] + 3 * TRACED[1])
    found = {"elements": FACTORS * len(steps) * layers * groups * window**2, "calls": float(sought)}
    terms = _added(_times(_added(own, calls), 1 + alone), found)  # a corner is looked at before
    frame = _frame(shape, window)
    fragments = shape.fragments * frame / math.prod(shape.padded_shape)
    images = groups + COVERAGES * (fidelity.occlusion == "hidden")
    return terms, {
        "elements": CORNERS * KERNELS * fragments * images,
        "transforms": 4.0 * KERNELS * frame * math.log2(frame),
    }


def _over_field(shape: Shape, window: int, step: int) -> tuple[int, float]:
    """How many places in the field a photo is joined from; and how much more is blurred: the parts of the
    frame of all of them, each with what its blur reaches."""
    if not step:
        return 1, 1.0
    rows, columns = (_parts(size, step) for size in (shape.height, shape.width))
    blurred = [sum(size + window for size in sizes) for sizes in (rows, columns)]
    return len(rows) * len(columns), max(1.0, blurred[0] * blurred[1] / _frame(shape, window))


@lru_cache(1024)
def _parts(size: int, step: int) -> list[int]:
    """Pixels along an axis of a frame of this size that each place of it has a share of."""
    row = Frame(size, 1, (size / 2, 0.5), 1.0)
    return [len(place.share) for place in places(row, step)]


def _times(amounts: Amounts, factor: float) -> dict[str, float]:
    return {kind: amount * factor for kind, amount in amounts.items()}


def _added(*parts: Amounts) -> Amounts:
    return {kind: sum(part.get(kind, 0.0) for part in parts) for kind in KINDS}


def _blurs(size: Tensor, nodes: Tensor, images: int, lights: int) -> Amounts:
    """Blurs of this many images at depth nodes, of pixels each. lights: what they are images of."""
    return {
        "calls": float((BLURRED + nodes).sum()),
        "transforms": float(((nodes * (images + lights) + 3) * size * size.log2()).sum()),
        "elements": float(((nodes * (images + COVERAGES) + 3) * size).sum()),
    }


def _blur_of(shape: Shape, occlusion: str, window: int, layers: int, groups: int) -> tuple[Amounts, float]:
    """Amounts of blurring, and the pixels of the largest transform."""
    frame = torch.tensor([_frame(shape, window)], dtype=torch.float64)
    scale = float(frame) / math.prod(shape.padded_shape)
    nodes = nodes_used(shape.occupied[None], layers)
    if occlusion in ("over", "normalised"):  # each fragment is at a node
        one = torch.ones(int(nodes), dtype=torch.float64)
        work = (_blurs(one * frame, one, groups, groups), _blurs(one * frame, one, COVERAGES, 1))
        return _added(*work, {"moves": shape.visible * scale * float(nodes)}), float(frame)
    slabs = shape.slabs if occlusion == "hidden" else None
    plain = _added(_blurs(frame, nodes, groups, groups), {"moves": MOVED * shape.visible * scale * groups})
    if slabs is None:
        return plain, float(frame)
    size, nodes = _boxes(shape, window // 2), nodes_used(slabs.occupied, layers)
    work = (_blurs(size, nodes, groups, groups), _blurs(size, nodes, COVERAGES, 1))
    kept = torch.ones_like(size) * scale
    if shape.in_tiles:
        kept, around = ((slabs.part + 2.0 * reach).prod(1) for reach in (window // 2, shape.reach))
        kept = kept / around
    moves = {"moves": float((slabs.around * kept).sum()) + shape.fragments * scale}
    return _added(*work, moves, plain if shape.in_tiles else {}), max(float(size.max()), float(frame))


def _boxes(shape: Shape, reach: int, side: int = 1) -> Tensor:
    """Pixels, in those of `side`, that each slab is blurred in: float64 [slab]. reach: of the blur."""
    assert shape.slabs is not None
    margin = 2 * reach if shape.in_tiles else 0
    part = (shape.slabs.part.double() + margin) / side
    own = (shape.slabs.extent.double() + 2 * reach) / side
    box, whole = torch.minimum(own, part).prod(1), part.prod(1)
    return torch.where(box < CROP_BELOW * whole, box, whole)


def _parts_of(
    shape: Shape, camera: Camera, coarse: Fidelity, window: int, layers: int, samples: int
) -> tuple[Amounts, float]:
    """Amounts of compositing sub-apertures, and the bytes of their PSFs and light. coarse: see
    `of_sub_apertures`."""
    across, slabs = coarse.sub_apertures, shape.slabs
    if across == 1 or coarse.occlusion != "hidden" or slabs is None:
        return {}, 0.0
    colours = min(shape.bands, COVERAGES * coarse.group_wavelengths)
    count, side = parts_of_disc(across), coarse.sub_aperture_pixel
    grids = ((layers, samples),)
    if coarse.pupil_sampling_um is None and pupil_is_free(camera):
        grids = _coarse_grids(shape, camera, coarse, window, layers)
    width = coarse_window(window, side)
    middle = shape.wavelengths[len(shape.wavelengths) // 2]
    out = (width * coarse_oversampling(simpler_camera(camera, coarse), middle, side) + 2) / 2
    along = sum(
        across * colours * (samples**2 + depths * out * (samples / 2) ** 2)
        + count * colours * depths * out**2 * samples / 2
        for depths, samples in grids
    )
    # light is blurred in pixels of `side`, by windows that are never narrower than a few of them
    size, nodes = _boxes(shape, width // 2 * side, side), nodes_used(slabs.occupied, layers)
    elements = count * 2 * COVERAGES * float((nodes * size).sum())
    held = 4.0 * layers * width**2 * count * (COVERAGES + colours)
    held += 32.0 * (COVERAGES + 1) * float((nodes * size).max())
    return {"calls": float(count), "products": along, "elements": elements}, held


def _coarse_grids(
    shape: Shape, camera: Camera, coarse: Fidelity, window: int, layers: int
) -> tuple[tuple[int, int], ...]:
    """Depths that share a grid of the pupil, and samples across it, as `sub_aperture_psfs` has them."""
    simpler = simpler_camera(camera, coarse)
    wavelengths = torch.tensor(shape.wavelengths, dtype=torch.float64)
    depths = torch.linspace(*shape.ends, layers, dtype=torch.float64)
    alike = sampled_alike(simpler, wavelengths, depths, window)
    return tuple((len(some), natural_samples(simpler, pitch)) for some, pitch in alike)


@lru_cache(maxsize=16)
def parts_of_disc(across: int) -> int:
    """Parts of a pupil that is open everywhere."""
    grid = PupilGrid(32 * across, 1 / (16 * across), 1.0)
    return len(partition(windows_along(grid, across), disc_coverage(grid, 1.0)))
