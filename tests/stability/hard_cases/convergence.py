"""Photos by their own plans, as commands take them, against converged ones: a camera and four scenes a case.

A promise of decibels holds for any camera, and for the lens alone as well as through the mask: six hundred
depth layers, all bands, the recipe's window and pupil, and 6 x 6 sub-apertures in full are what it is held
to. Views are small crops about the busiest edges of scenes with little noise, in the camera's own pixels.

    python tests/stability/hard_cases/convergence.py [CASE...]    # a line for each photo
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from edofsim.capture import capture, full_fidelity
from edofsim.capture.crop import crop
from edofsim.capture.framing import framed, seen_through
from edofsim.optics import Camera
from edofsim.plan import RESTORED, Plan, Target, facts_of, plan_alone, plan_photo
from edofsim.recipe import CameraRecipe, load_camera, load_scene
from edofsim.render import render
from edofsim.render.view import View
from edofsim.restore.scores import psnr
from edofsim.stability.case import Case, Finding

LAYERS = 600
SCENES = ("desk", "hallway", "clutter", "foliage")
PICTURE = "motorcycle"
"""With measured depths: nothing is rendered."""
BANDS, SAMPLES = 5, 8
WIDTH, HEIGHT = 64, 48
CUBIC = {"kind": "cubic", "alpha_rad": 60.0}
"""The mask of cameras that have none."""


@dataclass(frozen=True)
class Taker:
    """A camera with a mask; None in its place where that of another case has the same lens, which is then not
    judged alone once more. within: inverse depths [1/m] that scenes are moved and squeezed into, where lenses
    are so fast that a pupil for all depths would take minutes a PSF. target: what is asked for. layers: of
    the converged photo. bands: of the view."""

    make: Callable[[], Camera]
    masked: bool = True
    alone: bool = True
    within: tuple[float, float] | None = None
    target: Target = Target()
    layers: int = LAYERS
    bands: int = BANDS


def shipped(name: str, mask: Mapping[str, object] | None = None) -> Camera:
    loaded = load_camera(name)
    recipe = loaded.recipe
    if mask:
        recipe = CameraRecipe.model_validate({**recipe.model_dump(mode="json"), "mask": dict(mask)})
    return Camera.from_recipe(recipe, loaded.base)


def ideal(focal_mm: float, f_number: float, pixel_um: float, focus_m: float, window: int) -> Camera:
    recipe = {
        "name": f"{focal_mm:g}mm-f{f_number:g}",
        "lens": {"kind": "ideal", "focal_length_mm": focal_mm, "f_number": f_number},
        "focus": {"distance_m": focus_m},
        "sensor": {"pixel_um": pixel_um},
        "psf": {"window_px": window},
        "mask": CUBIC,
    }
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


CAMERAS: Mapping[str, Taker] = {
    "paper-clear": Taker(lambda: shipped("paper-clear"), masked=False),
    **{
        name: Taker(lambda name=name: shipped(name), alone=False)
        for name in ("paper-cubic", "paper-device", "paper-learned", "paper-levin", "paper-rings")
    },
    "35 mm f/4": Taker(lambda: ideal(35, 4, 3.45, 1.0, 160)),
    "50 mm f/2": Taker(lambda: ideal(50, 2, 3.45, 2.0, 96), within=(0.4, 0.6)),
    "phone": Taker(lambda: shipped("phone-5mm-f2", CUBIC)),
    "100 mm f/4": Taker(lambda: ideal(100, 4, 6.0, 3.0, 96), within=(0.25, 0.42)),
}
QUICK = "35 mm f/4 before a picture"


def view_of(
    scene: str, camera: Camera, within: tuple[float, float] | None = None, count: int = BANDS
) -> View:
    """The crop of a scene with the most depth edge in it, in the camera's pixels, with a margin that holds
    its PSFs."""
    loaded = load_scene(scene)
    recipe = loaded.recipe
    few = recipe.render.model_copy(update={"samples": SAMPLES})
    bands = recipe.bands.model_copy(update={"count": count})
    recipe = framed(recipe.model_copy(update={"bands": bands, "render": few}), camera, resample=True)
    _, view = seen_through(camera, recipe, render(recipe, loaded.base))
    depth = view.crop_margin(view.mean_inverse_depth())
    steps = depth.new_zeros(depth.shape)
    steps[:-1] += depth.diff(dim=0).abs().clamp_max(1)
    steps[:, :-1] += depth.diff(dim=1).abs().clamp_max(1)
    places = [
        (top, left)
        for top in range(0, view.height - HEIGHT + 1, HEIGHT // 2)
        for left in range(0, view.width - WIDTH + 1, WIDTH // 2)
    ]
    top, left = max(places, key=lambda at: float(steps[at[0] : at[0] + HEIGHT, at[1] : at[1] + WIDTH].sum()))
    part = crop(view, top, left, HEIGHT, WIDTH, camera.recipe.psf.window_px // 2)
    if within is None:
        return part
    near, far = part.inverse_depth.max(), part.inverse_depth.min()
    share = (part.inverse_depth - far) / (near - far)
    return replace(part, inverse_depth=within[0] + (within[1] - within[0]) * share)


def reached(view: View, camera: Camera, plan: Plan, layers: int = LAYERS) -> float:
    """PSNR in dB of the photo of a plan against the converged one."""
    photo = capture(view, camera, plan.fidelity)
    converged = full_fidelity(camera, view).changed({"layers": layers})
    return psnr(photo.clean, capture(view, camera, converged, exposure=photo.exposure).clean)


def photos(
    camera_recipe: Taker, scenes: tuple[str, ...]
) -> Iterator[tuple[str, float, float, int | None, float]]:
    """What is photographed, the promised and the reached PSNR in dB, depth layers, and seconds it took."""
    camera = camera_recipe.make()
    alone = camera.without_mask()
    for scene in scenes:
        view = view_of(scene, camera, camera_recipe.within, camera_recipe.bands)
        begun = time.process_time()
        facts = facts_of(view, camera)
        plan = plan_photo(view, camera, None, camera_recipe.target, every_effect=False, facts=facts)
        if camera_recipe.masked:
            found = reached(view, camera, plan, camera_recipe.layers)
            yield f"{scene}, masked", _asked(plan), found, plan.fidelity.layers, time.process_time() - begun
        if camera_recipe.alone:
            begun = time.process_time()
            bare = (
                plan_alone(plan, facts, alone, None, camera_recipe.target) if camera_recipe.masked else plan
            )
            found = reached(view, alone, bare, camera_recipe.layers)
            yield f"{scene}, alone", _asked(bare), found, bare.fidelity.layers, time.process_time() - begun


def _asked(plan: Plan) -> float:
    assert plan.asked_db is not None
    return plan.asked_db


def _findings(camera_recipe: Taker, scenes: tuple[str, ...]) -> Iterator[Finding]:
    for said, asked, found, _, seconds in photos(camera_recipe, scenes):
        error = math.nan if math.isnan(found) else 10 ** ((asked - found) / 20)
        yield Finding(f"{said}, error over the promised one", error, 1.0, seconds)


def _case(name: str, camera_recipe: Taker, scenes: tuple[str, ...] = SCENES) -> Case:
    return Case(
        name,
        "plan",
        "depth edges, slopes, thin occluders; the lens alone and through a mask",
        "a plan made for another photo, or for other cameras, misses what it promises",
        f"within the promised error of {camera_recipe.layers} layers",
        lambda: _findings(camera_recipe, scenes),
    )


CASES: tuple[Case, ...] = (
    _case(
        QUICK, Taker(lambda: ideal(35, 4, 3.45, 1.0, 64), target=RESTORED, layers=120, bands=3), (PICTURE,)
    ),
    *(_case(f"{name} as promised", camera_recipe) for name, camera_recipe in CAMERAS.items()),
)
SLOW = {case.name for case in CASES[1:]}


def _main(names: list[str]) -> None:
    for name, camera_recipe in CAMERAS.items():
        if not names or name in names:
            for said, asked, found, layers, seconds in photos(camera_recipe, SCENES):
                layered = "all" if layers is None else layers
                met = "" if found >= asked else "  MISSED"
                line = (
                    f"{name:13} {said:18} {asked:5.1f} {found:6.2f} dB  {layered:>4} layers {seconds:6.1f} s"
                )
                print(line + met, flush=True)


if __name__ == "__main__":
    _main(sys.argv[1:])
