"""PSFs of all places in the field, depths and bands as sums of a few kernels.

A lens that varies over the field has other PSFs everywhere, but they are much alike: each is a sum of the
same few kernels, with factors that change smoothly. Light is multiplied by the factors of where it comes from
*before* it is blurred, so that each source has its own PSF, and a photo takes a blur for each kernel in place
of one for each place, depth and band.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..core.memory import give_back_memory
from ..core.progress import Progress, silent
from ..core.store import Store
from ..errors import InputError
from . import cache as bank_cache
from .camera import Camera
from .contrast import CONTRAST_DB, Contrast
from .field import MEAN, Frame, relative_light
from .psf import psf_bank

COARSER = 2.0
"""Places that cubics go through are this many times as far apart as those that straight lines go through."""
CUBIC = 4
"""Places that a cubic goes through."""
AT_ONCE = 256
"""PSFs, those that are farthest from sums of the kernels, that further kernels are found from."""
MOST_TERMS = 400
"""Kernels, at most."""
FEWER_BANDS = (3, 4, 6, 8, 11, 15, 20)
"""Wavelengths at which PSFs of places may be computed."""
PART_BYTES = 32 << 20
"""PSFs that kernels are found of at a time."""
PARTS = ("kernels", "factors", "held", "lost")
"""Tensors of `Terms`, by the names that files have for them."""
HALF = 0.5
"""Of an allowed error is for each of two causes."""


@dataclass(frozen=True, eq=False)
class Terms:
    """factors: [place down, place across, node, band, term] of each PSF, with the light of its place over
    that of the axis; kernels: [term, y, x]; held, lost: [down, across, node, band], the light that lands
    within the window and outside of it. first: places in steps (down, right) from the axis; step: pixels. The
    norm of factors is how pictures differ, relative to their contrast."""

    kernels: Tensor
    factors: Tensor
    held: Tensor
    lost: Tensor
    first: tuple[int, int]
    step: float

    @property
    def nbytes(self) -> int:
        return sum(each.nbytes for each in (self.kernels, self.factors, self.held, self.lost))


@dataclass(frozen=True)
class Grid:
    """Places in the field: their steps (down, right) from the axis, and pixels a step."""

    down: range
    across: range
    step: float

    @classmethod
    def around(cls, frame: Frame, beyond: int, step: float) -> Grid:
        """As few as reach these pixels beyond a frame on all sides: `COARSER` times as far apart as `step`,
        where there are enough for a cubic, or `step`."""
        ends = [
            (-beyond - axis, length + beyond - axis)
            for length, axis in zip((frame.height, frame.width), frame.axis, strict=True)
        ]
        farthest = max(abs(end) for pair in ends for end in pair)
        for apart in (COARSER * step, step):
            even = farthest / math.ceil(farthest / apart)
            down, across = (
                range(math.floor(low / even + 1e-9), math.ceil(high / even - 1e-9) + 1) for low, high in ends
            )
            if min(len(down), len(across)) >= CUBIC:
                break
        return cls(down, across, even)


def cubic(at: Tensor, count: int) -> Tensor:
    """Weights [n, place] of places 0, 1, ... by which polynomials through the four next to each say what is
    between them; through all where there are fewer.

    at: [n], in places.
    count: of places.
    """
    width = min(CUBIC, count)
    start = (at.floor() - (width - 1) // 2).clamp(0, count - width).long()
    nodes = start[:, None] + torch.arange(width)
    weights = at.new_ones(len(at), width)
    for one in range(width):
        for other in range(width):
            if other != one:
                weights[:, one] *= (at - nodes[:, other]) / (one - other)
    return at.new_zeros(len(at), count).scatter_(1, nodes, weights)


class _Kernels:
    """Kernels that grow in number until they make up all PSFs that are shown to them."""

    def __init__(self, size: int, allowed: float, dtype: torch.dtype) -> None:
        self._contrast, self._allowed = Contrast(size, dtype, MEAN), allowed
        self.kernels = torch.zeros(0, size, size, dtype=dtype)
        self._duals = self.kernels
        self._basis = torch.zeros(0, 2 * size * (size // 2 + 1), dtype=torch.float64)

    def factors(self, psfs: Tensor) -> Tensor:
        """[..., term] of PSFs [..., y, x], to within the allowed error in their mean square."""
        shape, psfs = psfs.shape[:-2], psfs.flatten(0, -3)
        factors = psfs.flatten(1) @ self._duals.flatten(1).T
        left = self._contrast.seen(psfs - torch.tensordot(factors, self.kernels, 1))
        allowed = (HALF * self._allowed) ** 2
        while len(self.kernels) < MOST_TERMS:
            off = left.square().sum(1)
            if float(off.mean()) <= self._allowed**2:
                break
            worst = left[off.topk(min(AT_ONCE, len(off))).indices].double()
            values, vectors = torch.linalg.eigh(worst @ worst.T)
            many = int((values.cumsum(0) > allowed * len(worst)).sum().clamp_min(1))
            found = vectors[:, -min(many, MOST_TERMS - len(self.kernels)) :].T @ worst
            found = found / found.norm(dim=1, keepdim=True)
            found = torch.linalg.qr((found - found @ self._basis.T @ self._basis).T)[0].T
            self._basis, found = torch.cat([self._basis, found]), found.to(left)
            self.kernels = torch.cat([self.kernels, self._contrast.kernels(found)])
            self._duals = torch.cat([self._duals, self._contrast.duals(found)])
            more = left @ found.T
            factors, left = torch.cat([factors, more], 1), left - more @ found
        return factors.unflatten(0, shape)

    def apart(self, one: Tensor, other: Tensor) -> Tensor:
        """How pictures differ by PSFs [..., y, x], [...]."""
        return self._contrast.seen((one - other).flatten(0, -3)).norm(dim=1).reshape(one.shape[:-2])


def terms_of(
    camera: Camera,
    frame: Frame,
    step: int,
    wavelengths: Tensor,
    nodes: Tensor,
    shares: Tensor | None,
    *,
    window_px: int,
    db: float,
    cache: Path | None = None,
    dtype: torch.dtype = torch.float32,
    progress: Progress = silent,
) -> Terms:
    """Of a frame and all around it that a window reaches.

    camera: as it is simulated.
    frame: where it looks.
    step: pixels between places where straight lines between them are true enough.
    wavelengths: [band], metres.
    nodes: [node], 1/m.
    shares: [group, band], for PSFs of groups in place of bands.
    window_px: side of the kernels.
    db: PSNR that a photo keeps by the number of kernels.
    cache: a folder for terms that outlive the process.
    dtype: float32 or float64.
    progress: is given how many places are done.

    Of a place, those depths have PSFs of their own that it matters at. Raises InputError as `psf_bank`, and
    where a part of the frame is dark.
    """
    grid = Grid.around(frame, window_px // 2, step)
    key = _key(camera, grid, wavelengths, nodes, shares, window_px, db, dtype)
    known = KEPT.find(key, cache)
    if known is not None:
        return known
    asked = _Asked(camera, frame, grid, wavelengths, nodes, shares, window_px, dtype)
    terms = _found(asked, 10 ** ((CONTRAST_DB - db) / 20), progress)
    KEPT.keep(key, terms, cache)
    bank_cache.BANKS.forget()  # what they were found of is not asked for again
    give_back_memory()
    return terms


@dataclass(frozen=True, eq=False)
class _Asked:
    """What `terms_of` is asked for."""

    camera: Camera
    frame: Frame
    grid: Grid
    wavelengths: Tensor
    nodes: Tensor
    shares: Tensor | None
    window: int
    dtype: torch.dtype

    def psfs(self, here: Camera, nodes: Tensor, wavelengths: Tensor) -> Tensor:
        """[node, band, y, x]."""
        return psf_bank(here, wavelengths, nodes, window_px=self.window, dtype=self.dtype).values.cpu()

    def seen(self, place: tuple[int, int]) -> Camera:
        """The camera that looks at a place of the grid; where that is dark, and outside of the frame, at what
        is nearest to it within."""
        frame, step = self.frame, self.grid.step
        y, x = frame.axis[0] + place[0] * step, frame.axis[1] + place[1] * step
        try:
            here = self.camera.seen_at(frame.field(y, x))
            if relative_light(here) > 0:
                return here
        except InputError:
            if 0 <= y <= frame.height and 0 <= x <= frame.width:
                raise
        return self.camera.seen_at(frame.field(min(max(y, 0), frame.height), min(max(x, 0), frame.width)))


def _found(asked: _Asked, allowed: float, progress: Progress) -> Terms:
    """Terms whose PSFs err by so much, relative to the contrast of a picture."""
    kernels, grid = _Kernels(asked.window, allowed, asked.dtype), asked.grid
    shares = torch.eye(len(asked.wavelengths)) if asked.shares is None else asked.shares
    places = [(y, x) for y in grid.down for x in grid.across]
    order = sorted(places, key=lambda place: -math.hypot(*place))
    progress(0.0, "PSFs on the axis")
    axial = asked.camera.seen_at((0.0, 0.0))
    central = asked.psfs(axial, asked.nodes, asked.wavelengths)
    matter, few, weights = _few(asked, allowed, kernels, asked.seen(order[0]), central)
    # PSFs are mixed before kernels are found of them, or factors of these after: whichever are fewer
    mixed, mixed_later = shares.to(asked.dtype) @ weights.to(asked.dtype), None
    if len(few) < len(mixed):
        mixed, mixed_later = torch.eye(len(few), dtype=asked.dtype), mixed
    at_few = torch.einsum("fm,nmyx->nfyx", mixed, central[matter][:, few])
    middle = central if asked.shares is None else torch.einsum("gm,nmyx->ngyx", shares.to(central), central)
    outside, own = 1 - middle.sum((-2, -1)), _in_parts(kernels, middle)
    del central, middle
    found: dict[tuple[int, int], tuple[Tensor, Tensor]] = {}
    for done, place in enumerate(order):
        progress((1 + done) / (1 + len(order)), f"PSFs of places in the field, {1 + done} of {len(order)}")
        here = asked.seen(place)
        factors, lost = own, outside
        if here.field != axial.field and len(matter):
            other = asked.psfs(here, asked.nodes[matter], asked.wavelengths[few])
            other = torch.einsum("fm,nmyx->nfyx", mixed, other).sub_(at_few)
            more, gone = kernels.factors(other), other.sum((-2, -1))
            if mixed_later is not None:
                more, gone = mixed_later @ more, gone @ mixed_later.T
            factors, lost = _wider(own, more.shape[-1]).clone(), outside.clone()
            factors[matter] += more
            lost[matter] -= gone
        light = relative_light(here)
        found[place] = factors * light, lost * light
    shape = (len(grid.down), len(grid.across))
    parts = [_wider(found[place][0], len(kernels.kernels)) for place in places]
    factors = torch.stack(parts).unflatten(0, shape)
    held = factors @ kernels.kernels.sum((-2, -1))
    return Terms(
        kernels.kernels,
        _even(factors, held, kernels.kernels, grid.step),
        held,
        torch.stack([found[place][1] for place in places]).unflatten(0, shape),
        (grid.down[0], grid.across[0]),
        grid.step,
    )


def _in_parts(kernels: _Kernels, psfs: Tensor) -> Tensor:
    """Factors [node, group, term] of PSFs [node, group, y, x], of which a part is worked on at a time: nodes
    at equal steps."""
    count = min(len(psfs), math.ceil(psfs.nbytes / PART_BYTES))
    parts = [kernels.factors(psfs[start::count]) for start in range(count)]
    factors = psfs.new_empty(*psfs.shape[:2], len(kernels.kernels))
    for start, part in enumerate(parts):
        factors[start::count] = _wider(part, len(kernels.kernels))
    return factors


def _even(factors: Tensor, held: Tensor, kernels: Tensor, step: float) -> Tensor:
    """Factors by which a white scene is as bright as the light of each place: where PSFs move light by
    distances that change with the place, it is spread or crowded, and pixels see as much more or less of the
    scene."""
    offset = torch.arange(kernels.shape[-1], dtype=kernels.dtype) - kernels.shape[-1] // 2
    down, across = (factors @ (kernels.sum(axis) @ offset) for axis in (-1, -2))
    gone = sum(
        torch.gradient(moved, spacing=step, dim=axis)[0]
        for axis, moved in enumerate((down, across))
        if factors.shape[axis] > 1
    )
    return factors * (1 + gone / held)[..., None]


def _few(
    asked: _Asked, allowed: float, kernels: _Kernels, corner: Camera, central: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Nodes [node] at which the place of a corner matters, and the wavelengths [few] at which PSFs are
    computed there, whose differences from those of the axis tell those of all bands, by weights [band, few]:
    as few as leave out no more than is allowed, looked at in the first, the last and the middle of the nodes.

    central: PSFs of the axis, [node, band, y, x]. Depths far out of focus are blurred alike everywhere.
    """
    bands = asked.wavelengths
    some = torch.tensor([0, len(bands) // 2, len(bands) - 1]).unique()
    off = kernels.apart(asked.psfs(corner, asked.nodes, bands[some]), central[:, some])
    matter = torch.nonzero(off.amax(1) > HALF * allowed).flatten()
    everything = torch.arange(len(bands))
    if not len(matter):
        return matter, everything, torch.eye(len(bands))
    ends = matter[torch.tensor([0, len(matter) // 2, len(matter) - 1]).unique()]
    true = asked.psfs(corner, asked.nodes[ends], bands) - central[ends]
    for count in FEWER_BANDS:
        if count < len(bands):
            few, weights = _through(bands, count)
            rebuilt = torch.einsum("bf,nfyx->nbyx", weights.to(true), true[:, few])
            if float(kernels.apart(rebuilt, true).square().mean().sqrt()) < HALF * allowed:
                return matter, few, weights
    return matter, everything, torch.eye(len(bands), dtype=torch.float64)


def _through(bands: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Bands [few] near the extrema of a Chebyshev polynomial in the wave number, and weights [band, few] by
    which the polynomial through them says what is at each band."""
    number = 1 / bands.double()
    number = 2 * (number - number.min()) / (number.max() - number.min()) - 1
    wanted = torch.cos(math.pi * torch.arange(count, dtype=torch.float64) / (count - 1))
    few = (number[:, None] - wanted).abs().argmin(0).unique()
    at = number[few]
    apart = at[:, None] - at + torch.eye(len(at))
    weights = torch.ones(len(bands), len(few), dtype=torch.float64)
    for one in range(len(few)):
        for other in range(len(few)):
            if other != one:
                weights[:, one] *= (number - at[other]) / apart[one, other]
    return few, weights


def _wider(factors: Tensor, count: int) -> Tensor:
    """Factors of as many terms: those of kernels that came later are 0."""
    return torch.nn.functional.pad(factors, (0, count - factors.shape[-1]))


def _key(
    camera: Camera,
    grid: Grid,
    wavelengths: Tensor,
    nodes: Tensor,
    shares: Tensor | None,
    window_px: int,
    db: float,
    dtype: torch.dtype,
) -> str:
    said = {
        "optics": bank_cache.identity(camera),
        "grid": [list(grid.down), list(grid.across), grid.step],
        "window": window_px,
        "db": db,
        "dtype": str(dtype),
    }
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for axis in (wavelengths, nodes, *(() if shares is None else (shares,))):
        digest.update(axis.cpu().double().numpy().tobytes() + b"|")
    return digest.hexdigest()


def _read(path: Path) -> Terms:
    read = load_file(path)
    first, step = read["place"].tolist(), float(read["step"])
    kernels, factors, held, lost = (read[name] for name in PARTS)
    return Terms(kernels, factors, held, lost, (int(first[0]), int(first[1])), step)


def _write(terms: Terms, path: Path) -> None:
    parts = {name: getattr(terms, name) for name in PARTS}
    parts |= {"place": torch.tensor(terms.first), "step": torch.tensor(terms.step, dtype=torch.float64)}
    save_file({name: part.contiguous() for name, part in parts.items()}, path)


KEPT: Store[Terms] = Store(
    "terms-{}.safetensors",
    _read,
    _write,
    size=lambda terms: terms.nbytes,
    memory_bytes=512 << 20,
    most_files=24,
)
