"""Options that several commands have."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Device(StrEnum):
    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


Scene = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene recipe (TOML), or the name of a shipped one, e.g. desk.")
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera", metavar="CAMERA", help="Camera recipe or shipped name; default: what the scene names."
    ),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for what is written; default out/NAME.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="All printed figures, machine-readable.")
]
DeviceOption = Annotated[Device, typer.Option("--device", help="Where to compute.")]
SeedOption = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of everything random that is not in the scene recipe.")
]
CacheOption = Annotated[
    Path | None,
    typer.Option(
        "--cache", metavar="DIR", help="Folder of rendered views; default render_cache in a checkout."
    ),
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress.")]
LayersOption = Annotated[
    int | None, typer.Option("--layers", help="Depth layers; default: what the plan says.")
]
MethodOption = Annotated[
    str | None,
    typer.Option("--method", help="brute, layered, low_rank or constant; default: what the plan says."),
]
AccuracyOption = Annotated[
    str | None,
    typer.Option(
        "--accuracy",
        metavar="45dB|noise|full",
        help="What all left-out effects may err by together; default noise: half of the sensor's.",
    ),
]
TimeOption = Annotated[
    str | None, typer.Option("--time", metavar="20s", help="Instead: the best accuracy within a time.")
]
WithOption = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="EFFECT", help="Simulate an effect in full, whatever the plan says."),
]
WithoutOption = Annotated[
    list[str] | None,
    typer.Option("--without", metavar="EFFECT", help="Leave an effect out, whatever the plan says."),
]
OcclusionOption = Annotated[
    str | None,
    typer.Option("--occlusion", help="none, over, normalised or hidden; default: what the plan says."),
]
PupilPartsOption = Annotated[
    int | None,
    typer.Option(
        "--pupil-parts",
        metavar="N",
        min=1,
        max=16,
        help="Composite hidden surfaces through N x N parts of the pupil, one by one: truer where both sides "
        "of an edge are blurred; default: as many as the plan asks for.",
    ),
]
NetworkOption = Annotated[
    str | None,
    typer.Option(
        "--network",
        metavar="CHECKPOINT",
        help="Restore with this checkpoint, whose mask the camera then has; `wiener` for Wiener "
        "deconvolution; default: the network that was trained with the camera's mask, if there is one.",
    ),
]
