"""A mask's height map as files for a maskless lithography tool.

The map is upsampled to the pitch of the tool by bicubic interpolation, as Akpinar et al. do, but for wraps,
which stay steps; and rounded to its grey levels. Theirs writes squares of 3 um in 98 levels of a depth of
1.2 um.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core.files import whole, write_bytes, write_text
from ..core.images import png_bytes
from ..errors import InputError
from ..optics import Camera
from ..optics.fabrication import make
from ..optics.grid import PupilGrid
from ..optics.height import natural_samples, surface
from ..recipe.fabrication import Fabrication
from ..record import write_csv
from ..restore.checkpoint import Checkpoint, camera_with_mask, trained_camera

PITCH_UM = 3.0
LEVELS = 98
LIMIT_UM = 1.2


@dataclass(frozen=True)
class Device:
    """What a tool writes: levels uint16 [n, n], row 0 the pupil's top, seen from the sensor; metres."""

    levels: np.ndarray
    pitch: float
    level_height: float


def device(
    checkpoint: Checkpoint | Camera,
    *,
    pitch_um: float = PITCH_UM,
    levels: int = LEVELS,
    limit_um: float = LIMIT_UM,
    wrap_nm: float | None = None,
) -> Device:
    """The made height map of a camera's mask, or of a checkpoint's, without the errors of making it. Samples
    outside the pupil's square bounds do not occur; those in its corners are written like the rest.

    wrap_nm: wavelength [nm] by whose whole waves a height map deeper than the limit is wrapped.

    Raises InputError for a mask without a height map, and one deeper than the limit.
    """
    if isinstance(checkpoint, Checkpoint):
        if checkpoint.height is None:
            raise InputError(f"{checkpoint.name}: this checkpoint's mask has no height map to be made")
        camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
        camera = camera.with_height(checkpoint.height.double())
    else:
        camera = replace(checkpoint, recipe=checkpoint.recipe.model_copy(update={"fabrication": None}))
    grid = PupilGrid(natural_samples(camera, pitch_um * 1e-6), pitch_um * 1e-6, camera.aperture_radius)
    fabrication = Fabrication(
        pitch_um=pitch_um, height_limit_um=limit_um, levels=levels, wrap_wavelength_nm=wrap_nm
    )
    upsampled = surface(camera, grid)
    if upsampled is None:
        raise InputError(f"{camera.recipe.name}: its mask ({camera.mask.kind}) has no height map to be made")
    height = make(upsampled.detach(), fabrication, camera.mask_material, 0)
    level_height = limit_um * 1e-6 / (levels - 1)
    return Device((height / level_height).round().numpy().astype(np.uint16), grid.pitch, level_height)


def write_device(made: Device, folder: Path, name: str, *, gds: bool = False) -> tuple[Path, ...]:
    """NAME.png (16 bits, grey = level x a whole factor that the file states), NAME-levels.csv (a row of
    levels a line), NAME-heights.csv (level, height), and with `gds` NAME.gds (a layer for each level).

    Raises what `core.files.whole` raises, and InputError where GDS is asked for without gdstk.
    """
    factor = 65535 // max(1, int(made.levels.max()))
    about = {
        "pitch_um": made.pitch * 1e6,
        "level_nm": made.level_height * 1e9,
        "grey_per_level": factor,
        "orientation": "row 0 is the top of the pupil, column 0 its left, seen from the sensor",
    }
    paths = [folder / f"{name}.png", folder / f"{name}-levels.csv", folder / f"{name}-heights.csv"]
    write_bytes(paths[0], png_bytes(made.levels * np.uint16(factor), {"edofsim": json.dumps(about)}))
    lines = "\n".join(",".join(map(str, row)) for row in made.levels.tolist()) + "\n"
    write_text(paths[1], lines)
    heights = (f"{level * made.level_height * 1e9:.3f}" for level in range(int(made.levels.max()) + 1))
    write_csv(paths[2], ("level", "height_nm"), enumerate(heights))
    if gds:
        paths.append(_gds(made, folder / f"{name}.gds"))
    return tuple(paths)


def rectangles(levels: np.ndarray) -> np.ndarray:
    """Rows of equal level as rectangles, those of equal extent in neighbouring rows joined: int
    [rectangle, 5], (level, first row, end row, first column, end column), covering every sample once.

    levels: [y, x], integers.
    """
    found: list[tuple[int, int, int, int, int]] = []
    open_runs: dict[tuple[int, int, int], int] = {}
    for row, line in enumerate(levels):
        starts = np.flatnonzero(np.diff(line, prepend=-1 - int(line[0])))
        ends = np.append(starts[1:], len(line))
        runs = {(int(line[a]), int(a), int(b)) for a, b in zip(starts, ends, strict=True)}
        for run in [run for run in open_runs if run not in runs]:
            level, a, b = run
            found.append((level, open_runs.pop(run), row, a, b))
        for run in runs:
            open_runs.setdefault(run, row)
    found += [(level, first, len(levels), a, b) for (level, a, b), first in open_runs.items()]
    return np.array(sorted(found))


def _gds(made: Device, path: Path) -> Path:
    try:
        import gdstk
    except ImportError:
        raise InputError("a GDS file needs gdstk: pip install 'edofsim[gds]'") from None
    library = gdstk.Library(unit=1e-6, precision=1e-9)
    cell = library.new_cell("DOE")
    step, half = made.pitch * 1e6, made.levels.shape[0] / 2
    for level, top, bottom, left, right in rectangles(made.levels).tolist():
        if level:  # level 0 is the bare substrate
            corners = (
                ((left - half) * step, (half - top) * step),
                ((right - half) * step, (half - bottom) * step),
            )
            cell.add(gdstk.rectangle(*corners, layer=level))
    with whole(path) as temporary:
        library.write_gds(temporary)
    return path
