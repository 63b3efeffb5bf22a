"""An experiment: `edofsim evaluate width`, part of `edofsim evaluate paper` too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from edofsim.core.progress import Progress
from edofsim.optics import Camera, psf_bank
from edofsim.options import CameraOption
from edofsim.plugins import Findings, in_paper
from edofsim.recipe import load_camera
from edofsim.report import Key, Keys, Page


@in_paper(lambda paper: {"depth_m": 0.5})
def run(
    folder: Path,
    progress: Progress,
    camera: CameraOption = None,
    depth_m: Annotated[float, typer.Option("--depth", help="Of the point, in metres.")] = 1.0,
) -> Findings:
    """How wide a camera makes a point: side of the square of the same energy.

    Figures: width_um.
    """
    loaded = load_camera(camera or "paper-clear")
    progress(0.0, loaded.recipe.name)
    optics = Camera.from_recipe(loaded.recipe, loaded.base)
    psf = psf_bank(optics, [543e-9], [1 / depth_m]).values[0, 0]
    width = float(psf.sum() / psf.square().sum().sqrt()) * optics.pixel * 1e6
    page = Page("Width", "How wide a point becomes.", head=(Keys((Key("width", f"{width:.1f}", "µm"),)),))
    return Findings({"width_um": width}, page)
