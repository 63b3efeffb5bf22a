"""`edofsim cache`."""

from __future__ import annotations

import time
from typing import Annotated

import typer
from rich.table import Table

from ..core.words import counted
from ..options import CacheOption, JsonOption
from .shared import Done, begun, finish

cache_app = typer.Typer(help="Rendered views that are kept: list, check, clear.", no_args_is_help=True)


@cache_app.command()
def ls(cache: CacheOption = None, json: JsonOption = None) -> Done:
    """List every entry with its scene, size and age."""
    with begun("cache ls", json, quiet=True):
        from ..render import cache as store

        folder = cache or store.default_folder()
        entries = store.ls(folder)
        table = Table("key", "scene", "MiB", "last used", box=None)
        for entry in entries:
            used = time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used))
            table.add_row(entry.key[:16], entry.scene, f"{entry.bytes / 2**20:.1f}", used)
        numbers = {"entries": len(entries), "size_mib": sum(entry.bytes for entry in entries) / 2**20}
        lines = [table, f"{counted(len(entries), 'view')}, {numbers['size_mib']:.1f} MiB"]
        return finish("cache ls", lines, numbers, {"cache": folder}, json)


@cache_app.command()
def verify(cache: CacheOption = None, json: JsonOption = None) -> Done:
    """Check all entries; set damaged ones aside."""
    with begun("cache verify", json, quiet=True):
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


@cache_app.command()
def prune(
    cache: CacheOption = None,
    older_than_days: Annotated[
        float,
        typer.Option(
            "--older-than-days", min=0, help="Remove entries that were not used for this many days."
        ),
    ] = 30.0,
    json: JsonOption = None,
) -> Done:
    """Remove old, damaged and unfinished entries."""
    with begun("cache prune", json, quiet=True):
        from ..render import cache as store

        folder = cache or store.default_folder()
        removed = store.prune(folder, older_than_days)
        numbers = {"removed": removed.files, "freed_mib": removed.bytes / 2**20}
        lines = [f"{counted(removed.files, 'file')} removed, {numbers['freed_mib']:.1f} MiB"]
        return finish("cache prune", lines, numbers, {"cache": folder}, json)
