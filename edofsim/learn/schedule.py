"""How far a training is, how fast it learns there, and where its random numbers come from."""

from __future__ import annotations

import math

import numpy as np
import torch


def fraction_done(step: int, steps: int, seconds: float, limit_seconds: float | None) -> float:
    """0 at the start, 1 at the end: the larger of the shares of steps and of time, if time is limited."""
    by_time = seconds / limit_seconds if limit_seconds else 0.0
    return min(1.0, max(step / steps, by_time))


def rate_factor(fraction: float, decay: str, warmup: float, final: float) -> float:
    """Factor on the learning rate: a straight rise over `warmup`, then half a cosine to `final`, or 1."""
    if fraction < warmup:
        return max(fraction, 1e-3) / warmup
    if decay == "none":
        return 1.0
    done = (fraction - warmup) / (1 - warmup) if warmup < 1 else 1.0
    return final + (1 - final) * 0.5 * (1 + math.cos(math.pi * done))


def generator_of(
    seed: int, purpose: int, step: int, rank: int, device: torch.device | str = "cpu"
) -> torch.Generator:
    """A fresh generator for one purpose in one step on one worker.

    Counting in place of carrying a state on makes resuming exact on its own: step 1000 draws the same
    numbers whether or not the training was interrupted before it.
    """
    words = np.random.SeedSequence([seed, purpose, step, rank]).generate_state(2, np.uint32)
    return torch.Generator(device).manual_seed(int(words[0]) << 31 | int(words[1]) >> 1)
