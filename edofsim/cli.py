"""The `edofsim` command: one short function a command, no logic."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from . import __version__, console
from .errors import InputError

app = typer.Typer(
    help="A physically based 3D scene simulator for extended-depth-of-field cameras.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
cache_app = typer.Typer(help="Rendered views that are kept: list, check, clear.", no_args_is_help=True)
evaluate_app = typer.Typer(
    help="The paper's experiments: each writes figures, a CSV and a picture.", no_args_is_help=True
)
app.add_typer(cache_app, name="cache")
app.add_typer(evaluate_app, name="evaluate")


class Device(StrEnum):
    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


class RecipeKind(StrEnum):
    scene = "scene"
    camera = "camera"
    train = "train"


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
NetworkOption = Annotated[
    str | None,
    typer.Option(
        "--network",
        metavar="CHECKPOINT",
        help="Restore with this checkpoint, whose mask the camera then has; `wiener` for Wiener "
        "deconvolution; default: the network that was trained with the camera's mask, if there is one.",
    ),
]


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
    from .commands import Aim, run_scene

    overrule = {
        "method": method,
        "layers": layers,
        "occlusion": occlusion,
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
    from .commands import Aim, render_scenes

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
    from .commands import Aim, expose_scene

    overrule = {
        "method": method,
        "layers": layers,
        "occlusion": occlusion,
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
    from .commands import Aim, plan_scene

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
    left out in turn; table, CSV and chart. Interrupt it at any time: the same command goes on from there.

    Figures: psnr_db.CASE, predicted_db.CASE, seconds.CASE[.STAGE], predicted_seconds.CASE for each case
    target.N_dB, chosen, without.EFFECT and full; times_faster.chosen.
    """
    from .commands import cost_scene

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
    from .commands import restore_file

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
    from .commands import train_recipe

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
    from .commands import draw_masks, draw_psf

    (draw_masks(out, json) if masks else draw_psf(camera, out, json)).show()


@evaluate_app.command()
def mtf(camera: CameraOption = None, out: OutOption = None, json: JsonOption = None) -> None:
    """MTFs of clear, coded and cubic apertures, and of the camera's own mask (paper, Figs. 3 and 7)."""
    from .commands import evaluate_mtf

    evaluate_mtf(camera, out, json).show()


@evaluate_app.command()
def bandwidth(out: OutOption = None, json: JsonOption = None) -> None:
    """Bandwidth of the defocus chirp beside the paper's curve (paper, Fig. 6)."""
    from .commands import evaluate_bandwidth

    evaluate_bandwidth(out, json).show()


@evaluate_app.command()
def table(
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of photographs.")],
    systems: Annotated[
        list[str] | None,
        typer.Option(
            "--network", metavar="SYSTEM", help="Checkpoint or shipped camera; repeat it for several."
        ),
    ] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="Only so many photographs.")] = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Average PSNR at a random depth, and at 0.5, 0.8 and 1 m (paper, Table I).

    Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,1m} of the restored pictures, psnr_db.SYSTEM.photo.* alike.
    """
    from .commands import evaluate_table

    with console.progress("table", quiet=quiet) as progress:
        done = evaluate_table(data, systems, limit, seed, out, json, progress)
    done.show()


@evaluate_app.command()
def predictions(
    scenes: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENE...]", help="Shipped scenes; default all.")
    ] = None,
    small: Annotated[bool, typer.Option("--quick", help="The middle of each frame, few samples.")] = False,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> None:
    """Are plans right? Predicted and measured error and time, over scenes and three masks (clear, cubic,
    learned). Interrupt it at any time: the same command goes on from there.

    Figures: pairs, share.{error_within_3_db,targets_met,time_within_1.5}, worst_{optimism,pessimism}_db,
    worst_target_missed_db, times_faster.SCENE.MASK (the default choice against everything in full).
    """
    from .commands import evaluate_predictions

    with console.progress("predictions", quiet=quiet) as progress:
        done = evaluate_predictions(scenes or (), small, out, json, cache, progress)
    done.show()


@evaluate_app.command()
def occlusion(
    scenes: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENE...]", help="Default: desk, foliage, bench.")
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> None:
    """Ways to composite depth edges against pupils clipped ray by ray: 64 x 64 pixels a scene, a clear
    aperture, a cubic and a smooth random mask, focus in front of the edge, between its surfaces, and behind.

    Interrupt it at any time: scenes that are finished are kept in --out.

    Figures: psnr_db.SCENE.MASK.FOCUS.{none,over,normalised,hidden}, {near,far}_dpt.SCENE.
    """
    from .commands import evaluate_occlusion

    with console.progress("occlusion", quiet=quiet) as progress:
        done = evaluate_occlusion(scenes or (), out, json, cache, device.value, progress)
    done.show()


@evaluate_app.command()
def stability(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[CASE...]", help="Cases or groups of cases; default all.")
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """The catalogue of hard cases: error against a truth of every method, mask and precision.

    Figures: cases, findings, beyond_bound, failed, single_precision, seconds.
    """
    from .commands import evaluate_stability

    with console.progress("stability", quiet=quiet) as progress:
        done = evaluate_stability(names or (), out, json, progress)
    done.show()


@evaluate_app.command()
def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME...]", help="optics, render, expose, learn; default all."),
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Speed and memory: ratios measured in one run, with medians. Leave the machine alone meanwhile.

    `expose` keeps each piece that it has finished in --out; delete them there to measure anew.
    """
    from .commands import evaluate_bench

    with console.progress("bench", quiet=quiet) as progress:
        done = evaluate_bench(names or (), out, json, progress)
    done.show()


@cache_app.command("ls")
def cache_ls(cache: CacheOption = None, json: JsonOption = None) -> None:
    """Every entry with its scene, size and age."""
    from .commands import cache_list

    cache_list(cache, json).show()


@cache_app.command("verify")
def cache_verify(cache: CacheOption = None, json: JsonOption = None) -> None:
    """Check every entry against its checksum; damaged ones are set aside."""
    from .commands import cache_check

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
    from .commands import cache_clear

    cache_clear(cache, older_than_days, json).show()


@app.command()
def doctor(
    again: Annotated[bool, typer.Option("--again", help="Probe anew instead of remembering.")] = False,
    json: JsonOption = None,
) -> None:
    """Engines and devices found, which works, what to install for a faster one."""
    from .commands import examine_engines

    examine_engines(again, json).show()


@app.command()
def schema(
    kind: Annotated[RecipeKind, typer.Argument(help="Which recipe.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write it there instead of printing it.")
    ] = None,
) -> None:
    """JSON Schema of a recipe, for editors."""
    from .commands import recipe_schema

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
