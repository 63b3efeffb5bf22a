"""Learning a DOE and its network together: data, training loop, fabrication files."""

from .trainer import Trained, train

__all__ = ["Trained", "train"]
