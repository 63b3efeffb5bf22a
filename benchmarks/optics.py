"""What PSFs cost: against prysm, against depths, bands and pupil samples, and in the backward pass.

The bank of the comparison is 64 depths x 31 bands x 112 pixels, from a pupil of 252 samples at oversampling
2. prysm (https://github.com/brandondube/prysm) does the same work one PSF at a time, as it is made to:
pupil function, matrix DFT with its bases cached a wavelength, intensity, sum over pixels. Runs of the two
take turns, and medians are compared.
"""

from __future__ import annotations

import importlib.util
import math
import os
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from edofsim.core.progress import Progress, silent
from edofsim.optics import Camera, defocus, psf_bank
from edofsim.optics import cache as bank_cache
from edofsim.optics.grid import PupilGrid
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.propagation import BLOCK_BYTES, Wave, propagate
from edofsim.optics.pupil import aperture, chirp, pupil_function
from edofsim.optics.transform import SensorWindow, make_bases, pixel_weights
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.record import peak_memory_mib

DEPTHS, BANDS, WINDOW, PUPIL, OVERSAMPLING = 64, 31, 112, 252, 2
NEAREST, FARTHEST = 2.0, 0.25
"""1/m; farther away the paper's bound asks for more than 252 samples at 420 nm."""
PRYSM_DEPTHS = 4
REPEATS = 3


def run(progress: Progress | None = None) -> dict[str, float]:
    """Figures of the benchmark, all times in seconds:

    throughput_per_s.*: PSFs a second of this package and of prysm in its own precision (float64) and in
    float32; throughput_ratio.*: this package over prysm; difference.prysm: relative L2 between the two;
    bank.*_mib: size of the bank, memory that computing it took in all, and the limit of each thread's work
    next to it; seconds.depths_N, seconds.bands_N, seconds.pupil_N: a bank of which one number changes;
    backward.*: seconds and MiB kept for the backward pass of 12 PSFs, by hand and by automatic
    differentiation of the same transform as one complex matrix product.
    """
    tell = progress or silent
    figures: dict[str, float] = {}
    if importlib.util.find_spec("prysm"):
        tell(0.0, "against prysm")
        figures |= against_prysm()
    tell(0.5, "memory of a bank")
    figures |= bank_memory()
    tell(0.6, "cost against depths, bands and pupil samples")
    figures |= scaling()
    tell(0.9, "backward pass")
    return figures | backward()


def bench_camera(samples: int = PUPIL) -> Camera:
    """The paper's lens with a cubic mask, `samples` across the pupil."""
    pitch_um = 5000.0 / samples
    settings = PsfSettings(window_px=WINDOW, oversampling=OVERSAMPLING, pupil_sampling_um=pitch_um)
    return Camera.from_recipe(CameraRecipe(name="bench", mask=CubicMask(), psf=settings))


def axes(depths: int = DEPTHS, bands: int = BANDS) -> tuple[Tensor, Tensor]:
    """Wavelengths [band] from 420 to 720 nm and inverse depths [depth]."""
    wavelengths = torch.linspace(420e-9, 720e-9, bands, dtype=torch.float64)
    return wavelengths, torch.linspace(FARTHEST, NEAREST, depths, dtype=torch.float64)


def against_prysm(repeats: int = REPEATS) -> dict[str, float]:
    """Throughput of both, in turns, and how far their PSFs are apart."""
    camera = bench_camera()
    wavelengths, inverse_depths = axes()
    some = inverse_depths[:: DEPTHS // PRYSM_DEPTHS]
    seconds: dict[str, list[float]] = {"here": [], "prysm_float64": [], "prysm_float32": []}
    prysm_bank(camera, wavelengths[:1], some[:1], 64)
    _seconds_of(lambda: psf_bank(camera, wavelengths[:2], inverse_depths))
    for _ in range(repeats):
        seconds["here"].append(_seconds_of(lambda: psf_bank(camera, wavelengths, inverse_depths)))
        for bits in (64, 32):
            took = _seconds_of(lambda: prysm_bank(camera, wavelengths, some, bits))  # noqa: B023
            seconds[f"prysm_float{bits}"].append(took)
    counts = {"here": DEPTHS * BANDS} | dict.fromkeys(("prysm_float64", "prysm_float32"), len(some) * BANDS)
    rates = {name: counts[name] / statistics.median(times) for name, times in seconds.items()}
    mine = psf_bank(camera, wavelengths[::10], some, dtype=torch.float64).values
    theirs = prysm_bank(camera, wavelengths[::10], some, 64)
    return {
        **{f"throughput_per_s.{name}": rate for name, rate in rates.items()},
        **{f"throughput_ratio.{n}": rates["here"] / rates[n] for n in ("prysm_float64", "prysm_float32")},
        "difference.prysm": float((mine - theirs).norm() / mine.norm()),
    }


def prysm_bank(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, bits: int) -> Tensor:
    """The same PSFs by prysm's matrix DFT, one by one: [depth, band, y, x], float64."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # prysm warns of its own use of pkg_resources
        from prysm.conf import config
        from prysm.fttools import mdft

    real, complex_ = (np.float64, np.complex128) if bits == 64 else (np.float32, np.complex64)
    config.precision = bits
    mdft.clear()  # its cache of bases does not know of precision
    grid = PupilGrid(PUPIL, 2 * camera.aperture_radius / PUPIL, camera.aperture_radius)
    opening = aperture(camera, grid)
    rho_squared = (grid.radius_squared() / grid.radius**2).numpy().astype(real)
    step = camera.pixel / OVERSAMPLING
    count = WINDOW * OVERSAMPLING + 2
    images = np.empty((len(inverse_depths), len(wavelengths), WINDOW, WINDOW))
    for b, wavelength in enumerate(wavelengths.tolist()):
        reach = wavelength * camera.sensor_distance
        padding = reach / (grid.samples * grid.pitch * step)
        # prysm divides by count x padding
        scale = (count * padding * grid.pitch * step / reach) ** 2 / opening.light
        still = pupil_function(camera, opening, wavelength, dtype=torch.float64).numpy().astype(complex_)
        for d, psi in enumerate(defocus(camera, wavelength, inverse_depths).tolist()):
            pupil = still * np.exp(1j * (rho_squared * real(psi))).astype(complex_)
            # prysm's inverse transform looks the right way up, and half a sample puts pixels next to the axis
            field = mdft.idft2(pupil, padding, (count, count), shift=(0.5, 0.5))
            images[d, b] = _pixel_integrals(_pixel_integrals(field.real**2 + field.imag**2).T).T * scale
    config.precision = 64
    return torch.from_numpy(images)


def _pixel_integrals(samples: np.ndarray) -> np.ndarray:
    """Rows of sub-pixels to rows of pixels, the rule of `transform.pixel_weights`."""
    own = samples[1:-1].reshape(WINDOW, OVERSAMPLING, -1).sum(1)
    ends = samples[:-2:OVERSAMPLING] - samples[1:-1:OVERSAMPLING]
    ends = ends + samples[OVERSAMPLING + 1 :: OVERSAMPLING] - samples[OVERSAMPLING:-1:OVERSAMPLING]
    return own + ends / 24


def bank_memory() -> dict[str, float]:
    """Memory of the whole bank, measured in a process of its own."""
    code = (
        "from benchmarks.optics import axes, bench_camera, highest_memory\n"
        "from edofsim.optics import psf_bank\n"
        "wavelengths, inverse_depths = axes()\n"
        "psf_bank(bench_camera(), wavelengths[:1], inverse_depths[:1])\n"
        "before = highest_memory()\n"
        "psf_bank(bench_camera(), wavelengths, inverse_depths)\n"
        "print(highest_memory() - before)\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ.copy()
    )
    return {
        "bank.size_mib": DEPTHS * BANDS * WINDOW**2 * 4 / 2**20,
        "bank.growth_mib": float(told.stdout.split()[-1]),
        "bank.work_limit_mib": BLOCK_BYTES / 2**20,
    }


def highest_memory() -> float:
    """Most memory that this process has held, in MiB; not what its parent held, as `getrusage` would say."""
    status = Path("/proc/self/status")
    if not status.is_file():
        return peak_memory_mib()
    (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return float(line.split()[1]) / 2**10


def scaling() -> dict[str, float]:
    """Seconds of banks of which one number changes: depths, bands, or samples across the pupil."""
    figures = {}
    camera = bench_camera()
    for depths in (8, 16, 32, 64):
        figures[f"seconds.depths_{depths}"] = _median(lambda: psf_bank(camera, *axes(depths, 4)))  # noqa: B023
    for bands in (4, 8, 16, 31):
        figures[f"seconds.bands_{bands}"] = _median(lambda: psf_bank(camera, *axes(8, bands)))  # noqa: B023
    for samples in (252, 378, 504, 1008):
        finer = bench_camera(samples)
        figures[f"seconds.pupil_{samples}"] = _median(lambda: psf_bank(finer, *axes(8, 4)))  # noqa: B023
    return figures


def backward() -> dict[str, float]:
    """Forward and backward pass of 3 bands x 4 depths, by hand and by automatic differentiation."""
    camera = bench_camera()
    wavelengths, inverse_depths = axes(4, 3)
    grid = PupilGrid(PUPIL, 2 * camera.aperture_radius / PUPIL, camera.aperture_radius)
    opening = aperture(camera, grid)
    window = SensorWindow(WINDOW, camera.pixel, OVERSAMPLING)
    pixels = pixel_weights(window).float()
    waves = []
    for wavelength in wavelengths.tolist():
        reach = wavelength * camera.sensor_distance
        bases = make_bases(grid, window, reach, opening.light, torch.float32, torch.device("cpu"))
        chirps = chirp(grid, defocus(camera, wavelength, inverse_depths))
        pupil = pupil_function(camera, opening, wavelength).requires_grad_()
        waves.append((Wave(pupil, chirps, bases), _complex_basis(grid, window, reach)))

    def by_hand() -> None:
        propagate([wave for wave, _ in waves]).square().sum().backward()

    def automatic() -> None:
        for wave, basis in waves:
            whole = torch.cat([wave.chirps.flip(1), wave.chirps], 1)
            field = basis @ (wave.pupil * whole[:, :, None] * whole[:, None, :]) @ basis.T
            energy = field.real.square() + field.imag.square()
            (pixels @ energy @ pixels.T).square().sum().backward()

    figures: dict[str, float] = {}
    ways = {"by_hand": by_hand, "automatic": automatic}
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(2 * REPEATS + 1):
        for name, way in ways.items():
            start = time.perf_counter()
            way()
            times[name].append(time.perf_counter() - start)
    for name, way in ways.items():
        figures[f"backward.seconds.{name}"] = statistics.median(times[name][1:])
        figures[f"backward.kept_mib.{name}"] = _kept_bytes(way) / 2**20
    return figures


def _complex_basis(grid: PupilGrid, window: SensorWindow, reach: float) -> Tensor:
    step = window.pitch / window.oversampling
    sensor = (torch.arange(window.sub_pixels, dtype=torch.float64) - (window.sub_pixels - 1) / 2) * step
    angle = 2 * math.pi / reach * torch.outer(sensor, grid.centres)
    return torch.polar(torch.ones_like(angle), angle).to(torch.complex64)


def _kept_bytes(work: Callable[[], None]) -> int:
    """Bytes that PyTorch keeps between the passes, by its count of saved tensors."""
    kept: list[int] = []

    def keep(tensor: Tensor) -> Tensor:
        kept.append(tensor.nbytes)
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(keep, lambda tensor: tensor):
        work()
    return sum(kept)


def _seconds_of(work: Callable[[], Any]) -> float:
    bank_cache.forget()
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _median(work: Callable[[], Any], repeats: int = REPEATS) -> float:
    times: Sequence[float] = [_seconds_of(work) for _ in range(repeats)]
    return statistics.median(times)
