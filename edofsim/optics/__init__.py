"""Optics: glass, lens, masks, pupil, point spread functions, sensor. Knows nothing of scenes."""

from .camera import Camera, best_focus_distance, defocus, focal_length, focus_distance
from .materials import MATERIALS, Material, material
from .psf import channel_psfs, mean_psfs, psf_bank
from .psf_field import PsfField
from .sampling import plan_sampling, sampling_bound
from .sensor import PAPER_COLOURS, response, response_curves
from .sub_apertures import between_part_variance, sub_aperture_psfs

__all__ = [
    "MATERIALS",
    "PAPER_COLOURS",
    "Camera",
    "Material",
    "PsfField",
    "defocus",
    "focal_length",
    "best_focus_distance",
    "channel_psfs",
    "focus_distance",
    "material",
    "mean_psfs",
    "plan_sampling",
    "psf_bank",
    "response",
    "response_curves",
    "sampling_bound",
    "between_part_variance",
    "sub_aperture_psfs",
]
