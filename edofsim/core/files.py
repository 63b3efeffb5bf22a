"""Files that are complete or absent: written under another name in the same folder, synced, and renamed."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from safetensors import SafetensorError

from ..errors import DiskFullError, EdofsimError, InputError

FULL = 1 << 20
"""A disk with less room than this is full, whatever the system says about a write that failed."""

FAULTY = {errno.EIO, errno.ESTALE}
"""What the disk is to blame for, and not the place that was named."""


@contextmanager
def whole(path: Path, *, advice: str = "choose another place") -> Generator[Path]:
    """A temporary path to write to. It takes the place of `path`, in one step, once all of it is on the disk.

    Whoever reads `path` finds all of the old bytes or all of the new; where writing fails or is interrupted,
    nothing is left behind. Missing folders are made. The temporary name ends in `.tmp`.

    Raises DiskFullError for a full disk, InputError for a place that cannot be written, and EdofsimError for
    a disk that fails.

    advice: what to do then, the end of the sentence.
    """
    final = Path(os.path.realpath(path))  # a link goes on pointing to its file
    temporary = final.with_name(f".{final.name[:200]}.{secrets.token_hex(4)}.tmp")
    try:
        if final.exists() and not final.is_file():
            raise InputError(f"{path}: cannot be written (it is no file); {advice}")
        final.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch()
        mode = temporary.stat().st_mode
        yield temporary
        temporary.chmod(stat.S_IMODE(mode))  # some writers make a file of their own, for its owner alone
        sync(temporary)
        os.replace(temporary, final)
    except (OSError, SafetensorError) as error:
        raise _refusal(path, error, advice) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> Path:
    """Write a file as `whole` does. Returns the path; raises what `whole` raises."""
    with whole(path) as temporary:
        temporary.write_bytes(data)
    return path


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 as `whole` does, line ends as they are. Returns the path; raises what `whole` raises."""
    return write_bytes(path, text.encode())


def append_line(path: Path, line: str) -> None:
    """Add a line to a file, on the disk before this returns; a line that was cut short stays alone.

    Raises what `whole` raises.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            if file.tell():
                file.seek(-1, os.SEEK_END)
                line = line if file.read(1) == b"\n" else f"\n{line}"
            file.write(f"{line}\n".encode())
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise _refusal(path, error, "choose another place") from error


def sync(path: Path) -> None:
    """Have the system write a file, or the names in a folder, to the disk now. Raises OSError."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _refusal(path: Path, error: OSError | SafetensorError, advice: str) -> EdofsimError:
    """What could not be written, why, and what to do."""
    number = getattr(error, "errno", None)
    reason = getattr(error, "strerror", None) or error
    if number in (errno.ENOSPC, errno.EDQUOT) or _room(path) < FULL:
        return DiskFullError(f"{path}: cannot be written, the disk is full; free some space, or {advice}")
    blamed = InputError if number is not None and number not in FAULTY else EdofsimError
    return blamed(f"{path}: cannot be written ({reason}); {advice}")


def _room(path: Path) -> int:
    """Free bytes of the disk that a path is on."""
    for folder in path.absolute().parents:
        try:
            return shutil.disk_usage(folder).free
        except OSError:
            continue
    return FULL
