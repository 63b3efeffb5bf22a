"""Whatever a Mitsuba scene's file says is read, or sends the scene to Mitsuba by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from edofsim.errors import InputError
from edofsim.recipe.scene import SceneRecipe
from edofsim.render.keys import view_key
from edofsim.scene.foreign import LONGEST, MitsubaSource, NotCarried, read_scene
from edofsim.scene.model import SceneModel

BANDS = np.array([450, 550, 650]) * 1e-9
PAINT = '<bsdf type="diffuse"><spectrum name="reflectance" value="0.25"/></bsdf>'
LIGHT = '<emitter type="constant"/>'
FILE = '<string name="filename" value="t.png"/>'
BITMAP = f'<texture type="bitmap" name="reflectance">{FILE}'
GREY = '<spectrum name="reflectance" value="0.25"/>'


def read(folder: Path, body: str, **more: object) -> SceneModel:
    (folder / "s.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
    return read_scene(MitsubaSource(kind="mitsuba", path="s.xml", **more), folder, BANDS, "x")


def cube(inside: str) -> str:
    return f'<shape type="cube">{inside}</shape>{LIGHT}'


def bsdf(kind: str, inside: str = "") -> str:
    return cube(f'<bsdf type="{kind}">{inside}</bsdf>')


UNREAD = {
    "a picture of roughness": bsdf("principled", BITMAP.replace("reflectance", "roughness") + "</texture>"),
    "two roughnesses": bsdf("roughconductor", '<float name="alpha_u" value="0.1"/>'),
    "anisotropy": bsdf("principled", '<float name="anisotropic" value="0.5"/>'),
    "an index": bsdf("principled", '<float name="eta" value="1.8"/>'),
    "a metal of its own": bsdf("conductor", '<float name="eta" value="1.5"/><float name="k" value="2"/>'),
    "a metal by name": bsdf("conductor", '<string name="material" value="Cr"/>'),
    "no gloss": bsdf("plastic", '<spectrum name="specular_reflectance" value="0"/>'),
    "clamped": bsdf("diffuse", BITMAP + '<string name="wrap_mode" value="clamp"/></texture>'),
    "nearest": bsdf("diffuse", BITMAP + '<string name="filter_type" value="nearest"/></texture>'),
    "moved picture": bsdf(
        "diffuse", BITMAP + '<transform name="to_uv"><scale value="2"/></transform></texture>'
    ),
    "corners' colours": bsdf("diffuse", '<texture type="mesh_attribute" name="reflectance"/>'),
    "two surfaces": cube(PAINT + PAINT),
    "a pair": bsdf("twosided", PAINT + PAINT),
    "a medium": cube(PAINT + '<medium name="interior" type="homogeneous"/>'),
    "instances": cube(PAINT) + '<shape type="shapegroup" id="g"><shape type="sphere"/></shape>',
    "serialized": cube(PAINT) + '<shape type="serialized"><string name="filename" value="x"/></shape>',
    "a picture on a lamp": cube(
        '<emitter type="area">' + BITMAP.replace("reflectance", "radiance") + "</texture></emitter>"
    ),
    "point light": cube(PAINT) + '<emitter type="point"/>',
    "spot light": cube(PAINT) + '<emitter type="spot"/>',
    "directional light": cube(PAINT) + '<emitter type="directional"/>',
    "sky of bytes": cube(PAINT).replace(LIGHT, f'<emitter type="envmap">{FILE}</emitter>'),
    "hidden lamps": cube(PAINT)
    + '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>',
    "an unknown tag": cube(f"{PAINT}<animation/>"),
    "an unknown attribute": bsdf("diffuse", GREY.replace("/>", ' intent="x"/>')),
    "a blackbody": bsdf("diffuse", '<spectrum type="blackbody" name="reflectance"/>'),
    "an unknown bsdf": bsdf("hair"),
}  # fmt: skip


@pytest.mark.parametrize("body", UNREAD.values(), ids=UNREAD)
def test_what_is_not_read_sends_the_scene_to_mitsuba(tmp_path: Path, body: str):
    imsave(tmp_path / "t.png", np.full((4, 4, 3), 99, np.uint8), check_contrast=False)
    with pytest.raises(NotCarried):
        read(tmp_path, body)


@pytest.mark.parametrize("seed", range(60))
def test_any_key_that_has_no_reader_is_named(tmp_path: Path, seed: int):
    """A key of letters at random, on any plugin of a sound scene."""
    draw = np.random.default_rng(seed)
    key = "".join(draw.choice(list("abcdefghij"), 9))
    value = [f'<float name="{key}" value="1"/>', f'<string name="{key}" value="x"/>',
             f'<rgb name="{key}" value="1"/>', f'<boolean name="{key}" value="true"/>'][seed % 4]  # fmt: skip
    places = [
        '<bsdf type="diffuse">',
        '<shape type="cube">',
        '<emitter type="constant">',
        '<integrator type="path">',
    ]
    sound = (
        '<integrator type="path"></integrator><shape type="cube"><bsdf type="diffuse"></bsdf></shape>'
        '<emitter type="constant"></emitter>'
    )
    read(tmp_path, sound)
    place = places[seed // 4 % 4]
    with pytest.raises(NotCarried, match=key):
        read(tmp_path, sound.replace(place, place + value))


def test_what_stands_later_elsewhere_or_under_another_name_is_found(tmp_path: Path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "paint.xml").write_text(
        f'<scene version="3.0.0"><default name="grey" value="0.25"/><bsdf type="diffuse" id="paint">'
        f"{GREY.replace('0.25', '$grey')}</bsdf></scene>"
    )
    (tmp_path / "parts" / "red.spd").write_text("# nm\n400 0.25\n800, 0.25\n")
    body = (
        '<path value="parts"/><shape type="cube"><ref id="skin"/></shape><shape type="sphere"><bsdf '
        'type="diffuse"><spectrum name="reflectance" filename="red.spd"/></bsdf></shape>'
        '<shape type="disk"><ref id="late"/></shape><include filename="paint.xml"/>'
        f'<alias id="paint" as="skin"/>{LIGHT}<bsdf type="diffuse" id="late">{GREY}</bsdf>'
    )
    model = read(tmp_path, body)
    assert len(model.objects) == 3
    for thing in model.objects:
        np.testing.assert_allclose(thing.surface.reflectance.basis, 0.25)


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ('<include filename="../secret.xml"/>', "outside the scene's folder"),
        ('<path value=".."/><include filename="secret.xml"/>', "outside the scene's folder"),
        (bsdf("diffuse", '<spectrum name="reflectance" filename="../secret.xml"/>'), "outside the scene's"),
        ('<include filename="s.xml"/>', "includes more than"),
        ('<include filename="none.xml"/>', "does not exist"),
        ('<bsdf type="twosided" id="a"><ref id="a"/></bsdf>', "refers to itself"),
        ('<alias id="nothing" as="b"/>', "does not define"),
    ],
)  # fmt: skip
def test_files_and_names_that_cannot_be_followed_are_refused(tmp_path: Path, body: str, complaint: str):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret.xml").write_text("<scene/>")
    with pytest.raises(InputError, match=complaint):
        read(folder, body + cube(PAINT))


@pytest.mark.parametrize(
    ("integrator", "length"),
    [
        ("", LONGEST),
        ('<integrator type="path"/>', LONGEST),
        ('<integrator type="path"><integer name="max_depth" value="-1"/></integrator>', LONGEST),
        ('<integrator type="path"><integer name="maxDepth" value="7"/></integrator>', 7),
        ('<integrator type="volpath"><integer name="max_depth" value="1000"/></integrator>', LONGEST),
        ('<integrator type="direct"/>', 2),
    ],
)
def test_paths_are_as_long_as_the_file_says(tmp_path: Path, integrator: str, length: int):
    assert read(tmp_path, integrator + cube(PAINT)).path_length == length


def test_the_recipe_may_ask_for_another_length_which_is_another_view(tmp_path: Path):
    read(tmp_path, cube(PAINT))
    own = {"name": "x", "source": {"kind": "mitsuba", "path": "s.xml"}}
    recipes = [own, {**own, "render": {"max_depth": 5}}, {**own, "render": {"samples": 64}}]
    keys = [view_key(SceneRecipe.model_validate(each), tmp_path) for each in recipes]
    assert keys[0] != keys[1] and keys[0] == keys[2]


def test_a_lamp_without_a_surface_reflects_nothing_and_other_shapes_half(tmp_path: Path):
    """As Mitsuba has them."""
    lamp = '<shape type="sphere"><emitter type="area"/></shape>'
    model = read(tmp_path, lamp + '<shape type="cube"/>')
    assert [float(thing.surface.reflectance.basis.max()) for thing in model.objects] == [0.0, 0.5]


def test_an_axis_of_another_length_scales_as_mitsuba_has_it(tmp_path: Path):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    turn = '<transform name="to_world"><rotate x="0.4" y="1" z="0.5" angle="40"/></transform>'
    model = read(tmp_path, f'<shape type="rectangle">{turn}</shape>{LIGHT}')
    want = np.array(mi.ScalarTransform4f().rotate([0.4, 1, 0.5], 40).matrix)[:3, :3]
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) @ want.T
    np.testing.assert_allclose(model.objects[0].mesh.vertices, corners * [-1, 1, 1], atol=1e-5)
