"""Some of a view's bands alone."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from ..render.view import View


def chosen_bands(view: View, bands: Sequence[int]) -> View:
    """The view with some of its bands alone."""
    index = torch.as_tensor(list(bands), dtype=torch.int64)
    return view.with_light(view.radiance[index], view.wavelengths[index])
