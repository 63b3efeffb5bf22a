"""`psf`, `cache`, `doctor`, `schema`."""

from __future__ import annotations

import json as json_text
import time
from pathlib import Path

from rich.table import Table

from .. import console
from ..recipe import load_camera
from ..record import writable_folder
from .base import Done, experiment, finish


def draw_psf(camera: str, out: Path | None, json: Path | None) -> Done:
    """`edofsim psf`."""
    loaded = load_camera(camera)
    from ..experiments import psf_figure
    from ..optics import Camera

    folder = writable_folder(out or Path("out") / f"psf-{loaded.recipe.name}")
    numbers = psf_figure.run(Camera.from_recipe(loaded.recipe, loaded.base), folder)
    return experiment("psf", numbers, folder, json, {"camera": camera})


def draw_masks(out: Path | None, json: Path | None) -> Done:
    """`edofsim psf --masks`."""
    from ..experiments import psf_figure

    folder = writable_folder(out or Path("out") / "masks")
    picture = psf_figure.gallery(folder)
    return finish("psf --masks", [], {}, {"masks": picture}, json)


def cache_list(cache: Path | None, json: Path | None) -> Done:
    """`edofsim cache ls`."""
    from ..render import cache as store

    folder = cache or store.default_folder()
    entries = store.ls(folder)
    table = Table("key", "scene", "MiB", "last used", box=None)
    for entry in entries:
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used))
        table.add_row(entry.key[:16], entry.scene, f"{entry.bytes / 2**20:.1f}", used)
    numbers = {"entries": len(entries), "size_mib": sum(entry.bytes for entry in entries) / 2**20}
    lines = [table, f"{len(entries)} views, {numbers['size_mib']:.1f} MiB"]
    return finish("cache ls", lines, numbers, {"cache": folder}, json)


def cache_check(cache: Path | None, json: Path | None) -> Done:
    """`edofsim cache verify`."""
    from ..render import cache as store

    folder = cache or store.default_folder()
    checked = store.verify(folder)
    lines = [
        f"{path.name}: damaged, set aside; it is rendered again when it is asked for"
        for path in checked.damaged
    ]
    lines.append(f"{checked.good} views are as they were written, {len(checked.damaged)} were damaged")
    numbers = {"good": checked.good, "damaged": len(checked.damaged)}
    return finish("cache verify", lines, numbers, {"cache": folder}, json)


def cache_clear(cache: Path | None, older_than_days: float, json: Path | None) -> Done:
    """`edofsim cache prune`."""
    from ..render import cache as store

    folder = cache or store.default_folder()
    removed = store.prune(folder, older_than_days)
    numbers = {"removed": removed.files, "freed_mib": removed.bytes / 2**20}
    return finish(
        "cache prune",
        [f"{removed.files} files removed, {numbers['freed_mib']:.1f} MiB"],
        numbers,
        {"cache": folder},
        json,
    )


def examine_engines(again: bool, json: Path | None) -> Done:
    """`edofsim doctor`."""
    from ..render import engine

    probes = engine.find_engines(again=again)
    chosen = engine.choose(probes)  # raises EngineError with the command to type
    table = Table("engine", "version", "library", "works", "used", box=None)
    for probe in probes:
        works = "yes" if probe.works else f"no: {probe.reason}"
        table.add_row(probe.variant, probe.version, probe.library, works, "*" if probe == chosen else "")
    numbers = {"engines.found": len(probes), "engines.working": sum(probe.works for probe in probes)}
    return finish("doctor", [table, engine.hint(probes, chosen)], numbers, {}, json)


def recipe_schema(kind: str, out: Path | None) -> None:
    """`edofsim schema`."""
    from ..recipe.schema import json_schema, model_of, write_schema

    model = model_of(kind)
    if out is None:
        console.out.print(
            json_text.dumps(json_schema(model, f"edofsim {kind} recipe"), indent=1, sort_keys=True),
            markup=False,
        )
    else:
        writable_folder(out.parent)
        console.show_outputs({"schema": write_schema(model, f"edofsim {kind} recipe", out)})
