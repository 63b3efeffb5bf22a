"""Lenses of optiland, .json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from ....core.json_values import Json
from ....errors import InputError, first_line
from .rows import LensFile, Row

POWERS = {"Plane": (0, 0), "StandardGeometry": (0, 0), "EvenAsphere": (2, 2), "OddAsphere": (1, 1)}
"""By class of a surface: power of r of the first factor, and from one to the next."""
OPENINGS = {"EPD": "diameter", "imageFNO": "f-number", "float_by_stop_size": "stop"}


def read(text: str, name: str) -> LensFile:
    """Raises InputError for what is not traced, or is no such file."""
    try:
        data = json.loads(text)
        opening = data["aperture"]
        rows = data["surface_group"]["surfaces"]
        found = LensFile(title=data.get("name") or "")
        found.opening = (OPENINGS[opening["type"]], float(opening["value"]))
        found.rows = [_row(each, f"{name}, surface {place}") for place, each in enumerate(rows)]
        places = [float(each["geometry"]["cs"]["z"]) for each in rows]
    except InputError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name} is no lens of optiland: {first_line(error)}") from None
    for row, here, after in zip(found.rows[:-1], places[:-1], places[1:], strict=True):
        row.thickness = after - here
    if any(each.get("vx") or each.get("vy") for each in data.get("fields", {}).get("fields", [])):
        found.notes.append("vignetting factors are left out: clear radii shut the pupil, where there are any")
    return found


def _row(surface: Mapping[str, Json], where: str) -> Row:
    geometry, glass = surface["geometry"], surface.get("material_post") or {}
    kind, place = geometry["type"], geometry["cs"]
    if kind not in POWERS:
        raise InputError(f"{where}: surfaces of type {kind} are not traced; {', '.join(POWERS)} are")
    if any(place.get(key) for key in ("x", "y", "rx", "ry", "rz")):
        raise InputError(f"{where}: it is tilted or decentred, which is not traced")
    how = surface.get("interaction_model") or {}
    if (
        how.get("is_reflective")
        or how.get("type", "RefractiveReflectiveModel") != "RefractiveReflectiveModel"
    ):
        raise InputError(f"{where}: mirrors, thin lenses and gratings are not traced ({how.get('type')})")
    radius = float(geometry.get("radius", math.inf))
    row = Row(curvature=1 / radius if radius else 0.0, conic=float(geometry.get("conic") or 0.0))
    first, step = POWERS[kind]
    for number, factor in enumerate(geometry.get("coefficients") or [] if first else []):
        row.asphere(first + step * number, float(factor))
    row.stop = bool(surface.get("is_stop"))
    rim = surface.get("aperture")
    if rim:
        if "r_max" not in rim or rim.get("r_min"):
            raise InputError(f"{where}: openings that are not round about the axis are not traced")
        row.clear = float(rim["r_max"])
    if glass.get("type") == "Material":
        row.glass = str(glass["name"])
    elif glass.get("type") == "AbbeMaterial":
        row.glass, row.index = "model", (float(glass["index"]), float(glass["abbe"]))
    elif float(glass.get("index", 1.0)) != 1.0:
        raise InputError(f"{where}: glass of type {glass.get('type')} has no dispersion; give it nd and Vd")
    return row
