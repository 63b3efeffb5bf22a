"""From a photo to a sharp image: Wiener deconvolution and networks."""

from .restore import channel_psfs, restore
from .wiener import wiener, wiener_by_depth

__all__ = ["channel_psfs", "restore", "wiener", "wiener_by_depth"]
