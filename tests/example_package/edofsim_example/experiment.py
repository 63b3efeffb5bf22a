"""An experiment: `edofsim evaluate width`, part of `edofsim evaluate paper` too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import edofsim
from edofsim.plugins import CameraOption, Findings, Key, Keys, Page, Progress, in_paper


@in_paper(lambda paper: {"depth_m": 0.5})
def width(
    folder: Path,
    progress: Progress,
    camera: CameraOption = None,
    depth_m: Annotated[float, typer.Option("--depth", help="Of the point, in metres.")] = 1.0,
) -> Findings:
    """How wide a camera makes a point: side of the square of the same energy.

    Figures: width_um.
    """
    optics = edofsim.camera(camera or "paper-clear")
    progress(0.0, optics.recipe.name)
    psf = edofsim.psfs(optics, [depth_m], [543e-9]).values[0, 0]
    width = float(psf.sum() / psf.square().sum().sqrt()) * optics.pixel * 1e6
    page = Page("Width", "How wide a point becomes.", head=(Keys((Key("width", f"{width:.1f}", "µm"),)),))
    return Findings({"width_um": width}, page)
