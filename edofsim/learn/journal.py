"""What a training leaves behind while it runs: a JSON-lines log and pictures."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType

import torch
from torch import Tensor

from ..core.files import write_text
from ..core.images import write_png
from ..errors import EdofsimError


class Journal:
    """log.jsonl and pictures/ in a training's folder; `step` is the first step that is written anew."""

    def __init__(self, folder: Path, step: int) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _drop_from(folder / "log.jsonl", step)
            self._file = (folder / "log.jsonl").open("a", encoding="utf-8")
        except OSError as error:
            problem = f"{folder}: cannot be written ({error.strerror}); choose another --out"
            raise EdofsimError(problem) from None

    def write(self, **entry: float) -> None:
        """One line of the log: flat, JSON values."""
        try:
            self._file.write(json.dumps(entry) + "\n")
            self._file.flush()
        except OSError as error:
            raise EdofsimError(f"{self.folder}: the log cannot be written ({error.strerror})") from None

    def before(self) -> dict[str, float]:
        """PSNR of the validation before the first step, as psnr_db.start[.SOURCE]; nothing where a training
        starts from no weights."""
        with (self.folder / "log.jsonl").open(encoding="utf-8") as log:
            first = json.loads(log.readline() or "{}")
        known = first.items() if first.get("step") == 0 else ()
        said = ((*name.partition("psnr_db.validation"), value) for name, value in known)
        return {f"psnr_db.start{of}": value for _, stem, of, value in said if stem and of != "_photo"}

    def picture(self, step: int, rows: list[list[Tensor]], height: Tensor | None) -> Path:
        """Images of one size side by side (8-bit values are intensities), and the height map, dark is low.

        rows: of images [3, y, x] in [0, 1].
        height: [n, n], metres; None for none.
        """
        grid = torch.cat([torch.cat([image.cpu() for image in row], dim=-1) for row in rows], dim=-2)
        path = self.folder / "pictures" / f"{step:07d}.png"
        write_png(path, grid.detach())
        if height is not None:
            picture = stretched(height)[None].expand(3, -1, -1)
            write_png(self.folder / "pictures" / f"{step:07d}-height.png", picture.detach().cpu())
        return path

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def stretched(values: Tensor) -> Tensor:
    """Values stretched over [0, 1]; a flat map becomes 0.

    values: any shape [...].
    """
    low, high = values.min(), values.max()
    return (values - low) / (high - low).clamp_min(torch.finfo(values.dtype).tiny)


def _drop_from(path: Path, step: int) -> None:
    """Lines of steps that will be done again, after an interruption past the last saved state."""
    if not path.exists():
        return
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if _step_of(line) <= step]
    write_text(path, "".join(line + "\n" for line in lines if step > 0))


def _step_of(line: str) -> float:
    try:
        return float(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError):
        return float("inf")  # a line cut short by a crash
