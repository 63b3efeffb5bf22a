"""The camera: from views to a photo."""

from .fidelity import Fidelity, full_fidelity
from .files import read_image, save_image, write_image, write_photo
from .photo import Photo
from .photograph import capture, ideal_image

__all__ = [
    "Fidelity",
    "Photo",
    "capture",
    "full_fidelity",
    "ideal_image",
    "read_image",
    "save_image",
    "write_image",
    "write_photo",
]
