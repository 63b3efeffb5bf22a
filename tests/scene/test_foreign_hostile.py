"""Mitsuba scenes made to break their reader end in one message, soon, and with little memory."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from edofsim.errors import InputError
from edofsim.scene.foreign import MitsubaSource, read_scene

WAVELENGTHS = np.linspace(420e-9, 720e-9, 4)
VALUES = (
    "",
    "1",
    "nan",
    "1e999",
    "-1",
    "x",
    "1 2",
    "1 2 3",
    "$a",
    "$",
    "#zz",
    "#12345678",
    "/etc/passwd",
    "dir",
    "m.obj",
    "a" * 300,
    "400:1 300:2",
    ":",
    ":1",
    "1:",
    "true",
    "1e300",
)
TAGS = (
    "scene",
    "shape",
    "bsdf",
    "emitter",
    "sensor",
    "texture",
    "integrator",
    "float",
    "integer",
    "boolean",
    "string",
    "rgb",
    "spectrum",
    "transform",
    "translate",
    "rotate",
    "lookat",
    "matrix",
    "point",
    "vector",
    "ref",
    "alias",
    "default",
    "path",
    "include",
    "odd",
)
TYPES = (
    "obj",
    "sphere",
    "cube",
    "diffuse",
    "plastic",
    "conductor",
    "roughconductor",
    "dielectric",
    "principled",
    "twosided",
    "bitmap",
    "checkerboard",
    "area",
    "constant",
    "envmap",
    "point",
    "path",
    "",
)
NAMES = (
    "reflectance",
    "radiance",
    "to_world",
    "filename",
    "alpha",
    "int_ior",
    "max_depth",
    "radius",
    "center",
    "p0",
    "eta",
    "k",
    "a",
    "material",
    "metallic",
    "raw",
    "color0",
    "base_color",
)
JSON_VALUES = (None, True, 1, 1e999, 10**400, "x", "\0", [], [[1, 2], [3]], ["a"], [1, 2, 3], {}, {"type": 3},
               {"type": "rgb", "value": [1, [2]]}, {"type": "rgb", "value": "x"}, {"type": "ref"},
               {"type": "spectrum", "wavelengths": [1, 2], "value": [1]}, [None] * 9,
               {"type": "spectrum", "wavelengths": ["x"], "value": [1]}, [[1, 0, 0, 0]] * 4)  # fmt: skip

NESTED = '<bsdf type="diffuse" id="n0"/>' + "".join(
    f'<bsdf type="twosided" id="n{i}"><ref id="n{i - 1}"/></bsdf>' for i in range(1, 1500)
)
DOUBLED = '<bsdf type="diffuse" id="n0"/>' + "".join(
    f'<bsdf type="blendbsdf" id="n{i}"><ref id="n{i - 1}"/><ref id="n{i - 1}"/></bsdf>' for i in range(1, 200)
)
BOMB = '<default name="a0" value="xxxxxxxxxx"/>' + "".join(
    f'<default name="a{i}" value="{f"$a{i - 1} " * 10}"/>' for i in range(1, 30)
)
HOSTILE = {
    "defaults that grow": (f"<scene>{BOMB}</scene>", "makes a text of more"),
    "references in a long row": (f"<scene>{NESTED}</scene>", "nested"),
    "references that double": (f"<scene>{DOUBLED}</scene>", "nested"),
    "unknown encoding": ('<?xml version="1.0" encoding="foo"?><scene/>', "not valid XML"),
    "encoding of many bytes": ('<?xml version="1.0" encoding="shift_jis"?><scene/>', "not valid XML"),
    "a long name": (f'<scene><include filename="{"a" * 5000}"/></scene>', "too long"),
    "a look_at of one number": (
        '<scene><sensor type="perspective"><transform name="to_world"><lookat origin="1" target="0,0,0"/>'
        "</transform></sensor></scene>",
        "three numbers",
    ),
}


def read(path: Path) -> None:
    read_scene(MitsubaSource(kind="mitsuba", path=path.name), path.parent, WAVELENGTHS, "scene")


@pytest.mark.parametrize(("text", "complaint"), HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_scene_is_refused_by_its_cause(tmp_path: Path, text: str, complaint: str):
    (tmp_path / "s.xml").write_text(text)
    with pytest.raises(InputError, match=complaint):
        read(tmp_path / "s.xml")


def element(draw: np.random.Generator, depth: int) -> str:
    shares = {"name": 0.7, "value": 0.6, "type": 0.6, "id": 0.2, "as": 0.1, "filename": 0.1, "x": 0.1,
              "origin": 0.1,
              "target": 0.1, "angle": 0.2}  # fmt: skip
    options = {"name": NAMES, "type": TYPES, "id": ("a", "b"), "as": ("a", "b")}
    chosen = [key for key, share in shares.items() if draw.random() < share]
    words = [f" {key}={quoteattr(str(draw.choice(options.get(key, VALUES))))}" for key in chosen]
    inside = "".join(element(draw, depth + 1) for _ in range(draw.integers(4))) if depth < 4 else ""
    tag = draw.choice(TAGS)
    return f"<{tag}{''.join(words)}>{inside}</{tag}>"


def dictionary(draw: np.random.Generator, depth: int) -> dict[str, object]:
    found: dict[str, object] = {"type": str(draw.choice(TYPES)) if depth else "scene"}
    for _ in range(draw.integers(1, 6)):
        inner = depth < 3 and draw.random() < 0.35
        value = dictionary(draw, depth + 1) if inner else JSON_VALUES[draw.integers(len(JSON_VALUES))]
        found[str(draw.choice(NAMES))] = value
    return found


@pytest.mark.parametrize("pose", [[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], [], 3])
def test_a_place_that_is_no_matrix_is_refused(tmp_path: Path, pose: object):
    scene = {"type": "scene", "camera": {"type": "perspective", "to_world": pose}}
    (tmp_path / "s.json").write_text(json.dumps(scene))
    with pytest.raises(InputError, match=r"camera\.to_world: .*matrix"):
        read(tmp_path / "s.json")


@pytest.mark.parametrize("point", [[], [1, 2], [1, 2, 3, 4]])
def test_a_point_of_another_count_of_numbers_is_refused(tmp_path: Path, point: list[float]):
    ball = {"type": "sphere", "center": point}
    (tmp_path / "s.json").write_text(json.dumps({"type": "scene", "ball": ball}))
    with pytest.raises(InputError, match="center: a point needs 3 numbers"):
        read(tmp_path / "s.json")


@pytest.mark.parametrize("suffix", ["xml", "json"])
def test_no_scene_of_random_parts_ends_in_a_traceback(tmp_path: Path, suffix: str):
    (tmp_path / "dir").mkdir()
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path, refused = tmp_path / f"s.{suffix}", 0
    for seed in range(150):
        draw = np.random.default_rng(seed)
        xml = f"<scene>{''.join(element(draw, 0) for _ in range(3))}</scene>"
        path.write_text(xml if suffix == "xml" else json.dumps(dictionary(draw, 0)))
        try:
            read(path)
        except InputError:
            refused += 1
    assert refused > 100
