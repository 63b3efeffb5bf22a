"""Mitsuba scenes read into plain data, against Mitsuba's own reading of the same file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from edofsim.errors import InputError
from edofsim.recipe.scene import SceneRecipe
from edofsim.render.engine import reading_files
from edofsim.scene import build_scene
from edofsim.scene.foreign import MitsubaSource, NotCarried, read_scene
from edofsim.scene.foreign.nodes import look_at
from edofsim.scene.model import TriangleMesh

BANDS = np.array([450, 550, 650]) * 1e-9
LOOK = '<lookat origin="1,2,5" target="0,0.2,0" up="0,1,0"/>'
PLACE = """<transform name="to_world"><scale value="0.9"/><rotate y="1" angle="30"/>
    <translate x="0.2" y="0.1"/></transform>"""
PICTURE = """<bsdf type="diffuse"><texture name="reflectance" type="bitmap">
    <string name="filename" value="t.png"/></texture></bsdf>"""
NEAREST = '<string name="filename" value="t.png"/><string name="filter_type" value="nearest"/>'
QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
SHAPES = {
    "rectangle": PICTURE,
    "cube": PICTURE,
    "sphere": PICTURE + '<point name="center" x="0.1" y="0.2" z="0"/><float name="radius" value="0.8"/>',
    "obj": PICTURE + '<string name="filename" value="quad.obj"/>',
    "disk": "",
    "cylinder": '<point name="p1" x="0" y="0.3" z="1"/><float name="radius" value="0.5"/>',
}


def write(folder: Path, body: str, name: str = "s.xml") -> MitsubaSource:
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:4, :, 0] = picture[:, :4, 1] = 255  # red above, green on the left
    imsave(folder / "t.png", picture, check_contrast=False)
    (folder / "quad.obj").write_text(QUAD)
    sensor = f'<sensor type="perspective"><transform name="to_world">{LOOK}</transform></sensor>'
    (folder / name).write_text(f'<scene version="3.0.0">{sensor}{body}</scene>')
    return MitsubaSource(kind="mitsuba", path=name)


def shape(kind: str, inside: str, place: str = PLACE) -> str:
    return f'<shape type="{kind}">{inside}{place}</shape>'


def trace(mesh: TriangleMesh, direction: np.ndarray):
    """First hit of a ray from the origin (Moeller and Trumbore): depth, geometric normal, uv, or None."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(direction, e2)
    det = (e1 * p).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -(a * p).sum(1) / det
        q = np.cross(-a, e1)
        v = (q @ direction) / det
        t = (e2 * q).sum(1) / det
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    if not hit.any():
        return None
    i = int(np.where(hit, t, np.inf).argmin())
    normal = np.cross(e1[i], e2[i])
    uv = None
    if mesh.uv is not None:
        uv = np.array([1 - u[i] - v[i], u[i], v[i]]) @ mesh.uv[mesh.faces[i]]
    return t[i] * direction[2], normal / np.linalg.norm(normal), uv


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_lie_where_mitsuba_puts_them_and_wear_their_pictures_alike(kind: str, tmp_path: Path):
    """60 camera rays, traced by Mitsuba through the file and by hand through the imported mesh."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    light = '<emitter type="constant"/>'
    source = write(tmp_path, shape(kind, SHAPES[kind]) + light)
    # Mitsuba's picture without a slope between its two colours, which is hers alone to render
    inside = SHAPES[kind].replace('<string name="filename" value="t.png"/>', NEAREST)
    write(tmp_path, shape(kind, inside) + light, "nearest.xml")
    mesh = read_scene(source, tmp_path, BANDS, "x").objects[0].mesh
    theirs = mi.load_file(str(tmp_path / "nearest.xml"))
    pose = theirs.sensors()[0].world_transform()
    hits, colours = 0, []
    for x, y in np.random.default_rng(3).uniform(-0.12, 0.12, (60, 2)):
        # camera space has x to the right, Mitsuba's sensor to the left
        ray = mi.Ray3f(pose @ mi.Point3f(0, 0, 0), mi.Vector3f(pose @ mi.Vector3f(*_unit(-x, y, 1.0))))
        si = theirs.ray_intersect(ray)
        mine = trace(mesh, np.array([x, y, 1.0]))
        assert si.is_valid() == (mine is not None)
        if mine is None:
            continue
        hits += 1
        depth, normal, uv = mine
        assert depth == pytest.approx((pose.inverse() @ si.p).z, abs=4e-3)
        there = np.array(pose.inverse() @ mi.Vector3f(si.n)) * [-1, 1, 1]
        assert normal @ there > 0.995
        if uv is not None:
            up = 1.0 if si.wi.z > 0 else -1.0
            si.wi = mi.Vector3f(0, 0, 1)
            seen = np.array(si.bsdf().eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1))) * np.pi
            colours.append((seen, [uv[1] % 1 > 0.5, uv[0] % 1 < 0.5], up))
    assert hits > 10
    for seen, want, _ in colours:
        np.testing.assert_allclose(seen[:2], np.array(want, float), atol=0.02)


def _unit(*xyz: float) -> np.ndarray:
    return np.array(xyz) / np.linalg.norm(xyz)


def test_an_environment_map_shines_from_where_mitsuba_has_it(tmp_path: Path):
    """A smooth map that tells all directions apart; radiance along 200 rays, ours at the nearest of 64 x 128
    pixels: half a pixel is 0.012 of an azimuth's wave."""
    import mitsuba as mi
    import OpenEXR

    mi.set_variant("scalar_rgb")
    rows, columns = 64, 128
    around = 2 * np.pi * (np.arange(columns) + 0.5)[None] / columns
    down = (np.arange(rows) + 0.5)[:, None] / rows
    image = np.stack(np.broadcast_arrays(1 + np.cos(around), 1 + np.sin(around), down), axis=-1)
    image = image.astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {c: np.ascontiguousarray(image[..., i]) for i, c in enumerate("RGB")}
    OpenEXR.File(header, channels).write(str(tmp_path / "e.exr"))
    turn = '<transform name="to_world"><rotate x="0.6" y="0.8" angle="70"/></transform>'
    light = f'<emitter type="envmap"><string name="filename" value="e.exr"/>{turn}</emitter>'
    source = write(tmp_path, shape("sphere", '<float name="radius" value="0.001"/>') + light)
    ours = read_scene(source, tmp_path, BANDS, "x").environment.radiance.image
    with reading_files():
        theirs = mi.load_file(str(tmp_path / "s.xml"))
    pose = theirs.sensors()[0].world_transform()
    errors = []
    for direction in np.random.default_rng(0).standard_normal((200, 3)):
        x, y, z = direction / np.linalg.norm(direction)
        ray = mi.Ray3f(mi.Point3f(9, 9, 9), mi.Vector3f(pose @ mi.Vector3f(-x, y, z)))
        want = np.array(theirs.environment().eval(theirs.ray_intersect(ray)))[:3]
        row = (0.5 - np.arcsin(y) / np.pi) * rows
        column = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * columns
        got = ours[min(int(row), rows - 1), int(column) % columns]
        errors.append(np.abs(got - want))
    assert (np.mean(errors, axis=0) < 0.02).all()


def test_json_and_xml_say_the_same(tmp_path: Path):
    body = shape("cube", '<bsdf type="twosided"><bsdf type="roughplastic"><float name="alpha" value="0.2"/>'
                 '<rgb name="diffuse_reflectance" value="0.2 0.5 0.8"/></bsdf></bsdf>', "")  # fmt: skip
    xml = read_scene(write(tmp_path, body + '<emitter type="constant"/>'), tmp_path, BANDS, "x")
    pose = look_at(np.array([1.0, 2, 5]), np.array([0, 0.2, 0]), np.array([0, 1.0, 0]), "x")
    scene = {
        "type": "scene",
        "camera": {"type": "perspective", "to_world": pose.tolist()},
        "box": {"type": "cube", "bsdf": {"type": "twosided", "inner": {
            "type": "roughplastic", "alpha": 0.2,
            "diffuse_reflectance": {"type": "rgb", "value": [0.2, 0.5, 0.8]}}}},
        "sky": {"type": "constant"},
    }  # fmt: skip
    (tmp_path / "s.json").write_text(json.dumps(scene))
    own = read_scene(MitsubaSource(kind="mitsuba", path="s.json"), tmp_path, BANDS, "x")
    np.testing.assert_allclose(own.objects[0].mesh.vertices, xml.objects[0].mesh.vertices, atol=1e-5)
    assert own.objects[0].surface.bsdf == xml.objects[0].surface.bsdf
    assert own.objects[0].surface.two_sided and xml.objects[0].surface.two_sided


@pytest.mark.parametrize(
    "seed", [*range(20), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(20, 50))]
)
def test_dictionaries_may_name_what_comes_later(tmp_path: Path, seed: int):
    """Surfaces and textures in any order, within others or not: the same scene as with everything in its
    place."""
    draw = np.random.default_rng(seed)
    plain: dict[str, object] = {}
    named: dict[str, object] = {}
    for number in range(int(draw.integers(1, 6))):
        skin = {"type": "diffuse", "reflectance": {"type": "rgb", "value": draw.uniform(0, 1, 3).tolist()}}
        coat = {"type": "twosided", "inner": skin}
        plain[f"ball-{number}"] = {"type": "sphere", "radius": 1 + number, "skin": coat}
        named[f"ball-{number}"] = {"type": "sphere", "radius": 1 + number,
                                   "skin": {"type": "ref", "id": f"coat-{number}"}}  # fmt: skip
        named[f"coat-{number}"] = {"type": "twosided", "inner": {"type": "ref", "id": f"skin-{number}"}}
        named[f"skin-{number}"] = skin
    rest = {"sky": {"type": "constant"}, "way": {"type": "path", "max_depth": int(draw.integers(1, 9))}}
    found = []
    for name, parts in (
        ("plain", plain),
        ("named", {key: named[key] for key in draw.permutation(list(named))}),
    ):
        (tmp_path / f"{name}.json").write_text(json.dumps({"type": "scene", **parts, **rest}))
        found.append(read_scene(MitsubaSource(kind="mitsuba", path=f"{name}.json"), tmp_path, BANDS, "x"))
    first, second = ({float(np.ptp(o.mesh.vertices)): o.surface for o in model.objects} for model in found)
    assert first.keys() == second.keys()
    for size, surface in first.items():
        assert surface.two_sided and second[size].two_sided
        np.testing.assert_allclose(surface.reflectance.basis, second[size].reflectance.basis)
    assert found[0].path_length == found[1].path_length == rest["way"]["max_depth"]


@pytest.mark.parametrize(("identity", "complaint"), [("none", "does not define"), ("a", "refers to itself")])
def test_a_reference_that_leads_nowhere_is_named(tmp_path: Path, identity: str, complaint: str):
    inner = {"type": "twosided", "inner": {"type": "ref", "id": identity}}
    (tmp_path / "s.json").write_text(json.dumps({"type": "scene", "ball": {"type": "sphere", "a": inner}}))
    with pytest.raises(InputError, match=complaint):
        read_scene(MitsubaSource(kind="mitsuba", path="s.json"), tmp_path, BANDS, "x")


def test_what_a_dictionary_has_besides_is_named(tmp_path: Path):
    scene = {"type": "scene", "ball": {"type": "sphere"}, "sky": {"type": "constant"}, "x": {"type": "odd"}}
    (tmp_path / "s.json").write_text(json.dumps(scene))
    with pytest.raises(NotCarried, match="'odd'"):
        read_scene(MitsubaSource(kind="mitsuba", path="s.json"), tmp_path, BANDS, "x")


def test_an_orthographic_sensor_is_said_to_be_taken_as_a_pinhole(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    pose = np.diag([2.0, 2, 1, 1])
    for kind in ("perspective", "orthographic"):
        scene = {"type": "scene", "ball": {"type": "sphere"}, "sky": {"type": "constant"},
                 "camera": {"type": kind, "to_world": pose.tolist()}}  # fmt: skip
        (tmp_path / "s.json").write_text(json.dumps(scene))
        model = read_scene(MitsubaSource(kind="mitsuba", path="s.json"), tmp_path, BANDS, "x")
    assert "'orthographic'" in caplog.text and "perspective" not in caplog.text
    assert np.ptp(model.objects[0].mesh.vertices, axis=0) == pytest.approx(2)


def test_units_and_the_recipes_own_light(tmp_path: Path):
    source = write(tmp_path, shape("sphere", '<float name="radius" value="0.1"/>', ""))
    scene = {"name": "own", "source": {**source.model_dump(), "units_m": 0.01}}
    with pytest.raises(InputError, match="no light"):
        build_scene(SceneRecipe.model_validate(scene), tmp_path)
    model = build_scene(SceneRecipe.model_validate({**scene, "lights": [{"kind": "sky"}]}), tmp_path)
    distance = np.linalg.norm(np.array([1, 2, 5]))
    centre = model.objects[0].mesh.vertices.mean(axis=0)
    assert np.linalg.norm(centre) == pytest.approx(0.01 * distance, rel=1e-3)


def test_defaults_and_references_are_filled_in(tmp_path: Path):
    body = """<default name="grey" value="0.25"/>
        <bsdf type="diffuse" id="paint"><spectrum name="reflectance" value="$grey"/></bsdf>
        <shape type="cube"><ref id="paint"/></shape><emitter type="constant"/>"""
    model = read_scene(write(tmp_path, body), tmp_path, BANDS, "x")
    np.testing.assert_allclose(model.objects[0].surface.reflectance.basis, 0.25)


def test_area_lights_and_spectra_in_pairs(tmp_path: Path):
    body = shape(
        "rectangle", '<emitter type="area"><spectrum name="radiance" value="400:1, 500:2, 700:6"/></emitter>'
    )
    model = read_scene(write(tmp_path, body), tmp_path, BANDS, "x")
    np.testing.assert_allclose(model.objects[0].emission, [1.5, 3.0, 5.0])


@pytest.mark.parametrize("name", ["../secret.obj", "/etc/passwd"])
def test_files_outside_the_folder_are_refused_unless_allowed(tmp_path: Path, name: str):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret.obj").write_text(QUAD)
    body = shape("obj", f'<string name="filename" value="{name}"/>') + '<emitter type="constant"/>'
    source = write(folder, body)
    with pytest.raises(InputError, match="outside the scene's folder"):
        read_scene(source, folder, BANDS, "x")
    if name.startswith(".."):
        trusting = source.model_copy(update={"allow_outside": True})
        assert len(read_scene(trusting, folder, BANDS, "x").objects) == 1


def test_a_link_does_not_lead_outside_either(tmp_path: Path):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret.obj").write_text(QUAD)
    (folder / "here.obj").symlink_to(tmp_path / "secret.obj")
    source = write(folder, shape("obj", '<string name="filename" value="here.obj"/>'))
    with pytest.raises(InputError, match="outside"):
        read_scene(source, folder, BANDS, "x")


@pytest.mark.parametrize(
    "inside",
    ['<bsdf type="roughdielectric"/>', '<bsdf type="bumpmap"/>',
     '<bsdf type="plastic"><boolean name="nonlinear" value="true"/></bsdf>',
     '<bsdf type="principled"><float name="spec_tint" value="0.5"/></bsdf>'],
)  # fmt: skip
def test_surfaces_that_no_single_path_carries_are_told_apart_from_mistakes(tmp_path: Path, inside: str):
    with pytest.raises(NotCarried, match="spectral renderer"):
        read_scene(write(tmp_path, shape("cube", inside)), tmp_path, BANDS, "x")


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        (shape("serialized", ""), "serialized"),
        (shape("cube", '<ref id="nothing"/>'), "does not define"),
        (
            shape("cube", '<bsdf type="diffuse"><rgb name="reflectance" value="0.2 2 0.1"/></bsdf>'),
            "between 0 and 1",
        ),
        (shape("disk", PICTURE), "texture coordinates"),
        (shape("cube", "") + '<emitter type="point"/>', "lights of type 'point'"),
        ("", "no shapes"),
        ("<shape", "not valid XML"),
        (shape("obj", '<string name="filename" value="none.obj"/>'), "does not exist"),
    ],
)
def test_files_that_cannot_be_used_are_refused(tmp_path: Path, body: str, complaint: str):
    with pytest.raises(InputError, match=complaint):
        read_scene(write(tmp_path, body), tmp_path, BANDS, "x")


def test_a_bomb_of_entities_is_refused(tmp_path: Path):
    """Ten levels of ten references each would be ten thousand million characters."""
    entities = '<!ENTITY a0 "aaaaaaaaaa">' + "".join(
        f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10)
    )
    (tmp_path / "s.xml").write_text(
        f"<!DOCTYPE scene [{entities}]><scene><string name='x' value='&a9;'/></scene>"
    )
    with pytest.raises(InputError, match="not valid XML|entities"):
        read_scene(MitsubaSource(kind="mitsuba", path="s.xml"), tmp_path, BANDS, "x")
