"""Options that several commands have."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from . import completion
from .errors import InputError

LARGEST_SEED = 2**64 - 1
MOST_LAYERS = 4096
"""More would lie closer than any PSF changes: 0.5 m to infinity in steps of 0.0005 dioptres."""


class Device(StrEnum):
    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


Scenes = Annotated[
    list[str],
    typer.Argument(
        metavar="SCENE...",
        help="Scene recipes (TOML), or names of shipped ones.",
        autocompletion=completion.scenes,
    ),
]
ShippedScenes = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SCENE...]",
        help="Recipes or shipped names; default all shipped.",
        autocompletion=completion.scenes,
    ),
]
Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Scene recipe (TOML), or the name of a shipped one, e.g. desk.",
        autocompletion=completion.scenes,
    ),
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="CAMERA",
        help="Camera recipe or shipped name; default: what the scene names.",
        autocompletion=completion.cameras,
    ),
]
ResampleOption = Annotated[
    bool,
    typer.Option(
        "--resample",
        help="Resample the view where its pixels see another angle than the camera's.",
    ),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for what is written; default out/NAME.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="All printed figures, machine-readable.")
]
RawColoursOption = Annotated[
    bool, typer.Option("--raw-colours", help="Show the sensor's own colours, without white balance.")
]
DeviceOption = Annotated[Device, typer.Option("--device", help="Where to compute.")]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed",
        min=0,
        max=LARGEST_SEED,
        metavar="N",
        help="Seed of everything random that is not in the scene recipe; up to 64 bits.",
    ),
]
CacheOption = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="DIR",
        help="Folder of rendered views; default: what the environment variable EDOFSIM_CACHE names, else "
        "render_cache in a checkout, else edofsim/views in the user's cache folder.",
    ),
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress and no forecast.")]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, help="Worker processes on this machine.")]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="A Dask scheduler, e.g. tcp://host:8786, whose workers see the same folders.",
    ),
]
ShardOption = Annotated[
    str | None, typer.Option("--shard", metavar="I/N", help="Only the I-th of N shares of the work.")
]
LayersOption = Annotated[
    int | None,
    typer.Option(
        "--layers", metavar="N", min=1, max=MOST_LAYERS, help="Depth layers; default: what the plan says."
    ),
]
MethodOption = Annotated[
    str | None,
    typer.Option(
        "--method",
        help="Removed: photos are made in layers; `constant` is --layers 1.",
        hidden=True,
    ),
]
FidelityOption = Annotated[
    str | None,
    typer.Option(
        "--fidelity",
        metavar="FILE|preview|reference",
        help="Simulate as a file says, without a plan: the JSON of a run or plan, or TOML with "
        "fields of a fidelity. Or a preset: `preview` takes a moment, `reference` leaves "
        "nothing out.",
        autocompletion=completion.one_of("preview", "reference"),
    ),
]
AccuracyOption = Annotated[
    str | None,
    typer.Option(
        "--accuracy",
        metavar="45dB|noise|restored|full",
        help="Total error allowed, as PSNR. noise: half of the sensor's noise. restored: small "
        "enough that restored images keep their PSNR. Default: noise; for `run`: restored.",
        autocompletion=completion.one_of("noise", "restored", "full", "45dB"),
    ),
]
TimeOption = Annotated[
    str | None,
    typer.Option(
        "--time", metavar="20s", help="Time budget in place of --accuracy: the best accuracy within it."
    ),
]
WithOption = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        metavar="EFFECT",
        help="Simulate an effect in full, whatever the plan says; `edofsim list effects` names them.",
        autocompletion=completion.effects,
    ),
]
WithoutOption = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="EFFECT",
        help="Leave an effect out, whatever the plan says.",
        autocompletion=completion.effects,
    ),
]
OcclusionOption = Annotated[
    str | None,
    typer.Option(
        "--occlusion",
        help="none, over, normalised or hidden; default: what the plan says.",
        autocompletion=completion.one_of("none", "over", "normalised", "hidden"),
    ),
]
SubAperturesOption = Annotated[
    int | None,
    typer.Option(
        "--sub-apertures",
        "--pupil-parts",
        metavar="N",
        min=1,
        max=16,
        help="Composite hidden surfaces through N x N sub-apertures: more accurate at edges where "
        "both surfaces are out of focus. Default: what the plan says.",
    ),
]
NetworkOption = Annotated[
    str | None,
    typer.Option(
        "--network",
        metavar="CHECKPOINT",
        autocompletion=completion.networks,
        help="Restore with this checkpoint; the camera gets its mask. `wiener`: Wiener "
        "deconvolution. Default: the network trained with the camera's mask, else the one for "
        "any camera.",
    ),
]
QuickOption = Annotated[bool, typer.Option("--quick", help="Use only the middle of each frame.")]
MembersOption = Annotated[
    int,
    typer.Option(
        "--members",
        min=0,
        metavar="N",
        help="Replace each scene by this many random variants, seeds --seed and up.",
    ),
]
SYSTEM_HELP = (
    "A checkpoint, a camera (recipe or shipped name) with its usual network, wiener, wiener-depth (which "
    "knows distances), a Python function (module:function, file.py:function), or CAMERA+RESTORATION; "
    "repeatable; default: "
)


def systems_option(default: str) -> Any:  # pyrefly: ignore[explicit-any] - Typer's own kind
    """The option of systems to compare. default: said in its help."""
    names = ("--system", "--network")
    help_ = SYSTEM_HELP + default
    return typer.Option(*names, metavar="SYSTEM", help=help_, autocompletion=completion.systems)


def cameras_option(help_: str) -> Any:  # pyrefly: ignore[explicit-any] - Typer's own kind
    """The option of a camera, or of several."""
    return typer.Option("--camera", metavar="CAMERA", help=help_, autocompletion=completion.cameras)


NetworksOption = Annotated[
    list[str] | None,
    systems_option(
        "all networks that ship with a mask. A checkpoint's mask is put into the camera where that has the "
        "lens of the training, otherwise it brings its own."
    ),
]
PicturesOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder of photographs; default: those of scikit-image."),
]
SystemsOption = Annotated[list[str] | None, systems_option("all that ship, paper-clear, paper-cubic.")]
LensOption = Annotated[
    str | None,
    cameras_option("Camera recipe or shipped name, for systems that name none; default paper-clear."),
]
ChartOption = Annotated[
    Path | None,
    typer.Option("--chart", metavar="FILE", help="Picture of a test chart; default: USAF-1951, drawn."),
]
ShowOption = Annotated[
    list[str] | None,
    typer.Option("--show", metavar="NAME", help="Photograph to show, repeatable; default: the first."),
]
LimitOption = Annotated[int | None, typer.Option("--limit", min=1, help="Use only this many photographs.")]


@dataclass(frozen=True)
class Output:
    """Options of what a command leaves."""

    out: OutOption = None
    json: JsonOption = None
    quiet: QuietOption = False


@dataclass(frozen=True)
class Work(Output):
    """And of where it computes."""

    cache: CacheOption = None
    device: DeviceOption = Device.auto


@dataclass(frozen=True)
class Spreading:
    """Options of who does the work."""

    jobs: JobsOption = 1
    cluster: ClusterOption = None
    shard: ShardOption = None


@dataclass(frozen=True)
class Planned:
    """Options of what is planned for."""

    accuracy: AccuracyOption = None
    time: TimeOption = None
    with_: WithOption = None
    without: WithoutOption = None

    @property
    def overrule(self) -> dict[str, object]:
        """What replaces the plan's choices, by names of `plan.checked_overrule`."""
        given = vars(self).items()
        return {name: value for name, value in given if name not in ("accuracy", "time", "fidelity")}


@dataclass(frozen=True)
class Simulated(Planned):
    """Options of what is simulated."""

    method: MethodOption = None
    layers: LayersOption = None
    occlusion: OcclusionOption = None
    sub_apertures: SubAperturesOption = None
    fidelity: FidelityOption = None


Result = TypeVar("Result")


def grouped(command: Callable[..., Result]) -> Callable[..., Result]:
    """A command with the options of its groups, parameters whose type is a dataclass, as its own: for Typer,
    which knows no groups."""
    own = inspect.signature(command, eval_str=True).parameters.values()
    groups = {each.name: each.annotation for each in own if is_dataclass(each.annotation)}

    def whole(**options: object) -> Result:
        for name, group in groups.items():
            options[name] = group(**{each.name: options.pop(each.name) for each in fields(group)})
        return command(**options)

    every: list[inspect.Parameter] = []
    for each in own:
        inside = groups.get(each.name)
        every += [each] if inside is None else inspect.signature(inside, eval_str=True).parameters.values()
    every = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in every]
    whole.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    whole.__annotations__ = {each.name: each.annotation for each in every}
    whole.__doc__, whole.__name__ = command.__doc__, command.__name__
    return whole


def numbers(text: str, option: str, example: str, count: int | None = None) -> tuple[float, ...]:
    """Numbers with commas between them, as typed. Raises InputError for others, or another count."""
    try:
        found = tuple(float(each) for each in text.split(","))
    except ValueError:
        found = ()
    if not found or (count is not None and len(found) != count):
        many = "" if count is None else f"{count} "
        raise InputError(
            f"{option} {text}: give {many}numbers with commas between them, for instance {example}"
        )
    return found
