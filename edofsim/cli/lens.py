"""`edofsim lens`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.files import write_text
from ..errors import InputError
from ..options import JsonOption
from .shared import Done, finish

lens_app = typer.Typer(help="Lens files of other programs.", no_args_is_help=True)


@lens_app.command("import")
def import_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Zemax .zmx, CODE V .seq, OSLO .len, optiland .json.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The recipe. [default: NAME.toml]")
    ] = None,
    glass: Annotated[
        list[str] | None,
        typer.Option("--glass", metavar="NAME=ND,VD", help="Index and Abbe number of a glass; repeatable."),
    ] = None,
    glasses: Annotated[
        list[Path] | None,
        typer.Option("--glasses", metavar="FILE", help="Glass catalogue of a maker, .agf; repeatable."),
    ] = None,
    focus: Annotated[float, typer.Option("--focus", metavar="M", help="Distance in focus, metres.")] = 2.0,
    pixel: Annotated[float, typer.Option("--pixel", metavar="UM", help="Pixel pitch, um.")] = 3.45,
    json: JsonOption = None,
) -> Done:
    """Write a lens file of another program as a camera recipe.

    It reads rotationally symmetric surfaces: spheres, conics, even and odd aspheres, with clear radii.
    Anything else is refused, and what is left out is printed. Figures: focal_length_mm, f_number, surfaces.
    """
    glasses_by_name: dict[str, tuple[float, float]] = {}
    for each in glass or []:
        name, _, numbers = each.partition("=")
        try:
            nd, vd = (float(part) for part in numbers.split(","))
        except ValueError:
            raise InputError(f"--glass {each}: give NAME=ND,VD, for instance N-LAK9=1.691,54.71") from None
        glasses_by_name[name] = (nd, vd)
    if not (focus > 0 and pixel > 0):
        raise InputError("--focus and --pixel are above 0")
    from ..optics import Camera
    from ..optics.prescription.lens_files.imported import camera_of
    from ..recipe.written import toml_of

    recipe, notes = camera_of(
        file, glasses_by_name=glasses_by_name, catalogues=glasses or [], focus_m=focus, pixel_um=pixel
    )
    camera = Camera.from_recipe(recipe, Path.cwd())
    path = out or Path(f"{recipe.name}.toml")
    if path.resolve() == file.resolve() or path.suffix.lower() != ".toml":
        raise InputError(f"--out {path}: a recipe ends in .toml")
    write_text(path, toml_of(recipe, f"From {file.name}.\n" + "\n".join(notes)))
    focal = float(camera.lens.focal_length(recipe.focus.wavelength_nm * 1e-9))
    figures = {
        "focal_length_mm": focal * 1e3,
        "f_number": focal / (2 * camera.aperture_radius),
        "surfaces": len(getattr(camera.lens, "surfaces", ())),
    }
    said = f"{figures['surfaces']} surfaces, f = {focal * 1e3:.4g} mm, f/{figures['f_number']:.3g}"
    inputs = {"file": str(file)}
    return finish("lens import", [said, *notes], figures, {"camera": path}, json, inputs=inputs)
