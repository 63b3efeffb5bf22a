"""`evaluate` table, noise, fabrication, broadband, mtf, bandwidth: the paper's experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.table import Table

from ..errors import InputError
from ..recipe import load_camera, load_scene
from ..record import writable_folder
from .base import Done, Progress, finish


def evaluate_table(
    data: Path | None,
    systems: Sequence[str] | None,
    chart: Path | None,
    show: Sequence[str] | None,
    limit: int | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate table`."""
    folder = writable_folder(out or Path("out") / "table")
    from ..experiments import table
    from ..report.planes_page import table_page

    result = table.run(
        folder,
        data,
        systems=systems or None,
        chart_file=chart,
        show=show or (),
        seed=seed,
        limit=limit,
        progress=progress,
    )
    inputs = {"data": result.data.source, "chart": str(chart or "drawn"), "systems": list(systems or ())}
    inputs |= {"limit": limit, "seed": seed}
    return _end("table", table_page(result), result.figures, result.data.problems, folder, json, inputs)


def evaluate_noise(
    data: Path | None,
    systems: Sequence[str] | None,
    show: Sequence[str] | None,
    limit: int | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate noise`."""
    folder = writable_folder(out or Path("out") / "noise")
    from ..experiments import robustness
    from ..report.planes_page import noise_page

    result = robustness.run_noise(
        folder, data, systems=systems or None, show=show or (), seed=seed, limit=limit, progress=progress
    )
    inputs = {"data": result.data.source, "systems": list(systems or ()), "limit": limit, "seed": seed}
    return _end("noise", noise_page(result), result.figures, result.data.problems, folder, json, inputs)


def evaluate_fabrication(
    data: Path | None,
    systems: Sequence[str] | None,
    show: Sequence[str] | None,
    limit: int | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate fabrication`."""
    folder = writable_folder(out or Path("out") / "fabrication")
    from ..experiments import robustness
    from ..report.planes_page import fabrication_page

    result = robustness.run_fabrication(
        folder, data, systems=systems or None, show=show or (), seed=seed, limit=limit, progress=progress
    )
    inputs = {"data": result.data.source, "systems": list(systems or ()), "limit": limit, "seed": seed}
    page = fabrication_page(result)
    return _end("fabrication", page, result.figures, result.data.problems, folder, json, inputs)


def evaluate_broadband(
    data: Sequence[Path],
    scenes: Sequence[str],
    reading: Mapping[str, Any],
    systems: Sequence[str] | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate broadband`. reading: fields of `evaluate.cubes.Reading`, bands and crop as typed."""
    from ..experiments import broadband
    from ..experiments.cubes import Reading, from_view, read_cubes
    from ..render import render
    from ..report.broadband_page import broadband_page

    bands = _numbers(reading.get("bands"), 2, "--bands", "430,690")
    crop = _numbers(reading.get("crop"), 4, "--crop", "4,0,0,0") or (0, 0, 0, 0)
    how = Reading(**{**reading, "bands": bands, "crop": tuple(int(side) for side in crop)})
    loaded = [load_scene(scene) for scene in scenes]
    folder = writable_folder(out or Path("out") / "broadband")
    cubes, problems = [], []
    for path in data:
        found, wrong = read_cubes(path, broadband.sensor_bands_nm(), how)
        cubes += found
        problems += wrong
    for scene in loaded:
        view = render(scene.recipe, scene.base, cache=cache, progress=lambda done, text: progress(0.0, text))
        cubes.append(from_view(scene.recipe.name, view))
    result = broadband.run(
        folder, cubes, problems=problems, systems=systems or None, seed=seed, progress=progress
    )
    inputs = {"data": [str(path) for path in data], "scenes": list(scenes), "systems": list(systems or ())}
    inputs |= {"seed": seed, **reading}
    page = broadband_page(result)
    return _end("broadband", page, result.figures, problems, folder, json, inputs)


def evaluate_index(folder: Path | None) -> Done:
    """`edofsim evaluate index`."""
    from ..report.experiments_index import write_index

    return Done(outputs={"index": write_index(folder or Path("out"))})


def evaluate_mtf(camera: str | None, out: Path | None, json: Path | None) -> Done:
    """`edofsim evaluate mtf`."""
    loaded = load_camera(camera or "paper-learned")
    from ..experiments import mtf
    from ..optics import Camera
    from ..report.optics_pages import mtf_page

    folder = writable_folder(out or Path("out") / "mtf")
    found = Camera.from_recipe(loaded.recipe, loaded.base)
    figures = mtf.run(folder, found)
    return _end("mtf", mtf_page(found), figures, (), folder, json, {"camera": loaded.recipe.name})


def evaluate_bandwidth(out: Path | None, json: Path | None) -> Done:
    """`edofsim evaluate bandwidth`."""
    from ..experiments import bandwidth
    from ..report.optics_pages import bandwidth_page

    folder = writable_folder(out or Path("out") / "bandwidth")
    figures = bandwidth.run(folder)
    return _end("bandwidth", bandwidth_page(figures), figures, (), folder, json, {})


def _numbers(text: str | None, count: int, option: str, example: str) -> tuple[float, ...] | None:
    """Numbers with commas between them, as typed. Raises InputError."""
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(
            f"{option} {text}: give {count} numbers with commas between them, for instance {example}"
        )
    return numbers


def _end(
    name: str,
    page: Any,
    figures: Mapping[str, float],
    problems: Sequence[str],
    folder: Path,
    json: Path | None,
    inputs: dict[str, Any],
) -> Done:
    """Write the page and the JSON, and say what was found. json: None for OUT/NAME.json."""
    from ..report.page import write_page

    table = Table("figure", "value", box=None)
    for figure, value in figures.items():
        table.add_row(figure, f"{value:.6g}")
    write_page(folder / f"{name}.html", page)
    outputs = {path.name: path for path in sorted(folder.glob(f"{name}.*")) if path.suffix != ".json"}
    command, where = f"evaluate {name}", json or folder / f"{name}.json"
    done = finish(command, [table], figures, outputs, where, inputs=inputs, left_out=list(problems))
    return replace(done, problems=tuple(problems))
