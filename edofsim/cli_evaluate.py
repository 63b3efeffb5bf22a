"""`edofsim evaluate`: one short function an experiment, no logic."""

from __future__ import annotations

from typing import Annotated

import typer

from . import console
from .cli_options import (
    CacheOption,
    Device,
    DeviceOption,
    JsonOption,
    OutOption,
    QuietOption,
)

evaluate_app = typer.Typer(
    help="The paper's experiments and ours: each writes a page or pictures, a CSV and a JSON.",
    no_args_is_help=True,
)


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
    from .commands.experiments import evaluate_predictions

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
    aperture, a cubic and a smooth random mask, focus in front of the edge, between its surfaces, and behind;
    the clear aperture also against Mitsuba's thin lens, whose rays meet all surfaces.

    Interrupt it at any time: scenes that are finished are kept in --out.

    Figures: psnr_db.SCENE.MASK.FOCUS.{none,over,normalised,hidden,parts}, {near,far}_dpt.SCENE; MASK
    also `thin-lens`.
    """
    from .commands.experiments import evaluate_occlusion

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
    from .commands.experiments import evaluate_stability

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
    from .commands.experiments import evaluate_bench

    with console.progress("bench", quiet=quiet) as progress:
        done = evaluate_bench(names or (), out, json, progress)
    done.show()
