"""Sensor noise: read noise beyond the training's (Akpinar et al., section "Noise Analysis")."""

from __future__ import annotations

from .paper_figures import NOISE
from .planes import Condition
from .robustness import Study, command_of, green_focus
from .systems import EvaluatedSystem, paper_test

SIGMAS_S = (0.005, 0.009, 0.015, 0.020)


def conditions(system: EvaluatedSystem, seed: int) -> list[Condition]:
    """The paper's read noises at the green focus, height errors of 30 nm."""
    depth = 1 / green_focus(system)
    return [Condition(f"{sigma:g}", depth, sigma, paper_test(seed)) for sigma in SIGMAS_S]


STUDY = Study(
    name="noise",
    column="sigma_s",
    conditions=conditions,
    labels={f"{sigma:g}": sigma for sigma in SIGMAS_S},
    paper=NOISE,
    title="Sensor noise",
    purpose="Effect of the sensor's read noise on restored images.",
    axis="read noise σs (of full scale)",
    said="σs = {}",
    setting="an object at the green focus, height errors of 30 nm; the paper trained with σs from 0.001 to "
    "0.015",
    source="Figure “Reconstruction results for increasing sensor read noise”",
)

run = command_of(
    STUDY,
    """Measure the effect of read noise.

    Read noise is 0.005, 0.009, 0.015 and 0.02 of full scale, with objects at the green focus.

    The same command resumes interrupted work. A file that cannot be used is named and
    left out.

    Figures: psnr_db.SYSTEM.SIGMA, psnr_db.SYSTEM.photo.SIGMA, loss_db.SYSTEM, pictures, left_out.
    """,
)
