"""The `edofsim` command: one short function a command, no logic."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from . import __version__, console
from .cli_options import (
    AccuracyOption,
    CacheOption,
    CameraOption,
    Device,
    DeviceOption,
    JsonOption,
    LayersOption,
    MethodOption,
    NetworkOption,
    OcclusionOption,
    OutOption,
    PupilPartsOption,
    QuietOption,
    Scene,
    SeedOption,
    TimeOption,
    WithOption,
    WithoutOption,
)
from .cli_paper import evaluate_app
from .errors import InputError

app = typer.Typer(
    help="A physically based 3D scene simulator for extended-depth-of-field cameras.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
cache_app = typer.Typer(help="Rendered views that are kept: list, check, clear.", no_args_is_help=True)
app.add_typer(cache_app, name="cache")
app.add_typer(evaluate_app, name="evaluate")


class RecipeKind(StrEnum):
    scene = "scene"
    camera = "camera"
    train = "train"


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        typer.echo(f"edofsim {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def run(
    scene: Scene = "desk",
    camera: CameraOption = None,
    network: NetworkOption = None,
    method: MethodOption = None,
    layers: LayersOption = None,
    occlusion: OcclusionOption = None,
    pupil_parts: PupilPartsOption = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    with_: WithOption = None,
    without: WithoutOption = None,
    cost: Annotated[
        bool, typer.Option("--cost", help="Measure what accuracy costs; chart in the report.")
    ] = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """The main job: render (or fetch from the cache), plan, expose, restore, score, HTML report.

    Figures: psnr_db.{photo,restored,wiener,lens_alone}[.NEARm_to_FARm], ssim.* alike,
    seconds.{render,plan,expose,lens_alone,restore,wiener,score,report,total}, peak_memory_mib, render_noise,
    and what `edofsim plan` says.
    """
    from .commands.base import Aim
    from .commands.scenes import run_scene

    overrule = {
        "method": method,
        "layers": layers,
        "occlusion": occlusion,
        "sub_apertures": pupil_parts,
        "with_": with_,
        "without": without,
    }
    aim = Aim(accuracy, time)
    with console.progress("run", quiet=quiet) as progress:
        done = run_scene(
            scene, camera, network, overrule, aim, cost, seed, out, json, cache, device.value, progress
        )
    done.show()


@app.command()
def render(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE...", help="Scene recipes or shipped names.")],
    members: Annotated[
        int | None, typer.Option("--members", min=1, help="So many different scenes of each family.")
    ] = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    noise: Annotated[
        str | None, typer.Option("--noise", metavar="1%", help="Stop at this noise, not at a sample count.")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Worker processes on this machine.")] = 1,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://host:8786."),
    ] = None,
    shard: Annotated[
        str | None, typer.Option("--shard", metavar="I/N", help="Only the I-th of N shares of the work.")
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """Views into the cache; with --out a picture and a depth picture of each too. Interrupt it at any time:
    the same command goes on from there. A view serves every camera, so all of a recipe is rendered unless
    --accuracy or --time asks for what a photo through the scene's own camera calls for.

    Figures: views, views.rendered, seconds.{forecast,render}, seconds.SCENE, render_noise.SCENE,
    peak_memory_mib.
    """
    from .commands.base import Aim
    from .commands.scenes import render_scenes

    with console.progress("render", quiet=quiet) as progress:
        done = render_scenes(
            scenes,
            members,
            Aim(accuracy, time),
            noise,
            jobs,
            cluster,
            shard,
            out,
            json,
            cache,
            device.value,
            progress,
        )
    done.show()


@app.command()
def expose(
    scene: Scene,
    camera: CameraOption = None,
    method: MethodOption = None,
    layers: LayersOption = None,
    occlusion: OcclusionOption = None,
    pupil_parts: PupilPartsOption = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    with_: WithOption = None,
    without: WithoutOption = None,
    bands: Annotated[
        int | None,
        typer.Option("--bands", min=1, help="Merge the view's bands into so many; default: all of them."),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option("--reference", metavar="thinlens|pupil", help="A slow, true photo of --crop beside it."),
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option("--crop", metavar="X,Y,W,H", help="Part of the frame for --reference, in pixels."),
    ] = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """A photo through one camera: EXR (linear) and PNG.

    The reference `pupil` is wave optics with any mask: minutes for 64 x 64 pixels and few --bands; `thinlens`
    is geometric and for a clear aperture.

    Figures: psnr_db.{photo,against_reference}, seconds.{plan,render,expose,reference}, light_lost.{r,g,b},
    peak_memory_mib, and what `edofsim plan` says.
    """
    from .commands.base import Aim
    from .commands.scenes import expose_scene

    overrule = {
        "method": method,
        "layers": layers,
        "occlusion": occlusion,
        "sub_apertures": pupil_parts,
        "with_": with_,
        "without": without,
    }
    aim = Aim(accuracy, time)
    with console.progress("expose", quiet=quiet) as progress:
        done = expose_scene(
            scene,
            camera,
            overrule,
            aim,
            bands,
            reference,
            crop,
            seed,
            out,
            json,
            cache,
            device.value,
            progress,
        )
    done.show()


@app.command()
def plan(
    scene: Scene,
    camera: CameraOption = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    with_: WithOption = None,
    without: WithoutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """Which effects this scene and camera call for, what leaving each out would cost, and the choice.

    Figures: plan.{psnr_db,memory_mib,seconds}, plan.seconds.{render,prepare,psf,blur,sensor} (predicted), and
    for each effect called_for.EFFECT (1 or 0), psnr_db.without_EFFECT, plan.seconds.EFFECT.
    """
    from .commands.base import Aim
    from .commands.plans import plan_scene

    overrule = {"with_": with_, "without": without}
    aim = Aim(accuracy, time)
    with console.progress("plan", quiet=quiet) as progress:
        done = plan_scene(scene, camera, overrule, aim, json, cache, device.value, progress)
    done.show()


@app.command()
def cost(
    scene: Scene,
    camera: CameraOption = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Of each measurement, in turns.")] = 3,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """What accuracy costs: measured error against seconds for targets from 25 to 60 dB, and with each effect
    left out in turn; noise of rendering with more and more samples; every network's restoration. Tables, CSV,
    charts and a page. Interrupt it at any time: the same command goes on from there.

    Figures: psnr_db.CASE, predicted_db.CASE, seconds.CASE[.STAGE], predicted_seconds.CASE for each case
    target.N_dB, chosen, without.EFFECT and full; times_faster.chosen; render_noise.render.N_samples,
    seconds.render.N_samples; psnr_db.restore.NETWORK, seconds.restore.NETWORK.
    """
    from .commands.plans import cost_scene

    with console.progress("cost", quiet=quiet) as progress:
        done = cost_scene(scene, camera, repeats, out, json, cache, device.value, progress)
    done.show()


@app.command()
def restore(
    photo: Annotated[
        Path, typer.Argument(metavar="PHOTO", help="Photo from `expose` (EXR, linear), or PNG/JPEG (sRGB).")
    ],
    camera: Annotated[
        str, typer.Option("--camera", metavar="CAMERA", help="The camera that took it.")
    ] = "paper-learned",
    network: NetworkOption = None,
    near_m: Annotated[
        float, typer.Option("--near", metavar="METRES", help="Nearest depth in the photo.")
    ] = 0.5,
    far_m: Annotated[
        float, typer.Option("--far", metavar="METRES", help="Farthest depth; inf is legal.")
    ] = float("inf"),
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """A network or Wiener deconvolution on any image.

    Figures: seconds.restore, peak_memory_mib.
    """
    from .commands.learning import restore_file

    restore_file(photo, camera, network, near_m, far_m, out, json).show()


@app.command()
def train(
    recipe: Annotated[
        str, typer.Argument(metavar="RECIPE", help="Training recipe, or the name of a shipped one.")
    ],
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Photographs for sources that name none.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the state in --out.")] = False,
    max_minutes: Annotated[
        float | None, typer.Option("--max-minutes", min=0.01, help="End after so long, decay fitted to it.")
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """DOE and network end to end, or the network alone; several GPUs through `torchrun -m edofsim.cli`.

    Figures: psnr_db.validation, psnr_db.validation_photo, validation_loss, steps, seconds.training.
    """
    from .commands.learning import train_recipe

    with console.progress("train", quiet=quiet) as progress:
        done = train_recipe(recipe, data, resume, max_minutes, out, json, cache, device.value, progress)
    done.show()


@app.command()
def psf(
    camera: Annotated[
        str, typer.Argument(metavar="CAMERA", help="Camera recipe or shipped name.")
    ] = "paper-cubic",
    masks: Annotated[bool, typer.Option("--masks", help="Instead, a picture of every kind of mask.")] = False,
    out: OutOption = None,
    json: JsonOption = None,
) -> None:
    """PSFs and MTFs of a camera as picture and EXR."""
    from .commands.tools import draw_masks, draw_psf

    (draw_masks(out, json) if masks else draw_psf(camera, out, json)).show()


@cache_app.command("ls")
def cache_ls(cache: CacheOption = None, json: JsonOption = None) -> None:
    """Every entry with its scene, size and age."""
    from .commands.tools import cache_list

    cache_list(cache, json).show()


@cache_app.command("verify")
def cache_verify(cache: CacheOption = None, json: JsonOption = None) -> None:
    """Check every entry against its checksum; damaged ones are set aside."""
    from .commands.tools import cache_check

    cache_check(cache, json).show()


@cache_app.command("prune")
def cache_prune(
    cache: CacheOption = None,
    older_than_days: Annotated[
        float, typer.Option("--older-than-days", min=0, help="Remove entries not used for so long.")
    ] = 30.0,
    json: JsonOption = None,
) -> None:
    """Remove old entries, what was set aside, and what interrupted work left."""
    from .commands.tools import cache_clear

    cache_clear(cache, older_than_days, json).show()


@app.command()
def doctor(
    again: Annotated[bool, typer.Option("--again", help="Probe anew instead of remembering.")] = False,
    json: JsonOption = None,
) -> None:
    """Engines and devices found, which works, what to install for a faster one."""
    from .commands.tools import examine_engines

    examine_engines(again, json).show()


@app.command()
def schema(
    kind: Annotated[RecipeKind, typer.Argument(help="Which recipe.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write it there instead of printing it.")
    ] = None,
) -> None:
    """JSON Schema of a recipe, for editors."""
    from .commands.tools import recipe_schema

    recipe_schema(kind.value, out)


def main() -> None:
    """Entry point: every failure is one message and a status (0 done, 1 failed, 2 bad input)."""
    sys.exit(console.exit_status(invoke))


def invoke(arguments: list[str] | None = None) -> None:
    """Run the command line, by default the process's own. Raises InputError for a wrong one."""
    try:
        app(arguments, standalone_mode=False)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except Exception as error:
        usage = getattr(error, "format_message", None)  # click's own exceptions: a wrong option or argument
        if usage is None:
            raise
        raise InputError(f"{usage()}; see `edofsim --help`") from None


if __name__ == "__main__":
    main()
