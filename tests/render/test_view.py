"""Views that are made by hand: of images, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.errors import InputError
from edofsim.render.view import View

BANDS = (450e-9, 550e-9)


def view(**changes) -> View:
    """Two bands of 4 x 6 pixels with a margin of 1; numbers that are all different."""
    arguments = {
        "radiance": torch.arange(96.0).reshape(2, 6, 8),
        "inverse_depth": torch.arange(48.0).reshape(6, 8),
        "wavelengths": BANDS,
        "pixel_angle": 1.6e-4,
        "margin": 1,
    }
    return View.flat(**{**arguments, **changes})


def test_a_view_of_images_holds_them():
    made = view()
    assert (made.height, made.width, made.margin, made.bands) == (4, 6, 1, 2)
    assert made.one_each and made.wavelengths.tolist() == list(BANDS)
    assert torch.equal(made.all_in_focus(), torch.arange(96.0).reshape(2, 6, 8))
    assert torch.equal(made.mean_inverse_depth(), torch.arange(48.0).reshape(6, 8))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_numpy_and_torch_make_the_same_view(dtype: type):
    radiance = np.arange(96.0, dtype=dtype).reshape(2, 6, 8)
    one = view(radiance=radiance, inverse_depth=np.full((6, 8), 0.5), wavelengths=np.array(BANDS))
    two = view(radiance=torch.from_numpy(radiance), inverse_depth=0.5)
    for name in ("radiance", "inverse_depth", "coverage", "pixel", "hidden", "wavelengths"):
        first, second = getattr(one, name), getattr(two, name)
        assert torch.equal(first, second) and first.dtype == second.dtype
    assert one.radiance.dtype == one.inverse_depth.dtype == torch.from_numpy(radiance).dtype


def test_whole_numbers_become_real_ones():
    made = view(radiance=torch.ones(2, 6, 8, dtype=torch.uint8), inverse_depth=0)
    assert made.radiance.dtype == torch.float32 and not made.inverse_depth.any()


def test_depths_of_one_view_are_its_own():
    depth = torch.ones(6, 8)
    made = view(inverse_depth=depth)
    depth += 1
    assert (made.inverse_depth == 1).all()


def test_radiance_carries_gradients():
    radiance = torch.ones(2, 6, 8, requires_grad=True)
    view(radiance=radiance).all_in_focus().sum().backward()
    assert (radiance.grad == 1).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"radiance": torch.ones(6, 8)}, r"\[band, y, x\], not \[6, 8\]"),
        ({"radiance": torch.ones(3, 6, 8)}, "3 bands|radiance of shape"),
        ({"inverse_depth": torch.ones(4, 6)}, r"\[4, 6\].*\[6, 8\]"),
        ({"inverse_depth": torch.ones(48)}, r"shape \[48\]"),
        ({"margin": 3}, "margin of 3 pixels does not fit into 8 x 6"),
        ({"margin": -1}, "margin of -1"),
        ({"radiance": torch.full((2, 6, 8), torch.nan)}, "radiance holds values that are NaN"),
        ({"radiance": torch.full((2, 6, 8), torch.inf)}, "NaN or infinite"),
        ({"inverse_depth": -0.5}, "negative; it is 1/z"),
        ({"inverse_depth": float("inf")}, "infinite"),
        ({"inverse_depth": float("nan")}, "NaN"),
        ({"wavelengths": (450e-9,)}, "1 bands"),
        ({"pixel_angle": 0.0}, "pixel_angle"),
        ({"pixel_angle": float("nan")}, "pixel_angle"),
    ],
)
def test_what_makes_no_view_is_refused(changes: dict[str, object], said: str):
    with pytest.raises(InputError, match=said):
        view(**changes)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("radiance", torch.ones(2, 6, 8)),
        ("radiance", torch.ones(48, 2)),
        ("coverage", torch.ones(6, 8)),
        ("inverse_depth", torch.ones(1)),
        ("hidden", torch.zeros(47, dtype=torch.bool)),
        ("wavelengths", torch.tensor([[450e-9, 550e-9]], dtype=torch.float64)),
        ("height", 0),
        ("margin", -1),
    ],
)
def test_fields_that_do_not_fit_each_other_are_named(name: str, value: object):
    with pytest.raises(InputError, match=name if isinstance(value, torch.Tensor) else "cannot have"):
        replace(view(), **{name: value})
