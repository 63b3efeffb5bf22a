"""What the page of a run is made from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

from ..restore.scores import DepthScore, Score, TruthNoise
from .plot import Plot
from .words import depth_range

IMAGES = ("ideal", "photo", "restored", "wiener", "lens_alone")


@dataclass(frozen=True)
class ImageScore:
    """An image against the ideal one: as a whole, and over the pixels of each depth range."""

    whole: Score
    by_depth: tuple[DepthScore, ...] = ()


@dataclass(frozen=True)
class DepthRange:
    """Depths from near_m to far_m, both included; far_m may be infinite. `name` says what is special."""

    near_m: float
    far_m: float
    name: str = ""

    def mask(self, inverse_depth: Tensor) -> Tensor:
        """Where inverse_depth [y, x] in 1/m lies inside: bool [y, x]. NaN lies nowhere.

        inverse_depth: [y, x], 1/m.
        """
        nearest = math.inf if self.near_m <= 0 else 1 / self.near_m
        slack = 1e-6  # float32 depths that equal a bound belong to the range
        return (inverse_depth <= nearest * (1 + slack)) & (inverse_depth >= 1 / self.far_m * (1 - slack))

    def __str__(self) -> str:
        return depth_range(self.near_m, self.far_m)


@dataclass(frozen=True)
class Psfs:
    """Point spread functions of the three channels at some depths.

    values: [depth, channel, y, x], the fraction of the light through the pupil that lands in each pixel.
    depths_m: one each, infinity is legal.
    pixel_um: the sensor's pitch.
    """

    values: Tensor
    depths_m: tuple[float, ...]
    pixel_um: float

    def __post_init__(self) -> None:
        if self.values.ndim != 4 or self.values.shape[:2] != (len(self.depths_m), 3):
            raise ValueError(
                f"PSFs of shape {list(self.values.shape)} for {len(self.depths_m)} depths; "
                "[depth, 3, y, x] is needed"
            )


@dataclass(frozen=True)
class PlanRow:
    """One effect of a plan.

    error: RMS error of the sensor image if the effect is left out, full scale 1.
    seconds: what simulating it costs. None where unknown.
    lens_alone: what the plan of the photo through the lens alone chooses.
    """

    effect: str
    chosen: bool
    error: float | None = None
    seconds: float | None = None
    why: str = ""
    lens_alone: str = ""


@dataclass(frozen=True)
class RunReport:
    """Everything on the page of a run. Images are linear, [3, y, x], full scale 1, all of one shape.

    title, purpose: name of the scene and what it is for; camera: name of the camera
    ideal, photo, restored, wiener, lens_alone: the images, wiener by Wiener deconvolution where something
        else restored; the last three may be missing
    inverse_depth: [y, x] in 1/m; 0 is infinity
    scores: by image, under the image's name (`photo`, `restored`, `wiener`, `lens_alone`), in the order of
        the table; noises: what they are without, likewise
    psfs: of the camera, optional; height_m: [y, x] height map of the mask in metres, seen from the
        sensor, with mask_width_m the width that it covers, optional
    focus_m: distance in focus without a mask, marked in the figures
    focused: what the lens alone sees when it is focused elsewhere, [3, y, x] by distance in metres
    plan: effects considered; target: what error was asked for, a sentence;
        fidelity: what was simulated, a sentence; cost: its chart, optional
    seconds: time of each stage, in order; peak_memory_mib: largest memory of the process
    recipes: file name and text of each recipe; command: what to type for the same page
    facts: further short facts for the head of the page (size, bands, noise, seed, ...)
    figures: flat record, a dotted name with its unit to a number
    versions, machine: of the packages and of the computer
    colours: [3, 3], matrix to linear sRGB that the images are shown by (`Photo.colours`); None: as they are
    notes: what the reader must know (warnings); labels: other names for the images, by image
    """

    title: str
    purpose: str
    camera: str
    ideal: Tensor
    photo: Tensor
    inverse_depth: Tensor
    restored: Tensor | None = None
    lens_alone: Tensor | None = None
    wiener: Tensor | None = None
    scores: Mapping[str, ImageScore] = field(default_factory=dict)
    noises: Mapping[str, TruthNoise] = field(default_factory=dict)
    psfs: Psfs | None = None
    height_m: Tensor | None = None
    mask_width_m: float | None = None
    focus_m: float | None = None
    focused: Mapping[float, Tensor] = field(default_factory=dict)
    plan: tuple[PlanRow, ...] = ()
    target: str = ""
    fidelity: str = ""
    cost: Plot | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    peak_memory_mib: float | None = None
    recipes: Mapping[str, str] = field(default_factory=dict)
    command: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    versions: Mapping[str, object] = field(default_factory=dict)
    machine: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    restored_label: str = "Restored"
    lens_alone_label: str = "Lens alone"
    colours: Tensor | None = None

    def __post_init__(self) -> None:
        shape = (3, *self.inverse_depth.shape)
        for name, image in self.images().items():
            if tuple(image.shape) != shape:
                raise ValueError(
                    f"{name} has the shape {list(image.shape)}, but the depth asks for {list(shape)}"
                )

        if (self.height_m is None) != (self.mask_width_m is None):
            raise ValueError("height_m and mask_width_m are given together or not at all")

    def images(self) -> dict[str, Tensor]:
        """The images that there are, by name, in the order in which they are shown."""
        every = ((name, getattr(self, name)) for name in IMAGES)
        return {name: image for name, image in every if image is not None}

    def label(self, name: str) -> str:
        """What a reader calls an image or a row of the scores."""
        known = {"restored": self.restored_label, "lens_alone": self.lens_alone_label}
        return known.get(name) or name.replace("_", " ").capitalize()
