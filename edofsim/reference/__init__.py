"""The slow truths that `expose` is judged by: a thin lens and clipped pupils, both by tracing rays."""

from .clipped_pupil import clipped_pupil
from .thin_lens import thin_lens

__all__ = ["clipped_pupil", "thin_lens"]
