"""Photographs as planes at one depth each, photographed and restored: what the paper's tests have in common.

Protocol of Akpinar et al., section "Test Images": 8-bit values are intensities; red, green and blue are 611,
543 and 482 nm; the mask is upsampled to 3 um (bicubic between its wraps) and made with height errors, one
made mask a system. What restores is given which part of the light the made mask spreads evenly. PSNR over all
channels.

Where a picture ends matters, as what lies beyond is unknown. Ours: the frame is the middle of a larger
picture, half a PSF from its border, so that the world goes on and the photo holds light from beyond the
frame. The paper's, as far as it tells: the picture as it is; mirror images continue it here. Both are cut
from one photo, each is restored by itself, and no system is given anything about borders.

Every finished picture is kept in the output folder; the same call goes on from there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..capture import capture
from ..capture.planes import capture_planes, surroundings
from ..core.images import mirrored, write_png
from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera, psf_bank
from ..recipe.fabrication import Fabrication
from ..record import write_csv
from ..render.view import View
from ..report import Gallery, Notes, Picture
from ..report.page import Block
from ..report.pictures import picture_file
from ..report.words import decibels, listed
from ..restore.scores import image_psnr
from .kept import Kept, key_of
from .known_depth import at_known_depth
from .photographs import Photograph, Photographs
from .systems import NEAREST_PER_M, EvaluatedSystem, described, made, of_three_lines, truncated_share

RANDOM = "random"
CHANNELS = ("red", "green", "blue")
SCORES = ("photo_db", "restored_db", "whole_photo_db", "whole_restored_db")
SHOWN_PX = 240
ABOUT = (
    "8-bit values are taken as intensities; red, green and blue are 611, 543 and 482 nm; the mask is sampled "
    "every 3 µm and has height errors. A frame is a crop of a larger picture: the photo includes "
    "light from outside the crop. By the paper's protocol a frame is a whole picture, which mirror images "
    "continue. PSNR over all channels, averaged over the pictures."
)
MIDDLES = "The middle of the frame, pixel for pixel; the PSNR is of the whole frame."


@dataclass(frozen=True)
class Condition:
    """One way to photograph: at a depth (inverse, 1/m; None for a random one a picture, uniform in inverse
    depth over the paper's range), with a read noise relative to full scale, through a mask made so."""

    label: str
    inverse_depth: float | None
    read_noise: float
    fabrication: Fabrication


@dataclass(frozen=True)
class Shown:
    """Middles of a picture, of its photo and of what was restored from it, as PNG files, pixel for pixel."""

    sharp: Path
    photo: Path
    restored: Path

    @classmethod
    def of(cls, folder: Path, picture: str, key: str) -> Shown:
        """picture: its checksum; key: of the finding."""
        names = (f"{picture[:16]}-sharp", f"{key}-sensor", f"{key}-output")
        return cls(*(folder / f"{name}.png" for name in names))

    def write(self, *images: Tensor) -> None:
        """Three, as they are named, [3, y, x]."""
        for path, image in zip(vars(self).values(), images, strict=True):
            write_png(path, middle(image))

    def pair(self, of: str, at: str, where: str, photo_db: float, restored_db: float) -> list[Picture]:
        """Photo and restored image for a gallery. of: the picture; at: the condition; where: the system and
        the condition, as they are read out."""
        return [
            picture_file(
                path, f"{at}, {what}", f"{of}, {what} of {where}: {decibels(db)}.", note=decibels(db)
            )
            for path, what, db in (
                (self.photo, "sensor", photo_db),
                (self.restored, "output", restored_db),
            )
        ]


@dataclass(frozen=True)
class PictureScore:
    """One picture by one system under one condition. inverse_depth in 1/m; PSNRs in dB, of a frame in a world
    that goes on, and, whole_, of the picture as it is, which its mirror images continue. Of a frame, where
    asked for: channels_db, restored, red, green and blue; known_depth_db, all and each, see
    `at_known_depth`."""

    system: str
    picture: str
    condition: str
    inverse_depth: float
    photo_db: float
    restored_db: float
    whole_photo_db: float
    whole_restored_db: float
    shown: Shown | None = None
    channels_db: tuple[float, ...] = ()
    known_depth_db: tuple[float, ...] = ()


@dataclass(frozen=True)
class Job:
    picture: Photograph
    condition: Condition
    inverse_depth: float
    key: str


def measure(
    system: EvaluatedSystem,
    pictures: Sequence[Photograph],
    conditions: Sequence[Condition],
    out: Path,
    *,
    seed: int,
    show: Sequence[str] = (),
    known_depth: bool = False,
    nearest_per_m: float = NEAREST_PER_M,
    progress: Progress | None = None,
) -> list[PictureScore]:
    """Rows of every condition and picture.

    out: folder that keeps them.
    seed: of depths, noise, and height errors.
    show: names of pictures whose middles are written, too.
    known_depth: whether `at_known_depth` restores the photos, too.
    nearest_per_m: inverse depth up to which random ones go.

    Raises InputError where `at_known_depth` is to restore what a lens took whose PSFs vary over the frame.
    """
    work = _Work(system, Kept(out / "finished.jsonl"), out / "pictures", show, known_depth)
    depths = random_depths(pictures, seed, nearest_per_m)
    jobs = []
    for condition in conditions:
        for picture, depth in zip(pictures, depths, strict=True):
            inverse = depth if condition.inverse_depth is None else condition.inverse_depth
            key = key_of(
                system=system.digest,
                picture=picture.sha256,
                label=condition.label,
                depth=f"{inverse:.9g}",
                read_noise=condition.read_noise,
                fabrication=described(condition.fabrication),
                seed=seed,
                known_depth=known_depth,
                scores="within scale",
            )
            jobs.append(Job(picture, condition, inverse, key))
    rows = {job.key: row for job in jobs if (row := work.known(job)) is not None}
    missing = [job for job in jobs if job.key not in rows]
    for fabrication in dict.fromkeys(described(job.condition.fabrication) for job in missing):
        part = [job for job in missing if described(job.condition.fabrication) == fabrication]
        # all depths, finished ones too: the sampling of the pupil follows from the whole set
        whole = [job for job in jobs if described(job.condition.fabrication) == fabrication]
        wanted = sorted({job.inverse_depth for job in whole})
        camera = made(system.camera, part[0].condition.fabrication)
        varies = camera.lens.varies
        _check_sizes(system, part, camera.recipe.psf.window_px, varies and known_depth)
        bank = None if varies else psf_bank(camera, PAPER_COLOURS, wanted)
        for job in part:
            if progress:
                progress(len(rows) / len(jobs), f"{system.name}: {job.condition.label}, {job.picture.name}")
            psf = None if bank is None else bank.values[wanted.index(job.inverse_depth)]
            rows[job.key] = work.finish(job, camera, psf)
    return [rows[job.key] for job in jobs]


def _check_sizes(system: EvaluatedSystem, jobs: Sequence[Job], window: int, one_psf: bool) -> None:
    """Raise InputError for pictures without a middle that is half a window of a PSF from their border, and
    where one PSF is wanted of a lens that has many."""
    if one_psf:
        raise InputError(
            f"the linear restoration that is given the depth has one PSF for the frame, and that of"
            f" {system.name} varies over it: leave that camera out here"
        )
    small = [job.picture.name for job in jobs if min(job.picture.pixels.shape[-2:]) <= 2 * (window // 2)]
    if small:
        raise InputError(
            f"{system.name}: its PSFs have windows of {window} pixels, and {listed(sorted(set(small)))} "
            f"{'are' if len(set(small)) > 1 else 'is'} no larger; take larger pictures (--data), or a "
            "narrower psf.window_px"
        )


def random_depths(
    pictures: Sequence[Photograph], seed: int, nearest_per_m: float = NEAREST_PER_M
) -> list[float]:
    """An inverse depth in 1/m for each picture, decided by the seed and its place in the folder: one that is
    left out changes no other's."""
    last = max(picture.place for picture in pictures)
    generator = torch.Generator().manual_seed(seed * 1_000_003 % 2**64)
    drawn = nearest_per_m * torch.rand(last + 1, generator=generator)
    return [float(drawn[picture.place]) for picture in pictures]


def through(sharp: Tensor, psf: Tensor) -> Tensor:
    """The noise-free photo of a plane [band, y, x] through PSFs [band, w, w]; mirror images continue it.

    sharp: [band, y, x].
    psf: [band, w, w].
    """
    return capture_planes(_continued(sharp, *surroundings(psf.shape[-1]))[None], psf[None])[0]


def over_field(sharp: Tensor, inverse_depth: float, camera: Camera) -> tuple[Tensor, Tensor]:
    """The same through a lens whose PSFs vary over the frame, its axis in the middle; and the fraction of the
    light [band] that the PSFs' windows truncate.

    sharp: [band, y, x].
    """
    margin = camera.recipe.psf.window_px // 2
    how = {"wavelengths": PAPER_COLOURS, "pixel_angle": camera.pixel_angle, "margin": margin}
    view = View.flat(_continued(sharp, margin, margin), inverse_depth, **how, metadata={"hidden": "none"})
    photo = capture(view, of_three_lines(camera), exposure=1.0)
    return photo.clean, photo.truncated


def _continued(sharp: Tensor, before: int, after: int) -> Tensor:
    """A picture [band, y, x] that its mirror images continue by this many pixels."""
    rows, columns = sharp.shape[-2:]
    down = mirrored(torch.arange(-before, rows + after), rows)
    across = mirrored(torch.arange(-before, columns + after), columns)
    return sharp[:, down][:, :, across]


def noisy(photo: Tensor, read_noise: float, key: str) -> Tensor:
    """With read noise (Eq. `SensorImage`), decided by a text.

    photo: [3, y, x].
    """
    seed = int.from_bytes(hashlib.sha256(key.encode()).digest()[:7], "big")
    generator = torch.Generator().manual_seed(seed)
    return photo + read_noise * torch.randn(photo.shape, generator=generator)


def averages(rows: Sequence[PictureScore]) -> dict[str, float]:
    """Mean PSNR in dB: psnr_db.SYSTEM.CONDITION of what was restored, psnr_db.SYSTEM.photo.CONDITION, and
    psnr_db.SYSTEM.whole.CONDITION, psnr_db.SYSTEM.whole.photo.CONDITION of pictures as they are."""
    groups: dict[str, list[float]] = {}
    for row in rows:
        for kind, value in (
            ("", row.restored_db),
            ("photo.", row.photo_db),
            ("whole.", row.whole_restored_db),
            ("whole.photo.", row.whole_photo_db),
        ):
            groups.setdefault(f"psnr_db.{row.system}.{kind}{row.condition}", []).append(value)
    return {name: sum(values) / len(values) for name, values in groups.items()}


def write_rows(path: Path, rows: Sequence[PictureScore], condition: str) -> Path:
    """All rows as CSV; `condition` names that column. Returns the path."""
    header = ("system", "picture", condition, "inverse_depth_per_m", *SCORES)
    return write_csv(
        path,
        header,
        (
            (r.system, r.picture, r.condition, r.inverse_depth, *(getattr(r, name) for name in SCORES))
            for r in rows
        ),
    )


def middle(image: Tensor, size: int = SHOWN_PX) -> Tensor:
    """The middle of an image [..., y, x], at most `size` pixels each way.

    image: [..., y, x].
    """
    top, left = (max(0, (n - size) // 2) for n in image.shape[-2:])
    return image[..., top : top + size, left : left + size]


@dataclass(frozen=True)
class _Work:
    """What finishes the jobs of a system; see `measure`."""

    system: EvaluatedSystem
    kept: Kept
    folder: Path
    show: Sequence[str]
    known_depth: bool

    def known(self, job: Job) -> PictureScore | None:
        """The row of a job that was finished before."""
        found, shown = self.kept.get(job.key), self._shown(job)
        there = shown is None or all(path.is_file() for path in vars(shown).values())
        return None if found is None or not there else self._row(job, found, shown)

    def finish(self, job: Job, camera: Camera, psf: Tensor | None) -> PictureScore:
        """psf: None where it varies over the frame."""
        whole = job.picture.values
        if psf is None:
            clean, glare = over_field(whole, job.inverse_depth, camera)
        else:
            clean, glare = through(whole, psf), truncated_share(psf)
        # the same noise for all systems and strengths, so that they alone make the difference
        taken = noisy(clean, job.condition.read_noise, f"{job.picture.sha256} {job.inverse_depth}")
        sharp, photo = (framed(image, camera.recipe.psf.window_px // 2) for image in (whole, taken))
        with torch.inference_mode():
            restored, whole_restored = (
                self.system.restored(image, glare, job.inverse_depth) for image in (photo, taken)
            )
        if shown := self._shown(job):
            shown.write(sharp, photo, restored)
        compared = ((photo, sharp), (restored, sharp), (taken, whole), (whole_restored, whole))
        found: Json = {name: image_psnr(*pair) for name, pair in zip(SCORES, compared, strict=True)}
        if self.known_depth and psf is not None:
            linear = at_known_depth(photo, psf, job.condition.read_noise)
            found["channels_db"] = channels(restored, sharp)
            found["known_depth_db"] = [image_psnr(linear, sharp), *channels(linear, sharp)]
        self.kept.put(job.key, found)
        return self._row(job, found, shown)

    def _shown(self, job: Job) -> Shown | None:
        return Shown.of(self.folder, job.picture.sha256, job.key) if job.picture.name in self.show else None

    def _row(self, job: Job, found: Json, shown: Shown | None) -> PictureScore:
        about = (self.system.name, job.picture.name, job.condition.label, job.inverse_depth)
        levels = {"channels_db": (), "known_depth_db": (), **found}
        as_kept: Json = {
            name: tuple(value) if name not in SCORES else value for name, value in levels.items()
        }
        return PictureScore(*about, **as_kept, shown=shown)


def channels(image: Tensor, truth: Tensor) -> list[float]:
    """PSNR of each channel.

    image, truth: [channel, y, x].
    """
    return [image_psnr(image[c : c + 1], truth[c : c + 1]) for c in range(len(truth))]


def framed(image: Tensor, reach: int) -> Tensor:
    """The middle of an image [.., y, x], `reach` pixels from its border.

    image: [..., y, x].
    """
    return image[..., reach : image.shape[-2] - reach, reach : image.shape[-1] - reach]


def pairs(rows: Sequence[PictureScore], system: str, said: Callable[[PictureScore], str]) -> Gallery:
    """Sensor and output side by side, condition below condition."""
    pictures: list[Picture] = []
    for row in rows:
        if row.shown is None:
            continue
        where = f"{system}, {said(row)}"
        pictures += row.shown.pair(row.picture, said(row), where, row.photo_db, row.restored_db)
    return Gallery(tuple(pictures), MIDDLES, columns=4, pixels=True, title=system)


def sharp(rows: Sequence[PictureScore], name: str) -> Gallery:
    """The middle of a picture as it is."""
    shown = next(r.shown for r in rows if r.picture == name and r.shown)
    truth = picture_file(shown.sharp, "truth", f"{name}, the middle of the picture as it is.")
    return Gallery((truth,), "The scene.", columns=4, pixels=True)


def left_out(data: Photographs) -> tuple[Block, ...]:
    """Pictures that could not be used, if any."""
    if not data.problems:
        return ()
    names = listed([Path(problem.split(": ")[0]).name for problem in data.problems])
    return (Notes((f"Left out, since they cannot be used: {names}.", *data.problems)),)
