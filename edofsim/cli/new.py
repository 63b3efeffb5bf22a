"""`edofsim new`."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from .shared import Done

if TYPE_CHECKING:
    from ..recipe.sources import DepthMap


class Kind(StrEnum):
    scene = "scene"
    camera = "camera"
    train = "train"
    dataset = "dataset"
    plugin = "plugin"


USE = {
    "scene": "edofsim look",
    "camera": "edofsim psf",
    "train": "edofsim train",
    "dataset": "edofsim dataset make --forecast",
}


class Holds(StrEnum):
    depth = "depth"
    inverse_depth = "inverse_depth"
    relative_inverse_depth = "relative_inverse_depth"
    disparity = "disparity"


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture with a depth map."""

    image: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Picture to use as the scene, with --depth.")
    ] = None
    depth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Depth map of the picture. Without --unit, whole numbers are millimetres and others metres.",
        ),
    ] = None
    key: Annotated[
        str | None, typer.Option(metavar="NAME", help="Array or channel of the depth map's file.")
    ] = None
    holds: Annotated[Holds, typer.Option(help="Unit or kind of the depth map's numbers.")] = Holds.depth
    unit: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR", help="Factor on the depth map's numbers, such as 0.001 for millimetres."
        ),
    ] = None
    offset: Annotated[float, typer.Option(metavar="NUMBER", help="Number added after the factor.")] = 0.0
    near: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Distance of the largest relative inverse depth, metres."),
    ] = None
    far: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Distance of the smallest relative inverse depth, metres."),
    ] = None
    focal_length_px: Annotated[
        float | None,
        typer.Option("--focal-px", metavar="PIXELS", help="Focal length in pixels, for disparities."),
    ] = None
    baseline_mm: Annotated[
        float | None,
        typer.Option(
            "--baseline-mm", metavar="MM", help="Distance between the two cameras, for disparities."
        ),
    ] = None
    resize: Annotated[
        bool, typer.Option("--resize", help="Enlarge a smaller depth map to the picture's size.")
    ] = False
    layer: Annotated[
        str | None, typer.Option("--layer", metavar="NAME", help="Layer of an OpenEXR picture.")
    ] = None

    def given(self) -> dict[str, object]:
        """Keys of the recipe's source."""
        found: dict[str, object] = {"key": self.key, "unit": self.unit, "offset": self.offset or None}
        found |= {"near_m": self.near, "far_m": self.far, "focal_length_px": self.focal_length_px}
        found |= {"baseline_mm": self.baseline_mm, "resize": self.resize or None, "holds": self.holds.value}
        return found


def new(
    kind: Annotated[Kind, typer.Argument(help="Kind of recipe, or a package of plug-ins.")],
    name: Annotated[
        Path, typer.Argument(metavar="NAME", help="NAME.toml is written; of a package, the folder NAME.")
    ],
    *,
    picture: PictureOptions,
) -> Done:
    """Write a commented recipe to start from, or a package with one of each kind of plug-in."""
    from ..recipe.new import check_name, new_plugin, new_recipe

    if kind is not Kind.plugin:
        check_name(name)
    lines: list[str] = []
    given = picture.given()
    image, depth = picture.image, picture.depth
    if image is None and depth is None:
        if picture.layer is not None or {k for k, v in given.items() if v is not None} != {"holds"}:
            raise InputError("these options are for a picture with a depth map: give --image and --depth")
        if kind is Kind.plugin:
            folder = new_plugin(name)
            return Done([f"its README.md says how to try it: {folder / 'README.md'}"], {"package": folder})
        path = new_recipe(kind.value, name)
    elif image is None or depth is None or kind is not Kind.scene:
        raise InputError("--image and --depth go together, and with `new scene`: a picture and its depth map")
    else:
        values, lines = _picture(image, depth, name.parent, picture.layer, given)
        path = new_recipe("picture", name, values)
    return Done([*lines, f"edit it, then: {USE[kind.value]} {path}"], {"recipe": path})


def _picture(
    image: Path, depth: Path, folder: Path, layer: str | None, given: dict[str, object]
) -> tuple[dict[str, str], list[str]]:
    """What a recipe of a picture with a depth map says of these files, and what to say of them. Raises
    InputError for files that cannot be read or do not fit each other."""
    import numpy as np

    from ..core.measurements import read_numbers
    from ..render.readers import depths
    from ..scene.depth_maps import usual_unit
    from ..scene.pictures import source_picture

    picture = source_picture(str(image), layer, Path())
    rows, columns = picture.linear.shape[:2]
    said = {name: value for name, value in given.items() if value is not None}
    if "unit" not in said:
        key = given["key"]
        stored = read_numbers(str(depth), key if isinstance(key, str) else None, Path(), "depth map")
        said["unit"] = usual_unit(stored) if said["holds"] == "depth" else 1.0
    source = _checked({"path": str(depth), **said})
    inverse, facts = depths(source, Path(), (rows, columns))
    with np.errstate(divide="ignore"):
        far, near = (1 / inverse.min(), 1 / inverse.max())
    lines = [
        f"picture: {'; '.join(picture.assumed)}",
        f"depths: {near:.4g} to {far:.4g} m ({facts['depths']}), {facts['holes']:.1%} holes",
    ]
    more = {name: value for name, value in said.items() if name not in ("holds", "unit")}
    values = {
        "WIDTH": str(columns),
        "HEIGHT": str(rows),
        "IMAGE": _quoted(image, folder) + ("" if layer is None else f"\nimage_layer = {json.dumps(layer)}"),
        "DEPTH": _quoted(depth, folder),
        "HOLDS": str(said["holds"]),
        "UNIT": str(said["unit"]),
        "MORE": "".join(f"{name} = {json.dumps(value)}\n" for name, value in more.items()),
    }
    return values, lines


def _quoted(path: Path, folder: Path) -> str:
    """A file relative to the recipe's folder, as TOML writes text: as JSON does."""
    return json.dumps(Path(os.path.relpath(path, folder)).as_posix(), ensure_ascii=False)


def _checked(table: dict[str, object]) -> DepthMap:
    """The depth map of these keys. Raises InputError, by the names of the options."""
    from pydantic import ValidationError

    from ..recipe.sources import DepthMap

    options = {"focal_length_px": "--focal-px", "baseline_mm": "--baseline-mm", "near_m": "--near"}
    options |= {"far_m": "--far"}
    try:
        return DepthMap.model_validate(table)
    except ValidationError as error:
        problems = []
        for each in error.errors():
            place = "--" + str(each["loc"][0]) if each["loc"] else ""
            text = f"{place} {each['msg'].removeprefix('Value error, ')}".strip()
            for key, option in options.items():
                text = text.replace(f"--{key}", option).replace(key, option)
            problems.append(text)
        raise InputError(problems) from None
