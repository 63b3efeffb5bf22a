"""The training recipe: which camera and network learn together, from what, and for how long."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, model_validator

from ..core.json_values import Json
from .base import Fraction, NotNegative, Positive, RecipeModel, renamed
from .camera import PsfSettings
from .kinds import LENSES, MASKS, NETWORKS, TRAINING_DATA, AnyMask, KindModel, NameOf, OfKind, named

Range = tuple[NotNegative, NotNegative]
Count = Annotated[int, Field(ge=1)]


class NetworkTable(RecipeModel):
    """The restorer. `start`: checkpoint (file or shipped name) whose weights it starts from. start_share:
    what is saved in the end is a mean of the weights and those at the start, which have this share: of a
    training on new kinds of photos the old kinds then lose less than the new ones gain (Wortsman et al.,
    CVPR 2022). `validation`: the share from 0 to 0.8, in steps of 0.2, whose validation loss is least.
    beside: checkpoint (file or shipped name) of the same mask, whose network restores each photo for this one
    to see; it is kept as it is, and saved with it. Filter banks take a D-CNN."""

    kind: Annotated[str, NameOf(NETWORKS)] = "dcnn"
    settings: Json = {}
    start: str | None = None
    start_share: Annotated[float, Field(ge=0, lt=1)] | Literal["validation"] = 0.0
    beside: str | None = None

    @model_validator(mode="after")
    def _startable(self) -> NetworkTable:
        if self.start_share and self.start is None:
            raise ValueError(f"start_share = {self.start_share} needs a start")
        return self


class DoeTable(RecipeModel):
    """What becomes of the camera's mask.

    learn: a height map, Zernike or Fourier terms and rings can learn, the other masks are kept. start:
    checkpoint whose height map is taken in place of the recipe's. learning_rate_rad: in radians of phase at
    the mask's design wavelength; 0 keeps what `design_steps` made. height_limit_um: heights stay between 0
    and this, the deepest relief that Akpinar et al. could make. design_steps: before the training, this many
    steps on the mask alone, towards the best linear restoration (see `learn.design`). design_response: half
    of what they judge is light of all wavelengths through the sensor's response, beside the three colours.
    design_evenness: weight of the mean error, which the worst depths decide, beside its mean logarithm.
    """

    learn: bool = True
    design_steps: Annotated[int, Field(ge=0)] = 0
    design_response: bool = False
    design_evenness: NotNegative = 0.0
    start: str | None = None
    learning_rate_rad: NotNegative = 5e-3
    height_limit_um: Positive = 1.2
    height_noise_nm: NotNegative = 40.0


class LossTable(RecipeModel):
    """alpha, beta, gamma of the paper's loss; `restore.losses` says why these. truncated_energy: weight of
    the fraction of light that leaves the PSFs' window: unpunished, a mask learns to throw light out of it,
    which a real camera would show as veiling glare. light_kept: what is judged has the lowest spatial
    frequencies of the truth, as in use it gets those of the photo (see `restore.light`), and is made as in
    use, at borders too."""

    alpha: NotNegative = 0.01
    beta: NotNegative = 10.0
    gamma: Annotated[float, Field(gt=0, le=2)] = 0.8
    truncated_energy: NotNegative = 0.2
    light_kept: bool = False

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, data: object, info: ValidationInfo) -> object:
        return renamed(data, "stray", "truncated_energy", {}, info) if isinstance(data, Mapping) else data


class TrainingSource(KindModel):
    """What is trained on. weight: how often patches are drawn from it, beside the other sources."""

    weight: Positive = 1.0


AnySource = Annotated[TrainingSource, OfKind(TRAINING_DATA)]


class DataTable(RecipeModel):
    """Patches: their size, the share kept for validation, and where they come from. Each step draws from one
    source, chosen by weight. validation_sources: nothing of these is trained on; they are for validation,
    beside what is kept of the others."""

    patch_px: Annotated[int, Field(ge=16, le=2048)] = 300
    validation: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    validation_patches: Count = 16
    sources: Annotated[tuple[AnySource, ...], Field(min_length=1)] = (named("natural"),)
    validation_sources: tuple[AnySource, ...] = ()


class CaptureTable(RecipeModel):
    """What varies from photo to photo: inverse depth (uniform; 0 is infinity) and the sensor's noise."""

    inverse_depth_per_m: Range = (0.0, 2.0)
    read_noise: Range = (0.001, 0.015)

    @model_validator(mode="after")
    def _ascending(self) -> CaptureTable:
        for name in ("inverse_depth_per_m", "read_noise"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} must ascend, not go from {low:g} to {high:g}")
        return self


class CamerasTable(RecipeModel):
    """Random cameras in place of one: `count` to train with, `validation` others to validate with, drawn from
    these ranges by the recipe's seed. Focal lengths, f-numbers, pixels, strengths of masks and the read noise
    of `capture` are drawn evenly in their logarithm, the focus in inverse distance. nearest_per_m: inverse
    distance of the nearest thing, from less than half of the first to the second. blur_px: cameras whose
    widest blur over their depth range, without mask, is not within it are drawn anew. broadband: the share of
    sensors that see all wavelengths in place of three. masks: kinds, in turn. window_px: of the PSFs. steps:
    so many draws of photos follow with one camera."""

    count: Count = 64
    validation: Count = 8
    lenses: Annotated[tuple[Annotated[str, NameOf(LENSES)], ...], Field(min_length=1)] = ("ideal",)
    focal_length_mm: tuple[Positive, Positive] = (5.0, 50.0)
    f_number: tuple[Positive, Positive] = (2.0, 9.0)
    pixel_um: tuple[Positive, Positive] = (1.4, 8.0)
    focus_distance_m: tuple[Positive, Positive] = (0.7, 3.0)
    nearest_per_m: tuple[Positive, Positive] = (0.5, 2.0)
    blur_px: tuple[Positive, Positive] = (3.0, 120.0)
    masks: Annotated[tuple[Annotated[str, NameOf(MASKS)], ...], Field(min_length=1)] = ("clear",)
    strength_rad: tuple[Positive, Positive] = (8.0, 40.0)
    broadband: Annotated[float, Field(ge=0, le=1)] = 0.5
    window_px: Annotated[int, Field(ge=8, le=512)] = 96


class OptimiserTable(RecipeModel):
    """Adam as in the paper, for `steps` steps of `batch` patches. decay: the rate of network and mask falls
    along half a cosine to `final_rate` of itself, or stays, as in the paper. warmup: this share of the steps
    comes first, with the rate rising. network_steps: updates of the network in a step. The PSFs are
    computed, and the mask learns, in the first; in the others the same PSFs meet new patches and new noise,
    which saves the time of the optics. frozen_statistics: in this share of the steps, the last ones, batch
    normalisation goes by its running means, as in use: a batch of patches has other means than a photo.
    clip_gradient: a longer gradient of the network is made so long (Pascanu et al., ICML 2013)."""

    steps: Count = 100_000
    batch: Count = 4
    learning_rate: Positive = 1e-3
    betas: tuple[Fraction, Fraction] = (0.9, 0.999)
    weight_decay: NotNegative = 1e-4
    decay: Literal["cosine", "none"] = "cosine"
    final_rate: Fraction = 0.01
    warmup: Fraction = 0.0
    network_steps: Count = 1
    frozen_statistics: Annotated[float, Field(ge=0, le=1)] = 0.0
    clip_gradient: Positive | None = None
    precision: Literal["auto", "float32", "bfloat16"] = "auto"


class JournalTable(RecipeModel):
    """How often, in steps, something is written."""

    log_every: Count = 50
    validate_every: Count = 1000
    save_every: Count = 500
    pictures_every: Count = 2000
    tensorboard: bool = False


class TrainRecipe(RecipeModel):
    """A training recipe. `camera` is a file or a shipped name; `mask`, `psf` replace the camera's own."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    purpose: str = ""
    camera: str
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    device: Literal["auto", "cpu", "cuda"] = "auto"
    mask: AnyMask | None = None
    psf: PsfSettings | None = None
    network: NetworkTable = NetworkTable()
    doe: DoeTable = DoeTable()
    loss: LossTable = LossTable()
    data: DataTable = Field(default_factory=DataTable)
    capture: CaptureTable = CaptureTable()
    cameras: CamerasTable | None = None
    optimiser: OptimiserTable = OptimiserTable()
    journal: JournalTable = JournalTable()
