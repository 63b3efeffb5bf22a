"""Tolerances: photos, restored images and MTFs of cameras that are not made as designed.

Each draw is a camera of its own (`optics.tolerancing`). It takes one picture as a plane in focus at places of
the field, with the PSFs of the place all over the frame, by the three wavelengths of the paper; what restores
knows the camera as designed. The worst draws are traced by rays through their own lenses, which says what
the first order is worth.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import torch
import typer
from torch import Tensor

from .. import completion
from ..capture.planes import capture_planes, surroundings
from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera, psf_bank
from ..optics.lenses.prescription import PrescriptionLens
from ..optics.mtf import tangential_sagittal
from ..optics.prescription.errors import Errors
from ..optics.tolerancing import Draw, Series
from ..options import NetworkOption, PicturesOption, SeedOption, numbers
from ..recipe import load_camera
from ..record import write_csv
from ..restore import choose_network, restore
from ..restore.checkpoint import Checkpoint
from ..restore.scores import image_psnr
from .experiment import Findings, in_parts
from .field_figure import usual_fields
from .kept import Kept, key_of
from .mtf import nyquist_per_mm
from .photographs import Photograph, photographs
from .planes import middle, noisy
from .systems import camera_digest, of_three_lines
from .tolerances_page import Found, figures_of, page, quantiles_table, worst_of

ROWS, COLUMNS = 192, 256
A_PART = 20
"""Draws that a worker does at a time."""
GREEN = 543e-9
WORST = 5
"""Draws that are traced through lenses of their own."""


def parts_of(options: Mapping[str, object]) -> list[str]:
    """Names of parts of the draws: first and last."""
    draws = int(str(options.get("draws") or 200))
    return [f"{first}-{min(first + A_PART, draws) - 1}" for first in range(0, draws, A_PART)]


@in_parts("part", parts_of)
def run(
    folder: Path,
    progress: Progress,
    camera: Annotated[
        str,
        typer.Argument(
            metavar="CAMERA", help="Camera recipe or shipped name.", autocompletion=completion.cameras
        ),
    ],
    draws: Annotated[int, typer.Option("--draws", min=10, metavar="N", help="Cameras that are made.")] = 200,
    fields: Annotated[
        str | None,
        typer.Option(
            "--fields",
            metavar="DEG,DEG,...",
            help="Angles off the axis, of lenses that vary over the field. [default: 0 and the corner of"
            " 512 x 384 pixels]",
        ),
    ] = None,
    frequency: Annotated[
        float | None,
        typer.Option(
            "--frequency",
            metavar="PER_MM",
            help="Of the MTFs, cycles/mm. [default: half of what the pixels resolve]",
        ),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option("--distance", metavar="M", help="Of the picture, metres. [default: in focus]"),
    ] = None,
    network: NetworkOption = None,
    data: PicturesOption = None,
    seed: SeedOption = 0,
    part: Annotated[list[str] | None, typer.Option("--part", hidden=True)] = None,
) -> Findings:
    """Score cameras as made, with tolerances.

    The recipe's `tolerances` are drawn: PSNR and MTF that 10, 50 and 90 % of the cameras fall short of, and
    what matters most.

    Each draw photographs the first picture of --data (256 x 192 pixels of it) at each angle. The same command
    resumes interrupted work.

    Figures, by angle (0deg): psnr_db.{photo,restored} and mtf.{tangential,sagittal}, each with p10, p50, p90
    and designed; waves_rms.ERROR and share_percent.ERROR of the errors by surfaces, by one standard deviation
    and after focusing; exact.{change_waves,missed_waves,photo_db,restored_db,mtf}: of the five worst draws,
    the largest change of the wave, and the largest difference of the first order from rays through each
    lens; draws; seconds.{photos,restored}, of processor.
    """
    bench = Bench.of(camera, fields, frequency, distance, network, data, seed)
    kept = Kept(folder / "finished.jsonl")
    names = parts_of({"draws": draws}) if part is None else part
    wanted = [-1, *(number for name in names for number in _numbers_of(name))]
    found: dict[int, Found] = {}
    for place, number in enumerate(wanted):
        progress(0.95 * place / len(wanted), f"camera {place} of {len(wanted) - 1}")
        found[number] = bench.kept(kept, number)
    designed = found.pop(-1)
    worst = worst_of(found, WORST) if bench.traced and len(found) == draws else []  # of all, not of a share
    exact: dict[int, Found] = {}
    for number in worst:
        progress(0.95 + 0.05 * len(exact) / len(worst), "the worst by rays of their own")
        exact[number] = bench.kept(kept, number, exactly=True)
    parts = {each.name: bench.series.rms(each) for each in bench.series.parts}
    figures = figures_of(designed, found, exact, parts)
    rows = [(number, *each.values()) for number, each in found.items()]
    total = sum(value**2 for value in parts.values())
    ranked = sorted(parts.items(), key=lambda item: -item[1])
    outputs = {
        "draws": write_csv(folder / "tolerances.csv", ("draw", *designed), rows),
        "errors": write_csv(
            folder / "errors.csv",
            ("error", "waves_rms", "share_percent"),
            [(name, value, 100 * value**2 / total if total else 0.0) for name, value in ranked],
        ),
    }
    said = page(bench.camera, figures, found, bench.said, bench.per_mm)
    inputs = {"camera": bench.camera.recipe.name, "picture": bench.picture.name}
    return Findings(figures, said, shown=quantiles_table(figures), outputs=outputs, inputs=inputs)


def _numbers_of(name: str) -> range:
    first, _, last = name.partition("-")
    return range(int(first), int(last) + 1)


@dataclass(frozen=True, eq=False)
class Bench:
    """What all draws share. camera: as designed, whose colours are three lines; angles: [deg] by their names
    in figures; per_mm: frequency of the MTFs; inverse_depth: of the picture, 1/m; checkpoint: what restores,
    None for Wiener deconvolution."""

    camera: Camera
    series: Series
    angles: Mapping[str, float]
    per_mm: float
    inverse_depth: float
    checkpoint: Checkpoint | None
    picture: Photograph
    seed: int

    @classmethod
    def of(
        cls,
        camera: str,
        fields: str | None,
        frequency: float | None,
        distance: float | None,
        network: str | None,
        data: Path | None,
        seed: int,
    ) -> Bench:
        """From what was typed. Raises InputError for what cannot be used."""
        loaded = load_camera(camera)
        checkpoint, optics = choose_network(network, loaded)
        optics = of_three_lines(optics)
        angles = _angles(optics, fields)
        if frequency is not None and not 0 < frequency < math.inf:
            raise InputError(f"--frequency {frequency:g}: give cycles/mm above 0, for instance 40")
        if distance is not None and not distance > 0:
            raise InputError(f"--distance {distance:g}: give metres above 0, inf for infinity")
        away = loaded.recipe.focus.distance_m if distance is None else distance
        series = Series(optics, [math.tan(math.radians(angle)) for angle in angles])
        if not series.parts:
            raise InputError("tolerances: all are 0, so that all cameras are alike; give one above 0")
        picture = photographs(data, 1).pictures[0]
        need = optics.recipe.psf.window_px - 1
        if picture.pixels.shape[1] < ROWS + need or picture.pixels.shape[2] < COLUMNS + need:
            raise InputError(
                f"{picture.name}: {COLUMNS + need} x {ROWS + need} pixels are needed, of the frame and what"
                " PSFs reach around it; take a larger picture (--data), or a narrower psf.window_px"
            )
        by_name = {f"{angle:g}deg": angle for angle in angles}
        per_mm = nyquist_per_mm(optics) / 2 if frequency is None else frequency
        return cls(optics, series, by_name, per_mm, 1 / away, checkpoint, picture, seed)

    @property
    def traced(self) -> bool:
        """Whether draws can be traced by rays of their own."""
        return isinstance(self.camera.lens, PrescriptionLens)

    @property
    def said(self) -> str:
        """What restores, in words."""
        return "Wiener deconvolution" if self.checkpoint is None else self.checkpoint.name

    def kept(self, kept: Kept, number: int, *, exactly: bool = False) -> Found:
        """Figures of a draw, -1 for the camera as designed, by those that are kept or anew."""
        key = key_of(
            camera=camera_digest(self.camera),
            tolerances=self.series.tolerances.model_dump(mode="json"),
            at=(dict(self.angles), self.per_mm, self.inverse_depth),
            network=self.said,
            picture=self.picture.sha256,
            draw=(self.seed, number, exactly),
        )
        known = kept.get(key)
        if known is None:
            draw = Draw(Errors()) if number < 0 else self.series.draw(self.seed, number)
            known = self.measured(draw, exactly)
            kept.put(key, known)
        return {name: float(str(value)) for name, value in known.items()}

    def measured(self, draw: Draw, exactly: bool) -> Json:
        """Figures of a draw, or of its rays."""
        made = self.series.made(draw, exactly=exactly)
        found: dict[str, float] = {}
        for name, angle in self.angles.items():
            field = (0.0, math.tan(math.radians(angle)))
            here = made.at_field(field)
            begin = time.process_time()
            photo = self._photo(psf_bank(here, PAPER_COLOURS, [self.inverse_depth]).values[0])
            found[f"psnr_db.photo.{name}"] = image_psnr(photo, self._sharp)
            both = tangential_sagittal(here, GREEN, [self.inverse_depth], [self.per_mm * 1e3])
            for side, value in zip(("tangential", "sagittal"), both.flatten().tolist(), strict=True):
                found[f"mtf.{side}.{name}"] = value
            middle_ = time.process_time()
            found[f"psnr_db.restored.{name}"] = image_psnr(self._restored(photo, field), self._sharp)
            for what, seconds in (("photos", middle_ - begin), ("restored", time.process_time() - middle_)):
                found[f"seconds.{what}"] = found.get(f"seconds.{what}", 0.0) + seconds
            if exactly:
                change, missed = self.series.difference(draw, field)
                found[f"change_waves.{name}"], found[f"missed_waves.{name}"] = change, missed
        return dict(found)

    @cached_property
    def _cut(self) -> Tensor:
        """Of the picture, with what PSFs reach around the frame."""
        need = self.camera.recipe.psf.window_px - 1
        rows = self.picture.values.shape[-2]
        down = middle(self.picture.values, max(ROWS, COLUMNS) + need)
        top = (down.shape[-2] - min(rows, ROWS + need)) // 2
        return down[:, top : top + ROWS + need, : COLUMNS + need]

    @cached_property
    def _sharp(self) -> Tensor:
        before, _ = surroundings(self.camera.recipe.psf.window_px)
        return self._cut[:, before : before + ROWS, before : before + COLUMNS]

    def _photo(self, psf: Tensor) -> Tensor:
        """The same noise in all photos, so that the cameras alone make the difference."""
        clean = capture_planes(self._cut[None], psf[None].to(self._cut))[0]
        return noisy(clean, self.camera.read_noise, f"{self.picture.sha256} {self.seed}")

    def _restored(self, photo: Tensor, field: tuple[float, float]) -> Tensor:
        camera = self.camera.at_field(field)
        at = torch.tensor([self.inverse_depth], dtype=torch.float64)
        how = {"checkpoint": self.checkpoint, "by_place": False}
        with torch.inference_mode():
            return restore(photo, camera, PAPER_COLOURS, at, **how)[0].clamp(0, 1)


def _angles(camera: Camera, fields: str | None) -> tuple[float, ...]:
    """Angles [deg] off the axis. Raises InputError for what is none, and for a lens without a field."""
    if fields is None:
        usual = usual_fields(camera) if camera.lens.varies else (0.0,)
        return tuple(dict.fromkeys((0.0, round(usual[-1], 2))))
    angles = tuple(dict.fromkeys(numbers(fields, "--fields", "0,5")))
    if not all(0 <= angle < 90 for angle in angles):
        raise InputError(f"--fields {fields}: give degrees from 0 to 90, for instance 0,5")
    if any(angles) and not camera.lens.varies:
        raise InputError(f"--fields {fields}: this lens is the same over the field; leave --fields out")
    return angles
