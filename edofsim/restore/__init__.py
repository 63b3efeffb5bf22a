"""From a photo to a sharp image: Wiener deconvolution and networks. Other rooms take these names alone."""

from .choice import WIENER, any_camera_network, choose_network, said_of, usual_network
from .conditioning import forget, refusal
from .restore import channel_psfs, deconvolved, restore
from .wiener import wiener, wiener_by_depth

__all__ = [
    "WIENER",
    "any_camera_network",
    "channel_psfs",
    "choose_network",
    "deconvolved",
    "forget",
    "refusal",
    "restore",
    "said_of",
    "usual_network",
    "wiener",
    "wiener_by_depth",
]
