# ruff: noqa: E501 - a scene a line
"""Scenes as Mitsuba's documentation has them, remade small: they include files from other folders, name what comes
later, and use every kind of plugin. Each is rendered, or refused by name."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from edofsim.core.images import write_exr
from edofsim.errors import InputError
from edofsim.recipe import SceneRecipe
from edofsim.render import render
from edofsim.render.engine import use_engine

COMMON = '<path value="../../common"/>'
SENSOR = """
    <sensor type="perspective" id="Camera-camera">
        <string name="fov_axis" value="smaller"/><float name="focus_distance" value="6.0"/>
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat target="0, 0, 0.5" origin="3, -3, 3" up="0, 0, 1"/></transform>
        <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
        <film type="hdrfilm" id="film">
            <integer name="width" value="68"/><integer name="height" value="51"/>
            <string name="pixel_format" value="rgb"/><rfilter type="gaussian"/>
        </film>
    </sensor>"""
SKY = """
    <emitter type="envmap" id="Area_002-light">
        <string name="filename" value="textures/envmap.exr"/>
        <transform name="to_world"><rotate y="1" angle="-180"/><matrix value="0 0 -1 0 -1 0 0 0 0 1 0 8.87 0 0 0 1 "/>
        </transform>
        <float name="scale" value="3"/>
    </emitter>"""
FLOOR = """
    <texture type="checkerboard" id="planetex">
        <rgb name="color0" value="0.2"/><rgb name="color1" value="0.4"/>
        <transform name="to_uv"><matrix value="8 0 0 0 0 8 0 0 0 0 8 0 0 0 0 1"/></transform>
    </texture>
    <bsdf type="diffuse" id="planemat"><ref name="reflectance" id="planetex"/></bsdf>
    <shape type="serialized" id="Plane-mesh_0">
        <string name="filename" value="meshes/matpreview.serialized"/><integer name="shape_index" value="0"/>
        <transform name="to_world"><rotate z="1" angle="-4.3"/><matrix value="3 -3 0 0 3 3 0 0 0 0 4 0 0 0 0 1"/>
        </transform>
        <ref name="bsdf" id="planemat"/>
    </shape>"""
BALL = """
    <shape type="serialized">
        <string name="filename" value="meshes/matpreview.serialized"/><integer name="shape_index" value="1"/>
        <transform name="to_world"><scale value="0.6"/><translate z="0.6"/></transform><ref id="object_bsdf"/>
    </shape>"""
DEFAULTS = """
    <default name="spp" value="64"/><default name="integrator" value="path"/>
    <default name="rr_depth" value="5"/><default name="max_depth" value="-1"/>"""
PATH = """
    <integrator type="$integrator">
        <integer name="rr_depth" value="$rr_depth"/><integer name="max_depth" value="$max_depth"/>
    </integrator>"""
STOKES = '<integrator type="stokes"><integrator type="path"/></integrator>'
LAMPS = "".join(
    f'<shape type="sphere"><float name="radius" value="{radius}"/><point name="center" x="{x}" y="1" z="1.5"/>'
    f'<emitter type="area"><spectrum name="radiance" value="{1 / radius**2}"/></emitter></shape>'
    for x, radius in ((-0.6, 0.05), (0, 0.15), (0.6, 0.3))
)
PLATE = '<bsdf type="roughconductor" id="object_bsdf"><float name="alpha" value="0.05"/></bsdf>'
INCLUDES = {
    "matpreview": DEFAULTS + '<integrator type="path"/>' + SENSOR + SKY + FLOOR + BALL,
    "matpreview_stokes": DEFAULTS + STOKES + SENSOR + SKY + FLOOR + BALL,
    "shape_scene": DEFAULTS + PATH + SENSOR + SKY + FLOOR,
    "sensor_scene": DEFAULTS + PATH + SKY + FLOOR + '<bsdf type="plastic" id="object_bsdf"/>' + BALL,
    "sampler_scene": DEFAULTS + SKY + FLOOR + '<bsdf type="plastic" id="object_bsdf"/>' + BALL,
    "integrator_scene": COMMON
    + DEFAULTS
    + SENSOR
    + SKY
    + FLOOR
    + '<bsdf type="plastic" id="object_bsdf"/>'
    + BALL,
    "veach_mis": DEFAULTS + SENSOR + PLATE + FLOOR + BALL + LAMPS,
    "animation_scene": DEFAULTS + '<integrator type="$integrator"/>' + SKY + FLOOR,
}


def include(name: str) -> str:
    return f'<include filename="include/{name}.xml"/>'


def material(inside: str, scene: str = "matpreview") -> str:
    """The material ball of a surface, whose `<bsdf` begins the text."""
    return COMMON + inside.replace("<bsdf ", '<bsdf id="object_bsdf" ', 1) + include(scene)


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


def word(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


def colour(name: str, value: str = "0.2, 0.25, 0.7") -> str:
    return f'<rgb name="{name}" value="{value}"/>'


def bitmap(name: str, file: str = "textures/noise.png", more: str = "") -> str:
    return f'<texture name="{name}" type="bitmap">{word("filename", file)}{more}</texture>'


def bsdf(kind: str, inside: str = "") -> str:
    return f'<bsdf type="{kind}">{inside}</bsdf>'


def shape(kind: str, inside: str = "", surface: str = "", place: str = '<translate z="1"/>') -> str:
    own = surface or bsdf("diffuse", colour("reflectance"))
    at = f'<transform name="to_world">{place}</transform>'
    return COMMON + f'<shape type="{kind}">{inside}{own}{at}</shape>' + include("shape_scene")


def two(inside: str) -> str:
    return bsdf("twosided", inside)


RAW = '<boolean name="raw" value="true"/>'
BOARD = bsdf("diffuse", bitmap("reflectance", "textures/board.png"))
DIFFUSE = bsdf("diffuse", colour("reflectance"))
ROUGH = bsdf("roughplastic", number("alpha", 0.1))
SPOT = '<transform name="to_world"><lookat origin="3, 0, 5" target="0, 0, 0" up="-1, 0, 0"/></transform>'
LIT = COMMON + DEFAULTS + '<integrator type="path"/>' + SENSOR + FLOOR + '<shape type="sphere"/>'
THIN = '<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate z="1"/></transform>{}</shape>'
DIM = '<emitter type="constant"><spectrum name="radiance" value="0.1"/></emitter>'
LENS = SENSOR.replace("perspective", "thinlens").replace(
    "</sensor>", "<float name='aperture_radius' value='0.1'/></sensor>"
)
ORTHOGRAPHIC = (
    SENSOR.replace("perspective", "orthographic").replace(word("fov_axis", "smaller"), "")
    .replace(number("focus_distance", "6.0"), "").replace(number("fov", 40), "")
)  # fmt: skip
CURVE = word("filename", "meshes/curves.txt")
GROUP = '<shape type="shapegroup" id="group">{}</shape><shape type="instance"><ref id="group"/></shape>'
VERTEX = bsdf(
    "diffuse",
    '<texture type="mesh_attribute" name="reflectance">' + word("name", "vertex_color") + "</texture>",
)
FACE = VERTEX.replace("vertex_color", "face_color")
MOVED = '<transform time="0"/><transform time="1"><translate x="0.2"/></transform>'
SMOKE = (
    '<shape type="cube"><bsdf type="null"/><medium name="interior" type="{}">{}</medium>'
    '<transform name="to_world"><translate z="1"/></transform></shape>'
)
ROOM = (
    DEFAULTS
    + '<integrator type="path"/>'
    + SENSOR
    + '<shape type="cube"><boolean name="flip_normals" value="true"/>'
    '<transform name="to_world"><scale value="5"/></transform><bsdf type="{}">{}</bsdf></shape>'
    '<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate z="4"/></transform>'
    '<emitter type="area"><rgb name="radiance" value="18.387, 10.9873, 2.75357"/></emitter></shape>'
)
SCENES = {
    "animation_emitter": COMMON + SENSOR.replace("$spp", "4") + include("animation_scene")
    + f'<emitter type="spot"><animation name="to_world">{MOVED}</animation></emitter>',
    "animation_rotation": COMMON + SENSOR.replace("$spp", "4") + include("animation_scene") + GROUP.format(
        f'<shape type="sphere">{DIFFUSE}</shape>').replace('<ref id="group"/>',
        f'<ref id="group"/><animation name="to_world">{MOVED}</animation>'),
    "animation_sensor": COMMON + SENSOR.replace("$spp", "4").replace("<film", number("shutter_close", 1) + "<film")
    + include("animation_scene"),
    "animation_shape": COMMON + SENSOR.replace("$spp", "4") + include("animation_scene")
    + f'<shape type="sphere"><animation name="to_world">{MOVED}</animation></shape>',
    "bsdf_blendbsdf": material(bsdf("blendbsdf", bitmap("weight", more=RAW) + bsdf("conductor") + ROUGH)),
    "bsdf_bumpmap_with": material(bsdf("bumpmap", bitmap("arbitrary", more=RAW) + number("scale", 20) + ROUGH)),
    "bsdf_bumpmap_without": material(ROUGH),
    "bsdf_conductor_aluminium": material(bsdf("conductor", word("material", "Al"))),
    "bsdf_conductor_gold": material(bsdf("conductor", word("material", "Au"))),
    "bsdf_dielectric_diamond": material(bsdf("dielectric", word("int_ior", "diamond") + word("ext_ior", "air"))),
    "bsdf_dielectric_glass": material(bsdf("dielectric", word("int_ior", "water") + word("ext_ior", "air"))),
    "bsdf_diffuse_plain": material(bsdf("diffuse", '<rgb name="reflectance" value="0.16 0.17 0.23"/>')),
    "bsdf_diffuse_textured": material(bsdf("diffuse", bitmap("reflectance", "textures/board.png"))),
    "bsdf_hair_blonde": shape("bsplinecurve", CURVE, bsdf("hair", number("eumelanin", 0.1) + number("pheomelanin", 0.4))),
    "bsdf_hair_brown": shape("bsplinecurve", CURVE, bsdf("hair", number("eumelanin", 0.2) + number("pheomelanin", 0.8))),
    "bsdf_mask_after": material(bsdf("mask", bitmap("opacity", more=RAW) + bsdf("twosided", DIFFUSE))),
    "bsdf_mask_before": material(two(DIFFUSE)),
    "bsdf_measured_aniso_cc_nothern_aurora": material(bsdf("measured", word("filename", "brdfs/aurora.bsdf"))),
    "bsdf_measured_aniso_morpho_melenaus": material(bsdf("measured", word("filename", "brdfs/morpho.bsdf"))),
    "bsdf_measured_polarized_fakegold": material(bsdf("measured_polarized", word("filename", "brdfs/fake.pbsdf"))),
    "bsdf_measured_polarized_fakegold_stokes": material(
        bsdf("measured_polarized", word("filename", "brdfs/fake.pbsdf")), "matpreview_stokes"),
    "bsdf_measured_polarized_gold": material(bsdf("measured_polarized", word("filename", "brdfs/gold.pbsdf"))),
    "bsdf_measured_polarized_gold_stokes": material(
        bsdf("measured_polarized", word("filename", "brdfs/gold.pbsdf")), "matpreview_stokes"),
    "bsdf_normalmap_with": material(bsdf("normalmap", bitmap("normalmap", "textures/normals.png", RAW) + ROUGH)),
    "bsdf_normalmap_without": material(ROUGH),
    "bsdf_plastic_default": material(bsdf("plastic", colour("diffuse_reflectance", "0.1, 0.27, 0.36"))),
    "bsdf_plastic_diffuse": material(bsdf("diffuse", bitmap("reflectance", "textures/board.png"))),
    "bsdf_plastic_nopreserve": material(bsdf("plastic", bitmap("diffuse_reflectance", "textures/board.png")
                                             + '<boolean name="nonlinear" value="true"/>')),
    "bsdf_plastic_preserve": material(bsdf("plastic", bitmap("diffuse_reflectance", "textures/board.png"))),
    "bsdf_plastic_shiny": material(bsdf("plastic", colour("diffuse_reflectance") + number("int_ior", 1.9))),
    "bsdf_polarizer": material(bsdf("polarizer", '<spectrum name="theta" value="30"/>')),
    "bsdf_pplastic": material(bsdf("pplastic", colour("diffuse_reflectance") + number("alpha", 0.06))),
    "bsdf_pplastic_diffuse": material(bsdf("pplastic", '<spectrum name="specular_reflectance" value="0"/>')),
    "bsdf_pplastic_diffuse_stokes": material(
        bsdf("pplastic", '<spectrum name="specular_reflectance" value="0"/>'), "matpreview_stokes"),
    "bsdf_pplastic_specular": material(bsdf("pplastic", colour("diffuse_reflectance", "0"))),
    "bsdf_pplastic_specular_stokes": material(bsdf("pplastic", colour("diffuse_reflectance", "0")), "matpreview_stokes"),
    "bsdf_principled_metal": material(bsdf("principled", number("metallic", 1) + number("roughness", 0.2))),
    "bsdf_principled_textured": material(bsdf("principled", bitmap("roughness", more=RAW))),
    "bsdf_roughconductor_anisotropic_aluminium": material(bsdf(
        "roughconductor", word("material", "Al") + number("alpha_u", 0.05) + number("alpha_v", 0.3))),
    "bsdf_roughconductor_copper": material(bsdf("roughconductor", word("material", "Cu") + number("alpha", 0.1))),
    "bsdf_roughconductor_textured_carbon": material(bsdf("roughconductor", bitmap("alpha", more=RAW))),
    "bsdf_roughdielectric_glass": material(bsdf("roughdielectric", number("alpha", 0.02) + word("int_ior", "bk7"))),
    "bsdf_roughdielectric_rough": material(bsdf("roughdielectric", number("alpha", 0.1))),
    "bsdf_roughdielectric_textured": material(bsdf("roughdielectric", bitmap("alpha", more=RAW))),
    "bsdf_roughplastic_beckmann": material(bsdf("roughplastic", word("distribution", "beckmann") + number("alpha", 0.1))),
    "bsdf_roughplastic_ggx": material(bsdf("roughplastic", word("distribution", "ggx") + number("alpha", 0.1))),
    "bsdf_roughplastic_nopreserve": material(bsdf("roughplastic", '<boolean name="nonlinear" value="true"/>')),
    "bsdf_roughplastic_preserve": material(bsdf("roughplastic", '<boolean name="nonlinear" value="false"/>')),
    "bsdf_thindielectric": material(bsdf("thindielectric")),
    "bsdf_twosided_cbox": ROOM.format("twosided", DIFFUSE),
    "bsdf_twosided_cbox_onesided": ROOM.format("diffuse", ""),
    "emitter_projector_constant": LIT + DIM + f'<emitter type="projector">{SPOT}</emitter>',
    "emitter_projector_textured": LIT + DIM + f'<emitter type="projector">{bitmap("irradiance")}{SPOT}</emitter>',
    "emitter_spot_no_texture": LIT + DIM + f'<emitter type="spot">{SPOT}</emitter>',
    "emitter_spot_texture": LIT + DIM + f'<emitter type="spot">{bitmap("texture")}{SPOT}</emitter>',
    "emitter_sunsky": LIT + '<emitter type="sunsky"/>',
    **{f"integrator_aov_{name}": f'<integrator type="aov">{word("aovs", f"a:{name}")}</integrator>'
       + include("integrator_scene") for name in ("depth", "position", "sh_normal")},
    **{f"integrator_depth_{name}": f'<integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>'
       + include("integrator_scene") for name, depth in (("1", 1), ("2", 2), ("3", 3), ("inf", -1))},
    **{f"integrator_direct_{name}": f'<integrator type="direct"><integer name="emitter_samples" value="{lamps}"/>'
       f'<integer name="bsdf_samples" value="{others}"/></integrator>' + include("veach_mis")
       for name, lamps, others in (("both", 1, 1), ("bsdf", 0, 1), ("lum", 1, 0))},
    "integrator_volpath": '<integrator type="volpath"/>' + include("integrator_scene")
    + SMOKE.format("homogeneous", '<rgb name="albedo" value="0.9"/><rgb name="sigma_t" value="1"/>'),
    "integrator_volpathmis": '<integrator type="volpathmis"/>' + include("integrator_scene")
    + SMOKE.format("heterogeneous", '<volume type="gridvolume" name="sigma_t">' + word("filename", "../../common/grid.vol")
                   + '</volume><phase type="hg"><float name="g" value="0.3"/></phase>'),
    "principled_scene": material(bsdf("principled", colour("base_color") + number("spec_tint", 0.7))),
    "principled_scene_light": LIT + f'<emitter type="area" id="lamp">{colour("radiance", "9")}</emitter>'
    '<shape type="rectangle"><ref id="lamp"/><transform name="to_world"><rotate x="1" angle="180"/><translate z="5"/></transform></shape>',
    "principled_scene_studio": LIT + SKY + THIN.format(bsdf("principled", number("clearcoat", 1))),
    "principled_scene_thin": LIT + SKY + THIN.format(bsdf("principledthin", number("diff_trans", 0.6))),
    "principled_scene_thin_light": LIT + THIN.format(bsdf("principledthin", colour("base_color", "1.0,1.0,1.0")))
    + '<shape type="Rectangle"><emitter type="area"><texture name="radiance" type="checkerboard"><transform '
    'name="to_uv"><scale x="6" y="6"/></transform></texture></emitter></shape>',
    **{f"sampler_{kind}_16spp": f'<sampler type="{kind}" id="my_sampler"><integer name="sample_count" value="16"/></sampler>'
       + SENSOR.replace("$spp", "16") + include("sampler_scene")
       for kind in ("independent", "ldsampler", "multijitter", "stratified", "orthogonal", "bose", "bush")},
    "sensor_orthographic": ORTHOGRAPHIC + include("sensor_scene"),
    "sensor_orthographic_2": ORTHOGRAPHIC.replace("<lookat", '<scale x="2" y="2"/><lookat') + include("sensor_scene"),
    "sensor_perspective": SENSOR + include("sensor_scene"),
    "sensor_perspective_large_fov": SENSOR.replace('value="40"', 'value="80"') + include("sensor_scene"),
    "sensor_thinlens": LENS + include("sensor_scene"),
    "sensor_thinlens_small_aperture": LENS.replace("'0.1'", "'0.01'") + include("sensor_scene"),
    "shape_bsplinecurve_basic": shape("bsplinecurve", CURVE),
    "shape_bsplinecurve_parameterization": shape("bsplinecurve", CURVE, BOARD),
    "shape_cube": shape("cube"),
    "shape_cylinder_onesided": shape("cylinder"),
    "shape_cylinder_twosided": shape("cylinder", "", two(DIFFUSE)),
    "shape_disk": shape("disk"),
    "shape_disk_parameterization": shape("disk", "", BOARD),
    "shape_instance_fractal": COMMON + GROUP.format(f'<shape type="ply">{word("filename", "meshes/bunny.ply")}{DIFFUSE}'
                                                    "</shape>") + include("shape_scene"),
    "shape_linearcurve_basic": shape("linearcurve", CURVE),
    "shape_linearcurve_parameterization": shape("linearcurve", CURVE, BOARD),
    "shape_ply_bunny": shape("ply", word("filename", "meshes/bunny.ply")),
    "shape_ply_bunny_facet": shape("ply", word("filename", "meshes/bunny.ply")
                                   + '<boolean name="face_normals" value="true"/>'),
    "shape_rectangle": shape("rectangle"),
    "shape_rectangle_parameterization": shape("rectangle", "", BOARD),
    "shape_sdfgrid": COMMON + GROUP.format(f'<shape type="sdfgrid">{word("filename", "grid.vol")}{DIFFUSE}</shape>')
    + include("shape_scene"),
    "shape_sdfgrid_analytic": shape("sdfgrid", word("filename", "grid.vol") + word("normals", "analytic")),
    "shape_sphere_basic": shape("sphere"),
    "shape_sphere_light_analytic": LIT + LAMPS,
    "shape_sphere_light_mesh": LIT + f'<shape type="ply">{word("filename", "meshes/bunny.ply")}<emitter type="area"/><transform name="to_world"><translate z="3"/></transform></shape>',
    "shape_sphere_parameterization": shape("sphere", "", BOARD),
    "texture_bitmap_filtering": shape("rectangle", "", bsdf("diffuse", bitmap(
        "reflectance", "textures/board.png", word("filter_type", "nearest")))),
    "texture_checkerboard": material(bsdf("diffuse", '<texture type="checkerboard" name="reflectance"><transform '
                                          'name="to_uv"><scale x="4" y="4"/></transform></texture>')),
    "texture_mesh_attribute_face": shape("ply", word("filename", "meshes/bunny.ply"), FACE),
    "texture_mesh_attribute_vertex": shape("ply", word("filename", "meshes/bunny.ply"), VERTEX),
    "variants_cbox_spectral": ROOM.format("diffuse", '<spectrum name="reflectance" value="400:0.34, 500:0.44, 730:0.7"/>'),
}  # fmt: skip
REFUSED = {
    **{name: "brdfs/" for name in SCENES if "measured" in name},
    **{name: "polarized" for name in ("bsdf_pplastic_diffuse_stokes", "bsdf_pplastic_specular_stokes")},
    **{name: "<animation>" for name in ("animation_emitter", "animation_rotation", "animation_shape")},
    **{f"sampler_{kind}_16spp": kind for kind in ("bose", "bush")},
    "principled_scene_thin_light": "Rectangle",
}
"""Words of the messages of those that cannot be rendered: files that we do not ship, and what the version of Mitsuba
that is installed has not."""


def written(name: str) -> str:
    """The text of a scene; all look for files in the folder that they share."""
    text = SCENES[name]
    return f'<scene version="2.0.0">{text if text.startswith(COMMON) else COMMON + text}</scene>'


def files(folder: Path) -> Path:
    """The folder of scenes, with what they include beside it."""
    scenes, common = folder / "data" / "scenes", folder / "common"
    for each in (scenes / "include", common / "meshes", common / "textures"):
        each.mkdir(parents=True)
    for name, text in INCLUDES.items():
        (scenes / "include" / f"{name}.xml").write_text(f'<scene version="2.0.0">{text}</scene>')
    rows = np.linspace(0, 1, 8, dtype=np.float32)[:, None].repeat(16, 1)
    write_exr(common / "textures" / "envmap.exr", {"R": rows, "G": rows * 0.8, "B": rows * 0.6 + 0.2}, {})
    board = np.kron(np.indices((4, 4)).sum(0) % 2, np.ones((4, 4), int)).astype(np.uint8)
    imsave(common / "textures" / "noise.png", board * 120 + 60, check_contrast=False)
    imsave(
        common / "textures" / "board.png",
        np.stack([board * 200, board * 90, 255 - board], -1),
        check_contrast=False,
    )
    normals = np.full((8, 8, 3), (128, 128, 255), np.uint8)
    imsave(common / "textures" / "normals.png", normals, check_contrast=False)
    (common / "meshes" / "curves.txt").write_text("-1 0 0 .3\n-.3 .2 0 .3\n.3 -.2 0 .3\n1 0 0 .3\n")
    ball = octahedron()
    (common / "meshes" / "matpreview.serialized").write_bytes(serialized([square(), ball]))
    head = "property float {}\n" * 6
    (common / "meshes" / "bunny.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 6\n" + head.format("x", "y", "z", "r", "g", "b")
        + "element face 8\nproperty list uchar int vertex_indices\nproperty float r\nproperty float g\n"
        "property float b\nend_header\n"
        + "".join(f"{x} {y} {z} .2 .3 .4\n" for x, y, z in ball[0])
        + "".join(f"3 {a} {b} {c} .7 .3 .1\n" for a, b, c in ball[1])
    )  # fmt: skip
    mi = use_engine("auto")
    at = np.linspace(-1, 1, 8)
    distance = np.sqrt(at[:, None, None] ** 2 + at[:, None] ** 2 + at**2) - 0.5
    mi.VolumeGrid(distance.astype(np.float32)[..., None]).write(str(common / "grid.vol"))
    return scenes


def square() -> tuple[np.ndarray, np.ndarray]:
    return np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float), np.array([(0, 1, 2), (0, 2, 3)])


def octahedron() -> tuple[np.ndarray, np.ndarray]:
    vertices = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    return vertices, np.array(faces)


def serialized(meshes: list[tuple[np.ndarray, np.ndarray]]) -> bytes:
    """Mitsuba's compressed meshes, version 4, with texture coordinates and in single precision."""
    content, places = b"", []
    for vertices, faces in meshes:
        body = struct.pack("<I", 0x1002) + b"mesh\0" + struct.pack("<QQ", len(vertices), len(faces))
        body += vertices.astype("<f4").tobytes() + vertices[:, :2].astype("<f4").tobytes()
        places.append(len(content))
        content += struct.pack("<HH", 0x041C, 4) + zlib.compress(body + faces.astype("<u4").tobytes())
    return content + struct.pack(f"<{len(places)}QI", *places, len(places))


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_the_documentation_is_rendered_or_refused_by_name(name: str, tmp_path: Path):
    scenes = files(tmp_path)
    (scenes / f"{name}.xml").write_text(written(name))
    recipe = SceneRecipe.model_validate(
        {
            "name": "kind",
            "bands": {"count": 4},
            "frame": {"width_px": 12, "height_px": 9, "margin_px": 0, "pixel_angle_mrad": 60.0},
            "render": {"samples": 4, "hidden": False},
            "source": {"kind": "mitsuba", "path": f"{name}.xml", "allow_outside": True},
        }
    )
    if name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[name]):
            render(recipe, scenes, cache=tmp_path)
        return
    view = render(recipe, scenes, cache=tmp_path)
    image = view.all_in_focus()
    assert bool(image.isfinite().all()) and float(image.max()) > 0
    assert (view.inverse_depth > 0).any()
