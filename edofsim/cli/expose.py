"""`edofsim expose`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import completion
from ..core.progress import Progress
from ..errors import InputError
from ..options import (
    AccuracyOption,
    CacheOption,
    CameraOption,
    ClusterOption,
    Device,
    DeviceOption,
    FidelityOption,
    JobsOption,
    JsonOption,
    LayersOption,
    MethodOption,
    OcclusionOption,
    OutOption,
    QuietOption,
    RawColoursOption,
    ResampleOption,
    Scenes,
    SeedOption,
    ShardOption,
    SubAperturesOption,
    TimeOption,
    WithOption,
    WithoutOption,
)
from ..record import peak_memory_mib, writable_folder
from .many import OfScene, all_of, of_each, seen_by, spread_of
from .shared import Done, begun, check_alone, finish, inputs_of, plan_lines, plan_rows, recipes_of

if TYPE_CHECKING:
    from torch import Tensor

    from ..plan import Target
    from ..recipe import CameraRecipe, Loaded, SceneRecipe
    from ..reference.pinhole import Crop


def expose(
    scenes: Scenes,
    camera: CameraOption = None,
    resample: ResampleOption = False,
    method: MethodOption = None,
    layers: LayersOption = None,
    occlusion: OcclusionOption = None,
    sub_apertures: SubAperturesOption = None,
    fidelity: FidelityOption = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    with_: WithOption = None,
    without: WithoutOption = None,
    bands: Annotated[
        int | None,
        typer.Option(
            "--bands",
            min=1,
            help="Groups that each channel's bands are blurred in; default: as planned.",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference",
            metavar="thinlens|pupil",
            help="A slow, true photo of --crop beside it.",
            autocompletion=completion.one_of("thinlens", "pupil"),
        ),
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option("--crop", metavar="X,Y,W,H", help="Part of the frame for --reference, in pixels."),
    ] = None,
    members: Annotated[
        int | None, typer.Option("--members", min=1, help="In place of each scene, members of its family.")
    ] = None,
    raw_colours: RawColoursOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = 1,
    cluster: ClusterOption = None,
    shard: ShardOption = None,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """A photo of each scene through one camera, or through its own: EXR (linear) and PNG, of several scenes
    in folders of their own in --out. What is there already, of the same recipes and options, stays: the same
    command goes on from there.

    The reference `pupil` is wave optics with any mask: minutes for 64 x 64 pixels and few --bands; `thinlens`
    is geometric and for a clear aperture. With --bands N each channel's bands are gathered in N groups,
    weighted by its response: its light stays, and the groups are blurred.

    Figures, of several scenes with .SCENE behind: psnr_db.{photo,against_reference}, psnr_db_se.photo
    (standard error by the noise of the rendering), seconds.{plan,render,expose,reference},
    truncated_energy.{r,g,b}, peak_memory_mib, plan.share_of_saved (planning against the seconds that it
    saves), and what `edofsim plan` says.
    """
    if (reference is None) != (crop is None):
        raise InputError("--reference and --crop X,Y,WIDTH,HEIGHT belong together: a reference is slow")
    pairs = all_of(scenes, lambda scene: recipes_of(scene, camera, resample))
    if members is not None:
        pairs = [(each, taker) for scene, taker in pairs for each in _members(scene, members)]
    how = spread_of(jobs, cluster, shard)
    names = [f"{scene.recipe.name}-{taker.recipe.name}" for scene, taker in pairs]
    with begun("expose", json, quiet=quiet) as progress:
        from ..capture.device import torch_device
        from ..optics import Camera
        from ..plan import checked_overrule, parse_target
        from ..reference import check_reference, crop_of

        overrule: dict[str, object] = {"method": method, "layers": layers, "occlusion": occlusion}
        overrule |= {"sub_apertures": sub_apertures, "with_": with_, "without": without}
        check_alone(fidelity, {**overrule, "accuracy": accuracy, "time": time, "bands": bands})
        overrule = dict(checked_overrule(overrule))
        torch_device(device.value)
        for _, taker in pairs if reference is not None else ():
            check_reference(reference or "", Camera.from_recipe(taker.recipe, taker.base))
        top = writable_folder(out or Path("out"))
        folders = [top if out and len(names) == 1 else writable_folder(top / name) for name in names]
        work = partial(
            photographed,
            overrule=overrule,
            target=parse_target(accuracy, time),
            wanted=fidelity,
            bands=bands,
            reference=reference,
            resample=resample,
            raw_colours=raw_colours,
            where=None if crop is None else crop_of(crop),
            seed=seed,
            cache=seen_by(how, cache),
            device=device.value,
        )
        parts = [(*pair, seen_by(how, folder)) for pair, folder in zip(pairs, folders, strict=True)]
        found = of_each(parts, [scene.recipe.name for scene, _ in pairs], work, how, progress)
        inputs = {"scenes": [str(scene.path) for scene, _ in pairs], "crop": crop, "reference": reference}
        if len(pairs) == 1:
            inputs = inputs_of(*pairs[0], crop=crop, reference=reference)
        how_made = {"inputs": inputs, "seed": seed, "rest": found.record}
        done = finish("expose", found.printed, found.figures, found.outputs, json, **how_made)
        return replace(done, problems=found.problems, failures=found.failures)


def photographed(
    part: tuple[Loaded[SceneRecipe], Loaded[CameraRecipe], Path],
    progress: Progress,
    *,
    overrule: Mapping[str, object],
    target: Target,
    wanted: str | None,
    bands: int | None,
    reference: str | None,
    where: Crop | None,
    resample: bool,
    raw_colours: bool,
    seed: int,
    cache: Path | None,
    device: str,
) -> OfScene:
    """One scene through its camera, into the folder that is given with them, unless the photo is there."""
    from .photo_files import keep_taken, photo_key, taken

    scene, taker, folder = part
    options = {"overrule": dict(overrule), "target": target, "bands": bands, "reference": reference}
    options |= {"where": where, "resample": resample, "seed": seed}
    options["raw_colours"] = raw_colours
    key = photo_key(scene, taker, wanted, options)
    if (there := taken(folder, key)) is not None:
        return there
    found = _photographed(
        part,
        progress,
        overrule=overrule,
        target=target,
        wanted=wanted,
        bands=bands,
        reference=reference,
        where=where,
        resample=resample,
        raw_colours=raw_colours,
        seed=seed,
        cache=cache,
        device=device,
    )
    keep_taken(folder, key, found)
    return found


def _members(scene: Loaded[SceneRecipe], count: int) -> list[Loaded[SceneRecipe]]:
    from ..scene.family import members as family_members

    return [replace(scene, recipe=recipe) for recipe in family_members(scene.recipe, count)]


def _photographed(
    part: tuple[Loaded[SceneRecipe], Loaded[CameraRecipe], Path],
    progress: Progress,
    *,
    overrule: Mapping[str, object],
    target: Target,
    wanted: str | None,
    bands: int | None,
    reference: str | None,
    where: Crop | None,
    resample: bool,
    raw_colours: bool,
    seed: int,
    cache: Path | None,
    device: str,
) -> OfScene:
    """One scene through its camera, into the folder that is given with them."""
    from ..capture import capture, save_image, write_image, write_photo
    from ..capture.device import torch_device
    from ..capture.fidelity_file import values_of
    from ..capture.noise import photographed_noise
    from ..optics import Camera
    from ..pipeline import Stopwatch, planned_view
    from ..plan import learn_rates, plan_figures, with_predicted
    from ..reference import check_crop, reference_photo
    from ..render import is_picture
    from ..render.keys import view_key
    from ..restore.scores import level_and_error, psnr
    from ..restore.truth import SAID, Truth

    scene, taker, folder = part
    compute, optics = torch_device(device), Camera.from_recipe(taker.recipe, taker.base)
    watch = Stopwatch(progress)
    view, plan, _ = planned_view(
        scene,
        optics,
        watch,
        resample=resample,
        overrule=overrule,
        target=target,
        fidelity=wanted,
        cache=cache,
        device=device,
    )
    fidelity = plan.fidelity.of_photo()
    if bands is not None:  # in place of what the plan gathers them in
        if bands > view.bands:
            raise InputError(f"--bands {bands}: the view has {view.bands} bands; give 1 to {view.bands}")
        # the reference has one wavelength a group, and so has the photo beside it
        wavelengths = 1 if reference == "pupil" else 0
        fidelity = fidelity.changed({"band_groups": bands, "group_wavelengths": wavelengths})
    if where is not None:
        check_crop(view, where)
    with watch.stage("expose", 0.7, 0.8):
        photo = capture(view, optics, fidelity, seed=seed, device=compute)
    if raw_colours:
        photo = replace(photo, colours=None)
    if bands is None:
        photo = with_predicted(photo, plan)
    if compute == "cpu" and bands is None:
        learn_rates(plan.seconds, photo.seconds)
    origin = {"scene": scene.recipe.name, "view": view_key(scene.recipe, scene.base)}
    origin |= {"camera": taker.recipe.model_dump(mode="json", exclude_unset=True)}
    photo = replace(photo, how={**photo.how, **origin})
    noise = photographed_noise(view, optics, fidelity, photo, compute)
    level, error = level_and_error(*Truth(photo.ideal, noise).compared(photo.image, noise.image))
    numbers = {
        "psnr_db.photo": level,
        "psnr_db_se.photo": error,
        **plan_figures(plan, watch.seconds["plan"]),
        **{
            f"truncated_energy.{name}": float(value)
            for name, value in zip("rgb", photo.truncated, strict=False)
        },
    }
    outputs = {
        "photo (EXR, linear)": write_photo(folder / "photo.exr", photo),
        "photo (PNG, sRGB)": save_image(folder / "photo.png", photo.image, photo.colours),
        "ideal (PNG, sRGB)": save_image(folder / "ideal.png", photo.ideal, photo.colours),
    }
    if is_picture(scene.recipe):
        outputs["all in focus, as it was given (PNG)"] = save_image(folder / "given.png", view.colours())
    lines = [
        *plan_lines(plan, watch.seconds["plan"]),
        f"photo {numbers['psnr_db.photo']:.2f} dB against the ideal image",
        *([SAID[noise.state]] if noise.state == "included" else []),
    ]
    if reference is not None and where is not None:
        with watch.stage("reference", 0.8, 1.0) as tell:
            true = photo.exposure * reference_photo(
                reference,
                view,
                scene.recipe,
                scene.base,
                optics,
                where,
                groups=bands,
                device=device,
                progress=tell,
            )
        numbers["psnr_db.against_reference"] = psnr(_part(photo.clean, where).cpu(), true)
        outputs["reference (EXR, linear)"] = write_image(folder / "reference.exr", true)
        outputs["reference (PNG, sRGB)"] = save_image(folder / "reference.png", true, photo.colours)
        lines.append(
            f"there the photo without noise {numbers['psnr_db.against_reference']:.2f} dB against the "
            f"{reference} reference, which took {watch.seconds['reference']:.0f} s"
        )
    numbers |= {f"seconds.{stage}": seconds for stage, seconds in watch.seconds.items()}
    numbers["peak_memory_mib"] = peak_memory_mib()
    plan_of = {"fidelity": values_of(fidelity), "plan": plan_rows(plan)}
    return OfScene(scene.recipe.name, lines, numbers, outputs, plan_of)


def _part(image: Tensor, where: Crop) -> Tensor:
    """The crop of an image [..., y, x]."""
    return image[..., where.top : where.top + where.height, where.left : where.left + where.width]
