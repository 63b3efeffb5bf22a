"""Broadband imaging: 31 bands through optics whose restoration was trained with three wavelengths.

Akpinar et al., section "Broadband Imaging": every band of a spectral cube is convolved with the PSF at its
own wavelength; the sensor's colours are the sums weighted with its spectral response, and so is the truth.
The object is a plane at 0.5 m, 1 m and infinity.

The paper's sensor has 31 bands, 420 to 720 nm. Bands that a cube does not have are left out of photo and
truth alike, and the response is scaled so that those it has sum to 1 for each colour; the share left out is
reported. The exposure is automatic: the 99.5th percentile of the truth is 0.9 of full scale. Read noise and
height error are those of the paper's table.

Trained weights know three wavelengths. Filters, of a Wiener deconvolution and of a filter bank, follow from
the PSFs, and get those of the response (`restore.conditioning`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from ..capture.sensor import automatic_exposure
from ..core.images import developed, srgb_encode, write_png
from ..core.json_values import Json
from ..core.progress import Progress, part
from ..optics import PAPER_COLOURS, Camera, psf_bank, response, response_curves
from ..options import CacheOption, LensOption, SeedOption, SystemsOption, numbers
from ..recipe import load_scene
from ..recipe.camera import CameraRecipe
from ..record import write_csv
from ..render import render
from ..render.colour import colour_matrix
from ..restore.checkpoint import shipped_checkpoints
from ..restore.scores import image_psnr
from .broadband_page import page
from .chromatic import Chromatic, chromatic
from .cubes import Cube, CubesOption, PlanesOption, Reading, from_view, read_cubes
from .experiment import Findings, in_paper, in_parts
from .failures import Failures
from .kept import Kept, key_of
from .paper_figures import DEPTHS_M
from .planes import CHANNELS, Shown, channels, middle, noisy, through
from .sources import WITHOUT_TRAINING
from .systems import (
    READ_NOISE,
    EvaluatedSystem,
    described,
    evaluated_system,
    filtered,
    made,
    paper_test,
    truncated_share,
)

SHOWN_PX = 300


@dataclass(frozen=True)
class CubeScore:
    """One cube by one system at one distance.

    photo_db, restored_db: whole, then red, green, blue.
    three_db: of the same picture in the three wavelengths of the training.
    filter_db: of the photo restored by a Wiener filter that knows the distance and the mask as it was made,
        which is what a linear restoration could do.
    band_errors: root mean square of what the optics do to each band, over that of the band.
    """

    system: str
    cube: str
    depth_m: float
    photo_db: tuple[float, ...]
    restored_db: tuple[float, ...]
    three_db: float
    filter_db: float
    band_errors: tuple[float, ...]
    shown: Shown


@dataclass(frozen=True)
class Result:
    """Rows of all cubes. By cube: `bands_nm`, and `left_out`, the share of each colour's response in bands
    that the cube does not have."""

    rows: tuple[CubeScore, ...]
    optics: dict[str, Chromatic]
    bands_nm: dict[str, tuple[float, ...]]
    left_out: dict[str, tuple[float, ...]]
    problems: tuple[str, ...]
    figures: dict[str, float]


def sensor_bands_nm() -> np.ndarray:
    """The bands of the paper's sensor: 31 from 420 to 720 nm."""
    curves = response_curves(Camera.from_recipe(CameraRecipe(name="paper")))
    assert curves is not None  # the default response is a table
    return np.round(curves[0].numpy() * 1e9, 6)


@in_paper(
    lambda paper: {
        "data": [paper.cubes] if paper.cubes else None,
        "scenes": ["desk"],
        "systems": paper.systems,
        "seed": paper.seed,
        "cache": paper.cache,
    }
)
@in_parts("systems", lambda options: [*shipped_checkpoints(), *WITHOUT_TRAINING])
def run(
    folder: Path,
    progress: Progress,
    data: CubesOption = None,
    scenes: PlanesOption = None,
    bands: Annotated[
        str | None,
        typer.Option(
            "--bands", metavar="LOW,HIGH", help="Use only a cube's bands between these, nanometres."
        ),
    ] = None,
    crop: Annotated[
        str | None, typer.Option("--crop", metavar="L,T,R,B", help="Pixels to cut off a cube's sides.")
    ] = None,
    start_nm: Annotated[
        float | None,
        typer.Option("--start-nm", help="First band of a cube whose file does not say; CAVE is known."),
    ] = None,
    step_nm: Annotated[
        float | None, typer.Option("--step-nm", help="Step between bands, with --start-nm.")
    ] = None,
    key: Annotated[
        str | None, typer.Option("--key", help="Array in a .mat file; dots separate levels.")
    ] = None,
    systems: SystemsOption = None,
    camera: LensOption = None,
    seed: SeedOption = 0,
    cache: CacheOption = None,
) -> Findings:
    """Restore photos of 31 bands.

    Spectral cubes at 0.5 m, 1 m and infinity are restored by networks trained with three wavelengths.

    Bands of the sensor (420 to 720 nm) that a cube does not have are left out of photo and truth alike.
    Without --data and --scene: the shipped desk. The same command resumes interrupted work.
    A system that cannot be used is named, and the others are finished. Masks are made as the paper
    tests them, whatever a recipe's [fabrication] says.

    Figures: psnr_db.SYSTEM.CUBE.{0.5m,1m,infinity} with .red, .green, .blue; psnr_db.SYSTEM.CUBE.photo.*;
    psnr_db.SYSTEM.CUBE.three.* in three wavelengths, psnr_db.SYSTEM.CUBE.filter.* of a Wiener filter that
    knows distance and mask; linear_db.SYSTEM.{three,bands}.*, of photographs by the best linear filter
    that knows the distance, in closed form; left_out_percent.CUBE.COLOUR; cubes_left_out.
    """

    low_high = None if bands is None else numbers(bands, "--bands", "430,690", 2)
    sides = None if crop is None else tuple(map(int, numbers(crop, "--crop", "4,0,0,0", 4)))
    reading = Reading(key, start_nm, step_nm, low_high, sides or (0, 0, 0, 0))
    loaded = [load_scene(scene) for scene in scenes or ([] if data else ["desk"])]
    cubes: list[Cube] = []
    problems: list[str] = []
    for path in data or ():
        found, wrong = read_cubes(path, sensor_bands_nm(), reading)
        cubes += found
        problems += wrong
    for scene in loaded:
        view = render(scene.recipe, scene.base, cache=cache, progress=part(progress, 0.0, 0.0))
        cubes.append(from_view(scene.recipe.name, view))
    result = measure(folder, cubes, problems, systems, seed, progress, camera)
    return Findings(result.figures, page(result), outputs=_write(folder, result), problems=problems)


def measure(
    folder: Path,
    cubes: Sequence[Cube],
    problems: Sequence[str],
    systems: Sequence[str] | None,
    seed: int,
    progress: Progress,
    camera: str | None = None,
) -> Result:
    """Every cube by every system. Finished ones are kept in the folder.

    camera: of systems that name none.
    """
    names = list(systems or (*shipped_checkpoints(), *WITHOUT_TRAINING))
    kept = Kept(folder / "finished.jsonl")
    rows: list[CubeScore] = []
    optics: dict[str, Chromatic] = {}
    figures: dict[str, float] = {}
    failures = Failures()
    for number, name in enumerate(names):
        say = part(progress, number / len(names), (number + 1) / len(names))
        with failures.of(name):
            of_three = evaluated_system(name, camera=camera)
            own: list[CubeScore] = []
            for place, cube in enumerate(cubes):
                tell = part(say, 0.9 * place / len(cubes), 0.9 * (place + 1) / len(cubes))
                system = evaluated_system(name, cube.wavelengths, camera=camera)
                own += judge(system, of_three, cube, folder, kept, seed, tell)
            say(0.9, f"{of_three.name}: colours of its optics")
            optics[of_three.name] = _optics(of_three, kept)
            rows += own
    failures.check(len(rows))
    problems = [*problems, *failures.sentences]
    left_out = {cube.name: _left_out(cube.wavelengths) for cube in cubes}
    for row in rows:
        base, label = f"psnr_db.{row.system}.{row.cube}", label_of(row.depth_m)
        figures[f"{base}.{label}"] = row.restored_db[0]
        figures |= {f"{base}.{label}.{c}": v for c, v in zip(CHANNELS, row.restored_db[1:], strict=True)}
        figures[f"{base}.photo.{label}"] = row.photo_db[0]
        figures[f"{base}.three.{label}"] = row.three_db
        figures[f"{base}.filter.{label}"] = row.filter_db
    for name, found in optics.items():
        for depth, db in zip(DEPTHS_M, found.linear_db.tolist(), strict=True):
            figures |= {
                f"linear_db.{name}.{light}.{label_of(depth)}": value
                for light, value in zip(("three", "bands"), db, strict=True)
            }
    for cube, shares in left_out.items():
        named = zip(CHANNELS, shares, strict=True)
        figures |= {f"left_out_percent.{cube}.{c}": 100 * share for c, share in named}
    figures["cubes_left_out"] = len(problems) - len(failures.sentences)
    bands = {cube.name: tuple((cube.wavelengths * 1e9).tolist()) for cube in cubes}
    return Result(tuple(rows), optics, bands, left_out, tuple(problems), figures)


def judge(
    system: EvaluatedSystem,
    of_three: EvaluatedSystem,
    cube: Cube,
    out: Path,
    kept: Kept,
    seed: int,
    progress: Progress,
) -> list[CubeScore]:
    """A row for each of `DEPTHS_M`.

    of_three: the same system for photos in three wavelengths.
    """
    fabrication = paper_test(seed)
    keys = [
        key_of(
            system=system.digest,
            filter="known",
            conditioned_on="response",
            cube=cube.sha256,
            depth=depth,
            read_noise=READ_NOISE,
            fabrication=described(fabrication),
            seed=seed,
            scores="within scale",
        )
        for depth in DEPTHS_M
    ]
    place = out / "pictures"
    shown = [Shown.of(place, cube.sha256, key) for key in keys]
    ready = [
        kept.get(key) is not None and all(path.is_file() for path in vars(files).values())
        for key, files in zip(keys, shown, strict=True)
    ]
    if not all(ready):
        progress(0.0, f"{system.name}: {cube.name}, point spread functions")
        camera = made(system.camera, fabrication)
        inverse = [1 / depth for depth in DEPTHS_M]
        bank = psf_bank(camera, cube.wavelengths, inverse).values
        three = psf_bank(camera, PAPER_COLOURS, inverse).values
        weights = response(camera, cube.wavelengths).float()
        for i, (key, files) in enumerate(zip(keys, shown, strict=True)):
            if not ready[i]:
                progress((1 + i) / 4, f"{system.name}: {cube.name}, {label_of(DEPTHS_M[i])}")
                psfs = bank[i], three[i]
                kept.put(key, _captured(system, of_three, cube, *psfs, weights, inverse[i], files))
    return [
        CubeScore(system.name, cube.name, depth, **_as_kept(kept.get(key) or {}), shown=files)
        for depth, key, files in zip(DEPTHS_M, keys, shown, strict=True)
    ]


def _as_kept(found: Json) -> Json:
    """Of what `_captured` kept: lists as tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}


def capture_cube(radiance: Tensor, psf: Tensor, weights: Tensor) -> tuple[Tensor, list[float]]:
    """The noise-free colours [3, y, x] of a plane [band, y, x] through PSFs [band, w, w], weighted with the
    response [3, band]; and what the optics do to each band: root mean square over the band's own.

    radiance: [band, y, x].
    psf: [band, w, w].
    weights: [3, band].
    """
    photo = radiance.new_zeros(3, *radiance.shape[1:])
    errors = []
    for band in range(len(radiance)):
        seen = through(radiance[band : band + 1], psf[band : band + 1])[0]
        photo += weights[:, band, None, None] * seen
        size = float(radiance[band].square().mean().sqrt())
        errors.append(float((seen - radiance[band]).square().mean().sqrt()) / size if size else 0.0)
    return photo, errors


def label_of(depth_m: float) -> str:
    """A distance as figures name it."""
    return "infinity" if math.isinf(depth_m) else f"{depth_m:g}m"


def _captured(
    system: EvaluatedSystem,
    of_three: EvaluatedSystem,
    cube: Cube,
    psf: Tensor,
    three: Tensor,
    weights: Tensor,
    inverse_depth: float,
    files: Shown,
) -> dict[str, object]:
    """What is kept of one photo, after its pictures are written."""
    m = cube.margin
    rows, columns = cube.radiance.shape[1:]
    frame = (slice(None), slice(m, rows - m), slice(m, columns - m))
    truth = torch.einsum("cb,byx->cyx", weights, cube.radiance)
    exposure = automatic_exposure(truth[frame])
    clean, errors = capture_cube(cube.radiance * exposure, psf, weights)
    photo = noisy(clean[frame], READ_NOISE, cube.sha256)
    lines = noisy(through(truth * exposure, three)[frame], READ_NOISE, cube.sha256)
    sharp = (truth * exposure)[frame]
    with torch.inference_mode():
        known = torch.einsum("cb,byx->cyx", weights, psf)
        restored = system.restored(photo, truncated_share(known), inverse_depth)
        from_lines = of_three.restored(lines, truncated_share(three), inverse_depth)
        linear = filtered(photo, known[None], truncated_share(known))
    found = colour_matrix(weights.double().numpy(), cube.wavelengths.double().numpy())
    colours = None if found is None else torch.from_numpy(found)
    for path, image in ((files.sharp, sharp), (files.photo, photo), (files.restored, restored)):
        write_png(path, srgb_encode(developed(middle(image, SHOWN_PX), colours)))
    return {
        "photo_db": _scores(photo, sharp),
        "restored_db": _scores(restored, sharp),
        "three_db": image_psnr(from_lines, sharp),
        "filter_db": image_psnr(linear, sharp),
        "band_errors": errors,
    }


def _optics(system: EvaluatedSystem, kept: Kept) -> Chromatic:
    """Its chromatic measures, kept too."""
    key = key_of(optics=system.digest)
    found = kept.get(key)
    if found is None:
        measured = chromatic(system)
        kept.put(key, {field.name: getattr(measured, field.name).tolist() for field in fields(measured)})
        return measured
    return Chromatic(**{name: torch.tensor(values, dtype=torch.float64) for name, values in found.items()})


def _scores(image: Tensor, truth: Tensor) -> list[float]:
    """PSNR of all channels, then of each."""
    return [image_psnr(image, truth), *channels(image, truth)]


def _left_out(wavelengths: Tensor) -> tuple[float, ...]:
    """Share of each colour's response that lies in bands of the sensor which a cube has not."""
    curves = response_curves(Camera.from_recipe(CameraRecipe(name="paper")))
    assert curves is not None
    at, values = curves
    low, high = float(wavelengths.min()) - 1e-12, float(wavelengths.max()) + 1e-12
    outside = (at < low) | (at > high)
    return tuple((values[:, outside].sum(1) / values.sum(1)).tolist())


def _write(out: Path, result: Result) -> dict[str, Path]:
    names = ("all", *CHANNELS)
    columns = (*(f"photo_db_{n}" for n in names), *(f"restored_db_{n}" for n in names))
    scores = write_csv(
        out / "broadband.csv",
        ("system", "cube", "depth", *columns, "three_wavelengths_db", "filter_db"),
        (
            (r.system, r.cube, label_of(r.depth_m), *r.photo_db, *r.restored_db, r.three_db, r.filter_db)
            for r in result.rows
        ),
    )
    bands = write_csv(
        out / "broadband-bands.csv",
        ("system", "cube", "depth", "wavelength_nm", "relative_error"),
        (
            (r.system, r.cube, label_of(r.depth_m), nm, error)
            for r in result.rows
            for nm, error in zip(result.bands_nm[r.cube], r.band_errors, strict=True)
        ),
    )
    return {"table": scores, "table of bands": bands}
