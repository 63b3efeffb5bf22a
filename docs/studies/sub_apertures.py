"""What fewer sub-apertures, and their change in coarse pixels, leave out of what sub-apertures change.

`python -m docs.studies.sub_apertures [SCENE...] [--json FILE]` photographs the middles of shipped scenes
(`--whole`: all of them, which takes long) through three masks and prints what the constants of
`edofsim/plan/effects/sub_apertures.py` stand for, as root mean squares over that of the whole change: what a
coarse photo shows of it (`seen`); what fewer sub-apertures leave out (`fewer`), and pixels of two and four
(`coarse, 2`), next to what is predicted of these (`predicted, fewer`, `predicted, 2`).
"""

from __future__ import annotations

import argparse
import shlex
import statistics
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import torch

from edofsim.capture import capture
from edofsim.experiments.predictions import MASKS, camera_of, small_version
from edofsim.optics import Camera
from edofsim.plan.effect import Level, overall
from edofsim.plan.effects.sub_apertures import FEWER, differences
from edofsim.plan.facts import facts_of, photo_changes, rms
from edofsim.recipe import load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.render.view import View

SCENES = ("clutter", "foliage", "stilllife", "hallway", "bench", "desk", "night", "charts")
SIDES = (2, 4)


def shares(view: View, camera: Camera) -> Mapping[str, float]:
    """The figures above, by name; empty where there is no change."""
    facts = facts_of(view, camera)
    full = facts.full.sub_apertures
    if full <= FEWER or not facts.edges:
        return {}
    plain = facts.full.changed({"band_groups": 1, "group_wavelengths": 2, "layers": 13})

    def photo(across: int, pixel: int) -> torch.Tensor:
        how = plain.changed({"sub_apertures": across, "sub_aperture_pixel": pixel})
        return capture(view, camera, how, exposure=facts.exposure).clean

    best = photo(full, 1)
    change = _size(_per_pixel(best - photo(1, 1)))
    (seen,) = photo_changes(facts, [{"sub_apertures": 1}], sub_apertures=full)
    finest = {"sub_apertures": full}
    asked = [{"sub_apertures": n, "sub_aperture_pixel": 1} for n in (1, FEWER)]
    asked += [finest | {"sub_aperture_pixel": side} for side in SIDES]
    whole, fewer, *coarser = map(_size, differences(facts, [Level("", change) for change in asked]))
    found = {"seen": _size(seen) / change}
    found["fewer"] = _size(_per_pixel(photo(FEWER, 1) - best)) / change
    found["predicted, fewer"] = fewer / whole
    for side, said in zip(SIDES, coarser, strict=True):
        found[f"coarse, {side}"] = _size(_per_pixel(photo(full, side) - best)) / change
        found[f"predicted, {side}"] = said / whole
    return found


def _size(difference: torch.Tensor) -> float:
    """Root mean square of a difference as of `Effect.differences`."""
    return overall(rms(difference))


def _per_pixel(change: torch.Tensor) -> torch.Tensor:
    """A change of an image [channel, y, x] as such a difference."""
    return change.flatten(1) / change[0].numel() ** 0.5


def measured(scenes: Iterable[str], whole: bool = False) -> dict[str, dict[str, float]]:
    """Shares by scene and mask; whole: of the scenes themselves."""
    found = {}
    for scene in scenes:
        loaded = load_scene(scene)
        view = render(loaded.recipe if whole else small_version(loaded.recipe), loaded.base)
        for mask in MASKS:
            left = shares(view, camera_of(mask))
            if left:
                found[f"{scene}, {mask}"] = dict(left)
                print(f"{scene}, {mask}: " + ", ".join(f"{k} {v:.2f}" for k, v in left.items()), flush=True)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.studies.sub_apertures")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    by_case = measured(asked.scenes, asked.whole)
    for name in next(iter(by_case.values())):
        values = [left[name] for left in by_case.values()]
        print(f"{name}: {min(values):.2f} to {max(values):.2f}, median {statistics.median(values):.2f}")
    if asked.json:
        flat = {
            f"{name}.{case}".replace(", ", "."): value
            for case, left in by_case.items()
            for name, value in left.items()
        }
        typed = shlex.join(["python", "-m", "docs.studies.sub_apertures", *sys.argv[1:]])
        write_record(asked.json, record("sub_apertures", figures=flat, typed=typed))
