"""`evaluate scene3d` and `evaluate bench-scene`: deep scenes by the paper's protocol and by ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.table import Table

from ..errors import InputError
from ..recipe import Loaded, SceneRecipe, load_scene
from ..recipe.load import shipped, shipped_folder
from ..record import writable_folder
from .base import Done, Progress, finish


def evaluate_scene3d(
    scenes: Sequence[str],
    networks: Sequence[str],
    camera: str | None,
    quick: bool,
    seed: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate scene3d`."""
    loaded, broken = _readable(scenes or list(shipped(shipped_folder("scenes"))))
    if broken and not loaded:
        raise InputError([text for texts in broken.values() for text in texts])
    from ..experiments import scene3d
    from ..report import Link
    from ..report.scene3d_page import card, overview_page, scene_page, strip, write_page
    from ..restore.checkpoint import load_checkpoint, shipped_checkpoints

    names = _names(networks or shipped_checkpoints(), load_checkpoint)
    folder = writable_folder(out or Path("out") / ("scene3d-quick" if quick else "scene3d"))
    each = writable_folder(folder / "scenes")
    index = folder / "scene3d.html"

    def show(measured: scene3d.Measured, seen: scene3d.Seen) -> None:
        for system in seen.systems[1:]:
            page = scene_page(measured, seen, system, Link(f"../{index.name}", "Deep scenes"))
            write_page(each / _page_name(measured.scene, system.name), page)
        first = seen.systems[1].name
        ours = seen.taken[scene3d.OURS, first]
        alone = seen.taken[scene3d.OURS, scene3d.LENS_ALONE]
        shown = strip(ours.truth, alone, ours.images["restored"], measured.scene)
        (each / f"{measured.scene}.png").write_bytes(shown.png)

    outcome = scene3d.run(
        each,
        loaded,
        networks=list(names),
        camera=camera,
        quick=quick,
        seed=seed,
        cache=cache,
        show=show,
        progress=progress,
    )
    outcome = replace(outcome, failed={**broken, **outcome.failed})
    known = list(names.values())
    links = [
        card(
            m,
            name,
            f"scenes/{_page_name(m.scene, name)}",
            _title(m.scene, name, known),
            each / f"{m.scene}.png",
        )
        for m in outcome.measured
        for name in known
    ]
    numbers = scene3d.figures(outcome, known)
    outputs = {"scores": scene3d.write_table(folder / "scene3d.csv", outcome)}
    outputs["page"] = write_page(index, overview_page(outcome, known, links))
    printed = [table for name in known for table in (_scene_table(outcome, name), _way_table(outcome, name))]
    lows = {name: scene3d.worst(outcome, name) for name in known}
    printed += [
        f"worst of {name}: {low.scene}, {low.score(scene3d.OURS, name, 'restored').psnr_db:.2f} dB"
        for name, low in lows.items()
        if low is not None
    ]
    done = finish(
        "evaluate scene3d",
        printed,
        numbers,
        outputs,
        json or folder / "scene3d.json",
        seed=seed,
        inputs={"scenes": [m.scene for m in outcome.measured], "networks": list(names), "camera": camera},
        worst={name: None if low is None else low.scene for name, low in lows.items()},
        failed=dict(outcome.failed),
    )
    return replace(done, problems=[text for texts in outcome.failed.values() for text in texts])


def evaluate_bench_scene(
    networks: Sequence[str],
    camera: str | None,
    quick: bool,
    seed: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate bench-scene`."""
    from ..experiments import bench_scene, scene3d
    from ..report import save_srgb
    from ..report.bench_scene_page import bench_scene_page, write_page
    from ..restore.checkpoint import load_checkpoint, shipped_checkpoints

    names = _names(networks or shipped_checkpoints(), load_checkpoint)
    folder = writable_folder(out or Path("out") / ("bench-scene-quick" if quick else "bench-scene"))
    kept = writable_folder(folder / "scenes")
    known = list(names.values())
    pages = {name: _named("bench-scene", name, known) for name in known}

    def show(measured: scene3d.Measured, seen: scene3d.Seen, parts: Mapping[str, Any]) -> None:
        for system in seen.systems:
            ours = seen.taken[scene3d.OURS, system.name]
            for image, values in ours.images.items():
                save_srgb(kept / f"{system.name}-{image}.png", values)
            if system.name in pages:
                page = bench_scene_page(measured, seen, system, parts)
                write_page(folder / f"{pages[system.name]}.html", page)
        save_srgb(kept / "ideal.png", ours.truth)

    measured = bench_scene.run(
        kept,
        networks=list(names),
        camera=camera,
        quick=quick,
        seed=seed,
        cache=cache,
        show=show,
        progress=progress,
    )
    table = Table("image", *(f"{r} / dB" for r in (scene3d.WHOLE, *bench_scene.OBJECTS)), box=None)
    for row in measured.rows:
        if row.way == scene3d.OURS and row.region == scene3d.WHOLE:
            found = [measured.score(row.way, row.system, row.image, part) for part in bench_scene.OBJECTS]
            cells = (f"{each.psnr_db:.2f}" if each else "" for each in (row, *found))
            table.add_row(f"{row.system}, {row.image}", *cells)
    outcome = scene3d.Outcome((measured,))
    outputs = {"scores": scene3d.write_table(folder / "bench-scene.csv", outcome), "pictures": kept}
    outputs |= {f"page of {name}": folder / f"{page}.html" for name, page in pages.items()}
    return finish(
        "evaluate bench-scene",
        [table],
        bench_scene.figures(measured),
        outputs,
        json or folder / "bench-scene.json",
        seed=seed,
        inputs={"networks": list(names), "camera": camera},
    )


def _named(name: str, network: str, networks: Sequence[str]) -> str:
    return name if len(networks) == 1 else f"{name}-{network}"


def _readable(
    scenes: Sequence[str],
) -> tuple[list[Loaded[SceneRecipe]], dict[str, tuple[str, ...]]]:
    """The recipes that can be read, and what is wrong with the others, by what was typed."""
    loaded: list[Loaded[SceneRecipe]] = []
    broken: dict[str, tuple[str, ...]] = {}
    for scene in scenes:
        try:
            recipe = load_scene(scene)
        except InputError as error:
            broken[str(scene)] = error.problems
            continue
        twin = next((other for other in loaded if other.recipe.name == recipe.recipe.name), None)
        if twin is None:
            loaded.append(recipe)
        elif twin.path.resolve() != recipe.path.resolve():
            problem = (
                f"{scene}: its name is {recipe.recipe.name!r}, as that of {twin.path}; rename one of them"
            )
            broken[str(scene)] = (problem,)
    return loaded, broken


def _names(networks: Sequence[str], load: Any) -> Mapping[str, str]:
    """Names of the systems by what was typed. Raises InputError for a checkpoint that cannot be used, and for
    two of one name."""
    names = {source: load(source).name for source in dict.fromkeys(networks)}
    if len(set(names.values())) < len(names):
        raise InputError(f"{', '.join(names)}: two of these checkpoints have the same name; give one of them")
    return names


def _page_name(scene: str, network: str) -> str:
    return f"{scene}-{network}.html"


def _title(scene: str, network: str, networks: Sequence[str]) -> str:
    return scene if len(networks) == 1 else f"{scene}, {network}"


def _scene_table(outcome: Any, network: str) -> Table:
    from ..experiments.scene3d import LENS_ALONE, OURS, PAPER, mean

    columns = ("lens alone", "photo", "Wiener", network, "gain", "lens alone, paper's", f"{network}, paper's")
    table = Table("scene", *(f"{name} / dB" for name in columns), box=None)
    places = [(OURS, LENS_ALONE, "photo"), (OURS, network, "photo"), (OURS, network, "wiener")]
    places += [(OURS, network, "restored"), None]
    places += [(PAPER, LENS_ALONE, "photo"), (PAPER, network, "restored")]
    lines = {
        m.scene: [m.gain(OURS, network) if place is None else m.score(*place).psnr_db for place in places]
        for m in outcome.measured
    }
    if lines:
        lines["mean"] = [mean(column) for column in zip(*lines.values(), strict=True)]
    for name, values in lines.items():
        table.add_row(name, *(f"{value:.2f}" for value in values))
    return table


def _way_table(outcome: Any, network: str) -> Table:
    from ..experiments.scene3d import LENS_ALONE, NEAR_EDGES, OURS, WAYS, mean

    columns = ("lens alone", network, "gain", "gain near edges", "gain minus ours")
    table = Table("photos simulated by", *(f"{name} / dB" for name in columns), box=None)
    every = outcome.measured
    for way in WAYS:
        values = [
            mean(m.score(way.name, LENS_ALONE, "photo").psnr_db for m in every),
            mean(m.score(way.name, network, "restored").psnr_db for m in every),
            mean(m.gain(way.name, network) for m in every),
            mean(m.gain(way.name, network, NEAR_EDGES) for m in every),
            mean(m.gain(way.name, network) - m.gain(OURS, network) for m in every),
        ]
        table.add_row(way.title, *(f"{value:.2f}" for value in values))
    return table
