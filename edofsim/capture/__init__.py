"""From a view and a camera to a photo."""

from .files import read_image, write_image, write_photo
from .photo import Photo
from .photograph import expose, ideal_image
from .sensor import SensorEffects

__all__ = ["Photo", "SensorEffects", "expose", "ideal_image", "read_image", "write_image", "write_photo"]
