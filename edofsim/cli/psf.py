"""`edofsim psf`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import completion
from ..core.progress import Progress, part
from ..errors import InputError
from ..options import Device, DeviceOption, JsonOption, OutOption, QuietOption, numbers
from ..record import writable_folder
from .shared import Done, begun, figures_table, finish

if TYPE_CHECKING:
    from ..optics import Camera


DepthsOption = Annotated[
    str, typer.Option("--depths", metavar="M,M,...", help="Depths in metres; inf is allowed.")
]
WavelengthsOption = Annotated[
    str, typer.Option("--wavelengths", metavar="NM,NM,...", help="Wavelengths in nanometres.")
]
FieldsOption = Annotated[
    str | None,
    typer.Option(
        "--fields",
        metavar="DEG,DEG,...",
        help="Angles off the axis, of lenses that vary over the field. [default: to the corner of"
        " 512 x 384 pixels]",
    ),
]
FrequencyOption = Annotated[
    float | None,
    typer.Option(
        "--frequency",
        metavar="PER_MM",
        help="Frequency of the MTFs against depth, cycles/mm. [default: half of what the pixels resolve]",
    ),
]
SaveOption = Annotated[
    Path | None,
    typer.Option(
        "--save",
        metavar="FILE",
        help="Also write these PSFs as .exr or .npz, with FILE.toml, the recipe of a camera that has them.",
    ),
]
CameraArgument = Annotated[
    str,
    typer.Argument(
        metavar="CAMERA", help="Camera recipe or shipped name.", autocompletion=completion.cameras
    ),
]


def psf(
    camera: CameraArgument = "paper-cubic",
    depths: DepthsOption = "0.5,0.7,1,1.5,3,inf",
    wavelengths: WavelengthsOption = "611,543,482",
    fields: FieldsOption = None,
    frequency: FrequencyOption = None,
    save: SaveOption = None,
    masks: Annotated[bool, typer.Option("--masks", help="Draw every kind of mask instead.")] = False,
    out: OutOption = None,
    json: JsonOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """Write PSFs and MTFs of a camera.

    Figures: truncated_percent.DEPTH.WAVELENGTH (light outside the window), strehl.DEPTH.WAVELENGTH,
    focus_m.paraxial and focus_m.best (what is sharp to rays near the axis, and to the whole aperture without
    its mask; the recipe's focus.plane chooses), transmission_percent (light that the mask lets through). Of
    measured PSFs, mixing_percent.{depth,wavelength,field}: light that is in the wrong place between two.

    Of a lens that varies over the field, tables and pictures over field and depth as well. Figures, by angle
    (10deg): illumination_percent, mtf.tangential and mtf.sagittal (in focus, at --frequency, without the
    pixel), and of rays distortion_percent, focus_um.tangential and focus_um.sagittal (behind the sensor),
    lateral_colour_um (shortest to longest wavelength), spot_um (root mean square, in focus).
    """
    asked = _asked(depths, wavelengths, fields, frequency, save)
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
        optics = Camera.from_recipe(loaded.recipe, loaded.base)
        if not optics.lens.varies and (asked.angles or frequency):
            raise InputError(
                f"--fields, --frequency: the lens of {camera} is the same over the field; leave them out"
            )
        figures, outputs = _made(optics, asked, folder, compute, progress)
        inputs = {"camera": camera, "depths_m": depths, "wavelengths_nm": wavelengths}
        return finish("psf", [figures_table(figures)], figures, outputs, json, inputs=inputs)


@dataclass(frozen=True)
class _Asked:
    depths_m: tuple[float, ...]
    wavelengths_nm: tuple[float, ...]
    angles: tuple[float, ...] | None
    frequency: float | None
    save: Path | None


def _asked(
    depths: str, wavelengths: str, fields: str | None, frequency: float | None, save: Path | None
) -> _Asked:
    """What was typed, as numbers. Raises InputError for what is none or cannot be."""
    depths_m = tuple(dict.fromkeys(numbers(depths, "--depths", "0.5,1,inf")))
    if not all(depth > 0 for depth in depths_m):
        raise InputError(f"--depths {depths}: give metres above 0, for instance 0.5,1,inf")
    wavelengths_nm = tuple(dict.fromkeys(numbers(wavelengths, "--wavelengths", "611,543,482")))
    if not all(0 < nm < math.inf for nm in wavelengths_nm):
        raise InputError(f"--wavelengths {wavelengths}: give nanometres, for instance 611,543,482")
    angles = None if fields is None else tuple(dict.fromkeys(numbers(fields, "--fields", "0,5,10")))
    if angles is not None and not all(0 <= angle < 90 for angle in angles):
        raise InputError(f"--fields {fields}: give degrees from 0 to 90, for instance 0,5,10")
    if frequency is not None and not 0 < frequency < math.inf:
        raise InputError(f"--frequency {frequency:g}: give cycles/mm above 0, for instance 40")
    if save is not None and save.suffix.lower() not in (".exr", ".npz"):
        raise InputError(f"--save {save}: PSFs are written as .exr or .npz; name such a file")
    return _Asked(depths_m, wavelengths_nm, angles, frequency, save)


def _made(
    camera: Camera, asked: _Asked, folder: Path, device: str, progress: Progress
) -> tuple[dict[str, float], dict[str, Path]]:
    """Figures and files of a camera."""
    from ..experiments import field_figure, psf_figure
    from ..optics.measured.saving import save_bank

    what = {"wavelengths_nm": asked.wavelengths_nm, "depths_m": asked.depths_m, "device": device}
    varies = camera.lens.varies
    end = 0.3 if varies else 1.0
    figures, outputs = psf_figure.run(camera, folder, **what, progress=part(progress, 0, end))
    if varies:
        how = {"fields_deg": asked.angles or field_figure.usual_fields(camera), "per_mm": asked.frequency}
        more, files = field_figure.run(camera, folder, **what, **how, progress=part(progress, end, 1))
        figures, outputs = figures | more, outputs | files
    if asked.save is not None:
        angles = asked.angles or field_figure.usual_fields(camera)
        outputs |= save_bank(camera, asked.save, fields_deg=angles, **what)
    return figures, outputs
