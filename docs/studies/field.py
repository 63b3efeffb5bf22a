"""What a photo loses where a lens has the PSFs and the light of its axis all over the frame.

`python -m docs.studies.field [SCENE...] [--camera NAME] [--json FILE]` photographs shipped scenes through
lenses that vary over the field, as they are and with `field_step_px = 0`, and prints the PSNR of the second
photo against the first, as a whole and in the worst of four corners. Both have one group of bands and depth
layers for 45 dB, so that what they differ in is the field.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from statistics import median

from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.framing import framed, seen_through
from edofsim.optics import Camera
from edofsim.optics import cache as psfs_kept
from edofsim.optics.terms import KEPT
from edofsim.plan import parse_target, plan_photo
from edofsim.recipe import load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.render.view import View
from edofsim.restore.scores import image_psnr

SCENES = ("desk", "foliage")
CAMERAS = ("doublet-25mm-f6", "double-gauss-50mm-f4", "aspheres-5mm-f3")
FIDELITY = Fidelity(layers_db=45.0, band_groups=1, group_wavelengths=1, occlusion="hidden", read_noise=False)
REPEATS = 5
ASKED_DB = {"aspheres-5mm-f3": 45}
"""Of plans whose photos are timed, else 50."""


def seen(scene: str, name: str, cache: Path | None) -> tuple[View, Camera]:
    """A scene as a camera sees it, and the camera."""
    loaded, given = load_scene(scene), load_camera(name)
    camera = Camera.from_recipe(given.recipe, given.base)
    recipe = framed(loaded.recipe, camera)
    return seen_through(camera, recipe, render(recipe, loaded.base, cache=cache))[1], camera


def seconds(scene: str, name: str, cache: Path | None) -> Mapping[str, float]:
    """Of the processor, with the field and without; and how many times as long the field takes."""
    view, camera = seen(scene, name, cache)
    target = parse_target(f"{ASKED_DB.get(name, 50)}dB", None)
    plan = plan_photo(view, camera, None, target, every_effect=False)
    found: dict[str, float] = {}
    for field, change in (("axis", {"field_step_px": 0}), ("field", {})):
        psfs_kept.forget()
        KEPT.forget()
        with tempfile.TemporaryDirectory() as kept:
            taken = []
            for _ in range(1 + REPEATS):
                begun = time.process_time()
                capture(view, camera, plan.fidelity.changed(change), exposure=1.0, cache=Path(kept))
                taken.append(time.process_time() - begun)
        found[f"seconds.{field}.first.{scene}.{name}"] = taken[0]
        found[f"seconds.{field}.again.{scene}.{name}"] = median(taken[1:])
    for when in ("first", "again"):
        field, axis = (found[f"seconds.{each}.{when}.{scene}.{name}"] for each in ("field", "axis"))
        found[f"times.{when}.{scene}.{name}"] = field / axis
    return found


def figures(scene: str, name: str, cache: Path | None) -> Mapping[str, float]:
    """The figures of a scene and a camera."""
    view, camera = seen(scene, name, cache)
    whole = capture(view, camera, FIDELITY)
    axis = capture(view, camera, FIDELITY.changed({"field_step_px": 0}), exposure=whole.exposure)
    one, other = axis.clean, whole.clean
    corners = [image_psnr(_corner(one, at), _corner(other, at)) for at in range(4)]
    return {f"psnr_db.{scene}.{name}": image_psnr(one, other), f"psnr_db.corner.{scene}.{name}": min(corners)}


def _corner(image: Tensor, at: int) -> Tensor:
    """An eighth of each side, in a corner: [3, y, x]."""
    rows, columns = (size // 8 for size in image.shape[-2:])
    image = image.flip(-1) if at % 2 else image
    return (image.flip(-2) if at // 2 else image)[:, :rows, :columns]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--camera", action="append")
    parser.add_argument("--seconds", action="store_true")
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found: dict[str, float] = {}
    for scene in asked.scenes:
        for name in asked.camera or CAMERAS:
            now = (seconds if asked.seconds else figures)(scene, name, asked.cache)
            found |= now
            print(*(f"{key}: {value:.3g}" for key, value in now.items()), sep="\n", flush=True)
    if asked.json:
        typed = shlex.join(["python", "-m", "docs.studies.field", *sys.argv[1:]])
        write_record(asked.json, record("field", figures=found, typed=typed))


if __name__ == "__main__":
    main()
