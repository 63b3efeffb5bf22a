"""What knowing how far a chart is is worth to the filter that restores it.

`python -m docs.studies.distances [--json FILE]` photographs the USAF chart at half a metre through the
learned mask and restores it by the linear filter of 25 pixels, as many as the paper's D-CNN sees, with the
least mean square error for photographs: one for all distances from half a metre to infinity, and those for
the nearest half, quarter, eighth and sixteenth of that range (in inverse distance). Wider filters of 35
pixels next to.
Figures: `psnr_db.WIDTH.PARTS`, and each colour's.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

import torch
from torch.nn.functional import conv2d

from edofsim.capture.planes import capture_planes, surroundings
from edofsim.experiments.photographs import chart
from edofsim.optics import PAPER_COLOURS, mean_psfs
from edofsim.record import record, write_record
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.linear import local_filters

WIDTHS = (25, 35)  # pixels
PARTS = (1, 2, 4, 8, 16)  # of the range of distances
DEPTHS = 16
NEAREST_PER_M = 2.0
WINDOW = 96
READ_NOISE, HEIGHT_NOISE = 0.005, 30e-9
COLOURS = ("red", "green", "blue")


@torch.no_grad()
def restored() -> dict[str, float]:
    """PSNR of the middle of the chart by the filters above."""
    checkpoint = load_checkpoint("paper-dcnn")
    camera = camera_with_mask(trained_camera(checkpoint), checkpoint)
    depths = NEAREST_PER_M * (torch.arange(DEPTHS, dtype=torch.float64) + 1) / DEPTHS
    psf = mean_psfs(camera, PAPER_COLOURS, depths, HEIGHT_NOISE, window_px=WINDOW)
    psf = psf / psf.sum((-1, -2), keepdim=True)
    image = chart(None).pixels.float() / 255
    before, after = surroundings(WINDOW)
    ideal = image[:, before : image.shape[-2] - after, before : image.shape[-1] - after]
    photo = capture_planes(image[None], psf[-1:].float())
    photo = photo + READ_NOISE * torch.randn(photo.shape, generator=torch.Generator().manual_seed(0))
    found = {}
    for width in WIDTHS:
        for parts in PARTS:
            filters = local_filters(psf.double(), width, parts, READ_NOISE)[-1].float()
            border = width // 2
            error = conv2d(photo, filters)[0].clamp(0, 1) - ideal[:, border:-border, border:-border]
            squares = error.square().mean((-1, -2))
            name = f"psnr_db.{width}px.{parts}"
            found[name] = float(-10 * squares.mean().log10())
            colours = zip(COLOURS, squares, strict=True)
            found |= {f"{name}.{colour}": float(-10 * square.log10()) for colour, square in colours}
            print(f"{width} pixels, 1/{parts} of the range: {found[name]:.2f} dB", flush=True)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.studies.distances")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    figures = restored()
    if asked.json:
        typed = shlex.join(["python", "-m", "docs.studies.distances", *sys.argv[1:]])
        write_record(asked.json, record("distances", figures=figures, typed=typed))
