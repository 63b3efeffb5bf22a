"""Any scene of a grammar looks the same by many bands a path, by Mitsuba's spectral variant, and as Mitsuba
renders its file. Colours are spectra, straight between 400 and 800 nm: the truth of each band is the scene
with each colour's value there, in grey."""

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
BANDS = (450.0, 650.0)
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Of linear sRGB: an even spectrum is not white there, but its luminance is its value."""
MODEL = 0.006
"""What edges of textures and of round things, which are triangles here, may differ, as a part of the mean."""
SAMPLES, TRUTHS, TRUTH_SAMPLES = 256, 8, 128
GRID = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def scene(seed: int, band: float | None = None) -> str:
    """A random scene: a room or a floor, three things, a lamp or even light, paths of some length.

    band: the wavelength in nm at which its colours are taken, in grey; None: coloured.
    """
    draw = np.random.default_rng(seed)

    def pick(*options: str) -> str:
        return options[draw.integers(len(options))]

    def number(low: float, high: float) -> str:
        return f"{draw.uniform(low, high):.3f}"

    def colour(name: str, low: float = 0.1, high: float = 0.9) -> str:
        short, long = (round(draw.uniform(low, high), 3) for _ in range(2))
        if band is not None:
            return f'<spectrum name="{name}" value="{short + (long - short) * (band - 400) / 400:.6f}"/>'
        return f'<spectrum name="{name}" value="400:{short}, 800:{long}"/>'

    def reflectance(name: str, pictured: bool) -> str:
        squares = colour("color0", 0, 0.3) + colour("color1", 0.5, 1)
        board = f'<texture name="{name}" type="checkerboard">{squares}</texture>'
        file = '<string name="filename" value="quarters.png"/>'
        picture = f'<texture name="{name}" type="bitmap">{file}</texture>'
        return pick(board, picture) if pictured and draw.random() < 0.5 else colour(name)

    def surface(pictured: bool, glass: bool = True) -> str:
        alpha = f'<float name="alpha" value="{number(0.1, 0.5)}"/>'
        metal = colour("specular_reflectance") + '<string name="material" value="none"/>'
        satin = reflectance("base_color", pictured) + '<float name="roughness" value="0.4"/>'
        index = f'<float name="int_ior" value="{number(1.2, 1.8)}"/>'
        inside = {
            "diffuse": reflectance("reflectance", pictured),
            "plastic": reflectance("diffuse_reflectance", pictured),
            "roughplastic": alpha + reflectance("diffuse_reflectance", pictured),
            "roughconductor": alpha + metal,
            "principled": satin,
        }
        clear = {
            "dielectric": index + colour("specular_transmittance", 0.5, 1),
            "thindielectric": index,
        }
        kind = pick(*inside, *(clear if glass else ()))
        inner = f'<bsdf type="{kind}">{(inside | clear)[kind]}</bsdf>'
        return inner if kind in clear else f'<bsdf type="twosided">{inner}</bsdf>'

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
        f'<shape type="rectangle">{surface(True, glass=False)}<transform name="to_world"><scale value="4"/>'
        '<translate z="-1.5"/></transform></shape>'
    )
    lamp = (
        f'<shape type="sphere"><point name="center" x="{number(-1, 1)}" y="2.2" z="1"/><float name="radius" '
        f'value="0.6"/><emitter type="area">{colour("radiance", 3, 9)}</emitter></shape>'
    )
    even = f'<emitter type="constant">{colour("radiance", 0.3, 0.9)}</emitter>'
    # what a lamp throws through glass is found by too few paths to compare
    light = even if 'dielectric"' in "".join(things) else pick(lamp + even, even)
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


def ours(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray, str]:
    """The picture [band, y, x] of a scene's file, half of what two halves of its samples differ by, and the
    route that it took."""
    recipe = SceneRecipe.model_validate(
        {
            "name": "routes",
            "bands": {"start_nm": BANDS[0], "stop_nm": BANDS[1], "count": len(BANDS)},
            "frame": {
                "width_px": COLUMNS,
                "height_px": ROWS,
                "margin_px": 0,
                "pixel_angle_mrad": 2e3 * math.tan(math.radians(FIELD / 2)) / COLUMNS,
            },
            "render": {"samples": SAMPLES, "hidden": False},
            "source": {"kind": "mitsuba", "path": name, "illuminant": "E"},
        }
    )
    view = render(recipe, folder, cache=folder)
    half = view.with_light(view.half_difference).all_in_focus()
    return view.all_in_focus().numpy(), half.numpy(), str(view.metadata["route"])


def mitsubas(folder: Path, seed: int) -> np.ndarray:
    """Pictures [try, band, y, x] of a scene by Mitsuba, of as many seeds."""
    mi = use_engine("auto")
    bands = []
    for band in BANDS:
        (folder / "grey.xml").write_text(scene(seed, band))
        loaded = mi.load_file(str(folder / "grey.xml"))
        shots = [mi.render(loaded, spp=TRUTH_SAMPLES, seed=11 + k) for k in range(TRUTHS)]
        bands.append(np.stack([np.array(shot)[..., :3] @ LUMINANCE for shot in shots]))
    return np.stack(bands, axis=1)


def cells(image: np.ndarray) -> np.ndarray:
    """Means [..., cell] of pictures [..., y, x]."""
    shape = (*image.shape[:-2], ROWS // CELL, CELL, COLUMNS // CELL, CELL)
    return image.reshape(shape).mean((-3, -1)).reshape(*image.shape[:-2], -1)


def compare(image: np.ndarray, half: np.ndarray, truths: np.ndarray) -> tuple[float, float, float]:
    """Ratio of means and least correlation of cells of a band, what is brighter than most counting as much as
    that, and the share of cells that lie beyond three standard errors."""
    truth = truths.mean(0)
    most = 1.5 * np.percentile(truth, 99, axis=(-2, -1), keepdims=True)
    first, second = (cells(np.minimum(each, most)) for each in (image, truth))
    noise = cells(half**2) / CELL**2 + cells(truths).var(0, ddof=1) / TRUTHS
    # what noise takes from the correlation of pictures that show little else
    shown = 1 - np.minimum(noise.mean(1) / second.var(1), 0.1)
    likeness = min(np.corrcoef(a, b)[0, 1] / part for a, b, part in zip(first, second, shown, strict=True))
    error = np.sqrt(noise + (MODEL * second.mean()) ** 2)
    beyond = np.abs(cells(image) - cells(truth)) > 3 * error
    return float(first.mean() / second.mean()), float(likeness), float(beyond.mean())


def check(folder: Path, seed: int) -> None:
    files(folder)
    text = scene(seed)
    (folder / "scene.xml").write_text(text)
    *many, route = ours(folder, "scene.xml")
    assert route.startswith("many bands a path")
    # a mask that hides nothing is Mitsuba's own
    whole = '<bsdf type="twosided">'
    masked = text.replace(whole, f'<bsdf type="mask"><float name="opacity" value="1"/>{whole}', 1)
    masked = masked.replace("</bsdf></bsdf>", "</bsdf></bsdf></bsdf>", 1)
    (folder / "masked.xml").write_text(masked)
    *four, route = ours(folder, "masked.xml")
    assert "'mask'" in route
    truths = mitsubas(folder, seed)
    for image, half in (many, four):
        ratio, likeness, beyond = compare(image, half, truths)
        print(seed, f"{ratio:.4f} {likeness:.5f} {beyond:.3f}")
        assert ratio == pytest.approx(1, abs=0.01) and likeness > 0.99 and beyond < 0.05, (
            seed,
            ratio,
            likeness,
        )


def test_both_routes_show_what_mitsuba_shows(tmp_path: Path):
    check(tmp_path, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 53))
def test_any_scene_looks_the_same_by_both_routes(seed: int, tmp_path: Path):
    check(tmp_path, seed)
