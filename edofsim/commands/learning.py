"""`train` and `restore`."""

from __future__ import annotations

import time
from pathlib import Path

from ..errors import InputError
from ..recipe import load_camera
from ..recipe.load import load_train
from ..record import peak_memory_mib, writable_folder
from .base import Done, Progress, finish


def restore_file(
    photo: Path,
    camera: str,
    network: str | None,
    near_m: float,
    far_m: float,
    out: Path | None,
    json: Path | None,
) -> Done:
    """`edofsim restore`."""
    if not 0 < near_m <= far_m:
        raise InputError(f"--near {near_m:g} and --far {far_m:g}: give 0 < near <= far, in metres")
    loaded = load_camera(camera)
    folder = writable_folder(out or Path("out") / f"{photo.stem}-restored")
    import torch

    from ..capture import read_image, write_image
    from ..optics import Camera
    from ..pipeline import choose_network, depths_between
    from ..recipe.scene import Bands
    from ..report import save_srgb
    from ..restore import restore

    checkpoint, recipe = choose_network(network, loaded)
    image = read_image(photo)
    optics = Camera.from_recipe(recipe, loaded.base)
    wavelengths = torch.from_numpy(Bands().wavelengths())
    depths = depths_between(torch.tensor(1 / far_m), torch.tensor(1 / near_m))
    started = time.perf_counter()
    restored, by = restore(image, optics, wavelengths, depths, checkpoint=checkpoint)
    numbers = {"seconds.restore": time.perf_counter() - started, "peak_memory_mib": peak_memory_mib()}
    outputs = {
        "restored (EXR, linear)": write_image(folder / "restored.exr", restored),
        "restored (PNG, sRGB)": save_srgb(folder / "restored.png", restored),
    }
    lines = [f"{by}: {numbers['seconds.restore']:.2f} s"]
    inputs = {"photo": str(photo), "camera": camera, "network": network}
    return finish("restore", lines, numbers, outputs, json, inputs=inputs)


def train_recipe(
    recipe: str,
    data: Path | None,
    resume: bool,
    max_minutes: float | None,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim train`."""
    loaded = load_train(recipe)
    folder = writable_folder(out or Path("out") / f"train-{loaded.path.stem}")
    from ..learn import train

    trained = train(
        loaded,
        folder,
        data=data,
        resume=resume,
        max_minutes=max_minutes,
        device=device,
        cache=cache,
        progress=progress,
    )
    lines = [f"{name} {value:.6g}" for name, value in trained.figures.items()]
    if not trained.finished:
        lines.append(f"not finished: go on with edofsim train {recipe} --resume --out {folder}")
    outputs = {path.name: path for path in trained.outputs}
    inputs = {"recipe": str(loaded.path), "data": str(data) if data else None}
    return finish("train", lines, trained.figures, outputs, json, inputs=inputs)
