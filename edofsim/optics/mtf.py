"""Measures of a PSF: transfer functions, Strehl ratio, encircled energy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from scipy.fft import dct, next_fast_len
from torch import Tensor

from .camera import Camera, cutoff_frequency, defocus
from .grid import PupilGrid
from .pupil import aperture, bent, chirp, pupil_function
from .sampling import plan_sampling

FEWEST_SAMPLES = 512
"""Fewest samples across the pupil: what its edge scatters beyond the replica period is missing from a
transfer function, with this many less than 1e-3 of the light."""
PEAKS = 8
"""Samples around which the peak of a large pupil's PSF is looked for."""
BLOCK_BYTES = 256 << 20
"""Largest part of a transformed field that is held at a time: a fast lens needs thousands of samples."""
LINE_BYTES = 16 << 20
"""Of lines of the pupil that are transformed at a time: each by itself, so that few are as quick as many."""
LARGE_PUPIL = 4096
"""Samples across the pupil beyond which each depth has a grid of its own, as fine as its steepest phase asks
for, without the margin of the paper's bound."""
MIRRORED = 1e-12
"""Largest difference of pupils from their mirror images that is rounding."""


def otf(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
    *,
    angle_deg: float = 0.0,
    with_pixel: bool = False,
) -> Tensor:
    """Optical transfer function along one direction, complex128 [depth, frequency], 1 at frequency 0.

    inverse_depths: [depth], 1/m.
    frequencies: [frequency] in 1/m on the sensor.
    angle_deg: of the frequency vector in the upright picture, counter-clockwise from the right.
    with_pixel: times the transform of a square pixel. Of a measured lens, the pixel is in it in any case.
    camera: its lens, mask and place in the field.
    wavelength: metres.

    This is the Fourier transform of the whole PSF (Goodman, Introduction to Fourier Optics, section 6.3: the
    autocorrelation of the pupil function), sampled at the rate of the pupil's own bandwidth, so that it is
    free of the sensor's aliasing. Raises InputError as `psf_bank` does.
    """
    return _otfs(camera, wavelength, inverse_depths, frequencies, (angle_deg,), with_pixel)[0]


def _otfs(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
    angles_deg: Sequence[float],
    with_pixel: bool = False,
) -> Tensor:
    """`otf` along several directions, complex128 [direction, depth, frequency], of the same pupils."""
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64).flatten()
    frequencies = torch.as_tensor(frequencies, dtype=torch.float64).flatten()
    radians = [math.radians(angle) for angle in angles_deg]
    ways = [(frequencies * math.cos(angle), frequencies * math.sin(angle)) for angle in radians]
    if camera.lens.measured:
        return torch.stack([_of_measured(camera, wavelength, inverse_depths, *way) for way in ways])
    transform = torch.zeros(len(angles_deg), len(inverse_depths), len(frequencies), dtype=torch.complex128)
    for depth, (plane, place) in enumerate(_focal_planes(camera, wavelength, inverse_depths)):
        for side, ((across, up), angle) in enumerate(zip(ways, angles_deg, strict=True)):
            transform[side, depth] = plane.transform(place, across, up, angle % 180)
    # exactly 0 beyond the cut-off, where the samples would repeat the spectrum
    transform = transform * (frequencies.abs() < cutoff_frequency(camera, wavelength))
    if with_pixel:
        pixel = [torch.sinc(across * camera.pixel) * torch.sinc(up * camera.pixel) for across, up in ways]
        transform = transform * torch.stack(pixel)[:, None]
    return transform


def _of_measured(
    camera: Camera, wavelength: float, inverse_depths: Tensor, across: Tensor, up: Tensor
) -> Tensor:
    """Transfer functions [depth, frequency] of PSFs that were measured: their pixels are in them."""
    side = camera.recipe.psf.window_px
    at = torch.tensor([wavelength], dtype=torch.float64)
    psf = camera.lens.psfs(camera.field, at, inverse_depths, camera.pixel, side)[:, 0].to(torch.complex128)
    places = (torch.arange(side, dtype=torch.float64) - side // 2) * camera.pixel
    in_x, in_y = _wave(-places[:, None] * across), _wave(places[:, None] * up)
    found = torch.einsum("dyx,yf,xf->df", psf, in_y, in_x)
    return found / psf.sum((-1, -2))[:, None]


def mtf(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
    *,
    angle_deg: float = 0.0,
) -> Tensor:
    """Modulation transfer function |`otf`|, float64 [depth, frequency]; arguments as for `otf`.

    camera, wavelength, inverse_depths, frequencies, angle_deg: as of `otf`, [depth] and [frequency].
    """
    return otf(camera, wavelength, inverse_depths, frequencies, angle_deg=angle_deg).abs()


def tangential_sagittal(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
) -> Tensor:
    """MTFs along the camera's direction in the field and across it, float64 [2, depth, frequency]; arguments
    as for `otf`. On the axis, those of a field above it.

    camera, wavelength, inverse_depths, frequencies: as of `otf`, [depth] and [frequency].
    """
    right, up = camera.field
    along = math.degrees(math.atan2(up, right)) if right or up else 90.0
    found = [
        _otfs(camera, wavelength, [each], frequencies, (along, along - 90))
        for each in torch.as_tensor(inverse_depths, dtype=torch.float64).flatten().tolist()
    ]
    return torch.cat(found, 1).abs()


def strehl(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    *,
    on_axis: bool = False,
) -> Tensor:
    """Peak of each PSF over that of the same amplitude without aberration, float64 [depth, band].

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    on_axis: the intensity in the middle instead of the peak, wherever that lies.
    camera: its lens, mask and place in the field.
    """
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64).flatten()
    ratios = []
    for wavelength in torch.as_tensor(wavelengths, dtype=torch.float64).flatten().tolist():
        peaks = [
            (plane.centre(place) if on_axis else plane.peak(place)) / plane.amplitude**2
            for plane, place in _focal_planes(camera, wavelength, inverse_depths)
        ]
        ratios.append(torch.tensor(peaks, dtype=torch.float64))
    return torch.stack(ratios, dim=1)


@dataclass(frozen=True)
class _FocalPlane:
    """The field's transform over a whole replica period, `count` x `count` samples in upright orientation.

    pupil: complex128 [samples, samples] without defocus; chirps: its defocus along an axis, [depth, samples];
    step: between samples [m]; parts: of the rows, every n-th at a time; amplitude: sum of the pupil's;
    mirrored: the pupil is even in x and in y, so that a quadrant tells all.
    """

    pupil: Tensor
    chirps: Tensor
    count: int
    parts: int
    step: float
    amplitude: float
    mirrored: bool

    @property
    def positions(self) -> Tensor:
        """Places of the samples along one axis in metres, in the order of the transform, float64 [count]."""
        index = torch.arange(self.count, dtype=torch.float64)
        return ((index + self.count // 2) % self.count - self.count // 2) * self.step

    def transform(self, depth: int, across: Tensor, up: Tensor, angle_deg: float) -> Tensor:
        """Fourier transform of |F|^2 at frequencies [1/m], complex128 [frequency], 1 at frequency 0.

        angle_deg: their direction; along an axis a sum over lines of the pupil does.
        """
        none = torch.zeros(1, dtype=torch.float64)
        along_x, along_y = (
            _wave(torch.cat([each, none]) * self.positions[:, None]) for each in (-across, up)
        )
        if angle_deg in (0, 90):
            line = self.line(depth, angle_deg == 90)
            total = line.to(along_x.dtype) @ (along_y if angle_deg else along_x)
            return total[:-1] / total[-1]
        if self.mirrored:
            along_x, along_y = (_both_sides(along) for along in (along_x, along_y))
        in_parts = torch.view_as_real(along_x).flatten(1)
        total = torch.zeros(len(across) + 1, dtype=along_x.dtype)
        for rows, image in self.intensity(depth):
            in_x = torch.view_as_complex((image @ in_parts).unflatten(1, (-1, 2)))
            total += (in_x * along_y[rows]).sum(0)
        return total[:-1] / total[-1]

    def intensity(self, depth: int) -> Iterator[tuple[slice, Tensor]]:
        """Each part of the rows, and |F|^2 there, float64 [row, count], or of a quadrant [row, count // 2].

        Every `parts`-th row is a transform of the pupil's rows times a phase, folded to as many as are asked
        for (decimation in frequency: Cooley and Tukey, Math. Comput. 19, 297, 1965).
        """
        if self.mirrored:
            yield from self._quadrant(depth)
            return
        rows, chirp_ = self.count // self.parts, self.chirps[depth]
        samples = torch.arange(len(self.pupil), dtype=torch.float64)
        for part in range(self.parts):
            down = chirp_ * _wave(samples * (part / self.count)) if part else chirp_
            folded = sum(
                torch.nn.functional.pad(block * weight[:, None] * chirp_, (0, 0, 0, rows - len(block)))
                for block, weight in zip(self.pupil.split(rows), down.split(rows), strict=True)
            )
            field = torch.fft.ifft(folded, dim=0, norm="forward")
            del folded
            field = torch.fft.ifft(field, n=self.count, dim=1, norm="forward")
            yield slice(part, None, self.parts), field.real.square().add_(field.imag.square())

    def _quadrant(self, depth: int) -> Iterator[tuple[slice, Tensor]]:
        """`intensity` from the middle to the right and downwards: of an even field, a cosine transform."""
        half, size = self.chirps.shape[1] // 2, self.count // 2
        chirp_ = self.chirps[depth, half:]
        workers = torch.get_num_threads()
        lit = (self.pupil[half:, half:] * chirp_[:, None] * chirp_).numpy()
        field = dct(lit, n=size, axis=0, workers=workers)
        step = max(1, math.ceil(size / self.parts))
        for start in range(0, size, step):
            rows = torch.from_numpy(dct(field[start : start + step], n=size, axis=1, workers=workers))
            yield slice(start, start + len(rows), 1), rows.real.square().add_(rows.imag.square())

    def line(self, depth: int, down: bool) -> Tensor:
        """|F|^2 summed over y, or over x for a line down, float64 [count]: by Parseval's theorem the sum over
        the pupil's own rows, or columns."""
        total = torch.zeros(self.count, dtype=torch.float64)
        lines = self.pupil.T if down else self.pupil
        for some in lines.split(max(1, LINE_BYTES // (16 * self.count))):
            field = torch.fft.ifft(some * self.chirps[depth], n=self.count, dim=1, norm="forward")
            total += field.real.square().add_(field.imag.square()).sum(0)
        return total * self.count

    def centre(self, depth: int) -> float:
        """|F|^2 in the middle."""
        return float((self.chirps[depth] @ self.pupil @ self.chirps[depth]).abs() ** 2)

    def peak(self, depth: int) -> float:
        """Largest |F|^2 on a grid twice as fine, for between samples of this one a peak could be missed; of a
        large pupil only around the brightest samples of this one."""
        if (2 * self.count) ** 2 * self.pupil.itemsize <= BLOCK_BYTES:
            finer = replace(self, count=2 * self.count, step=self.step / 2)
            return max(float(image.max()) for _, image in finer.intensity(depth))
        found: list[tuple[float, int, int]] = []
        for rows, image in self.intensity(depth):
            values, places = image.flatten().topk(min(PEAKS, image.numel()))
            for value, place in zip(values.tolist(), places.tolist(), strict=True):
                down, along = divmod(place, image.shape[1])
                found.append((value, rows.start + down * rows.step, along))
        brightest = sorted(found, reverse=True)[:PEAKS]
        offsets = torch.tensor([-0.5, -0.25, 0.0, 0.25, 0.5], dtype=torch.float64) / self.count
        samples = torch.arange(len(self.pupil), dtype=torch.float64)
        down, along = (
            torch.tensor([place[axis] for place in brightest], dtype=torch.float64)[:, None] / self.count
            + offsets
            for axis in (1, 2)
        )
        lit = self.chirps[depth]
        rows_there = (_wave(down.flatten()[:, None] * samples) * lit) @ self.pupil
        rows_there = (rows_there * lit).unflatten(0, (-1, len(offsets)))
        across = _wave(along[:, :, None] * samples)
        fields = torch.bmm(rows_there, across.transpose(1, 2))
        return float(fields.abs().square().max())


def _focal_planes(
    camera: Camera, wavelength: float, inverse_depths: Tensor
) -> Iterator[tuple[_FocalPlane, int]]:
    """For each inverse depth [depth] a plane and its place in it: one for all, but of a large pupil."""
    wavelengths = torch.tensor([wavelength], dtype=torch.float64)
    window = camera.recipe.psf.window_px
    grid = plan_sampling(camera, wavelengths, inverse_depths, window)
    if grid.samples <= LARGE_PUPIL and aperture(camera, grid).bend is None:
        plane = _focal_plane(camera, wavelength, inverse_depths, grid)
        yield from ((plane, place) for place in range(len(inverse_depths)))
        return
    for depth in inverse_depths.split(1):
        grid = plan_sampling(camera, wavelengths, depth, window)
        if grid.samples > LARGE_PUPIL:
            grid = plan_sampling(replace(camera, by_phase=True), wavelengths, depth, window)
        yield _focal_plane(camera, wavelength, depth, grid), 0


def _focal_plane(camera: Camera, wavelength: float, inverse_depths: Tensor, grid: PupilGrid) -> _FocalPlane:
    """What comes of waves from inverse depths [depth], two samples to a cell of diffraction each way."""
    if grid.samples < FEWEST_SAMPLES:
        pitch = 2 * camera.aperture_radius / (FEWEST_SAMPLES - 2)
        grid = PupilGrid(FEWEST_SAMPLES, pitch, camera.aperture_radius)
    opening = aperture(camera, grid)
    amplitude = float(reduce(torch.add, (part for part, _ in opening.regions)).sum())
    pupil = pupil_function(camera, opening, wavelength, dtype=torch.float64)
    if opening.bend is not None:
        pupil = bent(pupil, opening, wavelength, inverse_depths)[0]
    half = chirp(grid, defocus(camera, wavelength, inverse_depths), dtype=torch.float64)
    chirps = torch.cat([half.flip(1)[:, : grid.samples // 2], half], dim=1)
    middle = grid.samples // 2
    mirrored = grid.samples % 2 == 0 and all(
        float((side[:middle] - side[middle:].flip(0)).abs().max()) <= MIRRORED for side in (pupil, pupil.T)
    )
    count = 2 * grid.samples
    parts = math.ceil(count**2 * pupil.itemsize / BLOCK_BYTES)
    if parts > 1:
        count = parts * next_fast_len(math.ceil(count / parts))
    if mirrored and count % 2:
        count = 2 * next_fast_len(math.ceil(count / 2))
    step = wavelength * camera.sensor_distance / (count * grid.pitch)
    return _FocalPlane(pupil, chirps, count, parts, step, amplitude, mirrored)


def _wave(cycles: Tensor) -> Tensor:
    return torch.polar(torch.ones_like(cycles), 2 * math.pi * cycles)


def _both_sides(wave: Tensor) -> Tensor:
    """Waves [position, frequency] over the first half of the positions, with those of the other side."""
    sides = wave[: len(wave) // 2].real * 2
    sides[0] /= 2
    return torch.complex(sides, torch.zeros_like(sides))
