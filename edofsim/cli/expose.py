"""`edofsim expose`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import completion
from ..core.memory import give_back_renderers_memory
from ..core.progress import Progress
from ..core.stopwatch import Stopwatch
from ..errors import InputError
from ..options import (
    CameraOption,
    RawColoursOption,
    ResampleOption,
    Scenes,
    SeedOption,
    Simulated,
    Spreading,
    Work,
)
from ..record import peak_memory_mib, writable_folder
from .many import OfScene, all_of, of_each, seen_by, spread_of
from .photo_files import keep_photo, kept_photo, photo_key
from .shared import Done, begun, check_alone, finish, inputs_of, plan_lines, plan_rows, recipes_of

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from ..capture import Fidelity, Photo
    from ..core.stopwatch import Stopwatch
    from ..optics import Camera
    from ..plan import Target
    from ..recipe import CameraRecipe, Loaded, SceneRecipe
    from ..reference.pinhole import Crop
    from ..render.view import View

    Pair = tuple[Loaded[SceneRecipe], Loaded[CameraRecipe]]
    Part = tuple[Loaded[SceneRecipe], Loaded[CameraRecipe], Path]


BandsOption = Annotated[
    int | None,
    typer.Option(
        "--bands", min=1, help="Number of band groups blurred in each channel; default: as planned."
    ),
]
ReferenceOption = Annotated[
    str | None,
    typer.Option(
        "--reference",
        metavar="thinlens|pupil",
        help="Also make a slow, accurate photo of --crop by this reference method, to compare.",
        autocompletion=completion.one_of("thinlens", "pupil"),
    ),
]
CropOption = Annotated[
    str | None,
    typer.Option("--crop", metavar="X,Y,W,H", help="Part of the frame for --reference, in pixels."),
]
FamilyOption = Annotated[
    int | None,
    typer.Option("--members", min=1, help="Replace each scene by this many variants of its family."),
]


@dataclass(frozen=True)
class Asked:
    """What is asked of each photo. wanted: by --fidelity; where: the part of the frame for the reference."""

    overrule: dict[str, object]
    target: Target
    bands: int | None
    reference: str | None
    where: Crop | None
    resample: bool
    seed: int
    raw_colours: bool
    wanted: str | None
    cache: Path | None
    device: str


def expose(
    scenes: Scenes,
    camera: CameraOption = None,
    resample: ResampleOption = False,
    *,
    simulated: Simulated,
    bands: BandsOption = None,
    reference: ReferenceOption = None,
    crop: CropOption = None,
    members: FamilyOption = None,
    raw_colours: RawColoursOption = False,
    seed: SeedOption = 0,
    spread: Spreading,
    work: Work,
) -> Done:
    """Make photos of scenes through a camera.

    Photos are EXR (linear) and PNG, through --camera or the scene's own camera. Several scenes have folders
    of their own in --out. Photos of the same recipes and options that are there already stay, so the same
    command resumes interrupted work. The reference `pupil` is wave optics with any mask: minutes for 64 x 64
    pixels and few --bands; `thinlens` is geometric and for a clear aperture. With --bands N each channel's
    bands are gathered in N groups, weighted by its response: its light stays, and the groups are blurred.

    Figures, of several scenes with .SCENE behind: psnr_db.{photo,against_reference}, psnr_db_se.photo (its
    standard error), seconds.{render,guess,plan,expose,reference}, truncated_energy.{r,g,b}, peak_memory_mib,
    plan.share_of_saved (seconds of planning over those that it saves), and what `edofsim plan` says.
    """
    if (reference is None) != (crop is None):
        raise InputError("--reference and --crop X,Y,WIDTH,HEIGHT belong together: a reference is slow")
    pairs = all_of(scenes, lambda scene: recipes_of(scene, camera, resample))
    if members is not None:
        pairs = [(each, taken_by) for scene, taken_by in pairs for each in _members(scene, members)]
    how = spread_of(spread)
    with begun("expose", work.json, quiet=work.quiet) as progress:
        from ..plan import checked_overrule, parse_target
        from ..reference import crop_of

        check_alone(simulated, bands=bands)
        asked = Asked(
            overrule=dict(checked_overrule(simulated.overrule)),
            target=parse_target(simulated.accuracy, simulated.time),
            bands=bands,
            reference=reference,
            where=None if crop is None else crop_of(crop),
            resample=resample,
            seed=seed,
            raw_colours=raw_colours,
            wanted=simulated.fidelity,
            cache=seen_by(how, work.cache),
            device=work.device.value,
        )
        folders = [seen_by(how, folder) for folder in _folders(pairs, asked, work.out)]
        parts = [(*pair, folder) for pair, folder in zip(pairs, folders, strict=True)]
        names = [scene.recipe.name for scene, _ in pairs]
        found = of_each(parts, names, partial(capture_part, asked=asked), how, progress)
        inputs = {"scenes": [str(scene.path) for scene, _ in pairs], "crop": crop, "reference": reference}
        inputs = inputs_of(*pairs[0], crop=crop, reference=reference) if len(pairs) == 1 else inputs
        how_made = {"inputs": inputs, "seed": seed, "rest": found.record}
        done = finish("expose", found.printed, found.figures, found.outputs, work.json, **how_made)
        return replace(done, problems=found.problems, failures=found.failures)


def _folders(pairs: Sequence[Pair], asked: Asked, out: Path | None) -> list[Path]:
    """Where the photos are written, once it is known that they can be made. Raises InputError."""
    from ..capture.device import torch_device
    from ..optics import Camera
    from ..reference import check_reference

    torch_device(asked.device)
    for _, camera_recipe in pairs if asked.reference is not None else ():
        check_reference(asked.reference or "", Camera.from_recipe(camera_recipe.recipe, camera_recipe.base))
    top = writable_folder(out or Path("out"))
    if out and len(pairs) == 1:
        return [top]
    return [
        writable_folder(top / f"{scene.recipe.name}-{camera_recipe.recipe.name}")
        for scene, camera_recipe in pairs
    ]


def capture_part(part: Part, progress: Progress, *, asked: Asked) -> OfScene:
    """One scene through its camera, into the folder that is given with them, unless the photo is there."""

    scene, camera_recipe, folder = part
    options = {
        name: value for name, value in vars(asked).items() if name not in ("wanted", "cache", "device")
    }
    key = photo_key(scene, camera_recipe, asked.wanted, options)
    if (there := kept_photo(folder, key)) is not None:
        return there
    found = _capture(part, progress, asked)
    keep_photo(folder, key, found)
    return found


def _members(scene: Loaded[SceneRecipe], count: int) -> list[Loaded[SceneRecipe]]:
    from ..scene.family import members as family_members

    return [replace(scene, recipe=recipe) for recipe in family_members(scene.recipe, count)]


def _capture(part: Part, progress: Progress, asked: Asked) -> OfScene:
    """One scene through its camera, into the folder that is given with them."""
    from ..capture import capture, save_image, write_photo
    from ..capture.device import torch_device
    from ..capture.fidelity_file import values_of
    from ..optics import Camera
    from ..pipeline import planned_view
    from ..plan import learn_rates, plan_figures, with_predicted
    from ..reference import check_crop
    from ..render import is_picture
    from ..render.keys import view_key

    scene, camera_recipe, folder = part
    compute, optics = torch_device(asked.device), Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    watch = Stopwatch(progress)
    how = {"overrule": asked.overrule, "fidelity": asked.wanted, "cache": asked.cache, "device": asked.device}
    view, plan, facts = planned_view(
        scene, optics, watch, resample=asked.resample, target=asked.target, **how
    )
    fidelity = _fidelity(plan.fidelity.of_photo(), view, asked)
    seen = facts.view if fidelity.uncovers else view
    del facts
    give_back_renderers_memory()
    if asked.where is not None:
        check_crop(view, asked.where)
    with watch.stage("expose", 0.7, 0.8):
        photo = capture(seen, optics, fidelity, seed=asked.seed, device=compute)
    del seen
    photo = replace(photo, colours=None) if asked.raw_colours else photo
    if asked.bands is None:
        photo = with_predicted(photo, plan)
        if compute == "cpu":
            learn_rates(plan.seconds, photo.seconds)
    of_view = {"scene": scene.recipe.name, "view": view_key(scene.recipe, scene.base)}
    seen_by = camera_recipe.recipe.model_dump(mode="json", exclude_unset=True)
    photo = replace(photo, how=replace(photo.how, **of_view, camera=seen_by))
    numbers, lines = _scored(view, optics, fidelity, photo, compute)
    numbers |= plan_figures(plan, watch.seconds["plan"])
    outputs = {
        "photo (EXR, linear)": write_photo(folder / "photo.exr", photo),
        "photo (PNG, sRGB)": save_image(folder / "photo.png", photo.image, photo.colours),
        "ideal (PNG, sRGB)": save_image(folder / "ideal.png", photo.ideal, photo.colours),
    }
    if is_picture(scene.recipe):
        outputs["all in focus, as it was given (PNG)"] = save_image(folder / "given.png", view.colours())
    printed = [*plan_lines(plan, watch.seconds["plan"]), *lines]
    if asked.where is not None:
        numbers["psnr_db.against_reference"], more = _reference(part, view, optics, photo, asked, watch)
        outputs |= more
        printed.append(
            f"there the photo without noise {numbers['psnr_db.against_reference']:.2f} dB against the "
            f"{asked.reference} reference, which took {watch.seconds['reference']:.0f} s"
        )
    numbers |= {f"seconds.{stage}": seconds for stage, seconds in watch.seconds.items()}
    numbers["peak_memory_mib"] = peak_memory_mib()
    plan_of = {"fidelity": values_of(fidelity), "plan": plan_rows(plan)}
    return OfScene(scene.recipe.name, printed, numbers, outputs, plan_of)


def _fidelity(planned: Fidelity, view: View, asked: Asked) -> Fidelity:
    """As planned, but for --bands. Raises InputError for more bands than the view has."""
    if asked.bands is None:
        return planned
    if asked.bands > view.bands:
        raise InputError(f"--bands {asked.bands}: the view has {view.bands} bands; give 1 to {view.bands}")
    # the reference has one wavelength a group, and so has the photo next to it
    wavelengths = 1 if asked.reference == "pupil" else 0
    return planned.changed({"band_groups": asked.bands, "group_wavelengths": wavelengths})


def _scored(
    view: View, camera: Camera, fidelity: Fidelity, photo: Photo, device: torch.device | str
) -> tuple[dict[str, float], list[str]]:
    """Figures of a photo against its ideal image, and what to say of them."""
    from ..capture.noise import photo_noise
    from ..restore.scores import level_and_error
    from ..restore.truth import SAID, Truth

    noise = photo_noise(view, camera, fidelity, photo, device)
    level, error = level_and_error(*Truth(photo.ideal, noise).compared(photo.image, noise.image))
    lost = zip("rgb", photo.truncated, strict=False)
    numbers = {"psnr_db.photo": level, "psnr_db_se.photo": error}
    numbers |= {f"truncated_energy.{name}": float(value) for name, value in lost}
    said = [SAID[noise.state]] if noise.state == "included" else []
    return numbers, [f"photo {level:.2f} dB against the ideal image", *said]


def _reference(
    part: Part, view: View, camera: Camera, photo: Photo, asked: Asked, watch: Stopwatch
) -> tuple[float, dict[str, Path]]:
    """PSNR of the photo without noise against the reference, and the files of that."""
    from ..capture import save_image, write_image
    from ..reference import reference_photo
    from ..restore.scores import psnr

    scene, _, folder = part
    assert asked.where is not None and asked.reference is not None
    how = {"groups": asked.bands, "device": asked.device}
    with watch.stage("reference", 0.8, 1.0) as tell:
        true = photo.exposure * reference_photo(
            asked.reference, view, scene.recipe, scene.base, camera, asked.where, progress=tell, **how
        )
    outputs = {
        "reference (EXR, linear)": write_image(folder / "reference.exr", true),
        "reference (PNG, sRGB)": save_image(folder / "reference.png", true, photo.colours),
    }
    return psnr(_part(photo.clean, asked.where).cpu(), true), outputs


def _part(image: Tensor, where: Crop) -> Tensor:
    """The crop of an image [..., y, x]."""
    return image[..., where.top : where.top + where.height, where.left : where.left + where.width]
