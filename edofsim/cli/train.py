"""`edofsim train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..options import Work
from ..record import writable_folder
from .shared import Done, begun, finish


def train(
    recipe: Annotated[
        str,
        typer.Argument(
            metavar="RECIPE",
            help="Training recipe, or the name of a shipped one.",
            autocompletion=completion.trainings,
        ),
    ],
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="DIR", help="Folder of photographs for sources that name none."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the state in --out.")] = False,
    max_minutes: Annotated[
        float | None,
        typer.Option(
            "--max-minutes", min=0.01, help="End after this time; the learning rate decays by then."
        ),
    ] = None,
    *,
    work: Work,
) -> Done:
    """Train a mask and a network, or a network alone.

    For several GPUs, use `torchrun -m edofsim`.

    Figures: psnr_db.validation, psnr_db.validation.SOURCE, psnr_db.validation_photo, validation_loss, steps,
    seconds.training; psnr_db.start, psnr_db.start.SOURCE: the same pictures restored by the weights that it
    starts from.
    """
    from ..recipe.load import load_train

    loaded = load_train(recipe)
    folder = writable_folder(work.out or Path("out") / f"train-{loaded.path.stem}")
    with begun("train", work.json, quiet=work.quiet) as progress:
        from ..learn import train

        trained = train(
            loaded,
            folder,
            data=data,
            resume=resume,
            max_minutes=max_minutes,
            device=work.device.value,
            cache=work.cache,
            progress=progress,
        )
        lines = [f"{name} {value:.6g}" for name, value in trained.figures.items()]
        if not trained.finished:
            lines.append(f"not finished: go on with edofsim train {recipe} --resume --out {folder}")
        outputs = {path.name: path for path in trained.outputs}
        inputs = {"recipe": str(loaded.path), "data": str(data) if data else None}
        return finish("train", lines, trained.figures, outputs, work.json, inputs=inputs)
