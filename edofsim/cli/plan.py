"""`edofsim plan`."""

from __future__ import annotations

from ..options import (
    CacheOption,
    CameraOption,
    Device,
    DeviceOption,
    JsonOption,
    Planned,
    QuietOption,
    ResampleOption,
    Scene,
)
from .shared import Done, begun, finish, inputs_of, plan_lines, plan_rows, recipes_of


def plan(
    scene: Scene,
    camera: CameraOption = None,
    resample: ResampleOption = False,
    *,
    planned: Planned,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """Print which effects a photo needs, and why.

    For each effect: the error without it, its time, and the choice. The plan uses small renderings of the
    scene unless its view is in the cache.

    Figures: plan.{psnr_db,memory_mib,seconds,seconds_saved},
    plan.seconds.{render,prepare,psf,blur,sensor} (predicted), and for each effect called_for.EFFECT (1 or 0),
    psnr_db.without_EFFECT, plan.seconds.EFFECT.
    """
    scene_recipe, camera_recipe = recipes_of(scene, camera, resample)
    with begun("plan", json, quiet=quiet) as progress:
        from ..capture.fidelity_file import values_of
        from ..optics import Camera
        from ..plan import checked_overrule, look, parse_target, plan_figures, plan_scene
        from ..plan.rendered_noise import noise_in_words

        target = parse_target(planned.accuracy, planned.time)
        overrule = checked_overrule(planned.overrule)
        optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
        recipe, base = scene_recipe.recipe, scene_recipe.base
        seen = look(recipe, base, optics, cache=cache, device=device.value, progress=progress)
        chosen = plan_scene(seen, optics, overrule=overrule, target=target, progress=progress)
        inputs = inputs_of(scene_recipe, camera_recipe)
        noise = noise_in_words(seen.facts)
        return finish(
            "plan",
            [*plan_lines(chosen), *([noise] if noise else [])],
            plan_figures(chosen),
            {},
            json,
            inputs=inputs,
            plan=plan_rows(chosen),
            fidelity=values_of(chosen.fidelity),
        )
