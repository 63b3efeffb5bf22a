"""Which effects are simulated, and why."""

from ..capture.fidelity import Fidelity, full_fidelity, simpler_recipe
from .costs import Rendering
from .effect import Decision, Effect, Level, Plan, decibels, overall
from .effects import EFFECTS, all_effects
from .facts import Facts, facts_of, through_mask_like
from .figures import plan_figures, with_predicted
from .overrule import checked_overrule, insisted_rendering
from .photo import Planner, plan_alone, plan_photo, planner_of
from .rates import learn as learn_rates
from .scene import SceneFacts, look, plan_scene, seen_in_thumbnails, thumbnail
from .target import RESTORED, Target, as_accurate, parse_target

__all__ = [
    "EFFECTS",
    "RESTORED",
    "Decision",
    "Effect",
    "Facts",
    "Fidelity",
    "Level",
    "SceneFacts",
    "Plan",
    "Planner",
    "Rendering",
    "Target",
    "all_effects",
    "as_accurate",
    "checked_overrule",
    "decibels",
    "facts_of",
    "full_fidelity",
    "insisted_rendering",
    "learn_rates",
    "look",
    "overall",
    "parse_target",
    "plan_alone",
    "plan_figures",
    "plan_photo",
    "plan_scene",
    "planner_of",
    "seen_in_thumbnails",
    "simpler_recipe",
    "through_mask_like",
    "thumbnail",
    "with_predicted",
]
