"""Optics keep their own precision, whatever they are called from."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar, cast

import torch

Given = ParamSpec("Given")
Made = TypeVar("Made")


def own_precision(work: Callable[Given, Made]) -> Callable[Given, Made]:
    """`work`, called as if there were no autocast around it.

    Mixed precision is for networks. In it, products of matrices are of bfloat16 or half: PSFs would be right
    to half a percent only, and would be remembered so for those who ask for float32.
    """

    @wraps(work)
    def alone(*args: Given.args, **options: Given.kwargs) -> Made:
        kind = torch.device(cast(torch.device | str, options.get("device", "cpu"))).type
        with torch.autocast("cpu", enabled=False):
            if kind == "cpu":
                return work(*args, **options)
            with torch.autocast(kind, enabled=False):
                return work(*args, **options)

    return alone
