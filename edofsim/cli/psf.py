"""`edofsim psf`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..errors import InputError
from ..options import Device, DeviceOption, JsonOption, OutOption, QuietOption, numbers
from ..record import writable_folder
from .shared import Done, begun, figures_table, finish


def psf(
    camera: Annotated[
        str,
        typer.Argument(
            metavar="CAMERA", help="Camera recipe or shipped name.", autocompletion=completion.cameras
        ),
    ] = "paper-cubic",
    depths: Annotated[
        str, typer.Option("--depths", metavar="M,M,...", help="Depths in metres; inf is legal.")
    ] = "0.5,0.7,1,1.5,3,inf",
    wavelengths: Annotated[
        str, typer.Option("--wavelengths", metavar="NM,NM,...", help="Wavelengths in nanometres.")
    ] = "611,543,482",
    masks: Annotated[bool, typer.Option("--masks", help="Instead, a picture of every kind of mask.")] = False,
    out: OutOption = None,
    json: JsonOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """PSFs and MTFs of a camera as picture and EXR.

    Figures: truncated_percent.DEPTH.WAVELENGTH (light outside the window), strehl.DEPTH.WAVELENGTH,
    focus_m.paraxial and focus_m.best (what is sharp to rays near the axis, and to the whole aperture without
    its mask; the recipe's focus.plane chooses), transmission_percent (light that the mask lets through).
    """
    depths_m = tuple(dict.fromkeys(numbers(depths, "--depths", "0.5,1,inf")))
    if not all(depth > 0 for depth in depths_m):
        raise InputError(f"--depths {depths}: give metres above 0, for instance 0.5,1,inf")
    wavelengths_nm = tuple(dict.fromkeys(numbers(wavelengths, "--wavelengths", "611,543,482")))
    if not all(0 < nm < math.inf for nm in wavelengths_nm):
        raise InputError(f"--wavelengths {wavelengths}: give nanometres, for instance 611,543,482")
    from ..recipe import load_camera

    loaded = None if masks else load_camera(camera)
    folder = writable_folder(out or Path("out") / (f"psf-{loaded.recipe.name}" if loaded else "masks"))
    with begun("psf", json, quiet=quiet) as progress:
        from ..capture.device import torch_device
        from ..experiments import psf_figure
        from ..optics import Camera

        compute = torch_device(device.value)
        if loaded is None:
            return finish("psf --masks", [], {}, {"masks": psf_figure.gallery(folder, progress)}, json)
        figures, outputs = psf_figure.run(
            Camera.from_recipe(loaded.recipe, loaded.base),
            folder,
            wavelengths_nm=wavelengths_nm,
            depths_m=depths_m,
            device=compute,
            progress=progress,
        )
        inputs = {"camera": camera, "depths_m": depths, "wavelengths_nm": wavelengths}
        return finish("psf", [figures_table(figures)], figures, outputs, json, inputs=inputs)
