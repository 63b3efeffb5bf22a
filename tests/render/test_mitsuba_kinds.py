# ruff: noqa: E501 - a scene a line
"""Each kind of plugin that Mitsuba's documentation shows is rendered, by one route or the other, or refused by
name. The scenes are small ones of our own, one for each kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from edofsim.errors import InputError
from edofsim.recipe import SceneRecipe
from edofsim.render import render

DIFFUSE = '<bsdf type="diffuse"/>'
TWO = DIFFUSE + '<bsdf type="plastic"/>'
FILE = '<string name="filename" value="t.png"/>'
GREY = '<texture type="bitmap" name="{}"><string name="filename" value="g.png"/></texture>'
"""Mitsuba's spectral variant takes numbers from pictures of one channel, or raw ones."""
BITMAP = '<texture type="bitmap" name="{}">' + FILE + "</texture>"
EVEN = '<emitter type="constant"/>'


def ball(bsdf: str, rest: str = EVEN) -> str:
    return f'<shape type="sphere">{bsdf}</shape>{rest}'


def bsdf(kind: str, inside: str = "") -> str:
    return ball(f'<bsdf type="{kind}">{inside}</bsdf>')


def shape(kind: str, inside: str = "") -> str:
    return f'<shape type="{kind}">{inside}{DIFFUSE}</shape>{EVEN}'


def light(kind: str, inside: str = "") -> str:
    return ball(DIFFUSE, f'<emitter type="{kind}">{inside}</emitter>')


def lamp(inside: str) -> str:
    return ball(DIFFUSE) + f'<shape type="rectangle"><emitter type="area">{inside}</emitter></shape>'


def texture(kind: str, inside: str = "") -> str:
    return bsdf("diffuse", f'<texture type="{kind}" name="reflectance">{inside}</texture>')


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


FOG = '<medium type="homogeneous" name="interior"><float name="scale" value="0.5"/></medium>'
VOLPATH = '<integrator type="volpath"/>'
GROUP = f'<shape type="shapegroup" id="g"><shape type="sphere">{DIFFUSE}</shape></shape>{EVEN}'
LOOK = '<transform name="to_world"><lookat origin="0,3,0.1" target="0,0,0" up="0,0,1"/></transform>'
NORMALS = '<texture type="bitmap" name="normalmap">' + FILE + '<boolean name="raw" value="true"/></texture>'
KINDS = {
    **{f"bsdf {kind}": bsdf(kind) for kind in (
        "diffuse", "plastic", "roughplastic", "dielectric", "thindielectric", "roughdielectric", "conductor",
        "roughconductor", "principled", "principledthin", "null", "pplastic", "hair")},
    "bsdf dielectric with a colour": bsdf("dielectric", '<rgb name="specular_transmittance" value="0.4 0.8 0.9"/>'),
    "bsdf dielectric of named media": bsdf("dielectric", '<string name="int_ior" value="water"/><string '
                                           'name="ext_ior" value="air"/>'),
    "bsdf conductor of gold": bsdf("conductor", '<string name="material" value="Au"/>'),
    "bsdf roughconductor, brushed": bsdf("roughconductor", number("alpha_u", 0.05) + number("alpha_v", 0.3)),
    "bsdf roughconductor, textured": bsdf("roughconductor", GREY.format("alpha")),
    "bsdf roughplastic, nonlinear": bsdf("roughplastic", '<boolean name="nonlinear" value="true"/>'),
    "bsdf roughdielectric, textured": bsdf("roughdielectric", GREY.format("alpha")),
    "bsdf twosided": bsdf("twosided", DIFFUSE),
    "bsdf twosided, two": bsdf("twosided", TWO),
    "bsdf blendbsdf": bsdf("blendbsdf", number("weight", 0.5) + TWO),
    "bsdf mask": bsdf("mask", number("opacity", 0.5) + DIFFUSE),
    "bsdf bumpmap": bsdf("bumpmap", GREY.format("arbitrary") + DIFFUSE),
    "bsdf normalmap": bsdf("normalmap", NORMALS + DIFFUSE),
    "bsdf measured": bsdf("measured", '<string name="filename" value="none.bsdf"/>'),
    "bsdf polarizer": bsdf("polarizer"),
    "bsdf retarder": bsdf("retarder"),
    "bsdf circular": bsdf("circular"),
    "bsdf principled, metallic picture": bsdf("principled", GREY.format("metallic")),
    "bsdf principled, spec_tint": bsdf("principled", number("spec_tint", 0.5)),
    "bsdf principled, sheen": bsdf("principled", number("sheen", 0.5)),
    "bsdf principled, clearcoat": bsdf("principled", number("clearcoat", 0.9) + number("clearcoat_gloss", 0.5)),
    "bsdf principled, glass": bsdf("principled", number("spec_trans", 0.9)),
    "bsdf principled, flatness": bsdf("principled", number("flatness", 0.7)),
    "bsdf principled, anisotropic": bsdf("principled", number("anisotropic", 0.7)),
    **{f"shape {kind}": shape(kind) for kind in ("sphere", "rectangle", "cube", "disk", "cylinder")},
    "shape obj": shape("obj", '<string name="filename" value="m.obj"/>'),
    "shape ply": shape("ply", '<string name="filename" value="m.ply"/>'),
    "shape obj, flat": shape("obj", '<string name="filename" value="m.obj"/><boolean name="face_normals" '
                             'value="true"/>'),
    "shape serialized": shape("serialized", '<string name="filename" value="none.serialized"/>'),
    "shape instance": GROUP + '<shape type="instance"><ref id="g"/></shape>',
    "shape bsplinecurve": shape("bsplinecurve", '<string name="filename" value="c.txt"/>'),
    "shape linearcurve": shape("linearcurve", '<string name="filename" value="c.txt"/>'),
    "shape flipped": shape("sphere", '<boolean name="flip_normals" value="true"/>'),
    "shape cylinder, bent": shape("cylinder", '<point name="p0" value="0,-1,0"/><point name="p1" value="0,1,0"/>'),
    "emitter constant": light("constant"),
    "emitter point": light("point", '<point name="position" value="0,3,3"/>'),
    "emitter spot": light("spot", LOOK),
    "emitter projector": light("projector", BITMAP.format("irradiance") + LOOK),
    "emitter directional": light("directional", '<vector name="direction" value="0,-1,-1"/>'),
    "emitter envmap": light("envmap", FILE),
    "emitter sunsky": light("sunsky"),
    "emitter area": lamp('<rgb name="radiance" value="4"/>'),
    "emitter area, textured": lamp(BITMAP.format("radiance")),
    "emitter directionalarea": ball(DIFFUSE) + '<shape type="rectangle"><emitter type="directionalarea"/></shape>',
    "texture bitmap": texture("bitmap", FILE),
    "texture bitmap, nearest": texture("bitmap", FILE + '<string name="filter_type" value="nearest"/>'),
    "texture bitmap, mirrored": texture("bitmap", FILE + '<string name="wrap_mode" value="mirror"/>'),
    "texture bitmap, moved": texture("bitmap", FILE + '<transform name="to_uv"><scale value="3"/></transform>'),
    "texture checkerboard": texture("checkerboard"),
    "texture checkerboard, moved": texture("checkerboard", '<transform name="to_uv"><scale value="4"/></transform>'),
    "texture mesh_attribute": f'<shape type="ply"><string name="filename" value="m.ply"/><bsdf type="diffuse">'
    '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'
    f"</bsdf></shape>{EVEN}",
    "spectrum uniform": bsdf("diffuse", '<spectrum name="reflectance" value="0.3"/>'),
    "spectrum in pairs": bsdf("diffuse", '<spectrum name="reflectance" value="400:0.1, 800:0.9"/>'),
    "spectrum from a file": bsdf("diffuse", '<spectrum name="reflectance" filename="r.spd"/>'),
    "spectrum rgb": bsdf("diffuse", '<rgb name="reflectance" value="#4080ff"/>'),
    "spectrum blackbody": lamp('<spectrum type="blackbody" name="radiance"><float name="temperature" '
                               'value="3000"/></spectrum>'),
    "spectrum d65": lamp('<spectrum type="d65" name="radiance"/>'),
    "medium homogeneous": VOLPATH + ball(f'<bsdf type="null"/>{FOG}'),
    "medium behind glass": VOLPATH + ball(f'<bsdf type="dielectric"/>{FOG}'),
    **{f"integrator {kind}": f'<integrator type="{kind}"/>' + ball(DIFFUSE) for kind in (
        "path", "direct", "volpath", "volpathmis", "depth", "ptracer")},
    "integrator aov": '<integrator type="aov"><string name="aovs" value="dd.y:depth"/></integrator>' + ball(DIFFUSE),
    "sensor thinlens": ball(DIFFUSE),
    "include": '<include filename="part.xml"/>' + EVEN,
    "path": '<path value="parts"/><include filename="inner.xml"/>' + EVEN,
    "default": '<default name="grey" value="0.2"/>' + bsdf("diffuse", '<spectrum name="reflectance" value="$grey"/>'),
    "alias": f'<bsdf type="diffuse" id="a"/><alias id="a" as="b"/><shape type="sphere"><ref id="b"/></shape>{EVEN}',
    "later": f'<shape type="sphere"><ref id="a"/></shape><bsdf type="diffuse" id="a"/>{EVEN}',
    "old names": '<integrator type="path"><integer name="maxDepth" value="3"/></integrator>' + ball(DIFFUSE),
}  # fmt: skip
REFUSED = {
    "bsdf measured": "none.bsdf",
    "shape serialized": "none.serialized",
}
"""What cannot be rendered here, and a word of the message: files that Mitsuba's data has and we do not ship."""


def files(folder: Path) -> None:
    imsave(folder / "t.png", np.full((8, 16, 3), 140, np.uint8), check_contrast=False)
    imsave(folder / "g.png", np.full((8, 16), 90, np.uint8), check_contrast=False)
    triangle = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (folder / "m.obj").write_text(triangle)
    (folder / "m.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float r\nproperty float g\nproperty float b\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n-1 -1 0 .2 .3 .4\n1 -1 0 .2 .3 .4\n0 1 0 .2 .3 .4\n3 0 1 2\n"
    )
    (folder / "c.txt").write_text("-1 0 0 .3\n-.3 .2 0 .3\n.3 -.2 0 .3\n1 0 0 .3\n")
    (folder / "r.spd").write_text("360 0.2\n830 0.6\n")
    (folder / "parts").mkdir()
    part = f'<scene version="3.0.0"><shape type="sphere">{DIFFUSE}</shape></scene>'
    (folder / "part.xml").write_text(part)
    (folder / "parts" / "inner.xml").write_text(part)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_of_the_documentation_is_rendered_or_refused_by_name(kind: str, tmp_path: Path):
    files(tmp_path)
    sensor = "thinlens" if kind == "sensor thinlens" else "perspective"
    lens = number("aperture_radius", 0.1) + number("focus_distance", 4) if sensor == "thinlens" else ""
    (tmp_path / "s.xml").write_text(
        f'<scene version="3.0.0"><sensor type="{sensor}">{lens}<transform name="to_world"><lookat '
        f'origin="0,0,4" target="0,0,0" up="0,1,0"/></transform></sensor>{KINDS[kind]}</scene>'
    )
    recipe = SceneRecipe.model_validate(
        {
            "name": "kind",
            "bands": {"count": 4},
            "frame": {"width_px": 12, "height_px": 9, "margin_px": 0, "pixel_angle_mrad": 50.0},
            "render": {"samples": 4, "hidden": False},
            "source": {"kind": "mitsuba", "path": "s.xml"},
        }
    )
    if kind in REFUSED:
        with pytest.raises(InputError, match=REFUSED[kind]):
            render(recipe, tmp_path, cache=tmp_path)
        return
    view = render(recipe, tmp_path, cache=tmp_path)
    image = view.all_in_focus()
    assert bool(image.isfinite().all()) and float(image.max()) > 0
    assert (view.inverse_depth > 0).any()
