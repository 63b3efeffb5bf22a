"""The training recipe: which camera and network learn together, from what, and for how long."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, model_validator

from ..core.json_values import Json
from .base import Fraction, NotNegative, Positive, RecipeModel, renamed, without
from .camera import PsfSettings
from .kinds import LENSES, MASKS, NETWORKS, TRAINING_DATA, AnyMask, KindModel, NameOf, OfKind, named

Range = tuple[NotNegative, NotNegative]
Count = Annotated[int, Field(ge=1)]


class NetworkTable(RecipeModel):
    """The restorer."""

    kind: Annotated[str, NameOf(NETWORKS)] = "dcnn"
    """which network"""
    settings: Json = {}
    """settings of the network, by its own keys"""
    start: str | None = None
    """checkpoint whose weights it starts from: a file or a shipped name"""
    auxiliary: str | None = None
    """checkpoint of the same mask whose restoration this filter bank sees and saves with it; a D-CNN"""

    @model_validator(mode="before")
    @classmethod
    def _as_once_written(cls, data: object, info: ValidationInfo) -> object:
        data = without(data, "start_share")
        return renamed(data, "beside", "auxiliary", {}, info) if isinstance(data, Mapping) else data


class DoeTable(RecipeModel):
    """What becomes of the camera's mask: `learn.design` says what the design steps do. 1.2 um is the deepest
    mask that Akpinar et al. could make."""

    learn: bool = True
    """whether the mask learns: height maps, Zernike and Fourier terms and rings can"""
    design_steps: Annotated[int, Field(ge=0)] = 0
    """steps on the mask alone before the training, towards the best linear restoration"""
    design_broadband: bool = False
    """whether these see all wavelengths, in place of three lines"""
    design_wanted_db: tuple[tuple[NotNegative, float], ...] = ()
    """pairs of an inverse depth, 1/m, and the PSNR that they want there, dB, ascending: the depths that lack
    most count most; without pairs the mean does"""
    start: str | None = None
    """checkpoint whose height map replaces the recipe's"""
    learning_rate_rad: NotNegative = 5e-3
    """learning rate, radians of phase at the design wavelength; 0 keeps the mask"""
    height_limit_um: Positive = 1.2
    """heights stay between 0 and this, um"""
    height_noise_nm: NotNegative = 40.0
    """standard deviation of the height error that is drawn in each step, nm"""

    @model_validator(mode="before")
    @classmethod
    def _as_once_written(cls, data: object) -> object:
        return without(data, "design_response", "design_evenness")

    @model_validator(mode="after")
    def _ascending(self) -> DoeTable:
        places = [place for place, _ in self.design_wanted_db]
        if any(second <= first for first, second in pairwise(places)):
            raise ValueError(f"design_wanted_db: inverse depths must ascend, and are {places}")
        return self


class LossTable(RecipeModel):
    """Weights of the paper's loss; `restore.losses` says why these. Unpunished, a mask learns to throw light
    out of the PSFs' window, which a real camera would show as veiling glare."""

    alpha: NotNegative = 0.01
    """weight of the gradient prior, relative to the mean absolute error"""
    beta: NotNegative = 10.0
    """how fast the prior's weight falls at edges of the truth"""
    gamma: Annotated[float, Field(gt=0, le=2)] = 0.8
    """exponent of the gradient in the prior"""
    truncated_energy: NotNegative = 0.2
    """weight of the share of the light that leaves the PSFs' window"""
    light_kept: bool = False
    """whether the loss sees images with the truth's lowest spatial frequencies, as in use"""

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, data: object, info: ValidationInfo) -> object:
        return renamed(data, "stray", "truncated_energy", {}, info) if isinstance(data, Mapping) else data


class TrainingSource(KindModel):
    """What is trained on."""

    weight: Positive = 1.0
    """how often patches come from this source, relative to the others"""


AnySource = Annotated[TrainingSource, OfKind(TRAINING_DATA)]


class DataTable(RecipeModel):
    """Patches: their size, the share kept for validation, and where they come from. Each step draws from one
    source, chosen by weight."""

    patch_px: Annotated[int, Field(ge=16, le=2048)] = 300
    """side of the patches, pixels"""
    validation: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    """share of each source that is kept for validation"""
    validation_patches: Count = 16
    """patches that are validated on"""
    sources: Annotated[tuple[AnySource, ...], Field(min_length=1)] = (named("natural"),)
    """what is trained on, each a table with its `kind`"""
    validation_sources: tuple[AnySource, ...] = ()
    """sources for validation alone"""


class CaptureTable(RecipeModel):
    """What varies from photo to photo: inverse depth (uniform; 0 is infinity) and the sensor's noise."""

    inverse_depth_per_m: Range = (0.0, 2.0)
    """range of inverse depths, 1/m, drawn uniformly; 0 is infinity"""
    read_noise: Range = (0.001, 0.015)
    """range of the read noise, relative to full scale, in place of the camera's; all else that its sensor
    does is as in its recipe"""

    @model_validator(mode="after")
    def _ascending(self) -> CaptureTable:
        for name in ("inverse_depth_per_m", "read_noise"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} must ascend, not go from {low:g} to {high:g}")
        return self


class CamerasTable(RecipeModel):
    """Random cameras in place of one, drawn from these ranges by the recipe's seed."""

    count: Count = 64
    """cameras to train with"""
    validation: Count = 8
    """other cameras to validate with"""
    lenses: Annotated[tuple[Annotated[str, NameOf(LENSES)], ...], Field(min_length=1)] = ("ideal",)
    """kinds of lens, in turn"""
    focal_length_mm: tuple[Positive, Positive] = (5.0, 50.0)
    """range of focal lengths, mm, drawn evenly in their logarithm"""
    f_number: tuple[Positive, Positive] = (2.0, 9.0)
    """range of f-numbers, drawn evenly in their logarithm"""
    pixel_um: tuple[Positive, Positive] = (1.4, 8.0)
    """range of pixel pitches, um, drawn evenly in their logarithm"""
    focus_distance_m: tuple[Positive, Positive] = (0.7, 3.0)
    """range of focus distances, m, drawn evenly in inverse distance"""
    nearest_per_m: tuple[Positive, Positive] = (0.5, 2.0)
    """range of the inverse distance of the nearest thing, 1/m, from half of the first on"""
    blur_px: tuple[Positive, Positive] = (3.0, 120.0)
    """range that the widest blur without a mask must lie in, pixels; other cameras are drawn anew"""
    masks: Annotated[tuple[Annotated[str, NameOf(MASKS)], ...], Field(min_length=1)] = ("clear",)
    """kinds of mask, in turn"""
    strength_rad: tuple[Positive, Positive] = (8.0, 40.0)
    """range of the masks' strengths, rad, drawn evenly in their logarithm"""
    broadband: Annotated[float, Field(ge=0, le=1)] = 0.5
    """share of the sensors that see all wavelengths in place of three"""
    window_px: Annotated[int, Field(ge=8, le=512)] = 96
    """side of the PSFs' window, pixels"""


class OptimiserTable(RecipeModel):
    """Adam as in the paper. Several updates of the network a step save the time of the optics. Frozen
    statistics are those of use, as a batch of patches has other means than a photo. Pascanu et al. (ICML
    2013) clip gradients so."""

    steps: Count = 100_000
    """steps of the training"""
    batch: Count = 4
    """patches a step"""
    learning_rate: Positive = 1e-3
    """learning rate of the network (Adam)"""
    betas: tuple[Fraction, Fraction] = (0.9, 0.999)
    """decay of Adam's means of gradients and of their squares"""
    weight_decay: NotNegative = 1e-4
    """weight decay"""
    decay: Literal["cosine", "none"] = "cosine"
    """"cosine": rates fall along half a cosine to `final_rate` of themselves; "none": they stay"""
    final_rate: Fraction = 0.01
    """share of the learning rate at the end"""
    warmup: Fraction = 0.0
    """share of the steps, the first, in which the rate rises"""
    network_steps: Count = 1
    """updates of the network a step; the mask learns in the first, the others use its PSFs again"""
    frozen_statistics: Annotated[float, Field(ge=0, le=1)] = 0.0
    """share of the steps, the last, in which batch normalisation uses its running means"""
    clip_gradient: Positive | None = None
    """longest gradient of the network; longer ones are shortened to it"""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """number format of the network; "auto": bfloat16 where the processor has fast units for it"""


class JournalTable(RecipeModel):
    """How often, in steps, something is written."""

    log_every: Count = 50
    """steps between lines of the log"""
    validate_every: Count = 1000
    """steps between validations"""
    save_every: Count = 500
    """steps between checkpoints"""
    pictures_every: Count = 2000
    """steps between pictures"""

    @model_validator(mode="before")
    @classmethod
    def _as_once_written(cls, data: object) -> object:
        return without(data, "tensorboard")


class TrainRecipe(RecipeModel):
    """A training recipe. `camera` is a file or a shipped name; `mask`, `psf` replace the camera's own."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    """name of the training: letters, digits, _ and -, at most 64"""
    purpose: str = ""
    """what the training is for, in a sentence"""
    camera: str
    """camera: a shipped name or a file"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    """seed of everything random"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """where to train; "auto" takes a GPU where there is one"""
    mask: AnyMask | None = None
    """mask in place of the camera's"""
    psf: PsfSettings | None = None
    """PSF settings in place of the camera's"""
    network: NetworkTable = NetworkTable()
    """the restoring network"""
    doe: DoeTable = DoeTable()
    """training of the camera's mask"""
    loss: LossTable = LossTable()
    """weights of the loss"""
    data: DataTable = Field(default_factory=DataTable)
    """what is trained on"""
    capture: CaptureTable = CaptureTable()
    """what varies from photo to photo"""
    cameras: CamerasTable | None = None
    """random cameras in place of one"""
    optimiser: OptimiserTable = OptimiserTable()
    """optimiser and its rates"""
    journal: JournalTable = JournalTable()
    """how often something is written"""
