"""The state of a training that is not finished: everything that continues it exactly."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from ..core.json_values import Json
from ..errors import InputError
from ..recipe.base import in_new_names
from ..recipe.train import TrainRecipe
from ..restore.checkpoint import load_arrays, save_arrays

# settings that may change between the parts of a training
FREE = ("purpose", "journal", "device", "$schema", "schema_")


@dataclass
class Position:
    """Where a training stands.

    step: steps done.
    seconds: time spent on them, over all its parts.
    """

    step: int = 0
    seconds: float = 0.0


def save_state(
    path: Path,
    system: nn.Module,
    optimiser: torch.optim.Optimizer,
    position: Position,
    recipe: Json,
    data_sha256: str,
) -> None:
    """Write weights, the optimiser's moments and the position in one piece (safetensors, no pickle).

    Random numbers need no state of their own: see `schedule.generator_of`.
    """
    arrays = {f"system.{name}": value for name, value in system.state_dict().items()}
    for index, entries in optimiser.state_dict()["state"].items():
        arrays |= {f"optimiser.{index}.{name}": value for name, value in entries.items()}
    about = {
        "step": position.step,
        "seconds": position.seconds,
        "recipe": _bound(recipe),
        "data": data_sha256,
        "torch": torch.__version__,
    }
    save_arrays(path, arrays, {"state": json.dumps(about)})


def load_state(
    path: Path,
    system: nn.Module,
    optimiser: torch.optim.Optimizer,
    recipe: Json,
    data_sha256: str,
) -> Position:
    """Put a saved state back. Raises InputError for a damaged file, and for a recipe or data that differ
    from those it was saved under, naming what differs."""
    arrays, metadata = load_arrays(path, "training state")
    try:
        about = json.loads(metadata["state"])
        position = Position(int(about["step"]), float(about["seconds"]))
        saved_recipe = _bound(in_new_names(TrainRecipe, about["recipe"]))
        saved_data = about["data"]
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError):
        raise InputError(f"{path}: not the state of an edofsim training; remove it to start anew") from None
    wanted = json.loads(json.dumps(_bound(recipe)))
    keys = sorted(wanted.keys() | saved_recipe.keys())
    changed = [key for key in keys if wanted.get(key) != saved_recipe.get(key)]
    problems = [
        f"{path}: saved with another [{key}]; resume with the same recipe, or start anew" for key in changed
    ]
    if saved_data != data_sha256:
        problems.append(f"{path}: saved with other training pictures; resume with the same, or start anew")
    if problems:
        raise InputError(problems)
    try:
        system.load_state_dict(_under(arrays, "system."))
        _load_moments(optimiser, _under(arrays, "optimiser."))
    except (RuntimeError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: does not fit this training ({reason}); start anew") from None
    return position


def _load_moments(optimiser: torch.optim.Optimizer, arrays: Mapping[str, torch.Tensor]) -> None:
    state: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in arrays.items():
        index, _, entry = name.partition(".")
        state.setdefault(int(index), {})[entry] = value
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": state, "param_groups": groups})


def _under(arrays: Mapping[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


def _bound(recipe: Json) -> Json:
    return {key: value for key, value in recipe.items() if key not in FREE}
