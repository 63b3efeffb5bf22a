"""Learning a DOE and its network together: data, training loop, fabrication files."""

from .doe import FreeHeight
from .fit import Evaluation, evaluate, fit
from .trainer import Trained, train

__all__ = ["Evaluation", "FreeHeight", "Trained", "evaluate", "fit", "train"]
