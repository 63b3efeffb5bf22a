"""Fewer bands: some of a view's, or all of them merged into a few."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from ..errors import InputError
from ..render.view import View


def chosen_bands(view: View, bands: Sequence[int]) -> View:
    """The view with some of its bands alone."""
    index = torch.as_tensor(list(bands), dtype=torch.int64)
    return view.with_light(view.radiance[index], view.wavelengths[index])


def merged_bands(view: View, count: int) -> View:
    """The view with its bands merged into `count` of about equal width: mean radiance at the mean wavelength.

    Raises InputError for no band, or more than there are.
    """
    if not 1 <= count <= view.bands:
        raise InputError(f"{count} bands: the view has {view.bands}; give 1 to {view.bands}")
    groups = torch.tensor_split(torch.arange(view.bands), count)
    means = [
        torch.stack([each[group].mean(0) for group in groups]) for each in (view.radiance, view.wavelengths)
    ]
    return view.with_light(*means)
