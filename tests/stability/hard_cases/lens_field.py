"""Photos through traced lenses by their own plans, 512 x 384 pixels, against PSFs of 33 x 25 places.

Each of these has PSFs of its own at every depth and band; light is blurred and composited by those of the
four around it. A slope fills the frame; discs before it, which hide a part of it, one of them in a corner,
where pupils are cut to cat's eyes, have edges out of focus.

    python tests/stability/hard_cases/lens_field.py [CAMERA...] [--bands N] [--out DIR]   # goes on if stopped
    python tests/stability/hard_cases/lens_field.py [CAMERA...] --others      # and other ways, of flat scenes
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from edofsim.capture import Fidelity, capture
from edofsim.capture.crop import crop
from edofsim.capture.prepare import blur_per_dioptre, channel_weights
from edofsim.optics import Camera
from edofsim.optics.field import Frame, relative_light
from edofsim.optics.psf import psf_bank
from edofsim.plan import parse_target, plan_photo
from edofsim.recipe.load import load_camera
from edofsim.render.view import View
from edofsim.restore.scores import psnr

WIDTH, HEIGHT = 512, 384
STEP, STRIP = 16, 96
"""Pixels between the places of the truth, and rows of it that are computed, and kept, together."""
BANDS = 3
ASKED = {"double-gauss-50mm-f4": 50, "doublet-25mm-f6": 50, "aspheres-5mm-f3": 45}
"""dB that plans promise."""
SLOPE_PX, NEAR_PX = 6.0, 14.0
"""Blur at both ends of the slope, and of the discs."""
DISCS = ((330, 450, 34), (200, 250, 30), (40, 90, 26))
"""(y, x, radius) in the frame."""
TRUTH = Fidelity(layers_db=70.0, field_step_px=STEP, field_terms=False)
SIDES = {"optiland": 5, "DeepLens": 10}
"""Places along a side: of a decomposition without weights, and of tiles with hard edges."""
RANK = 4
"""Terms of the decomposition: the mean and three."""


def camera_of(name: str) -> Camera:
    return Camera.from_recipe(load_camera(name).recipe)


def view_of(camera: Camera, bands: int = BANDS, blur_px: float | None = None) -> View:
    """Blocks of random light on the slope and the discs; blur_px: on a plane that is blurred by so much."""
    margin = camera.recipe.psf.window_px // 2
    rows, columns = HEIGHT + 2 * margin, WIDTH + 2 * margin
    blocks = torch.rand(bands, rows // 4, columns // 4, generator=torch.Generator().manual_seed(1))
    light = interpolate(blocks[None], (rows, columns))[0]
    y, x = torch.meshgrid(torch.arange(rows) - margin, torch.arange(columns) - margin, indexing="ij")
    focus, a_pixel = 1 / camera.recipe.focus.distance_m, 1 / blur_per_dioptre(camera)
    depth = focus + a_pixel * SLOPE_PX * (x / (WIDTH / 2) - 1).clamp(-1, 1)
    if blur_px is not None:
        depth = torch.full_like(depth, focus + a_pixel * blur_px)
    view = View.flat(
        light,
        depth,
        wavelengths=torch.linspace(450e-9, 650e-9, bands, dtype=torch.float64),
        pixel_angle=camera.pixel_angle,
        margin=margin,
        metadata={"hidden": "known"},
    )
    if blur_px is not None:
        return view
    discs = [(y - down) ** 2 + (x - right) ** 2 < radius**2 for down, right, radius in DISCS]
    return with_nearer(view, torch.stack(discs).any(0), focus + a_pixel * NEAR_PX)


def with_nearer(view: View, which: Tensor, inverse_depth: float) -> View:
    """A flat view with some of its pixels at another inverse depth [1/m], and behind these its own surface,
    in the light of other pixels.

    which: bool [y, x].
    """
    near = torch.nonzero(which.flatten()).squeeze(1)
    pixel = torch.cat([view.pixel, near])
    order = pixel.argsort(stable=True)
    seen = torch.where(which.flatten(), inverse_depth, view.inverse_depth)
    return replace(
        view,
        pixel=pixel[order],
        coverage=torch.ones(len(order)),
        inverse_depth=torch.cat([seen, view.inverse_depth[near]])[order],
        radiance=torch.cat([view.radiance, view.radiance.flip(1)[:, near]], 1)[:, order],
        hidden=(torch.arange(len(order)) >= len(seen))[order],
    )


def photo(view: View, camera: Camera, fidelity: Fidelity, folder: Path) -> Tensor:
    """[channel, y, x], with the veiling glare of what its PSFs' window leaves out."""
    return capture(view, camera, fidelity, exposure=1.0, cache=folder).clean


def part_of_truth(view: View, camera: Camera, folder: Path, fidelity: Fidelity = TRUTH) -> Tensor:
    """[channel, y, x] without veiling glare, of which a part of a frame has another; the window is whole."""
    module = sys.modules[capture.__module__]
    with_glare = module.glare_of
    with mock.patch.object(module, "glare_of", lambda *of: tuple(0 * each for each in with_glare(*of))):
        return photo(view, camera, fidelity, folder)


def glare_of_frame(view: View, camera: Camera, folder: Path) -> Tensor:
    """[channel, y, x]."""
    axis = TRUTH.changed({"field_step_px": 0})
    return photo(view, camera, axis, folder) - part_of_truth(view, camera, folder, axis)


def truth(view: View, camera: Camera, folder: Path, strips: range) -> Iterator[tuple[slice, Tensor]]:
    """Rows of the photo by PSFs of each place, [channel, row, x], with the glare of the whole frame, by PSFs
    of the axis; rows that a folder holds are not computed again."""
    folder.mkdir(parents=True, exist_ok=True)
    glare = glare_of_frame(view, camera, folder)
    for strip in strips:
        rows, path = slice(strip * STRIP, (strip + 1) * STRIP), folder / f"rows-{strip}.pt"
        if not path.exists():
            begun = time.process_time()
            part = crop(view, rows.start, 0, STRIP, WIDTH, view.margin)
            torch.save(part_of_truth(part, camera, folder), path)
            print(f"  rows {rows.start} to {rows.stop}: {time.process_time() - begun:.0f} s", flush=True)
        yield rows, torch.load(path) + glare[:, rows]


def reached(
    name: str, folder: Path, bands: int = BANDS, strips: range = range(HEIGHT // STRIP)
) -> tuple[float, float]:
    """PSNR [dB] of the photo that the plan makes, and of one by the PSFs of the axis, in some strips."""
    camera = camera_of(name)
    view = view_of(camera, bands)
    plan = plan_photo(view, camera, None, parse_target(f"{ASKED[name]}dB", None), every_effect=False)
    planned = photo(view, camera, plan.fidelity, folder)
    axis = photo(view, camera, plan.fidelity.changed({"field_step_px": 0}), folder)
    true = list(truth(view, camera, folder, strips))
    whole = torch.cat([part for _, part in true], 1)
    of_plan, of_axis = (
        psnr(torch.cat([each[:, rows] for rows, _ in true], 1), whole) for each in (planned, axis)
    )
    return of_plan, of_axis


def others(name: str, folder: Path, blur_px: float) -> Iterator[tuple[str, float, float]]:
    """Ways to a photo of a plane: PSNR [dB], and seconds that they take once their PSFs are known. All have
    the light of the places, and the glare of the frame."""
    camera = camera_of(name)
    view = view_of(camera, blur_px=blur_px)
    rows = slice(HEIGHT - STRIP, HEIGHT)  # next to a corner
    true = torch.cat([part for _, part in truth(view, camera, folder, range(3, 4))], 1)
    plan = plan_photo(view, camera, None, parse_target(f"{ASKED[name]}dB", None), every_effect=False)
    photo(view, camera, plan.fidelity, folder)
    begun = time.process_time()
    yield "ours", psnr(photo(view, camera, plan.fidelity, folder)[:, rows], true), time.process_time() - begun
    glare = glare_of_frame(view, camera, folder)
    weights = channel_weights(camera, view.wavelengths).float()
    light = view.radiance.reshape(view.bands, *view.padded_shape)
    for way, image in (("optiland", decomposed), ("DeepLens", tiled)):
        psfs = psfs_at(camera, view, SIDES[way], at_edges=way == "optiland")
        begun = time.process_time()
        found = torch.einsum("cb,byx->cyx", weights, image(light, psfs, view.margin))
        taken = time.process_time() - begun
        yield way, psnr((found + glare)[:, rows], true), taken


def psfs_at(camera: Camera, view: View, side: int, at_edges: bool) -> Tensor:
    """[down, across, band, y, x], of places from edge to edge, or in the middles of tiles."""
    frame = Frame.about(HEIGHT, WIDTH, camera)
    parts = torch.arange(side) / (side - 1) if at_edges else (torch.arange(side) + 0.5) / side
    found = []
    for down in parts.tolist():
        for across in parts.tolist():
            here = camera.seen_at(frame.field(down * HEIGHT, across * WIDTH))
            depth = view.inverse_depth[:1].double()
            found.append(psf_bank(here, view.wavelengths, depth).values[0] * relative_light(here))
    return torch.stack(found).unflatten(0, (side, side))


def convolved(light: Tensor, psfs: Tensor) -> Tensor:
    """[..., y, x], the same part of the frame."""
    size = [a + b for a, b in zip(light.shape[-2:], psfs.shape[-2:], strict=True)]
    both = torch.fft.rfft2(light, s=size) * torch.fft.rfft2(psfs, s=size)
    half = psfs.shape[-1] // 2
    return torch.fft.irfft2(both, s=size)[..., half : half + light.shape[-2], half : half + light.shape[-1]]


def decomposed(light: Tensor, psfs: Tensor, margin: int) -> Tensor:
    """By the mean and `RANK` - 1 singular vectors of each band; maps of their weights are enlarged linearly,
    and light is multiplied by these before it is blurred."""
    side = len(psfs)
    image = torch.zeros(len(light), HEIGHT, WIDTH)
    inside = slice(margin, margin + HEIGHT), slice(margin, margin + WIDTH)
    for band, own in enumerate(psfs.flatten(0, 1).transpose(0, 1).flatten(2)):
        mean = own.mean(0, keepdim=True)
        left, values, vectors = torch.linalg.svd(own - mean, full_matrices=False)
        kernels = torch.cat([mean, vectors[: RANK - 1]]).unflatten(1, psfs.shape[-2:])
        weights = torch.cat([torch.ones(len(own), 1), left[:, : RANK - 1] * values[: RANK - 1]], 1)
        maps = weights.T.reshape(1, RANK, side, side)
        maps = interpolate(maps, (HEIGHT, WIDTH), mode="bilinear", align_corners=True)
        maps = torch.nn.functional.pad(maps, (margin,) * 4, mode="replicate")[0]
        image[band] = convolved(light[band] * maps, kernels).sum(0)[inside]
    return image


def tiled(light: Tensor, psfs: Tensor, margin: int) -> Tensor:
    """Each tile by the PSF of its middle."""
    side = len(psfs)
    image = torch.zeros(len(light), HEIGHT, WIDTH)
    edges = [[round(part * size / side) for part in range(side + 1)] for size in (HEIGHT, WIDTH)]
    for down in range(side):
        for across in range(side):
            top, bottom = edges[0][down : down + 2]
            left, right = edges[1][across : across + 2]
            around = light[:, top : bottom + 2 * margin, left : right + 2 * margin]
            blurred = convolved(around, psfs[down, across])
            image[:, top:bottom, left:right] = blurred[
                :, margin : margin + bottom - top, margin : margin + right - left
            ]
    return image


def _main() -> None:
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("cameras", nargs="*", default=list(ASKED))
    reader.add_argument("--bands", type=int, default=BANDS)
    reader.add_argument("--strips", default="0,1,2,3", help="of 96 rows each")
    reader.add_argument("--others", action="store_true")
    reader.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "edofsim-lens-field")
    given = reader.parse_args()
    for name in given.cameras:
        if given.others:
            for blur in (0.0, NEAR_PX):
                for way, found, seconds in others(name, given.out / f"{name}-flat-{blur:g}", blur):
                    print(f"{name:22} {way:9} blur {blur:2g} px {found:6.2f} dB {seconds:6.2f} s", flush=True)
            continue
        strips = range(*[int(given.strips.split(",")[0]), int(given.strips.split(",")[-1]) + 1])
        found, axis = reached(name, given.out / f"{name}-{given.bands}", given.bands, strips)
        met = "" if found >= ASKED[name] - 1 else "  MISSED"
        print(f"{name:22} {ASKED[name]} dB asked, {found:.2f} dB; axis {axis:.2f} dB{met}", flush=True)


if __name__ == "__main__":
    _main()
