"""Finding a render engine that works on this machine, and switching Mitsuba to it.

Mitsuba runs on LLVM (any CPU) or CUDA with OptiX (NVIDIA cards). Both are shared libraries of the system,
and not every version works: LLVM 14 and older are refused by Dr.Jit, and LLVM 15 and 16 *abort the process*
in the middle of a render. So every candidate renders a tiny image in a child process before it is used.
The outcome is remembered by the library's path, size and modification time and by the versions of Mitsuba
and Dr.Jit, so that this costs time only once.
"""

from __future__ import annotations

import ctypes.util
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import TypedDict

from ..core.store import found, keep, user_folder
from ..errors import EngineError

LLVM_VARIANT = "llvm_ad_rgb"
CUDA_VARIANT = "cuda_ad_rgb"
INSTALL_COMMAND = "apt-get install libllvm19"
PROBE_SECONDS = 120

# Renders one small lit square through the same machinery as a real view (textures, a symbolic loop, a
# reduction): an LLVM that is too old loads and sets the variant without complaint and dies only here.
PROBE_PROGRAM = """
import sys
import mitsuba as mi
mi.set_variant(sys.argv[1])
import drjit as dr
scene = mi.load_dict({
    "type": "scene", "integrator": {"type": "path", "max_depth": 3},
    "shape": {"type": "rectangle", "bsdf": {"type": "roughplastic"}}, "light": {"type": "constant"},
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8},
               "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0])},
})
mean = dr.mean(mi.render(scene, spp=4), axis=None)
value = float(mean.array[0])
assert 0.01 < value < 10, f"the probe image has mean {value}"
if sys.argv[1].startswith("llvm"):
    print("LLVM", dr.detail.llvm_version())
"""


class Tried(TypedDict):
    """What came of a candidate, as it is remembered."""

    works: bool
    version: str
    reason: str


_TRYING = threading.Lock()
_tried: dict[str, Tried] = {}  # by this process; the file that remembers may not be writable


@dataclass(frozen=True)
class EngineProbe:
    """One candidate engine and what came of trying it.

    device: `cpu` or `cuda`.
    variant: Mitsuba's name for it.
    library: path of libLLVM, or `driver` for CUDA.
    version: of LLVM, as text.
    reason: why it does not work, empty if it does.
    """

    device: str
    variant: str
    library: str
    version: str
    works: bool
    reason: str = ""


def llvm_libraries() -> list[Path]:
    """Every libLLVM on this machine, newest first, each real file once.

    Looks at `DRJIT_LIBLLVM_PATH`, the dynamic linker's cache and the usual folders (Debian, Fedora, Homebrew,
    conda). A library that the user names comes first, whatever its version.
    """
    folders = [
        *_globbed(("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib"), ""),
        *_globbed(("/usr/lib",), "*-linux-gnu"),
        *_globbed(("/usr/lib", "/opt"), "llvm*/lib*"),
        *_globbed(("/usr/local/opt",), "llvm*/lib"),
        *_globbed((sys.prefix,), "lib"),
    ]
    found = [
        path
        for folder in folders
        for path in folder.glob("libLLVM*")
        if re.search(r"\.so|\.dylib", path.name)
    ]
    found += _linker_cache()
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    unique: dict[Path, Path] = {}
    for path in found:
        if path.is_file():
            unique.setdefault(path.resolve(), path)
    newest_first = sorted(unique, key=lambda path: (llvm_version(path), str(path)), reverse=True)
    if named and Path(named).is_file():
        chosen = Path(named).resolve()
        newest_first = [chosen, *(path for path in newest_first if path != chosen)]
    return newest_first


def llvm_version(path: Path) -> tuple[int, ...]:
    """The version in a library's file name, e.g. (19, 1); (0,) if it has none."""
    match = re.search(r"libLLVM-?(\d[\d.]*)?\.(?:so|dylib)(?:\.(\d[\d.]*))?", path.name)
    text = match and (match.group(1) or match.group(2))
    return tuple(int(part) for part in text.split(".") if part) if text else (0,)


def _globbed(roots: Iterable[str], pattern: str) -> list[Path]:
    out: list[Path] = []
    for root in map(Path, roots):
        if root.is_dir():
            out += [root] if not pattern else sorted(p for p in root.glob(pattern) if p.is_dir())
    return out


@cache
def _linker_cache() -> list[Path]:
    try:
        listing = subprocess.run(["ldconfig", "-p"], capture_output=True, text=True, timeout=20).stdout
    except (OSError, subprocess.TimeoutExpired):
        return []
    return [
        Path(line.split("=>")[1].strip())
        for line in listing.splitlines()
        if "libLLVM" in line and "=>" in line
    ]


def cuda_driver() -> str | None:
    """Name of the CUDA driver library, or None where there is no NVIDIA driver."""
    return _library("cuda")


@cache
def _library(name: str) -> str | None:
    return ctypes.util.find_library(name)


def find_engines(*, again: bool = False) -> tuple[EngineProbe, ...]:
    """Try every candidate and say which work, the best first: CUDA, then LLVM from the newest.

    Takes seconds a candidate the first time and reads the remembered outcome afterwards; `again` tries all of
    them once more. One thread at a time tries; others wait for what it finds.
    """
    with _TRYING:
        return _found_engines(again)


def _found_engines(again: bool) -> tuple[EngineProbe, ...]:
    if again:
        _linker_cache.cache_clear()
        _library.cache_clear()
    candidates: list[tuple[str, str, str]] = []
    driver = cuda_driver()
    if driver:
        candidates.append(("cuda", CUDA_VARIANT, driver))
    candidates += [("cpu", LLVM_VARIANT, str(path)) for path in llvm_libraries()]
    remembered = {} if again else _load_memory() | _tried
    keys = [_memory_key(variant, library) for _, variant, library in candidates]
    missing = [
        (key, variant, library)
        for key, (_, variant, library) in zip(keys, candidates, strict=True)
        if key not in remembered
    ]
    if missing:
        with ThreadPoolExecutor(max_workers=2) as pool:
            outcomes = list(pool.map(_try_engine, *zip(*(found[1:] for found in missing), strict=True)))
        _tried.update({key: outcome for (key, _, _), outcome in zip(missing, outcomes, strict=True)})
        remembered |= _tried
        _save_memory(remembered)
    return tuple(
        EngineProbe(
            device,
            variant,
            library,
            remembered[key]["version"] or _file_version(variant, library),
            remembered[key]["works"],
            remembered[key]["reason"],
        )
        for key, (device, variant, library) in zip(keys, candidates, strict=True)
    )


def _file_version(variant: str, library: str) -> str:
    return ".".join(map(str, llvm_version(Path(library)))) if variant == LLVM_VARIANT else ""


def _try_engine(variant: str, library: str) -> Tried:
    """Render the probe image in a child process: {"works", "version", "reason"}."""
    environment = dict(os.environ)
    if variant == LLVM_VARIANT:
        environment["DRJIT_LIBLLVM_PATH"] = library
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE_PROGRAM, variant],
            env=environment,
            timeout=PROBE_SECONDS,
            capture_output=True,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return {"works": False, "version": "", "reason": f"no image after {PROBE_SECONDS} s"}
    if done.returncode == 0:
        found = re.search(r"LLVM \(?([\d., ]+)\)?", done.stdout)
        return {"works": True, "version": found.group(1).replace(", ", ".") if found else "", "reason": ""}
    return {"works": False, "version": "", "reason": _reason(done.returncode, done.stderr)}


def _reason(status: int, stderr: str) -> str:
    """The one line of a failed probe's output that tells the user most."""
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    telling = [
        line
        for line in lines
        if re.search(
            r"LLVM ERROR|Cannot select|ImportError|Error:|too old|unsupported|"
            r"could not be|OptiX",
            line,
        )
    ]
    text = (telling or lines or ["no message"])[0][:200]
    return f"aborts the process: {text}" if status < 0 else text


def _memory_file() -> Path:
    return user_folder() / "engines.json"


def _memory_key(variant: str, library: str) -> str:
    """What the outcome of a probe depends on."""
    parts = [variant, library, version("mitsuba"), version("drjit")]
    path = Path(library)
    if path.is_file():
        stat = path.stat()
        parts += [str(stat.st_size), str(stat.st_mtime_ns)]
    return "|".join(parts)


def _load_memory() -> dict[str, Tried]:
    def read(path: Path) -> dict[str, Tried]:
        memory = json.loads(path.read_text(encoding="utf-8"))
        return {key: value for key, value in memory.items() if {"works", "version", "reason"} <= value.keys()}

    return found(_memory_file(), read) or {}


def _save_memory(memory: dict[str, Tried]) -> None:
    """Remember; a folder that cannot be written only costs the probes again next time."""
    keep(_memory_file(), lambda path: path.write_text(json.dumps(memory, indent=1), encoding="utf-8"))


def choose(probes: Sequence[EngineProbe], device: str = "auto") -> EngineProbe:
    """The first engine that works for `device` (`auto`, `cpu` or `cuda`).

    Raises EngineError, naming the command that installs one, if none does.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise EngineError(f"There is no render device {device!r}: use auto, cpu or cuda.")
    wanted = ("cpu", "cuda") if device == "auto" else (device,)
    for probe in probes:
        if probe.works and probe.device in wanted:
            return probe
    tried = "; ".join(f"{probe.library}: {probe.reason}" for probe in probes if probe.device in wanted)
    if device == "cuda":
        raise EngineError(
            "No usable CUDA engine: it needs an NVIDIA driver with OptiX "
            f"({tried or 'no CUDA driver was found'}). Use --device cpu."
        )
    raise EngineError(
        f"No usable render engine ({tried or 'no libLLVM was found'}). "
        f"Mitsuba needs LLVM 17 or newer; install one with: {INSTALL_COMMAND}"
    )


def hint(probes: Sequence[EngineProbe], chosen: EngineProbe) -> str:
    """A sentence on what is used and what would be faster."""
    if chosen.device == "cuda":
        return "Rendering runs on the GPU."
    failed = [probe for probe in probes if probe.device == "cuda"]
    if failed:
        return (
            f"Rendering runs on the CPU: CUDA does not work ({failed[0].reason}). For the GPU, install "
            "an NVIDIA driver that brings OptiX (libnvoptix.so.1)."
        )
    return "Rendering runs on the CPU. An NVIDIA card with its driver (CUDA and OptiX) would be faster."


_threads: int | None = None


def set_threads(count: int | None) -> None:
    """Render with this many threads in this process; None for as many as it may use."""
    global _threads
    _threads = count


def thread_count() -> int:
    """Threads to render with: what was set, or the processors that this process may use (not those of the
    machine: batch systems give fewer)."""
    if _threads is not None:
        return _threads
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


@contextmanager
def reading_files() -> Generator[None]:
    """Let Mitsuba read a scene's files with two threads at least: a pool of one waits for itself, for ever,
    where it reads an OpenEXR picture (Mitsuba 3.9)."""
    import drjit

    before = drjit.thread_count()
    drjit.set_thread_count(max(2, before))
    try:
        yield
    finally:
        drjit.set_thread_count(before)


def use_engine(device: str = "auto", *, colours: str = "rgb") -> ModuleType:
    """Switch Mitsuba to the chosen engine and return the module.

    colours: `rgb`, or `spectral` for what the many-band integrator cannot carry. Only the ad variants of both
        engines exist in Mitsuba's wheels.

    Raises EngineError if no engine works.
    """
    probe = choose(find_engines(), device)
    if probe.device == "cpu":
        # Read by Dr.Jit when the first LLVM variant is set; later changes have no effect.
        os.environ["DRJIT_LIBLLVM_PATH"] = probe.library
    import drjit
    import mitsuba

    wanted = probe.variant.replace("rgb", colours)
    if mitsuba.variant() != wanted:
        mitsuba.set_variant(wanted)
    if probe.device == "cpu":
        drjit.set_thread_count(thread_count())
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba
