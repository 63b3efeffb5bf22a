"""`evaluate`: one function an experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from ..recipe import load_scene
from ..record import writable_folder
from .base import Done, Progress, finish


def evaluate_predictions(
    scenes: Sequence[str],
    quick: bool,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate predictions`."""
    from ..experiments import predictions

    folder = writable_folder(out or Path("out") / ("predictions-quick" if quick else "predictions"))
    outcomes = predictions.run(
        folder, scenes=scenes or predictions.SCENES, quick=quick, cache=cache, progress=progress
    )
    table = Table("scene", "mask", "case", "PSNR / dB", "predicted", "seconds", "predicted", box=None)
    for outcome in outcomes:
        for row in outcome.rows:
            if row.case.kind in ("without", "target") and row.measured_db < predictions.MATTERS_DB:
                table.add_row(
                    outcome.scene,
                    outcome.mask,
                    f"{row.case.kind} {row.case.name}",
                    f"{row.measured_db:.1f}",
                    f"{row.case.predicted_db:.1f}",
                    f"{row.seconds:.2f}",
                    f"{row.case.predicted_seconds:.2f}",
                )
    numbers = predictions.figures(outcomes)
    numbers |= {f"times_faster.{name}": value for name, value in predictions.saved(outcomes).items()}
    totals = Table("figure", "value", box=None)
    for name, value in numbers.items():
        totals.add_row(name, f"{value:.4g}")
    return finish("evaluate predictions", [table, totals], numbers, {"measurements": folder}, json)


def evaluate_occlusion(
    scenes: Sequence[str],
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim evaluate occlusion`."""
    folder = writable_folder(out or Path("out") / "occlusion")
    from ..experiments import occlusion

    chosen = tuple(scenes) or occlusion.SCENES
    for scene in chosen:
        load_scene(scene)  # a wrong name is refused before any time is spent
    numbers = occlusion.run(folder, chosen, cache=cache, device=device, progress=progress)
    table = Table("scene", "mask", "focus", *(f"{way} / dB" for way in occlusion.WAYS), box=None)
    for row in occlusion.table(numbers):
        table.add_row(*(f"{cell:.2f}" if isinstance(cell, float) else cell for cell in row))
    names = [*(f"occlusion-{scene}.png" for scene in chosen), "occlusion.csv"]
    outputs = {name: folder / name for name in names}
    return finish("evaluate occlusion", [table], numbers, outputs, json, inputs={"scenes": list(chosen)})


def evaluate_stability(names: Sequence[str], out: Path | None, json: Path | None, progress: Progress) -> Done:
    """`edofsim evaluate stability`."""
    from ..report.stability_page import stability_page, write_page
    from ..stability import catalogue as stability

    stability.choose(names)  # a wrong name is told before any time is spent
    folder = writable_folder(out or Path("out") / "stability")
    results = stability.run(names, progress)
    numbers = stability.figures(results)
    table = Table("case", "group", "ways", "holds", "nearest to its bound", "error", "bound", box=None)
    for result in results:
        worst = result.worst
        cells = ("", "", "") if worst is None else (worst.way, f"{worst.error:.2g}", f"{worst.bound:.2g}")
        holds = result.failed or ("yes" if result.holds else "NO")
        table.add_row(result.case.name, result.case.group, str(len(result.findings)), holds, *cells)
    summary = (
        f"{numbers['cases']:.0f} cases, {numbers['findings']:.0f} findings in {numbers['seconds']:.0f} s: "
        f"{numbers['beyond_bound']:.0f} beyond their bound, {numbers['failed']:.0f} cases without an end; "
        f"float32 photos differ from float64 by at most {numbers['single_precision']:.1g} of their brightest "
        "value"
    )
    outputs = {
        "findings": stability.write_csv(folder / "stability.csv", results),
        "page": write_page(folder / "stability.html", stability_page(results, numbers)),
    }
    return finish(
        "evaluate stability", [table, summary], numbers, outputs, json, inputs={"cases": list(names)}
    )


def evaluate_bench(names: Sequence[str], out: Path | None, json: Path | None, progress: Progress) -> Done:
    """`edofsim evaluate bench`."""
    from benchmarks import run as benches

    from ..record import machine

    folder = writable_folder(out or Path("out") / "bench")
    numbers = benches.run(names or benches.BENCHES, progress, folder)
    table = Table("figure", "value", box=None)
    for name, value in numbers.items():
        table.add_row(name, f"{value:.4g}")
    about = machine()
    line = f"{about['processor']}, {about['cores']} cores, {about['memory_gib']} GiB, {about['system']}"
    outputs = {path.stem: path for path in sorted(folder.glob("*.png"))}
    inputs = {"benchmarks": list(names)}
    return finish("evaluate bench", [table, line], numbers, outputs, json, inputs=inputs)
