"""Fabrication: height errors beyond the training's (Akpinar et al., section "Noise Analysis"), and the device
that the paper made."""

from __future__ import annotations

from ..recipe.fabrication import Fabrication
from .paper_figures import FABRICATION
from .planes import Condition
from .robustness import Study, command_of, green_focus
from .systems import READ_NOISE, EvaluatedSystem, fabrication_seed

SIGMAS_D_NM = (20.0, 30.0, 40.0, 50.0)
DEVICE = "device"
PITCH_UM = 3.0


def conditions(system: EvaluatedSystem, seed: int) -> list[Condition]:
    """The paper's height errors at the green focus, the same draw at each strength, and its measured device,
    read noise 0.005.

    A height map deeper than the device allows is wrapped by one wave of the mask's design wavelength.
    """
    depth, seed = 1 / green_focus(system), fabrication_seed(seed)
    errors = [
        Condition(
            f"{sigma:g}nm",
            depth,
            READ_NOISE,
            Fabrication(pitch_um=PITCH_UM, height_noise_nm=sigma, seed=seed),
        )
        for sigma in SIGMAS_D_NM
    ]
    wave = getattr(system.camera.recipe.mask, "design_wavelength_nm", None)
    device = Fabrication(preset="paper-device", wrap_wavelength_nm=wave, seed=seed)
    return [*errors, Condition(DEVICE, depth, READ_NOISE, device)]


STUDY = Study(
    name="fabrication",
    column="fabrication",
    conditions=conditions,
    labels={f"{sigma:g}nm": sigma for sigma in SIGMAS_D_NM},
    paper=FABRICATION,
    title="Fabrication errors",
    purpose="Effect of height errors of the mask on restored images.",
    axis="height error σd (nm)",
    said="σd = {} nm",
    setting="an object at the green focus, read noise 0.005; one draw of height errors at every strength; "
    "the device has 98 levels, a mean error of 44 nm and σd = 49.5 nm, as the paper measured on the one "
    "that was made. A network that was trained with height errors expects the veiling glare that they make: "
    "with a smoother mask than it knows it may score lower",
    source="Figure “Reconstruction results for increasing height-map noise”",
)

run = command_of(
    STUDY,
    """Measure the effect of height errors.

    Height errors are 20, 30, 40 and 50 nm, and those of the paper's device, with objects at the green focus.

    The same command resumes interrupted work. A file that cannot be used is named and
    left out.

    Figures: psnr_db.SYSTEM.{20nm,30nm,40nm,50nm,device}, psnr_db.SYSTEM.photo.*, loss_db.SYSTEM from 20 to
    50 nm, pictures, left_out.
    """,
)
