"""The slow truths that `capture` is judged by: a thin lens and clipped pupils, both by tracing rays."""

from .clipped_pupil import check_crop, clipped_pupil, clipped_pupils
from .photograph import REFERENCES, check_reference, crop_of, reference_photo
from .thin_lens import thin_lens

__all__ = [
    "REFERENCES",
    "check_crop",
    "check_reference",
    "clipped_pupil",
    "clipped_pupils",
    "crop_of",
    "reference_photo",
    "thin_lens",
]
