"""What cannot be meant is refused in one message that says what to do, in Python too."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

import edofsim
from edofsim import InputError
from edofsim.optics.masks import PhaseMask, SmoothMask
from edofsim.recipe.kinds import MASKS


def small() -> edofsim.View:
    return edofsim.View.from_image(np.zeros((16, 16, 3)), 1.0, margin=16)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: edofsim.camera(pixel=3.45), "3.45 um is 3.45e-06"),
        (lambda: edofsim.camera(focal_length=35, f_number=4), "35 mm is 0.035"),
        (lambda: edofsim.camera(height=np.zeros((5, 5)), pitch=21), "21 um is 2.1e-05"),
        (lambda: edofsim.camera(height="h.npy"), "a file goes into"),
        (lambda: edofsim.camera(height=np.zeros((5, 5), complex)), "not real numbers"),
        (lambda: edofsim.camera(height=np.zeros((5, 4))), "is square"),
        (lambda: edofsim.camera(bayer="XYZW"), "sensor.bayer"),
        (lambda: edofsim.camera(mask={"kind": "cubic"}, height=np.zeros((5, 5))), "give one of them"),
        (lambda: edofsim.restored("photo.png", edofsim.camera()), "read_image"),
        (lambda: edofsim.restored(torch.zeros(2, 3, 8, 8), edofsim.camera()), "one by one"),
        (lambda: edofsim.restored(3, edofsim.camera()), "not a int"),
        (lambda: edofsim.restored(np.zeros((8, 8, 3)), edofsim.camera()), "channels first"),
        (lambda: edofsim.camera(mask={"kind": "cubic", "alpha": 60}), "did you mean 'alpha_rad'?"),
        (lambda: edofsim.camera(bits=99), "not 99 (bits of the converter"),
        (
            lambda: edofsim.restored(torch.zeros(3, 8, 8), edofsim.camera(), network=torch.nn.Identity()),
            "name a checkpoint",
        ),
        (lambda: edofsim.photograph([small(), 3], edofsim.camera()), "a list of them"),
        (lambda: edofsim.photograph(small(), edofsim.camera(), device="odd"), "none of auto, cpu, cuda"),
        (lambda: next(edofsim.views("clutter", members=0)), "at least 1"),
        (lambda: edofsim.View.from_image(np.full((8, 8, 3), 200.0), 1.0), "divide by 255"),
        (
            lambda: edofsim.photograph(
                edofsim.View.from_image(np.zeros((16, 16, 3)), 1.0, margin=16, pixel_angle=1e-3),
                edofsim.camera(),
            ),
            "pixel_angle=camera.pixel_angle",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_way_out(call: Callable[[], object], words: str):
    with pytest.raises(InputError) as caught:
        call()
    assert words in str(caught.value)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="no CUDA device"):
        edofsim.photograph(small(), edofsim.camera(), device="cuda")


def test_a_camera_by_numbers_has_a_name_a_mask_and_a_whole_sensor():
    made = edofsim.camera(
        focal_length=0.035, f_number=4, name="mine", mask={"kind": "annular", "inner": 0.5}
        if "inner" in type(MASKS["annular"](kind="annular")).model_fields else {"kind": "annular"},
        full_well=1e4, bits=12, bayer="RGGB",
    )  # fmt: skip
    assert made.recipe.name == "mine" and made.mask.kind == "annular"
    sensor = made.recipe.sensor
    assert (sensor.full_well_electrons, sensor.bits, sensor.bayer) == (1e4, 12, "RGGB")


@pytest.mark.parametrize("samples", [100, 239, 255, 300])
def test_heights_of_any_material_just_cover_the_pupil(samples: int):
    height = np.zeros((samples, samples))
    made = edofsim.camera(height=height, material="fused-silica")
    assert made.mask.material == "fused-silica" and isinstance(made.mask, PhaseMask)
    bank = edofsim.psfs(made, [1.5], [550e-9], window=16)
    plain = edofsim.psfs(edofsim.camera("paper-clear"), [1.5], [550e-9], window=16)
    torch.testing.assert_close(bank.values, plain.values, atol=1e-4, rtol=1e-2)


def failing(how: str) -> type[SmoothMask]:
    class Boom(SmoothMask):
        """A mask of another package that goes wrong."""

        kind: Literal["boom"] = "boom"

        def wavefront(self, u: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
            if how == "raises":
                raise ZeroDivisionError("an own mistake")
            if how == "exits":
                raise SystemExit(3)
            return u * v * (torch.nan if how == "nan" else torch.inf)

    return Boom


@pytest.fixture
def another() -> Generator[Callable[[str], None]]:
    """Add a mask of another package for a while."""

    def add(how: str) -> None:
        MASKS.__dict__["_places"] = {**MASKS._places, "boom": f"{__name__}:Boom"}
        MASKS._loaded["boom"] = failing(how)

    yield add
    MASKS.look_again()


@pytest.mark.parametrize("how", ["raises", "exits", "nan", "inf"])
def test_a_mask_of_another_package_that_fails_is_named(
    tmp_path: Path, another: Callable[[str], None], how: str
):
    another(how)
    (tmp_path / "c.toml").write_text('name = "c"\n[mask]\nkind = "boom"\n')
    with pytest.raises(InputError, match="the mask 'boom' of another package"):
        edofsim.psfs(edofsim.camera(tmp_path / "c.toml"), [1.0], [550e-9], window=16)
