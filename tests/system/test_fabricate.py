"""`edofsim fabricate`: files for making the mask of any camera."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import edofsim as package
from edofsim.learn.fabricate import device
from edofsim.optics.materials import material

Run = Callable[..., tuple[int, str]]


def test_a_mask_by_a_formula_is_made_in_whole_levels(edofsim: Run, tmp_path: Path):
    """Its heights differ from those of the formula by whole waves and half a level at most."""
    pytest.importorskip("gdstk")
    given = ("--pitch", "21", "--wrap", "543", "--levels", "1201", "--gds", "--out", tmp_path)
    assert edofsim("fabricate", "paper-cubic", *given)[0] == 0
    assert (tmp_path / "paper-cubic.gds").stat().st_size > 1000
    levels = np.loadtxt(tmp_path / "paper-cubic-levels.csv", delimiter=",")
    camera = package.camera("paper-cubic")
    across = 2 * camera.aperture_radius / 21e-6
    place = (np.arange(len(levels)) - (len(levels) - 1) / 2) / (across / 2)
    u, v = torch.tensor(place)[None], torch.tensor(place[::-1].copy())[:, None]
    index = float(material(camera.mask.material).index(543e-9))
    wave = 543e-9 / (index - 1)
    height = camera.mask.wavefront(u, v).numpy() / (2 * np.pi) * wave
    off = (levels * 1e-9 - (height - height.min())) / wave
    assert np.abs(off - np.round(off)).max() * wave < 0.51e-9 + 1e-12


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("paper-cubic",), "state --wrap"),
        (("paper-clear",), "no height map to be made"),
        (("paper-cubic", "--pitch", "-1"), "above 0"),
    ],
)
def test_what_cannot_be_made_is_refused(edofsim: Run, arguments: tuple[str, ...], words: str):
    status, said = edofsim("fabricate", *arguments)
    assert status == 2 and words in said


def test_a_given_height_map_is_made_as_it_is():
    axis = torch.linspace(-1, 1, 239, dtype=torch.float64)
    height = 0.5e-6 * (1 + torch.sin(2 * axis[:, None] + axis[None]))
    made = device(package.camera(height=height, pitch=21e-6), pitch_um=21.0)
    height_map = made.levels * made.level_height
    want = (height - height.min()).numpy()
    assert np.abs(height_map - want).max() < 0.51 * made.level_height


def test_a_wrong_option_names_its_command(edofsim: Run):
    status, said = edofsim("look", "desk", "--nope")
    assert status == 2 and "`edofsim look --help`" in said and "." not in said.split(";")[0][-1]
