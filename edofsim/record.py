"""What a command leaves for machines to read: figures, versions, the machine, inputs and outputs."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import platform
import resource
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from . import __version__
from .core.files import write_text
from .core.json_values import Json
from .errors import InputError

PACKAGES = ("mitsuba", "drjit", "torch", "numpy", "OpenEXR", "colour-science", "trimesh", "scikit-image")


def versions() -> dict[str, str]:
    """Versions of edofsim, Python and the packages that decide its figures."""
    found = {"edofsim": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, str | float | None]:
    """Processor, cores that this process may use, memory in GiB, operating system."""
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "memory_gib": round(pages / 2**30, 1),
        "system": platform.platform(),
    }


def commit_of(folder: Path) -> str:
    """The commit of a checkout that the folder, or the one that holds it, is the root of, with `-dirty` where
    files differ from it; `unknown` for others, and without git."""
    if not any((root / ".git").exists() for root in (folder, folder.parent)):
        return "unknown"
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--match="]
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return said.stdout.strip()


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def peak_memory_mib() -> float:
    """Largest resident memory of this process so far, in MiB."""
    try:
        # Linux' getrusage would count what the process that started this one held then
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 2**10
    except OSError:
        pass
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def processor_seconds() -> float:
    """Of all cores so far, by this process and by those that it started and that have ended."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def record(
    command: str,
    *,
    figures: Mapping[str, float],
    seed: int | None = None,
    inputs: Mapping[str, object] | None = None,
    outputs: Mapping[str, object] | None = None,
    **more: object,
) -> Json:
    """The object that `--json` writes. `figures` is flat: a dotted name that ends in its unit or says it."""
    return {
        "command": command,
        "typed": shlex.join(["edofsim", *sys.argv[1:]]),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "commit": commit_of(Path(__file__).parent),
        "versions": versions(),
        "machine": machine(),
        "seed": seed,
        "inputs": dict(inputs or {}),
        "figures": {name: _plain(value) for name, value in figures.items()},
        "outputs": {name: str(value) for name, value in (outputs or {}).items()},
        **more,
    }


def write_record(path: Path, content: Mapping[str, object]) -> Path:
    """Write it as JSON. Returns the path; raises what `core.files.whole` raises."""
    return write_text(path, json.dumps(content, indent=1, allow_nan=False, default=str) + "\n")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write rows as CSV; numbers with six significant digits. Returns the path; raises as `write_record`."""
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(header)
    writer.writerows([f"{value:.6g}" if isinstance(value, float) else value for value in row] for row in rows)
    return write_text(path, table.getvalue())


def _plain(value: float) -> float | int | str:
    """JSON has no infinity: a PSNR of equal images is written as the string `inf`."""
    number = value if isinstance(value, int) else float(value)
    return number if math.isfinite(number) else str(number)


def writable_folder(path: Path, option: str = "--out") -> Path:
    """`path`, made if need be. Raises InputError, naming the option, where nothing can be written in it."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / f".edofsim-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"the folder {path} cannot be written ({reason}); name another one with {option}"
        ) from None
    return path


def writable_file(path: Path) -> Path:
    """`path`, whose folder is made if need be. Raises InputError where no such file can be written."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file with --json")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{path}: cannot be written ({reason}); name another file with --json") from None
    return path
