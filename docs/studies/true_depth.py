"""How much of what a deep scene costs a restoration is its depth: a ceiling for the networks that go by PSFs.

`python -m docs.studies.true_depth [--json FILE]` photographs the middles of the shipped scenes as `evaluate
scene3d --quick` does (all bands, sub-apertures). `depth-dcnn` and `paper-bank` restore them, given depths by
the photo's own blur, as in use, and `depth-dcnn` also given the true ones. The same pictures are planes, too,
at the mean inverse depth of their scenes: without depth edges.
Figures: `psnr_db.{SCENE,mean}.NETWORK.{blur,plane}`, `psnr_db.{SCENE,mean}.depth-dcnn.true`.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor

from edofsim.experiments.protocols import OURS, WAYS, System, capture_restored, systems_of
from edofsim.experiments.restorations import ByNetwork
from edofsim.experiments.scene3d import scored_version
from edofsim.recipe.load import load_camera, load_scene, shipped, shipped_folder
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.render.view import View
from edofsim.restore.conditioning import conditioned_on
from edofsim.restore.dcnn import DCnn
from edofsim.restore.scores import image_psnr

WAY = next(way for way in WAYS if way.name == OURS)


def likely(view: View, parts: int, nearest_per_m: float) -> Tensor:
    """What share of each pixel of the frame lies in each part of the depth range, [1, parts, y, x]; surfaces
    between the middles of two parts count for both, as near as they are."""
    rows, columns = view.padded_shape
    seen = ~view.hidden
    place = (view.inverse_depth[seen] * parts / nearest_per_m - 0.5).clamp(0, parts - 1)
    lower = place.floor().long().clamp_max(parts - 2)
    upper = place - lower
    share = torch.zeros(parts, rows * columns)
    for part, weight in ((lower, 1 - upper), (lower + 1, upper)):
        share.index_put_((part, view.pixel[seen]), weight * view.coverage[seen], accumulate=True)
    return view.crop_margin((share / share.sum(0).clamp_min(1e-6)).view(parts, rows, columns))[None]


def as_plane(view: View) -> View:
    """What a pinhole sees of a view, at the mean inverse distance."""
    picture = view.all_in_focus()
    inverse = torch.full(picture.shape[1:], float(view.mean_inverse_depth().mean()))
    about = {"wavelengths": view.wavelengths, "pixel_angle": view.pixel_angle, "margin": view.margin}
    return View.flat(picture, inverse, metadata={}, **about)


def score(view: View, system: System) -> float:
    taken = capture_restored(view, WAY, system)
    image, truth, noise = taken.compared("restored")
    return image_psnr(image, truth, noise=noise)


def given_truth(view: View, system: System) -> float:
    """By the D-CNN of a system, told how far each place is."""
    assert isinstance(system.restoration, ByNetwork)
    checkpoint = system.restoration.checkpoint
    network = conditioned_on(checkpoint, system.camera, view.wavelengths)
    assert isinstance(network, DCnn) and network.distances
    nearest = checkpoint.card["recipe"]["capture"]["inverse_depth_per_m"][1]
    truth = likely(view, network.distances, nearest)
    network.likely = lambda photo: truth
    try:
        return score(view, system)
    finally:
        del network.likely


@torch.no_grad()
def restored() -> dict[str, float]:
    found: dict[str, list[float]] = {}
    figures: dict[str, float] = {}
    for path in shipped(shipped_folder("scenes")).values():
        scene = load_scene(path)
        view = render(scored_version(scene.recipe, quick=True), scene.base)
        depth_dcnn, bank = systems_of(
            load_camera(scene.recipe.camera, scene.base), ["depth-dcnn", "paper-bank"]
        )[1:]
        plane = as_plane(view)
        own = {f"{each.name}.blur": score(view, each) for each in (depth_dcnn, bank)}
        own |= {f"{each.name}.plane": score(plane, each) for each in (depth_dcnn, bank)}
        own[f"{depth_dcnn.name}.true"] = given_truth(view, depth_dcnn)
        for way, value in own.items():
            found.setdefault(way, []).append(value)
            figures[f"psnr_db.{scene.recipe.name}.{way}"] = value
        print(f"{scene.recipe.name}: {_listed(own)}", flush=True)
    mean = {way: fmean(values) for way, values in found.items()}
    print(f"{_listed(mean)} in the mean")
    return figures | {f"psnr_db.mean.{way}": value for way, value in mean.items()}


def _listed(values: dict[str, float]) -> str:
    return ", ".join(f"{way} {value:.2f}" for way, value in values.items()) + " dB"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.studies.true_depth")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    figures = restored()
    if asked.json:
        typed = shlex.join(["python", "-m", "docs.studies.true_depth", *sys.argv[1:]])
        write_record(asked.json, record("true_depth", figures=figures, typed=typed))
