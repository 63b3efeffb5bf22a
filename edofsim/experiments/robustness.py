"""How much sensor noise and how much fabrication error the restoration bears.

Akpinar et al., section "Noise Analysis": an object at the green focus; read noise beyond the training's, and
height errors of the mask beyond the training's. The paper shows one natural image; here it is a folder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..optics import focus_distance
from ..recipe.fabrication import Fabrication
from .photographs import Photographs, chosen, photographs
from .planes import Condition, Progress, Row, averages, measure, write_rows
from .systems import READ_NOISE, Contestant, contestants, paper_test

SIGMAS_S = (0.005, 0.009, 0.015, 0.020)
SIGMAS_D_NM = (20.0, 30.0, 40.0, 50.0)
DEVICE = "device"
GREEN = 543e-9
PITCH_UM = 3.0


@dataclass(frozen=True)
class Result:
    """Rows of every system, picture and condition; shown: names of the pictures that are shown."""

    rows: tuple[Row, ...]
    data: Photographs
    shown: tuple[str, ...]
    figures: dict[str, float]


def run_noise(out: Path, data: Path | None, **options: object) -> Result:
    """Measure at each of `SIGMAS_S` with a height error of 30 nm, and write OUT/noise.csv. See `_run`.

    Figures: psnr_db.SYSTEM.SIGMA, psnr_db.SYSTEM.photo.SIGMA, loss_db.SYSTEM from the least to the most.
    """
    result = _run(out, data, noise_conditions, "sigma_s", **options)
    write_rows(out / "noise.csv", result.rows, "sigma_s")
    return result


def run_fabrication(out: Path, data: Path | None, **options: object) -> Result:
    """Measure at each of `SIGMAS_D_NM` and for the device that the paper made and measured, read noise 0.005,
    and write OUT/fabrication.csv. See `_run`.

    Figures: psnr_db.SYSTEM.{20nm,...,device}, psnr_db.SYSTEM.photo.*, loss_db.SYSTEM from 20 to 50 nm.
    """
    result = _run(out, data, fabrication_conditions, "fabrication", **options)
    write_rows(out / "fabrication.csv", result.rows, "fabrication")
    return result


def noise_conditions(system: Contestant, seed: int) -> list[Condition]:
    """The paper's read noises at the green focus."""
    depth = 1 / green_focus(system)
    return [Condition(f"{sigma:g}", depth, sigma, paper_test(seed)) for sigma in SIGMAS_S]


def fabrication_conditions(system: Contestant, seed: int) -> list[Condition]:
    """The paper's height errors at the green focus, the same draw at each strength, and its measured device.

    A relief deeper than the device allows is wrapped by one wave of the mask's design wavelength.
    """
    depth = 1 / green_focus(system)
    errors = [
        Condition(
            f"{sigma:g}nm",
            depth,
            READ_NOISE,
            Fabrication(pitch_um=PITCH_UM, height_noise_nm=sigma, seed=seed),
        )
        for sigma in SIGMAS_D_NM
    ]
    wave = getattr(system.camera.recipe.mask, "design_wavelength_nm", None)
    device = Fabrication(preset="paper-device", wrap_wavelength_nm=wave, seed=seed)
    return [*errors, Condition(DEVICE, depth, READ_NOISE, device)]


def green_focus(system: Contestant) -> float:
    """Distance in metres that is sharp at 543 nm: z_fG of the paper."""
    return float(focus_distance(system.camera, GREEN))


def _run(
    out: Path,
    data: Path | None,
    conditions_of: Callable[[Contestant, int], list[Condition]],
    what: str,
    *,
    systems: Sequence[str | Path] | None = None,
    show: Sequence[str] = (),
    seed: int = 0,
    limit: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """data: folder of pictures, None for scikit-image's; systems: as for the table; show: names of pictures,
    the first by default; limit: only so many pictures. Raises InputError for what cannot be used."""
    found = photographs(data, limit)
    shown = chosen(found.pictures, show, 1)
    every = contestants(systems)
    rows: list[Row] = []
    figures: dict[str, float] = {}
    for index, system in enumerate(every):

        def part(done: float, text: str, index: int = index) -> None:
            if progress:
                progress((index + done) / len(every), text)

        conditions = conditions_of(system, seed)
        own = measure(system, found.pictures, conditions, out, seed=seed, show=shown, progress=part)
        means = averages(own)
        ends = [c.label for c in conditions if c.label != DEVICE]
        least, most = (means[f"psnr_db.{system.name}.{label}"] for label in (ends[0], ends[-1]))
        figures |= means | {f"loss_db.{system.name}": least - most}
        rows += own
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    return Result(tuple(rows), found, shown, figures)
