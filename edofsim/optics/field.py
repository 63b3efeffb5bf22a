"""Places in the field that PSFs are computed at, and the share that each has of a place on the sensor.

Of a lens that varies over the field (`Lens.varies`), the PSF changes from place to place. The places stand on
a square grid, `step` pixels apart, with one on the optical axis: a part of a frame has the same ones as the
whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from .camera import Camera, focus_distance
from .contrast import CONTRAST_DB, contrast_transfer, transfers_apart
from .grid import PupilGrid
from .lenses.base import AXIS, Field, Lens
from .masks import Mask, mask_amplitude
from .psf import carries_gradients, psf_bank
from .psf_field import PsfField
from .pupil import StrongMask
from .sensor import response

STEPS = (1024, 512, 256, 128, 64, 32, 16, 8)
"""Distances of places, in pixels, that are chosen from: halved, errors fall by 12 dB."""
LIGHT_SAMPLES = 258
"""Across the pupil, for the light that comes from a place in the field."""
HELD_BYTES = 1 << 29
"""Largest PSFs that are held in memory as a whole."""
MEAN = 1.6
"""Of a picture, in units of its contrast."""
BLUR_PX = 16.0
"""Blur of the depths that cells are looked at in: farther out of focus, PSFs change less."""
WAY = (0.0, 0.5, 0.999)
"""Parts of the way to the farthest corner at which cells are looked at."""


@dataclass(frozen=True)
class Place:
    """A place that PSFs are computed at.

    field: as `Frame.field` gives it.
    rows, columns: of the frame that it has a share of.
    share: [row, column] of that, from 0 to 1: hats, which sum to 1 over the places at each pixel.
    """

    field: Field
    rows: slice
    columns: slice
    share: Tensor


@dataclass(frozen=True)
class Frame:
    """What a view says of where it looks.

    axis: (y, x) of the optical axis, pixels from the top left corner of height x width pixels.
    pixel_angle: tangent that one sees.
    """

    height: int
    width: int
    axis: tuple[float, float]
    pixel_angle: float

    @classmethod
    def about(cls, height: int, width: int, camera: Camera) -> Frame:
        """A frame with the optical axis in its middle, in the camera's pixels."""
        return cls(height, width, (height / 2, width / 2), camera.pixel_angle)

    def field(self, y: float, x: float) -> Field:
        """Tangents (right, up) that a lens without distortion images at a place, in pixels from the top left
        corner: see `Camera.seen_at`."""
        return (x - self.axis[1]) * self.pixel_angle, (self.axis[0] - y) * self.pixel_angle


def places(frame: Frame, step: int) -> Iterator[Place]:
    """The places, row by row, that have a share of a frame; those next to it are outside."""
    down, across = (
        _hats(n, at, step) for n, at in ((frame.height, frame.axis[0]), (frame.width, frame.axis[1]))
    )
    for y, rows, row_share in down:
        for x, columns, column_share in across:
            yield Place(frame.field(y, x), rows, columns, torch.outer(row_share, column_share))


def _hats(count: int, axis: float, step: int) -> list[tuple[float, slice, Tensor]]:
    """Places along one axis of a frame of `count` pixels: where, of which pixels, which share [pixel]."""
    middles = torch.arange(count, dtype=torch.float64) + 0.5
    first, last = math.floor((0.5 - axis) / step), math.ceil((count - 0.5 - axis) / step)
    found = []
    for k in range(first, last + 1):
        share = (1 - (middles - axis - k * step).abs() / step).clamp_min(0)
        there = torch.nonzero(share).flatten()
        if len(there):
            part = slice(int(there[0]), int(there[-1]) + 1)
            found.append((axis + k * step, part, share[part]))
    return found


def joined(frame: Frame, step: int, image: Callable[[Place], Tensor]) -> Tensor:
    """One image of a frame from those of its places, [..., row, column].

    image: of a place's rows and columns, [..., row, column], as all light that reaches them is seen from
        there.
    frame: rows and columns of the image.
    step: pixels between places.
    """
    whole = None
    for place in places(frame, step):
        part = image(place) * place.share.to(torch.float64)
        if whole is None:
            whole = part.new_zeros(*part.shape[:-2], frame.height, frame.width)
        whole[..., place.rows, place.columns] += part
    assert whole is not None  # every frame has a place
    return whole


def relative_light(camera: Camera) -> float:
    """Light on the sensor from the camera's place in the field over that from the axis."""
    if not camera.lens.varies:
        return 1.0
    right, up = map(abs, camera.field)
    alike = camera.lens.round and camera.mask.kind == "clear"  # the same all round, mirrored
    field = (max(right, up), min(right, up)) if alike else camera.field
    return _light(camera.lens, camera.mask, field) / _light(camera.lens, camera.mask, AXIS)


@lru_cache(maxsize=4096)
def _light(lens: Lens, mask: Mask, field: Field) -> float:
    radius = lens.aperture_radius
    grid = PupilGrid(LIGHT_SAMPLES, 2 * radius / (LIGHT_SAMPLES - 2), radius)
    right, up = grid.centres[None, :], grid.centres.flip(0)[:, None]
    light = mask_amplitude(mask, grid)[1] * lens.field_open(right, up, field)
    return float(light.sum()) * lens.illumination(field)


def psfs_on_sensor(camera: Camera, step: float, psfs: Callable[[Camera], Tensor]) -> Tensor:
    """What lands around the camera's place in the field, each pixel from the place that its light comes from.

    psfs: of a camera, [..., y, x].
    step: tangent to the places on both sides, from whose PSFs it follows how they change with the place.
    camera: at its place in the field.

    A PSF says where light from one place goes; on the sensor, light that lands u pixels from its place is
    from a place u pixels away, whose PSF is another: to first order, the PSF less u times its slope. Light,
    relative to that of the camera's place, changes likewise. The sum stays: pixels see as much of a white
    scene as their place has light, however PSFs spread or crowd it.
    """
    own = relative_light(camera)
    right, up = camera.lens.lands(camera.field)

    def at(place: Field) -> Tensor | None:
        try:
            there = camera.seen_at(place)
            return psfs(there) * (relative_light(there) / own)
        except StrongMask:
            raise
        except InputError:  # no light from there reaches the sensor
            return None

    middle = psfs(camera)
    offset = torch.arange(middle.shape[-1], dtype=middle.dtype, device=middle.device) - middle.shape[-1] // 2
    result = middle
    across = (at((right + step, up)), at((right - step, up)))
    down = (at((right, up - step)), at((right, up + step)))
    in_pixels = step / camera.pixel_angle
    for (after, before), u in ((across, offset[None, :]), (down, offset[:, None])):
        steps = (after is not None) + (before is not None)
        if steps:
            change = (middle if after is None else after) - (middle if before is None else before)
            result = result - u * change / (steps * in_pixels)
    return result * (middle.sum((-2, -1)) / result.sum((-2, -1)))[..., None, None]


def step_for(camera: Camera, frame: Frame, wavelengths: Tensor, ends: tuple[float, float], db: float) -> int:
    """The largest of `STEPS` by which photos err by less than `db` of PSNR, see `errors_by_step`.

    wavelengths: [band], metres.
    camera, frame, ends: as of `errors_by_step`.
    db: PSNR of the error that is allowed.
    """
    if not camera.lens.varies:
        return STEPS[0]
    found = errors_by_step(camera, frame, wavelengths, ends)
    return next((step for step, error in found if step and error < 10 ** (-db / 20)), STEPS[-1])


def errors_by_step(
    camera: Camera, frame: Frame, wavelengths: Tensor, ends: tuple[float, float], *, lit: bool = False
) -> Iterator[tuple[int, float]]:
    """For 0, which is the PSF of the axis everywhere, and then each of `STEPS`: by how much photos err, root
    mean square at full scale 1, where PSFs of places so far apart are joined.

    Looked at along a diagonal, from the axis to the corner that is farthest from it: at the middle of a cell
    the PSF, with its light, stands against the mean of the cell's corners, by the contrast of a picture whose
    power spectrum falls with the square of the frequency.

    wavelengths: [band], metres.
    ends: least and largest inverse depth [1/m]: looked at are the distance in focus and those whose blur is
        `BLUR_PX`, or what is nearest to them between the ends. Nothing of a picture decides.
    camera: one whose lens `varies`.
    frame: rows and columns of the photo.
    lit: of a change that has the light of each place in any case, and is of all depths and colours: only PSFs
        err, and their mean counts; else the worst of them.

    Raises InputError for a mask that bends rays too much.
    """
    bands = torch.as_tensor(wavelengths, dtype=torch.float64).flatten().cpu()
    colours = response(camera, bands) @ bands
    focus = 1 / float(focus_distance(camera, float(colours[1])))
    blur = BLUR_PX * camera.pixel / (2 * camera.aperture_radius * camera.sensor_distance)
    depths = sorted({min(max(focus + aside, ends[0]), ends[1]) for aside in (-blur, 0.0, blur)})
    corners = [(y, x) for y in (0.0, float(frame.height)) for x in (0.0, float(frame.width))]
    y, x = max(corners, key=lambda c: math.hypot(c[0] - frame.axis[0], c[1] - frame.axis[1]))
    along = (y - frame.axis[0], x - frame.axis[1])
    known: dict[tuple[float, float], tuple[Tensor, float]] = {}

    def seen_at(down: float, right: float) -> tuple[Tensor, float]:
        """Transfer functions, and the light, at a place in pixels from the axis."""
        if (down, right) not in known:
            here = camera.seen_at((right * frame.pixel_angle, -down * frame.pixel_angle))
            light = 1.0 if lit else relative_light(here)
            known[down, right] = contrast_transfer(psf_bank(here, colours, depths).values) * light, light
        return known[down, right]

    def off(step: int, part: float) -> float:
        """At the middle of the cell that holds a part of the way to the corner; or there, without steps."""
        try:
            if step:
                down, right = (math.floor(part * way / step) * step for way in along)
                ends = [seen_at(down + y * step, right + x * step) for y in (0, 1) for x in (0, 1)]
                transfer, light = seen_at(down + step / 2, right + step / 2)
            else:
                ends, (transfer, light) = [seen_at(0.0, 0.0)], seen_at(*(part * way for way in along))
        except StrongMask:
            raise
        except InputError:  # light from so far outside of the frame does not reach the sensor
            return math.inf
        mean = torch.stack([each for each, _ in ends]).mean(0)
        dark = MEAN * (light - sum(each for _, each in ends) / len(ends))
        return 10 ** (-CONTRAST_DB / 20) * math.hypot(transfers_apart(transfer, mean, of_all=lit), dark)

    return ((step, max(off(step, part) for part in WAY)) for step in (0, *STEPS))


def psf_field(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    window_px: int,
    field_step: float | None = None,
    held: bool = True,
    cache: Path | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> PsfField:
    """`psf_bank`, but that more than `HELD_BYTES` are computed as they are needed, unless gradients must pass
    them; and, on request, as what reaches a place on the sensor.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    field_step: tangent from the camera's place in the field to those next to it, for what reaches its place
        on the sensor (see `psfs_on_sensor`); None: for what leaves its place in the scene.
    camera, window_px, cache, dtype, device: as of `psf_bank`.

    Raises InputError as `psf_bank`.
    """

    def psfs(depths: Tensor) -> Tensor:
        def of(seen_by: Camera) -> Tensor:
            how = {"cache": cache, "dtype": dtype, "device": device}
            return psf_bank(seen_by, wavelengths, depths, window_px=window_px, **how).values

        return of(camera) if field_step is None else psfs_on_sensor(camera, field_step, of)

    size = inverse_depths.numel() * wavelengths.numel() * window_px**2 * dtype.itemsize
    if held and size <= HELD_BYTES or carries_gradients(camera):
        return PsfField(psfs(inverse_depths), inverse_depths, wavelengths)
    return PsfField(psfs, inverse_depths, wavelengths, window_px)
