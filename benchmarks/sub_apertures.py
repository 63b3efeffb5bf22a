"""What fewer sub-apertures, and their change in coarse pixels, leave out of what sub-apertures change.

`python -m benchmarks.sub_apertures [SCENE...]` photographs the middles of shipped scenes through three masks
and prints what `LEFT_BY_FEWER` and `LEFT_BY_COARSE` of `edofsim/plan/effects/sub_apertures.py` stand for: the
root mean square of what is left, over that of the whole change.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterable, Mapping

import torch

from edofsim.capture import capture, full_fidelity
from edofsim.experiments.predictions import MASKS, camera_of, small_version
from edofsim.optics import Camera
from edofsim.plan.effects.sub_apertures import FEWER, LEFT_BY_COARSE
from edofsim.recipe import load_scene
from edofsim.render import View, render

SCENES = ("desk", "hallway", "clutter", "stilllife")


def shares(view: View, camera: Camera) -> Mapping[str, float]:
    """`fewer` and `coarse, N` for each width N: the shares that are left; empty where there is no change."""
    full = full_fidelity(camera, view)
    if full.sub_apertures <= FEWER:
        return {}
    plain = full.changed({"band_groups": 1, "group_wavelengths": 2, "layers": 13})

    def photo(across: int, pixel: int) -> torch.Tensor:
        how = plain.changed({"sub_apertures": across, "sub_aperture_pixel": pixel})
        return capture(view, camera, how).clean

    best = photo(full.sub_apertures, 1)
    change = float((best - photo(1, 1)).norm())
    left = {f"coarse, {side}": photo(full.sub_apertures, side) for side in LEFT_BY_COARSE}
    left["fewer"] = photo(FEWER, 1)
    return {name: float((other - best).norm()) / change for name, other in left.items()}


def measured(scenes: Iterable[str]) -> dict[str, dict[str, float]]:
    """Shares by scene and mask."""
    found = {}
    for scene in scenes:
        loaded = load_scene(scene)
        view = render(small_version(loaded.recipe), loaded.base)
        for mask in MASKS:
            left = shares(view, camera_of(mask))
            if left:
                found[f"{scene}, {mask}"] = dict(left)
                print(f"{scene}, {mask}: " + ", ".join(f"{k} {v:.2f}" for k, v in left.items()), flush=True)
    return found


if __name__ == "__main__":
    each = measured(sys.argv[1:] or SCENES).values()
    for name in ("fewer", *(f"coarse, {side}" for side in LEFT_BY_COARSE)):
        values = [left[name] for left in each]
        print(f"{name}: {min(values):.2f} to {max(values):.2f}, median {statistics.median(values):.2f}")
