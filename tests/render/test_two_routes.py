"""Any scene of a grammar looks the same by many bands a path, by Mitsuba's spectral variant, and as Mitsuba
renders its file. All colours are grey, so that every band has the same light."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from edofsim.recipe import SceneRecipe
from edofsim.render import render
from edofsim.render.engine import use_engine

ROWS, COLUMNS, FIELD = 24, 32, 40.0
CELL = 4
"""Pixels that are averaged before pictures are compared: all renderings are noisy."""
GRID = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def scene(seed: int) -> str:
    """A random scene: a room or a floor, three or four things, a lamp or even light, paths of some length."""
    draw = np.random.default_rng(seed)

    def pick(*options: str) -> str:
        return options[draw.integers(len(options))]

    def number(low: float, high: float) -> str:
        return f"{draw.uniform(low, high):.3f}"

    def grey(name: str, low: float = 0.1, high: float = 0.9) -> str:
        return f'<spectrum name="{name}" value="{number(low, high)}"/>'

    def reflectance(name: str, pictured: bool) -> str:
        squares = grey("color0", 0, 0.3) + grey("color1", 0.5, 1)
        board = f'<texture name="{name}" type="checkerboard">{squares}</texture>'
        file = '<string name="filename" value="quarters.png"/>'
        picture = f'<texture name="{name}" type="bitmap">{file}</texture>'
        return pick(board, picture) if pictured and draw.random() < 0.5 else grey(name)

    def surface(pictured: bool) -> str:
        alpha = f'<float name="alpha" value="{number(0.1, 0.5)}"/>'
        metal = grey("specular_reflectance") + '<string name="material" value="none"/>'
        satin = reflectance("base_color", pictured) + '<float name="roughness" value="0.4"/>'
        inside = {
            "diffuse": reflectance("reflectance", pictured),
            "plastic": reflectance("diffuse_reflectance", pictured),
            "roughplastic": alpha + reflectance("diffuse_reflectance", pictured),
            "roughconductor": alpha + metal,
            "principled": satin,
        }
        kind = pick(*inside)
        inner = f'<bsdf type="{kind}">{inside[kind]}</bsdf>'
        return f'<bsdf type="twosided">{inner}</bsdf>'

    def place(x: float, size: float) -> str:
        axis = np.array([draw.uniform(-1, 1), 1, draw.uniform(-1, 1)])
        x1, y1, z1 = axis / np.linalg.norm(axis)  # any other length shears, which Mitsuba's own shapes refuse
        turn = f'<rotate x="{x1:.6f}" y="{y1:.6f}" z="{z1:.6f}" angle="{number(-50, 50)}"/>'
        at = f'<translate x="{x:.3f}" y="{number(-0.4, 0.5)}" z="{number(-0.5, 0.5)}"/>'
        return f'<transform name="to_world"><scale value="{size:.3f}"/>{turn}{at}</transform>'

    things = []
    for x in (-0.9, 0.0, 0.9):
        kind = pick("rectangle", "cube", "sphere", "disk", "cylinder", "obj")
        file = '<string name="filename" value="quad.obj"/>' if kind == "obj" else ""
        pictured = kind in ("rectangle", "cube", "sphere", "obj")
        things.append(
            f'<shape type="{kind}">{file}{surface(pictured)}{place(x, draw.uniform(0.25, 0.45))}</shape>'
        )
    wall = (
        f'<shape type="rectangle">{surface(True)}<transform name="to_world"><scale value="4"/>'
        '<translate z="-1.5"/></transform></shape>'
    )
    lamp = (
        f'<shape type="sphere"><point name="center" x="{number(-1, 1)}" y="2.2" z="1"/><float name="radius" '
        'value="0.6"/><emitter type="area"><spectrum name="radiance" value="6"/></emitter></shape>'
    )
    even = '<emitter type="constant"><spectrum name="radiance" value="0.6"/></emitter>'
    light = pick(lamp + even, even)
    length = pick("-1", "2", "3", "8")
    integrator = f'<integrator type="path"><integer name="max_depth" value="{length}"/></integrator>'
    sensor = (
        f'<sensor type="perspective"><float name="fov" value="{FIELD}"/><string name="fov_axis" value="x"/>'
        '<transform name="to_world"><lookat origin="0,0.3,4" target="0,0,0" up="0,1,0"/></transform>'
        f'<film type="hdrfilm"><integer name="width" value="{COLUMNS}"/>'
        f'<integer name="height" value="{ROWS}"/><rfilter type="box"/></film></sensor>'
    )
    return f'<scene version="3.0.0">{integrator}{sensor}{wall}{"".join(things)}{light}</scene>'


def files(folder: Path) -> None:
    quarters = np.zeros((16, 16, 3), np.uint8)
    quarters[:8, :8], quarters[:8, 8:], quarters[8:, :8], quarters[8:, 8:] = 230, 40, 90, 160
    imsave(folder / "quarters.png", quarters, check_contrast=False)
    (folder / "quad.obj").write_text(GRID)


def ours(folder: Path, name: str) -> tuple[np.ndarray, str]:
    """The picture [y, x] of a scene's file, and the route that it took."""
    recipe = SceneRecipe.model_validate(
        {
            "name": "routes",
            "bands": {"count": 2},
            "frame": {
                "width_px": COLUMNS,
                "height_px": ROWS,
                "margin_px": 0,
                "pixel_angle_mrad": 2e3 * math.tan(math.radians(FIELD / 2)) / COLUMNS,
            },
            "render": {"samples": 128, "hidden": False},
            "source": {"kind": "mitsuba", "path": name, "illuminant": "E"},
        }
    )
    view = render(recipe, folder, cache=folder)
    return view.all_in_focus().mean(0).numpy(), str(view.metadata["route"])


def mitsubas(folder: Path, name: str) -> np.ndarray:
    mi = use_engine("auto")
    loaded = mi.load_file(str(folder / name))
    return np.array(mi.render(loaded, spp=512, seed=7))[..., :3] @ [0.2126, 0.7152, 0.0722]


def compare(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Ratio of means and correlation of means of cells; what is brighter than most counts as much as that."""
    most = 1.5 * np.percentile(second, 99)
    cells = [
        np.minimum(image, most).reshape(ROWS // CELL, CELL, COLUMNS // CELL, CELL).mean((1, 3))
        for image in (first, second)
    ]
    return float(cells[0].mean() / cells[1].mean()), float(np.corrcoef(*(c.ravel() for c in cells))[0, 1])


def check(folder: Path, seed: int) -> None:
    files(folder)
    text = scene(seed)
    (folder / "scene.xml").write_text(text)
    many, route = ours(folder, "scene.xml")
    assert route.startswith("many bands a path")
    # a mask that hides nothing is Mitsuba's own
    whole = '<bsdf type="twosided">'
    masked = text.replace(whole, f'<bsdf type="mask"><float name="opacity" value="1"/>{whole}', 1)
    masked = masked.replace("</bsdf></bsdf>", "</bsdf></bsdf></bsdf>", 1)
    (folder / "masked.xml").write_text(masked)
    four, route = ours(folder, "masked.xml")
    assert "'mask'" in route
    truth = mitsubas(folder, "scene.xml")
    for image in (many, four):
        ratio, likeness = compare(image, truth)
        assert ratio == pytest.approx(1, abs=0.012) and likeness > 0.99, (seed, ratio, likeness)


@pytest.mark.parametrize("seed", range(3))
def test_both_routes_show_what_mitsuba_shows(seed: int, tmp_path: Path):
    check(tmp_path, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 53))
def test_any_scene_looks_the_same_by_both_routes(seed: int, tmp_path: Path):
    check(tmp_path, seed)
