"""`edofsim evaluate`: the paper's experiments, one short function each, no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import console
from .cli_evaluate import evaluate_app
from .cli_options import CacheOption, CameraOption, JsonOption, OutOption, QuietOption, SeedOption

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder of photographs; default: those of scikit-image."),
]
SystemsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--network",
        metavar="SYSTEM",
        help="Checkpoint or shipped camera, repeatable; default: all that ship, paper-clear, paper-cubic.",
    ),
]
ShowOption = Annotated[
    list[str] | None,
    typer.Option("--show", metavar="NAME", help="Photograph to show, repeatable; default: the first."),
]
NetworksOption = Annotated[
    list[str] | None,
    typer.Option(
        "--network",
        metavar="CHECKPOINT",
        help="Checkpoint or shipped name; the camera has its mask; repeatable; default: all that ship.",
    ),
]
SmallOption = Annotated[bool, typer.Option("--quick", help="Only the middle of each frame.")]
LimitOption = Annotated[int | None, typer.Option("--limit", min=1, help="Only so many photographs.")]


@evaluate_app.command()
def mtf(camera: CameraOption = None, out: OutOption = None, json: JsonOption = None) -> None:
    """MTFs of clear, coded and cubic apertures, and of the camera's own mask (paper, Figs. 3 and 7).

    Figures: mean_mtf.PANEL.CURVE up to the sensor's Nyquist frequency, least_mtf.PANEL up to half of it.
    """
    from .commands.paper import evaluate_mtf

    evaluate_mtf(camera, out, json).show()


@evaluate_app.command()
def bandwidth(out: OutOption = None, json: JsonOption = None) -> None:
    """Bandwidth of the defocus chirp beside the paper's curve (paper, Fig. 6).

    Figures: ratio_difference_percent.{psi_5_up,all}, psi_max, sampling_bound_um.
    """
    from .commands.paper import evaluate_bandwidth

    evaluate_bandwidth(out, json).show()


@evaluate_app.command()
def table(
    data: DataOption = None,
    systems: SystemsOption = None,
    chart: Annotated[
        Path | None,
        typer.Option("--chart", metavar="FILE", help="Picture of a test chart; default: USAF-1951, drawn."),
    ] = None,
    show: ShowOption = None,
    limit: LimitOption = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Average PSNR at a random depth, and at 0.5, 0.8 and 1 m; a test chart and two photographs (Table I).

    Interrupt it at any time: the same command goes on from there. A file that cannot be used is named and
    left out.

    Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,1m} of the restored pictures, psnr_db.SYSTEM.photo.* alike,
    psnr_db.SYSTEM.chart.{0.5m,0.8m,1m}, pictures, left_out.
    """
    from .commands.paper import evaluate_table

    with console.progress("table", quiet=quiet) as progress:
        done = evaluate_table(data, systems, chart, show, limit, seed, out, json, progress)
    done.show()


@evaluate_app.command()
def noise(
    data: DataOption = None,
    systems: SystemsOption = None,
    show: ShowOption = None,
    limit: LimitOption = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Read noise of 0.005, 0.009, 0.015 and 0.02 of full scale, objects at the green focus.

    Interrupt it at any time: the same command goes on from there. A file that cannot be used is named and
    left out.

    Figures: psnr_db.SYSTEM.SIGMA, psnr_db.SYSTEM.photo.SIGMA, loss_db.SYSTEM, pictures, left_out.
    """
    from .commands.paper import evaluate_noise

    with console.progress("noise", quiet=quiet) as progress:
        done = evaluate_noise(data, systems, show, limit, seed, out, json, progress)
    done.show()


@evaluate_app.command()
def fabrication(
    data: DataOption = None,
    systems: SystemsOption = None,
    show: ShowOption = None,
    limit: LimitOption = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Height errors of 20, 30, 40 and 50 nm, and the device that the paper made; objects at the green focus.

    Interrupt it at any time: the same command goes on from there. A file that cannot be used is named and
    left out.

    Figures: psnr_db.SYSTEM.{20nm,30nm,40nm,50nm,device}, psnr_db.SYSTEM.photo.*, loss_db.SYSTEM, pictures,
    left_out.
    """
    from .commands.paper import evaluate_fabrication

    with console.progress("fabrication", quiet=quiet) as progress:
        done = evaluate_fabrication(data, systems, show, limit, seed, out, json, progress)
    done.show()


@evaluate_app.command()
def broadband(
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            metavar="PATH",
            help="Spectral cube (folder with a picture a band, .mat, spectral .exr) or a folder of cubes.",
        ),
    ] = None,
    scenes: Annotated[
        list[str] | None,
        typer.Option("--scene", metavar="SCENE", help="Scene to render, as one plane; repeatable."),
    ] = None,
    bands: Annotated[
        str | None, typer.Option("--bands", metavar="LOW,HIGH", help="Only a cube's bands between these, nm.")
    ] = None,
    crop: Annotated[
        str | None, typer.Option("--crop", metavar="L,T,R,B", help="Pixels to cut off a cube's sides.")
    ] = None,
    start: Annotated[
        float | None,
        typer.Option("--start-nm", help="First band where a cube does not tell; CAVE is known."),
    ] = None,
    step: Annotated[float | None, typer.Option("--step-nm", help="Band to band, with --start-nm.")] = None,
    key: Annotated[str | None, typer.Option("--key", help="Array in a .mat file; dots lead inwards.")] = None,
    systems: SystemsOption = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> None:
    """Spectral cubes at 0.5 m, 1 m and infinity, restored by networks trained with three wavelengths.

    Bands of the sensor (420 to 720 nm) that a cube lacks are left out of photo and truth alike. Without
    --data and --scene: the shipped desk. Interrupt it at any time: the same command goes on from there.

    Figures: psnr_db.SYSTEM.CUBE.{0.5m,1m,infinity} with .red, .green, .blue; psnr_db.SYSTEM.CUBE.photo.*;
    psnr_db.SYSTEM.CUBE.three.* in three wavelengths, psnr_db.SYSTEM.CUBE.filter.* of a Wiener filter that
    knows distance and mask; left_out_percent.CUBE.COLOUR; cubes_left_out.
    """
    from .commands.paper import evaluate_broadband

    reading = {"key": key, "start_nm": start, "step_nm": step, "bands": bands, "crop": crop}
    chosen = scenes or ([] if data else ["desk"])
    with console.progress("broadband", quiet=quiet) as progress:
        done = evaluate_broadband(data or [], chosen, reading, systems, seed, out, json, cache, progress)
    done.show()


@evaluate_app.command()
def scene3d(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SCENE...]", help="Recipes or shipped names; default all shipped."),
    ] = None,
    networks: NetworksOption = None,
    camera: CameraOption = None,
    small: SmallOption = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> None:
    """Deep scenes through the lens alone and through learned masks, by the paper's protocol and by ours:
    scores whole, by depth and near depth edges, and what each way to simulate concludes (paper, Fig. 13).

    Interrupt it at any time: scenes that are finished are kept in --out. What cannot be read is named at the
    end, and the others are finished. Scenes are rendered with at least 512 samples a pixel, as the grain of
    the truth counts against every restoration.

    Figures, SCENE also `mean`: {psnr_db,ssim}.SCENE.WAY.{lens_alone,NETWORK,NETWORK.photo,NETWORK.wiener},
    gain_db.SCENE.WAY.NETWORK (above the lens alone), scenes, scenes.failed;
    WAY: paper, linear, none, over, normalised, hidden (ours).
    """
    from .commands.deep_scenes import evaluate_scene3d

    with console.progress("scene3d", quiet=quiet) as progress:
        done = evaluate_scene3d(scenes or (), networks or (), camera, small, seed, out, json, cache, progress)
    done.show()


@evaluate_app.command("bench-scene")
def bench_scene(
    networks: NetworksOption = None,
    camera: CameraOption = None,
    small: SmallOption = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> None:
    """The paper's bench, a bus at 0.5 m and a car at 1.3 m: lens alone, photo and restored, the mask as
    designed and as the paper's device was made (paper, Fig. 14). --quick leaves the made mask out.

    Figures: {psnr_db,ssim}.WAY.{lens_alone,NETWORK,NETWORK.photo,NETWORK.wiener}, each also with .bus and
    .car; NETWORK-made with the mask as made; WAY: paper, hidden (ours).
    """
    from .commands.deep_scenes import evaluate_bench_scene

    with console.progress("bench-scene", quiet=quiet) as progress:
        done = evaluate_bench_scene(networks or (), camera, small, seed, out, json, cache, progress)
    done.show()


@evaluate_app.command()
def index(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="Folder of experiments; default out."),
    ] = None,
) -> None:
    """One page of cards over all experiments in a folder."""
    from .commands.paper import evaluate_index

    evaluate_index(folder).show()


@evaluate_app.command()
def paper(
    photos: Annotated[
        Path | None,
        typer.Option(
            "--photos", metavar="DIR", help="Folder of photographs; default: those of scikit-image."
        ),
    ] = None,
    chart: Annotated[
        Path | None, typer.Option("--chart", metavar="FILE", help="Picture of a test chart; default: drawn.")
    ] = None,
    cubes: Annotated[
        Path | None, typer.Option("--cubes", metavar="PATH", help="Spectral cube, or a folder of them.")
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="The paper's sizes: all photographs, all systems.")
    ] = False,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="Only this experiment; repeatable.")
    ] = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> None:
    """All of the paper's experiments at a small size, and an index over their pages.

    Each has a folder in --out (default out/paper) with its page, CSV and JSON. Interrupt it at any time: the
    same command goes on from there.
    """
    from .commands.paper_all import Setting, evaluate_paper

    setting = Setting(out or Path("out") / "paper", photos, chart, cubes, full, seed, cache)
    with console.progress("paper", quiet=quiet) as progress:
        done = evaluate_paper(setting, only or (), progress)
    done.show()
