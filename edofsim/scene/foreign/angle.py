"""The angle that a Mitsuba scene's own sensor sees."""

from __future__ import annotations

import math
from pathlib import Path

from ...errors import InputError
from . import MitsubaSource
from .read import read_nodes


def pixel_angle(source: MitsubaSource, base: Path, width: int, height: int) -> float | None:
    """Tangent of the angle that a pixel sees where a frame of width x height pixels shows what the file's
    sensor shows; None where the file has no sensor with a field of view that can be read."""
    try:
        sensors = read_nodes(Path(base) / source.path).of_kind("sensor")
        values = sensors[0].values if sensors else {}
        fov = float(values["fov"])
    except (InputError, KeyError, ValueError, TypeError):
        return None
    if not 0 < fov < 180:
        return None
    sides = {"x": width, "y": height, "diagonal": math.hypot(width, height)}
    sides |= {"smaller": min(width, height), "larger": max(width, height)}
    side = sides.get(str(values.get("fov_axis", "x")))
    return None if side is None else 2 * math.tan(math.radians(fov) / 2) / side
