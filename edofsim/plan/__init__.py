"""Which effects are simulated, and why."""

from ..capture.fidelity import Fidelity, full_fidelity, simpler_recipe
from .effect import Decision, Effect, Level, Plan, decibels, overall
from .effects import EFFECTS
from .photo import Planner, plan_photo, planner_of
from .scene import Looked, look, plan_scene, seen_in_thumbnails
from .target import Target, parse_target
from .thumbnail import thumbnail

__all__ = [
    "EFFECTS",
    "Decision",
    "Effect",
    "Fidelity",
    "Level",
    "Looked",
    "Plan",
    "Planner",
    "Target",
    "decibels",
    "full_fidelity",
    "look",
    "overall",
    "parse_target",
    "plan_photo",
    "plan_scene",
    "planner_of",
    "seen_in_thumbnails",
    "simpler_recipe",
    "thumbnail",
]
