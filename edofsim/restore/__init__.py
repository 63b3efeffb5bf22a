"""From a photo to a sharp image: Wiener deconvolution and networks."""

from .wiener import wiener

__all__ = ["wiener"]
