"""Which effects are simulated, and why."""

from .effect import Decision, Plan
from .photo import plan_photo
from .thumbnail import thumbnail

__all__ = ["Decision", "Plan", "plan_photo", "thumbnail"]
