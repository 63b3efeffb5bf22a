"""`edofsim benchmark`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ..core.files import write_text
from ..core.progress import part
from ..errors import EdofsimError, InputError
from ..options import ClusterOption, Device, DeviceOption, JobsOption, Output, Spreading, grouped
from ..record import writable_folder
from . import dataset
from .many import seen_by, spread_of, work_on
from .shared import Done, begun, finish

EntriesArgument = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[ENTRY]...",
        help="FILE.py with a function restore, a folder of images KEY.exr or KEY.png, a system as of "
        "`edofsim evaluate --system`, `photo`, optics:CAMERA, deepinv-wiener, deepinv-tv; default: the "
        "entries that ship.",
    ),
]
benchmark_app = typer.Typer(help="Make photos for a benchmark, enter it, and score entries.")


@benchmark_app.command()
@grouped
def make(
    size: Annotated[
        str,
        typer.Argument(metavar="SIZE", help="tiny, small, full, or a dataset recipe whose views are kept."),
    ],
    *,
    spread: Spreading,
    device: DeviceOption = Device.auto,
    to: Output,
) -> Done:
    """Make the photos of a benchmark.

    It writes views, photos and sharp images with checksums, as `edofsim dataset make` does.

    Figures: those of `edofsim dataset make`.
    """
    to = replace(to, out=to.out or Path("out") / f"benchmark-{Path(size).stem}")
    return dataset.make(size, spread=spread, device=device, to=to)


@benchmark_app.command()
def enter(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the entry; NAME.py is written.")],
) -> Done:
    """Write a Python function to enter with."""
    path = Path(f"{name}.py")
    if not path.stem.isidentifier() or path.name != f"{name}.py":
        raise InputError(f"{name}: give letters, digits and _, beginning with a letter")
    if path.exists():
        raise InputError(f"{path}: is there already; choose another name, or remove it")
    from ..benchmark.entries import SKELETON

    return Done(outputs={"entry": write_text(path, SKELETON.replace("{file}", path.name))})


@benchmark_app.command()
@grouped
def score(
    entries: EntriesArgument = None,
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="The benchmark's folder.")] = Path(
        "out/benchmark-tiny"
    ),
    jobs: JobsOption = 1,
    cluster: ClusterOption = None,
    *,
    to: Output,
) -> Done:
    """Score entries on the photos of a benchmark.

    Scores have intervals and paired differences, by depth, by distance from depth edges and by family. The
    same command resumes interrupted work. Failures of an entry are named at the end (status 1), and scored as
    black images.

    Figures: {psnr_db,ssim,flip}.ENTRY.REGION, also .low and .high (95 %); psnr_db.ENTRY.family.FAMILY;
    difference_db.ENTRY.ENTRY, also .low and .high; {failures,seconds,peak_mib,gmacs,parameters}.ENTRY;
    scenes, photos.
    """
    how = spread_of(Spreading(jobs, cluster))
    with begun("benchmark score", to.json, quiet=to.quiet) as progress:
        from ..benchmark.definition import Benchmark
        from ..benchmark.entries import LEFT_OUT, deepinv_version, entries_of
        from ..benchmark.results import Results, page_of, submission, write_rows
        from ..benchmark.score import check_entries, score_scene
        from ..report import write_page

        benchmark = Benchmark(data)
        benchmark.check()
        chosen = entries_of(tuple(entries or ()))
        check_entries(benchmark, chosen)
        folder = writable_folder(to.out or Path("out") / f"score-{benchmark.recipe.name}")
        scenes = list(benchmark.scenes)
        there = {"benchmark": Benchmark(seen_by(how, data)), "folder": seen_by(how, folder)}
        work = partial(score_scene, entries=chosen, **there)
        found, problems, failures = work_on(scenes, scenes, work, how, part(progress, 0.0, 0.95))
        results = Results(chosen, [row for rows in found if rows is not None for row in rows])
        figures = results.figures()
        outputs = {
            "page": write_page(folder / "benchmark.html", page_of(results, benchmark)),
            "scores": write_rows(folder / "scores.csv", results.rows),
        }
        done = finish(
            "benchmark score",
            [results.table(), *([] if entries or deepinv_version() else [LEFT_OUT])],
            figures,
            outputs,
            to.json or folder / "benchmark.json",
            inputs={"data": str(data), "entries": [entry.name for entry in chosen]},
            rest=submission(results, benchmark),
        )
        failed = [line for entry in chosen for line in results.failures(entry.name)]
        if problems or failures:
            raise EdofsimError("\n".join([*problems, *failures]))
        return Done(done.printed, done.outputs, failures=failed)
