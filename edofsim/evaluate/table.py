"""The paper's table of methods: planes at one depth, photographed and restored by each system.

Protocol of Akpinar et al., section "Test Images": 8-bit values are intensities; red, green and blue are 611,
543 and 482 nm; the mask is upsampled to 3 um (bicubic) and made with a height error of 30 nm, one made mask a
system; read noise 0.005. For the average each picture stands at a random depth, uniform in inverse depth over
[0.5 m, infinity], the same for all systems; then all pictures at 0.5, 0.8 and 1.0 m. Where light comes from
beyond a picture, its mirror image goes on. PSNR over all channels, averaged over the pictures.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import EdofsimError
from ..learn.imaging import photograph, surroundings
from ..learn.sources import Images, mirrored, read_folder
from ..learn.system import COLOURS
from ..optics import Camera, psf_bank
from ..recipe.camera import CameraRecipe
from ..recipe.fabrication import Fabrication
from ..recipe.load import load_camera
from ..restore.checkpoint import camera_with_mask, load_checkpoint, shipped_checkpoints, trained_camera
from ..restore.network import apply_network
from ..restore.wiener import wiener
from .scores import psnr

Progress = Callable[[float, str], None]
READ_NOISE = 0.005
DEPTHS_M = (0.5, 0.8, 1.0)
NEAREST_PER_M = 2.0
SMALLEST_PX = 64
FILTER_DEPTHS = 9
WITHOUT_TRAINING = ("paper-clear", "paper-cubic")


@dataclass(frozen=True)
class Contestant:
    """A system of the table. camera: with its made mask; height: [n, n] in metres or None for the mask of the
    recipe; restore: [3, y, x] to [3, y, x]."""

    name: str
    camera: Camera
    height: Tensor | None
    restore: Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Row:
    """One picture by one system: depth is "random" or the distance."""

    system: str
    picture: str
    depth: str
    inverse_depth: float
    photo_db: float
    restored_db: float


def run(
    out: Path,
    data: Path,
    *,
    systems: Sequence[str | Path] | None = None,
    seed: int = 0,
    limit: int | None = None,
    progress: Progress | None = None,
) -> dict[str, float]:
    """Write OUT/table.csv and return the averages.

    data: folder of pictures. systems: checkpoints (files or shipped names) and shipped cameras whose photos
    Wiener deconvolution restores; None for all that ship, with the clear and the cubic aperture. seed: of
    depths, noise and height error. limit: only so many pictures. Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,
    1m} of the restored pictures, psnr_db.SYSTEM.photo.* of the photos. Raises InputError for pictures and
    systems that cannot be used.
    """
    images = _first(read_folder(data, SMALLEST_PX), limit)
    contestants = [contestant(name, seed) for name in systems or (*shipped_checkpoints(), *WITHOUT_TRAINING)]
    rows: list[Row] = []
    for index, system in enumerate(contestants):

        def part(done: float, index: int = index, name: str = system.name) -> None:
            if progress:
                progress((index + done) / len(contestants), name)

        rows += judge(system, images, seed, part)
    _write(out / "table.csv", rows)
    return averages(rows)


def contestant(source: str | Path, seed: int) -> Contestant:
    """A system from a checkpoint, or from a shipped camera by name with Wiener deconvolution."""
    if str(source) in WITHOUT_TRAINING:
        recipe, height = load_camera(source).recipe, None
        camera = made(recipe, seed)
        stack = filter_psfs(Camera.from_recipe(recipe))
        return Contestant(f"{source}+wiener", camera, None, lambda photo: _filtered(photo, stack))
    checkpoint = load_checkpoint(source)
    recipe = camera_with_mask(trained_camera(checkpoint), checkpoint)
    height = checkpoint.height
    recipe = recipe.model_copy(update={"psf": CameraRecipe(name="default").psf})
    return Contestant(
        checkpoint.name, made(recipe, seed), height, lambda photo: apply_network(checkpoint.network, photo)
    )


def made(recipe: CameraRecipe, seed: int) -> Camera:
    """The camera with its mask as the paper tests it: at 3 um with 30 nm of height error. Masks without
    relief have no such error."""
    if hasattr(recipe.mask, "design_wavelength_nm"):
        fabrication = Fabrication(preset="paper-test", seed=seed)
        return Camera.from_recipe(recipe.model_copy(update={"fabrication": fabrication}))
    return Camera.from_recipe(recipe)


def judge(
    system: Contestant, images: Images, seed: int, progress: Callable[[float], None] | None = None
) -> list[Row]:
    """All pictures at their random depths, then at each of `DEPTHS_M`."""
    random_depths = NEAREST_PER_M * torch.rand(len(images.names), generator=_generator(seed, 0))
    fixed = [1 / metres for metres in DEPTHS_M]
    bank = psf_bank(
        system.camera, COLOURS, [*random_depths.tolist(), *fixed], height=system.height, seed=seed
    )
    jobs = [(i, i, "random") for i in range(len(images.names))]
    for number, metres in enumerate(DEPTHS_M):
        jobs += [(i, len(images.names) + number, f"{metres:g}m") for i in range(len(images.names))]
    rows = []
    for done, (picture, depth, label) in enumerate(jobs):
        sharp = images.pictures[picture].to(torch.float32) / 255
        photo = noisy(_photo(sharp, bank.values[depth]), _generator(seed, 1 + done))
        with torch.inference_mode():
            restored = system.restore(photo)
        inverse = float(bank.inverse_depths[depth])
        name = images.names[picture]
        rows.append(Row(system.name, name, label, inverse, psnr(photo, sharp), psnr(restored, sharp)))
        if progress:
            progress((done + 1) / len(jobs))
    return rows


def averages(rows: Sequence[Row]) -> dict[str, float]:
    """Mean PSNR in dB of each system and depth."""
    groups: dict[str, list[float]] = {}
    for row in rows:
        groups.setdefault(f"psnr_db.{row.system}.{row.depth}", []).append(row.restored_db)
        groups.setdefault(f"psnr_db.{row.system}.photo.{row.depth}", []).append(row.photo_db)
    return {name: sum(values) / len(values) for name, values in groups.items()}


def filter_psfs(camera: Camera) -> Tensor:
    """PSFs over the depth range, [depth, 3, y, x], of the mask as designed: what a filter knows."""
    depths = torch.linspace(0, NEAREST_PER_M, FILTER_DEPTHS, dtype=torch.float64)
    return psf_bank(camera, COLOURS, depths).values


def noisy(photo: Tensor, generator: torch.Generator) -> Tensor:
    """With read noise (Eq. `SensorImage`)."""
    return photo + READ_NOISE * torch.randn(photo.shape, generator=generator)


def _photo(sharp: Tensor, psf: Tensor) -> Tensor:
    """[3, y, x] through PSFs [3, w, w], continued by its mirror images."""
    before, after = surroundings(psf.shape[-1])
    rows, columns = sharp.shape[-2:]
    down = mirrored(-before, rows + before + after, rows)
    across = mirrored(-before, columns + before + after, columns)
    return photograph(sharp[:, down][:, :, across][None], psf[None])[0]


def _filtered(photo: Tensor, stack: Tensor) -> Tensor:
    return wiener(photo, stack, READ_NOISE).clamp(0, 1)


def _first(images: Images, limit: int | None) -> Images:
    return Images(images.pictures[:limit], images.names[:limit], images.sha256)


def _generator(seed: int, number: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed * 1_000_003 + number)


def _write(path: Path, rows: Sequence[Row]) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["system", "picture", "depth", "inverse_depth_per_m", "photo_db", "restored_db"])
            for row in rows:
                numbers = (f"{row.inverse_depth:.6f}", f"{row.photo_db:.4f}", f"{row.restored_db:.4f}")
                writer.writerow([row.system, row.picture, row.depth, *numbers])
    except OSError as error:
        raise EdofsimError(f"{path}: cannot be written ({error.strerror}); choose another --out") from None
