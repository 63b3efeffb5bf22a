"""`edofsim run`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ..core.progress import Progress
from ..options import (
    CameraOption,
    NetworkOption,
    RawColoursOption,
    ResampleOption,
    Scene,
    SeedOption,
    Simulated,
    Work,
)
from ..record import peak_memory_mib, processor_seconds, writable_folder
from .shared import (
    Done,
    begun,
    check_alone,
    finish,
    inputs_of,
    load_report,
    plan_lines,
    plan_rows,
    recipes_of,
)

if TYPE_CHECKING:
    from torch import Tensor

    from ..pipeline import Run
    from ..report import Plot

GIVEN = "given"
"""A picture with depths as it was given: it has its own colours."""
LINEAR = "photo (EXR, linear)"


def run(
    scene: Scene = "desk",
    camera: CameraOption = None,
    resample: ResampleOption = False,
    network: NetworkOption = None,
    *,
    simulated: Simulated,
    cost: Annotated[
        bool, typer.Option("--cost", help="Measure what accuracy costs, and add the chart to the report.")
    ] = False,
    raw_colours: RawColoursOption = False,
    seed: SeedOption = 0,
    work: Work,
) -> Done:
    """Render, plan, photograph, restore, score, report.

    The view comes from the cache if it is there. The report is one HTML page.

    Figures: psnr_db.{photo,restored,wiener,lens_alone}[.NEARm_to_FARm], ssim.* alike, without the noise of
    the rendering; psnr_db_se.*, ssim_se.*: their standard errors by it (nan: it is in the score);
    samples_for_0.05_db (that the restored image's whole PSNR takes to be so certain),
    noise_db.{truth,photo} (of the rendering, in the ideal image and in the photo),
    gain_db.over_{photo,lens_alone,wiener} of the restored image,
    seconds.{render,guess,plan,plan_lens_alone,expose,lens_alone,psfs,restore,wiener,score,report,total},
    seconds.processor (of all cores, start included), peak_memory_mib, render_noise, plan.share_of_saved
    (planning against the seconds that it saves), and what `edofsim plan` says; plan_lens_alone.* of the
    plan of the photo through the lens alone, for `noise` where `restored` is asked for.
    """
    scene_recipe, camera_recipe = recipes_of(scene, camera, resample)
    folder = writable_folder(work.out or Path("out") / scene_recipe.recipe.name)
    with begun("run", work.json, quiet=work.quiet) as progress:
        from .. import pipeline
        from ..plan import RESTORED, parse_target

        load_report()
        check_alone(simulated)
        result = pipeline.run(
            scene_recipe,
            camera_recipe,
            cache=work.cache,
            network=network,
            resample=resample,
            overrule=simulated.overrule,
            target=parse_target(simulated.accuracy, simulated.time, RESTORED),
            fidelity=simulated.fidelity,
            seed=seed,
            device=work.device.value,
            progress=progress,
        )
        if raw_colours:
            result = replace(result, photo=replace(result.photo, colours=None))
        progress(0.98, "report")
        started = clock.perf_counter()
        options = words_of(simulated, network=network, resample=resample, raw_colours=raw_colours)
        outputs = _written(result, folder, _cost_chart(result, folder, progress) if cost else None, options)
        numbers = pipeline.figures(result)
        _add_report(numbers, clock.perf_counter() - started)
        inputs = inputs_of(scene_recipe, camera_recipe, network=network)
        how = {"seed": seed, "inputs": inputs, "rest": _record_of(result)}
        return finish("run", _lines(result, numbers), numbers, outputs, work.json, **how)


def _add_report(numbers: dict[str, float], seconds: float) -> None:
    """Add what the page took, and what the process has used by now."""
    numbers["seconds.report"] = seconds
    numbers["seconds.total"] += seconds
    numbers["seconds.processor"], numbers["peak_memory_mib"] = processor_seconds(), peak_memory_mib()


def words_of(simulated: Simulated, **more: object) -> list[str]:
    """Options by name, as they are typed; those that are None or False are left out."""
    words: list[str] = []
    for name, given in (vars(simulated) | more).items():
        for value in given if isinstance(given, list) else [given]:
            if value is not None and value is not False:
                words += ["--" + name.strip("_").replace("_", "-"), *([] if value is True else [str(value)])]
    return words


def _written(result: Run, folder: Path, chart: Plot | None, options: Sequence[str]) -> dict[str, Path]:
    """The images of a run and its page."""
    import torch

    from ..capture import save_image, write_photo
    from ..core.threads import in_threads
    from ..report import write_run_report

    images = _images(result)

    def saved(name: str) -> Path:
        if name == LINEAR:
            return write_photo(folder / "photo.exr", result.photo)
        colours = None if name == GIVEN else result.photo.colours
        return save_image(folder / f"{name}.png", images[name], colours)

    longest_first = [LINEAR, *images]
    paths = dict(zip(longest_first, in_threads(saved, longest_first, torch.device("cpu")), strict=True))
    outputs = {name: paths[name] for name in (*images, LINEAR)}
    return outputs | {"report": write_run_report(folder / "report.html", result, chart, options)}


def _lines(result: Run, numbers: Mapping[str, float]) -> list[str | Table]:
    """What a run prints."""
    from ..restore import said_of
    from ..restore.gains import gains_in_words
    from ..restore.truth import noise_sentence

    return [
        *plan_lines(result.plan, result.seconds["plan"]),
        f"the lens alone has a plan of its own: {result.plan_lens_alone.summary()}",
        _score_table(result),
        *([gained] if (gained := gains_in_words(result.gains)) else []),
        noise_sentence(result.noise.state, numbers),
        *([said] if (said := said_of(result.checkpoint, result.restored_by)) else []),
        f"render {numbers['seconds.render']:.1f} s, expose {numbers['seconds.expose']:.1f} s, "
        f"in all {numbers['seconds.total']:.1f} s; peak memory {numbers['peak_memory_mib']:.0f} MiB",
    ]


def _record_of(result: Run) -> dict[str, object]:
    from ..capture.fidelity_file import values_of

    return {
        "plan": plan_rows(result.plan),
        "plan_lens_alone": plan_rows(result.plan_lens_alone),
        "fidelity_lens_alone": values_of(result.plan_lens_alone.fidelity),
        "fidelity": values_of(result.plan.fidelity),
        "restored_by": str(result.restored_by),
    }


def _images(result: Run) -> Mapping[str, Tensor]:
    from ..render import is_picture

    images = {
        "ideal": result.photo.ideal,
        "photo": result.photo.image,
        "restored": result.restored,
        "lens-alone": result.lens_alone.image,
        "wiener": result.wiener,
        GIVEN: result.view.colours() if is_picture(result.scene.recipe) else None,
    }
    return {name: image for name, image in images.items() if image is not None}


def _cost_chart(result: Run, folder: Path, progress: Progress) -> Plot:
    """What accuracy costs for the photo of a run, measured in its folder."""
    from ..experiments import cost
    from ..experiments.cost_page import cost_plot
    from ..plan import planner_of

    cases = cost.cases_of(planner_of(result.view, result.optics))
    rows = cost.measure(result.view, result.optics, cases, folder, repeats=1, progress=progress)
    return cost_plot(rows, result.scene.recipe.name)


def _score_table(result: Run) -> Table:
    names = {
        "photo": "photo",
        "restored": f"restored ({result.restored_by.name})",
        "wiener": "Wiener instead",
    }
    names = {name: label for name, label in names.items() if name in result.scores}
    names["lens_alone"] = "lens alone"
    ranges = [(part.near_m, part.far_m) for part in result.by_depth["photo"]]
    table = Table("PSNR / dB (SSIM)", "whole", *(_range(near, far) for near, far in ranges), box=None)
    for name, label in names.items():
        cells = [result.scores[name], *(part.score for part in result.by_depth[name])]
        table.add_row(label, *(_cell(cell.psnr_db, cell.ssim) for cell in cells))
    return table


def _cell(psnr_db: float, ssim: float) -> str:
    """A score; in words where the noise of the rendering leaves the PSNR unknown."""
    return f"{'too noisy' if math.isnan(psnr_db) else f'{psnr_db:.2f}'} ({ssim:.3f})"


def _range(near: float, far: float) -> str:
    return f"{near:g} m to {'infinity' if math.isinf(far) else f'{far:g} m'}"
