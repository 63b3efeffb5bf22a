"""`edofsim restore`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..errors import InputError
from ..options import (
    Device,
    DeviceOption,
    JsonOption,
    NetworkOption,
    OutOption,
    QuietOption,
    RawColoursOption,
)
from ..record import peak_memory_mib, writable_folder
from .shared import Done, begun, finish

TakenByOption = Annotated[
    str,
    typer.Option(
        "--camera", metavar="CAMERA", help="Camera that took the photo.", autocompletion=completion.cameras
    ),
]


def restore(
    photo: Annotated[
        Path, typer.Argument(metavar="PHOTO", help="Photo from `expose` (EXR, linear), or PNG/JPEG (sRGB).")
    ],
    camera: TakenByOption = "paper-learned",
    network: NetworkOption = None,
    near_m: Annotated[
        float, typer.Option("--near", metavar="METRES", help="Nearest depth in the photo.")
    ] = 0.5,
    far_m: Annotated[
        float, typer.Option("--far", metavar="METRES", help="Farthest depth; inf is allowed.")
    ] = float("inf"),
    raw_colours: RawColoursOption = False,
    out: OutOption = None,
    json: JsonOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """Restore an image by network or Wiener filter.

    Figures: seconds.restore, peak_memory_mib.
    """
    if not 0 < near_m <= far_m:
        raise InputError(f"--near {near_m:g} and --far {far_m:g}: give 0 < near <= far, in metres")
    from ..recipe import load_camera

    loaded = load_camera(camera)
    folder = writable_folder(out or Path("out") / f"{photo.stem}-restored")
    with begun("restore", json, quiet=quiet) as progress:
        import torch

        from ..capture import read_image, save_image, write_image
        from ..capture.device import torch_device
        from ..capture.files import read_colour_matrix
        from ..recipe.scene import Bands
        from ..restore import choose_network, restore, said_of

        checkpoint, optics = choose_network(network, loaded)
        image = read_image(photo).to(torch_device(device.value))
        wavelengths = torch.from_numpy(Bands().wavelengths())
        depths = torch.tensor([1 / far_m, 1 / near_m], dtype=torch.float64)
        progress(0.1, "restoring")
        started = time.perf_counter()
        restored, by = restore(image, optics, wavelengths, depths, checkpoint=checkpoint)
        restored = restored.cpu()
        colours = None if raw_colours else read_colour_matrix(photo)
        numbers = {"seconds.restore": time.perf_counter() - started, "peak_memory_mib": peak_memory_mib()}
        outputs = {
            "restored (EXR, linear)": write_image(folder / "restored.exr", restored),
            "restored (PNG, sRGB)": save_image(folder / "restored.png", restored, colours),
        }
        lines = [f"{by}: {numbers['seconds.restore']:.2f} s"]
        lines += [said] if (said := said_of(checkpoint, by)) else []
        inputs = {"photo": str(photo), "camera": camera, "network": network}
        return finish("restore", lines, numbers, outputs, json, inputs=inputs)
