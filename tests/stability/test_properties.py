"""What holds for any input: energy, linearity, shifts, mirrors, accuracy, keys, recipes."""

from __future__ import annotations

import json
import platform
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from hard_cases.pupils import bank
from hypothesis import given, settings
from hypothesis import strategies as st

from edofsim.capture import Fidelity, capture
from edofsim.optics import psf_bank, response
from edofsim.recipe import load_camera, load_scene
from edofsim.recipe.load import load_train, shipped, shipped_folder
from edofsim.render import engine
from edofsim.render.keys import view_key
from edofsim.render.view import View
from edofsim.stability.photos import SHIPPED, distance
from edofsim.stability.views import (
    MASKS,
    PADDED,
    WINDOW,
    camera_with,
    flat,
    free_height,
    uniform,
    with_free_height,
)

few = settings(max_examples=8, deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 2**31 - 1)
masks = st.sampled_from(sorted(MASKS))
dioptres = st.floats(0.0, 2.0)


def photo(view: View, mask: str, **how: Any) -> torch.Tensor:
    """Clean photo, float64."""
    camera = camera_with(MASKS[mask])
    fidelity = Fidelity(**{**SHIPPED, "occlusion": "none", **how})
    return capture(view, with_free_height(camera), fidelity, exposure=1.0, dtype=torch.float64).clean


def two_depths(seed: int) -> View:
    """Light at random places of two depths, none near the border of the frame."""
    near = uniform(*PADDED, seed=seed) < 0.5
    view = flat(torch.where(near, 1.2, 0.4).double())
    inside = torch.zeros(PADDED, dtype=torch.bool)
    inside[11:-11, 11:-11] = True
    light = uniform(view.bands, *PADDED, seed=seed + 1) * inside
    return replace(view, radiance=light.reshape(view.bands, -1))


@few
@given(mask=masks, depth=dioptres, seed=seeds)
def test_light_is_kept(mask: str, depth: float, seed: int):
    """A point's photo holds all its light, weighed by the response: what leaves the window too, as glare."""
    view = flat(depth, rows=WINDOW + 2, columns=WINDOW + 2)
    point = torch.zeros_like(view.radiance)
    point[:, point.shape[1] // 2] = 0.1 + uniform(view.bands, seed=seed)
    view = replace(view, radiance=point)
    camera = camera_with(MASKS[mask])
    height = free_height(camera)
    rest = psf_bank(camera.with_height(height), view.wavelengths, [depth], dtype=torch.float64).truncated[0]
    weights = response(camera, view.wavelengths).double()
    whole = weights @ point.sum(1)
    fidelity = Fidelity(occlusion="none")
    made = capture(view, camera.with_height(height), fidelity, exposure=1.0, dtype=torch.float64)
    landed = made.clean.sum((-1, -2))
    beyond = weights @ (point.sum(1) * rest)
    inside = made.clean[0].numel() / view.pixel.numel()
    torch.testing.assert_close(landed, whole - beyond * (1 - inside), rtol=2e-3, atol=0)
    torch.testing.assert_close(made.truncated, beyond / whole, rtol=0, atol=2e-3)


@few
@given(mask=masks, seed=seeds, a=st.floats(0, 1e3), b=st.floats(1e-3, 1e3))
def test_photos_add_up(mask: str, seed: int, a: float, b: float):
    one, other = two_depths(seed), two_depths(seed)
    other = replace(other, radiance=uniform(*one.radiance.shape, seed=seed + 2))
    both = replace(one, radiance=a * one.radiance + b * other.radiance)
    parts = a * photo(one, mask) + b * photo(other, mask)
    assert distance(photo(both, mask), parts) < 1e-9


@few
@given(
    mask=masks,
    occlusion=st.sampled_from(["none", "over", "normalised", "hidden"]),
    seed=seeds,
    rows=st.integers(-3, 3),
    columns=st.integers(-3, 3),
)
def test_a_shifted_view_has_a_shifted_photo(mask: str, occlusion: str, seed: int, rows: int, columns: int):
    """Light and depth alike, round the frame: where neither comes from across its border."""
    view = two_depths(seed)

    def moved(values: torch.Tensor) -> torch.Tensor:
        image = values.reshape(*values.shape[:-1], *PADDED)
        return image.roll((rows, columns), (-2, -1)).reshape(values.shape)

    shifted = replace(view, radiance=moved(view.radiance), inverse_depth=moved(view.inverse_depth))
    here, there = (photo(each, mask, occlusion=occlusion) for each in (view, shifted))
    back = there.roll((-rows, -columns), (-2, -1))
    inner = (slice(None), slice(5, -5), slice(5, -5))
    assert distance(back[inner], here[inner]) < 1e-9


@few
@given(seed=seeds, depth=dioptres, axis=st.sampled_from([-1, -2]))
def test_a_mirrored_mask_has_a_mirrored_psf(seed: int, depth: float, axis: int):
    camera = camera_with(MASKS["free"])
    height = 1e-6 * uniform(*free_height(camera).shape, seed=seed)
    straight = bank(camera.with_height(height), depth).values
    mirrored = bank(camera.with_height(height.flip(axis)), depth).values
    assert distance(mirrored.flip(axis), straight) < 1e-9


def shuffled(data: Any, order: random.Random) -> Any:
    """The same tables with their keys in another order."""
    if isinstance(data, dict):
        keys = list(data)
        order.shuffle(keys)
        return {key: shuffled(data[key], order) for key in keys}
    return [shuffled(each, order) for each in data] if isinstance(data, list) else data


def toml(data: dict[str, Any]) -> str:
    """A recipe's data as TOML. JSON's strings, numbers and lists are TOML's; tables are written inline."""

    def value(item: Any) -> str:
        if isinstance(item, dict):
            pairs = [f"{json.dumps(key)} = {value(each)}" for key, each in item.items() if each is not None]
            return f"{{{', '.join(pairs)}}}"
        if isinstance(item, list):
            return f"[{', '.join(map(value, item))}]"
        return json.dumps(item, ensure_ascii=False)  # TOML has no escaped surrogates

    return "".join(f"{json.dumps(key)} = {value(item)}\n" for key, item in data.items() if item is not None)


SCENES = shipped(shipped_folder("scenes"))
ALL = {
    **{f"scene {name}": (path, load_scene) for name, path in SCENES.items()},
    **{f"camera {n}": (p, load_camera) for n, p in shipped(shipped_folder("scenes") / "cameras").items()},
    **{f"train {n}": (p, load_train) for n, p in shipped(shipped_folder("train")).items()},
}


def written(recipe: Any, order: random.Random | None = None) -> str:
    data = recipe.model_dump(mode="json", by_alias=True)
    return toml(shuffled(data, order) if order else data)


@pytest.mark.parametrize("name", ALL)
def test_a_recipe_survives_being_written(name: str, tmp_path: Path):
    path, load = ALL[name]
    recipe = load(path).recipe
    (tmp_path / "again.toml").write_text(written(recipe), encoding="utf-8")
    assert load(tmp_path / "again.toml").recipe == recipe


@few
@given(data=st.data())
def test_any_camera_survives_being_written(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory):
    """Numbers of every size and masks of every kind."""
    number = st.floats(1e-3, 1e3, allow_subnormal=False)
    shipped_camera = load_camera("paper-clear").recipe.model_dump(mode="json", by_alias=True)
    kind = data.draw(st.sampled_from(["clear", "annular", "cubic", "coded", "rings"]))
    more = {
        "annular": {"inner_radius": data.draw(st.floats(0.01, 0.99))},
        "cubic": {"alpha_rad": data.draw(st.floats(-1e4, 1e4))},
        "coded": {
            "pattern": data.draw(st.lists(st.sampled_from(["01", "10", "11"]), min_size=1, max_size=5))
        },
    }.get(kind, {})
    shipped_camera["name"] = data.draw(st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,20}", fullmatch=True))
    shipped_camera["purpose"] = data.draw(st.text(max_size=20).filter(lambda text: text.isprintable()))
    shipped_camera["mask"] = {"kind": kind, **more}
    shipped_camera["lens"]["aperture_radius_mm"] = data.draw(number)
    shipped_camera["sensor"]["read_noise"] = data.draw(st.floats(0, 0.5))
    path = tmp_path_factory.mktemp("camera") / "camera.toml"
    path.write_text(toml(shipped_camera), encoding="utf-8")
    first = load_camera(path).recipe
    assert first.lens.aperture_radius_mm == shipped_camera["lens"]["aperture_radius_mm"]
    path.write_text(written(first), encoding="utf-8")
    assert load_camera(path).recipe == first


@few
@given(
    name=st.sampled_from(sorted(SCENES)), order=st.randoms(use_true_random=False), threads=st.integers(1, 64)
)
def test_a_view_has_one_key(
    name: str, order: random.Random, threads: int, tmp_path_factory: pytest.TempPathFactory
):
    """Whatever the order of the keys in the recipe, the host and its threads; another seed has another."""
    recipe = load_scene(name).recipe
    base = shipped_folder("scenes")
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(written(recipe, order), encoding="utf-8")
    again = load_scene(path).recipe
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(platform, "node", lambda: f"host-{threads}")
        patch.setattr(engine, "_threads", threads)
        assert view_key(again, base) == view_key(recipe, base)
    assert view_key(recipe.model_copy(update={"seed": recipe.seed + 1}), base) != view_key(recipe, base)
