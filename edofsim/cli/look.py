"""`edofsim look`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..options import Work
from ..record import peak_memory_mib, writable_folder
from .shared import Done, begun, finish

LOOK_SAMPLES = 16


def look(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help="Scene recipe or shipped name.", autocompletion=completion.scenes
        ),
    ],
    samples: Annotated[
        int, typer.Option("--samples", min=1, help="Light paths per pixel, if the scene is rendered.")
    ] = LOOK_SAMPLES,
    *,
    work: Work,
) -> Done:
    """Show a scene, all sharp: picture and depths.

    It also prints what was assumed to read the scene. It needs no camera: pixels see the angle of the recipe
    or the file, else that of the scene's own camera.

    Figures: depth_m.nearest, depth_m.farthest, pixel_angle_mrad, peak_memory_mib.
    """
    from ..recipe import load_scene

    loaded = load_scene(scene)
    folder = writable_folder(work.out or Path("out") / f"{loaded.recipe.name}-look")
    with begun("look", work.json, quiet=work.quiet) as progress:
        from ..render.seen import assumptions, by_itself, for_preview
        from .angles import framed_by_own

        recipe, whose = by_itself(loaded.recipe, loaded.base)
        if recipe is None:
            recipe = framed_by_own(loaded.recipe, loaded.base)
        from ..capture import save_image
        from ..render import render
        from ..report import depth_plot

        view = render(
            for_preview(recipe, samples),
            loaded.base,
            cache=work.cache,
            device=work.device.value,
            progress=progress,
        )
        inverse = view.crop_margin(view.mean_inverse_depth())
        numbers = {
            "depth_m.nearest": 1 / float(inverse.max()) if float(inverse.max()) else float("inf"),
            "depth_m.farthest": 1 / float(inverse.min()) if float(inverse.min()) else float("inf"),
            "pixel_angle_mrad": view.pixel_angle * 1e3,
            "peak_memory_mib": peak_memory_mib(),
        }
        outputs = {
            "picture": save_image(folder / "picture.png", view.picture()),
            "depth": depth_plot(inverse).save(folder / "depth.png"),
        }
        lines = assumptions(view, whose)
        if recipe.source is None or recipe.source.rendered:
            lines.append(f"rendered with {samples} samples a pixel; --samples for less noise")
        return finish("look", lines, numbers, outputs, work.json, inputs={"scene": str(loaded.path)})
