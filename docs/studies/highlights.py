"""What lamps beyond full scale cost a restoration, and what is gained where they are taken off first.

`python -m docs.studies.highlights [--data FOLDER] [--limit N] [--json FILE] [--picture FILE]`. Photographs
are planes at a random depth through the learned mask, with a disc of light before their middle, of several
radii and brightnesses, and without one; the sensor saturates. The shipped scenes with lamps are photographed
as by `evaluate scene3d`, whole frames. Networks and Wiener deconvolution restore each photo with its
highlights and without, see `edofsim.restore.highlights`. The picture is of the first scene: its photo, and
what `paper-bank` restores.
Figures: `psnr_db.PHOTO.SYSTEM.{as_it_is,taken_off}`, with PHOTO one of the scenes, `plain` and
`RADIUSpx.TIMES`, SYSTEM one of `wiener` and the networks; `psnr_db.PHOTO.photo`; `lamps.PHOTO`, taken off;
`seconds.PHOTO`, which that took once its PSFs were known.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor

from edofsim.capture.prepare import channel_weights
from edofsim.core.images import srgb_encode, write_png
from edofsim.experiments.photographs import photographs
from edofsim.experiments.planes import noisy, random_depths, through
from edofsim.experiments.protocols import OURS, WAYS, capture_restored, systems_of, unscattered_light
from edofsim.experiments.scene3d import scored_version
from edofsim.experiments.systems import READ_NOISE, of_three_lines
from edofsim.optics import PAPER_COLOURS, Camera, channel_psfs
from edofsim.recipe.load import load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.restore import restore
from edofsim.restore.checkpoint import load_checkpoint
from edofsim.restore.scores import image_psnr

SCENES = ("night", "stilllife")
NETWORKS = ("paper-bank", "depth-dcnn", "paper-dcnn")
RADII_PX = (2, 4, 8)
TIMES = (3, 10, 40)
TINT = (1.0, 0.8, 0.5)
NEAREST_PER_M = 2.0
FRAME_PX, SCORED_PX = 320, 192
WAY = next(way for way in WAYS if way.name == OURS)


@dataclass(frozen=True)
class Taken:
    """A photo [3, y, x] and its truth. ends: inverse depths in 1/m, [2]. scored_px: of its middle."""

    name: str
    camera: Camera
    wavelengths: Tensor
    ends: Tensor
    photo: Tensor
    truth: Tensor
    glare: Tensor
    scored_px: int | None = None

    def restored(self, system: str, taken_off: bool) -> tuple[Tensor, int]:
        """The image, and how many highlights were taken off."""
        checkpoint = None if system == "wiener" else load_checkpoint(system)
        how = {"checkpoint": checkpoint, "glare": self.glare, "highlights": taken_off}
        image, by = restore(self.photo, self.camera, self.wavelengths, self.ends, **how)
        return image, by.highlights

    def score(self, image: Tensor) -> float:
        return image_psnr(middle(image, self.scored_px), middle(self.truth, self.scored_px))


def middle(image: Tensor, size: int | None) -> Tensor:
    if size is None:
        return image
    return image[(..., *(slice((n - size) // 2, (n + size) // 2) for n in image.shape[-2:]))]


def with_lamp(picture: Tensor, radius: float, times: float) -> Tensor:
    """A disc of light before the middle of a picture [3, y, x]."""
    rows, columns = ((torch.arange(n) - n / 2) for n in picture.shape[-2:])
    cover = (radius + 0.5 - rows[:, None].hypot(columns)).clamp(0, 1)
    return picture * (1 - cover) + times * cover * torch.tensor(TINT)[:, None, None]


def of_pictures(data: Path | None, limit: int | None) -> Iterator[Taken]:
    pictures = photographs(data, limit).pictures
    camera = of_three_lines(systems_of(load_camera("paper-clear"), [NETWORKS[0]])[1].camera)
    lamps = [("plain", 0, 0), *((f"{r}px.{t}", r, t) for r in RADII_PX for t in TIMES)]
    for picture, inverse in zip(pictures, random_depths(pictures, 0, NEAREST_PER_M), strict=True):
        psf = channel_psfs(camera, PAPER_COLOURS, torch.tensor([inverse], dtype=torch.float64))[0].float()
        for name, radius, times in lamps:
            truth = middle(picture.values, FRAME_PX)
            truth = with_lamp(truth, radius, times) if radius else truth
            photo = noisy(through(truth, psf), READ_NOISE, f"{name} {picture.sha256}").clamp(0, 1)
            ends = torch.tensor([0.0, NEAREST_PER_M])
            yield Taken(name, camera, PAPER_COLOURS, ends, photo, truth, torch.zeros(3), SCORED_PX)


def of_scenes() -> Iterator[Taken]:
    for name in SCENES:
        scene = load_scene(name)
        view = render(scored_version(scene.recipe), scene.base)
        system = systems_of(load_camera(scene.recipe.camera, scene.base), [NETWORKS[0]])[1]
        photo = capture_restored(view, WAY, system).photo
        scattered = 1 - channel_weights(system.camera, view.wavelengths) @ unscattered_light(
            system.camera, view.wavelengths
        )
        ends = torch.stack(view.inverse_depth.double().aminmax())
        about = {"photo": photo.image, "truth": photo.ideal, "glare": scattered.float()}
        yield Taken(name, system.camera, view.wavelengths, ends, **about)


@torch.no_grad()
def figures_of(taken: Taken) -> dict[str, float]:
    """Of one photo; {} stands for its name."""
    found = {"psnr_db.{}.photo": taken.score(taken.photo)}
    for system in ("wiener", *NETWORKS):
        for way, taken_off in (("as_it_is", False), ("taken_off", True)):
            image, found["lamps.{}"] = taken.restored(system, taken_off)
            found[f"psnr_db.{{}}.{system}.{way}"] = taken.score(image)
    clock = [time.perf_counter()]
    for taken_off in (True, False):
        taken.restored("wiener", taken_off)
        clock.append(time.perf_counter())
    return {**found, "seconds.{}": clock[1] - clock[0] - (clock[2] - clock[1])}


def measured(data: Path | None, limit: int | None) -> dict[str, float]:
    """Means over the photographs, and each scene."""
    every: dict[str, list[float]] = {}
    for taken in (*of_pictures(data, limit), *of_scenes()):
        found = {figure.format(taken.name): value for figure, value in figures_of(taken).items()}
        print(", ".join(f"{figure} {value:.2f}" for figure, value in found.items()), flush=True)
        for figure, value in found.items():
            every.setdefault(figure, []).append(value)
    return {figure: fmean(values) for figure, values in every.items()}


@torch.no_grad()
def write_picture(path: Path) -> None:
    """The first scene: its photo, and what a network restores with its highlights, and without."""
    taken = next(of_scenes())
    images = [taken.photo, *(taken.restored(NETWORKS[0], taken_off)[0] for taken_off in (False, True))]
    shown = torch.cat([image[:, 100:310, 90:440] for image in images], 2)
    write_png(path, srgb_encode(shown.clamp(0, 1)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.studies.highlights")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--limit", type=int)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    if asked.picture:
        write_picture(asked.picture)
    figures = measured(asked.data, asked.limit)
    if asked.json:
        typed = shlex.join(["python", "-m", "docs.studies.highlights", *sys.argv[1:]])
        write_record(asked.json, record("highlights", figures=figures, typed=typed))
