"""`edofsim fabricate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..errors import InputError
from ..options import JsonOption, OutOption
from ..record import writable_folder
from .shared import Done, begun, finish


def fabricate(
    camera: Annotated[
        str,
        typer.Argument(
            metavar="CAMERA", help="Camera recipe, or shipped name.", autocompletion=completion.cameras
        ),
    ],
    pitch_um: Annotated[
        float,
        typer.Option("--pitch", metavar="UM", help="Side of the fabrication tool's squares, micrometres."),
    ] = 3.0,
    levels: Annotated[int, typer.Option("--levels", min=2, max=65535, help="Grey levels.")] = 98,
    limit_um: Annotated[
        float, typer.Option("--limit", metavar="UM", help="Largest height in micrometres.")
    ] = 1.2,
    wrap_nm: Annotated[
        float | None,
        typer.Option(
            "--wrap", metavar="NM", help="Wrap larger heights by whole waves of this wavelength, nanometres."
        ),
    ] = None,
    gds: Annotated[
        bool, typer.Option("--gds", help="Also write GDSII, with one layer for each level.")
    ] = False,
    out: OutOption = None,
    json: JsonOption = None,
) -> Done:
    """Write fabrication files of a camera's mask.

    Files are levels as PNG of 16 bits and CSV, heights as CSV, and GDSII. Height errors of the recipe are
    left out.

    Figures: relief_um, levels, samples.
    """
    if not (pitch_um > 0 and limit_um > 0 and (wrap_nm is None or wrap_nm > 0)):
        raise InputError("--pitch, --limit and --wrap are above 0")
    from ..recipe import load_camera

    loaded = load_camera(camera)
    name = loaded.recipe.name
    folder = writable_folder(out or Path("out") / f"{name}-mask")
    with begun("fabricate", json, quiet=True):
        from ..learn.fabricate import device, write_device
        from ..restore import choose_network

        optics = choose_network(None, loaded)[1]
        try:
            made = device(optics, pitch_um=pitch_um, levels=levels, limit_um=limit_um, wrap_nm=wrap_nm)
        except InputError as error:
            wrap = [each.replace("fabrication.wrap_wavelength_nm", "--wrap") for each in error.problems]
            limit = [each.replace("fabrication.height_limit_um", "--limit") for each in wrap]
            raise InputError(limit) from None
        height = float(made.levels.max()) * made.level_height * 1e6
        paths = write_device(made, folder, name, gds=gds)
        figures = {"relief_um": height, "levels": int(made.levels.max()) + 1, "samples": len(made.levels)}
        squares = f"{len(made.levels)} x {len(made.levels)} squares of {pitch_um:g} um"
        deep = f"{figures['levels']} levels, {height:.3g} um deep"
        lines = [f"{squares}, {deep}; row 0 is the top of the pupil, seen from the sensor"]
        outputs = {path.suffix[1:] + (" " + path.stem.rpartition("-")[2]): path for path in paths}
        return finish("fabricate", lines, figures, outputs, json, inputs={"camera": camera})
