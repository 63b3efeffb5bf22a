"""Lens files of other programs: the same lens whoever wrote it, and nothing left out in silence."""

from __future__ import annotations

import json
import tomllib

import pytest

from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.lenses.prescription import PrescriptionLens
from edofsim.optics.prescription.lens_files.imported import camera_of
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.written import toml_of

TOLD = {"SK16": (1.62041, 60.32), "F2": (1.62004, 36.37)}
COOKE = (
    (22.01359, 3.25896, "SK16"),
    (-435.76044, 6.00755, ""),
    (-22.21328, 0.99997, "F2"),
    (20.29192, 4.75041, ""),
    (79.68360, 2.95208, "SK16"),
    (-18.39533, 42.20778, ""),
)
"""The Cooke triplet of textbooks: radius, thickness, glass; its stop is the fourth surface."""
STOP = 3


def zemax(unit: str = "MM", scale: float = 1.0, more: dict[int, str] | None = None, head: str = "") -> str:
    """more: lines of surfaces."""
    lines = ["VERS 140124", "MODE SEQ", "NAME Cooke triplet", f"UNIT {unit} X W X CM MR CPMM"]
    lines += [f"ENPD {10 * scale!r}", head, "SURF 0", "  CURV 0.0", "  DISZ INFINITY"]
    for number, (radius, thickness, glass) in enumerate(COOKE, 1):
        lines += [f"SURF {number}", "  TYPE STANDARD", *(["  STOP"] if number == STOP + 1 else [])]
        lines += [f"  CURV {1 / (radius * scale)!r} 0 0 0", f"  DISZ {thickness * scale!r}"]
        lines += [f"  GLAS {glass} 0 0 1.5 40 0 0 0"] if glass else []
        lines += [(more or {}).get(number, "")]
    return "\n".join([*lines, "SURF 7", "  DISZ 0"]) + "\n"


def code_v() -> str:
    lines = ["RDM;LEN", "TITLE 'Cooke; triplet'", "DIM M", "EPD 10", "WL 656 588 486", "SO 0.0 0.1e14"]
    for number, (radius, thickness, glass) in enumerate(COOKE):
        lines += [
            f"S {radius} {thickness} {glass and glass + '_SCHOTT'}",
            *(["  STO"] if number == STOP else []),
        ]
    return "\n".join([*lines, "SI 0 0", "GO"]) + "\n"


def oslo() -> str:
    lines = ["// OSLO", 'LEN NEW "Cooke triplet" 50 7', "EBR 5.0", "UNI 1.0", "AIR", "TH 1e20", "NXT"]
    for number, (radius, thickness, glass) in enumerate(COOKE):
        lines += [f"GLA {glass}" if glass else "AIR", f"RD {radius}", f"TH {thickness}"]
        lines += [*(["AST"] if number == STOP else []), "NXT"]
    return "\n".join([*lines, "AIR", "END 7", "GLA NONSENSE"]) + "\n"


def optiland(**first) -> str:
    """first: of its first surface."""
    places, surfaces = [0.0], []
    for radius, thickness, glass in COOKE:
        material = {"type": "Material", "name": glass} if glass else {"type": "IdealMaterial", "index": 1.0}
        geometry = {"type": "StandardGeometry", "cs": {"z": places[-1]}, "radius": radius, "conic": 0.0}
        surfaces.append({"geometry": geometry, "material_post": material, "is_stop": len(surfaces) == STOP})
        places.append(places[-1] + thickness)
    surfaces[0] = {**surfaces[0], **first}
    plane = {"type": "Plane", "cs": {"z": -float("inf")}}
    image = {"geometry": {"type": "Plane", "cs": {"z": places[-1]}, "radius": float("inf")}}
    surfaces = [{"geometry": plane}, *surfaces, image]
    return json.dumps({"aperture": {"type": "EPD", "value": 10}, "surface_group": {"surfaces": surfaces}})


def read(folder, ending: str, text: str | bytes, **how) -> tuple[CameraRecipe, list[str]]:
    path = folder / f"lens.{ending}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return camera_of(path, **{"glasses_by_name": TOLD, **how})


def lens_of(recipe: CameraRecipe) -> PrescriptionLens:
    assert isinstance(recipe.lens, PrescriptionLens)
    return recipe.lens


def refused(folder, ending: str, text: str | bytes, *said: str, **how) -> None:
    with pytest.raises(InputError) as error:
        read(folder, ending, text, **how)
    for each in said:
        assert each in str(error.value)


@pytest.mark.parametrize(
    "ending, text", [("zmx", zemax()), ("seq", code_v()), ("len", oslo()), ("json", optiland())]
)
def test_a_lens_is_the_same_in_every_program(tmp_path, ending, text):
    """First order of OpticStudio at 550 nm, of the triplet's catalogue glasses: f = 49.9998 mm, F/5."""
    recipe, notes = read(tmp_path, ending, text)
    lens = lens_of(recipe)
    assert [each.stop for each in lens.surfaces].index(True) == STOP
    for surface, (radius, thickness, glass) in zip(lens.surfaces, COOKE, strict=True):
        assert surface.radius_mm == pytest.approx(radius, rel=1e-9)
        assert surface.thickness_mm == pytest.approx(thickness, rel=1e-9)
        assert (surface.nd, surface.vd) == TOLD.get(glass, (None, None))
    green = lens.model_copy(update={"traced_at_nm": 550.0})
    assert green.held().first.focal == pytest.approx(49.9998, abs=2e-3)
    assert lens.f_number == pytest.approx(lens.held().first.focal / 10, rel=1e-4)
    assert Camera.from_recipe(recipe).lens.problems() == []
    assert "no surface has a clear radius" in " ".join(notes)


@pytest.mark.parametrize("unit, millimetres", [("MM", 1), ("CM", 10), ("IN", 25.4), ("METER", 1000)])
def test_a_file_in_inches_is_in_inches(tmp_path, unit, millimetres):
    aspheric = {1: "  TYPE EVENASPH\n  PARM 1 0.001\n  PARM 2 1e-05\n  DIAM 5.0 1 0 0 1"}
    text = zemax(unit, more=aspheric)
    inches, plain = (
        lens_of(read(tmp_path, "zmx", text)[0]),
        lens_of(read(tmp_path, "zmx", zemax(more=aspheric))[0]),
    )
    assert inches.f_number == pytest.approx(plain.f_number)
    first, other = inches.surfaces[0], plain.surfaces[0]
    assert first.radius_mm == pytest.approx(millimetres * other.radius_mm)
    assert first.clear_radius_mm == pytest.approx(millimetres * 5)
    assert first.aspheres_mm == pytest.approx((1e-3 / millimetres, 1e-5 / millimetres**3))


def test_a_file_without_a_unit_is_refused(tmp_path):
    refused(tmp_path, "zmx", zemax("FURLONG"), "does not say its unit", "FURLONG")
    refused(tmp_path, "seq", code_v().replace("DIM M", "DIM X"), "a unit is M (mm), C or I")


def test_what_shuts_the_pupil_is_kept(tmp_path):
    """Semi-diameters that somebody gave, and clear apertures; not those that follow from rays."""
    more = {1: "  DIAM 6.5 1 0 0 1", 2: "  DIAM 6.0 0 0 0 1", 6: "  CLAP 0 5.5 0\n  DIAM 9.0 1 0 0 1"}
    recipe, notes = read(tmp_path, "zmx", zemax(more=more))
    assert [each.clear_radius_mm for each in lens_of(recipe).surfaces] == [6.5, None, None, None, None, 5.5]
    assert "1 semi-diameters that the program worked out" in " ".join(notes)
    with_rim = code_v().replace("S 22.01359 3.25896 SK16_SCHOTT", "S 22.01359 3.25896 SK16_SCHOTT\n CIR 6.5")
    assert lens_of(read(tmp_path, "seq", with_rim)[0]).surfaces[0].clear_radius_mm == 6.5
    with_rim = (
        oslo()
        .replace("RD 22.01359", "RD 22.01359\nAP CHK 6.5")
        .replace("RD -435.76044", "RD -435.76044\nAP 6")
    )
    assert [e.clear_radius_mm for e in lens_of(read(tmp_path, "len", with_rim)[0]).surfaces[:2]] == [
        6.5,
        None,
    ]
    with_rim = optiland(aperture={"type": "RadialAperture", "r_max": 6.5, "r_min": 0.0})
    assert lens_of(read(tmp_path, "json", with_rim)[0]).surfaces[0].clear_radius_mm == 6.5


def test_openings(tmp_path):
    recipe, _ = read(tmp_path, "zmx", zemax().replace("ENPD 10.0", "FNUM 4.0 0"))
    assert lens_of(recipe).f_number == 4
    recipe, _ = read(tmp_path, "zmx", zemax(more={4: "  DIAM 3.5 1"}).replace("ENPD 10.0", "FLOA"))
    assert lens_of(recipe).f_number is None and lens_of(recipe).surfaces[STOP].clear_radius_mm == 3.5
    refused(tmp_path, "zmx", zemax().replace("ENPD 10.0", "FLOA"), "does not give the radius of the stop")
    refused(tmp_path, "zmx", zemax().replace("ENPD 10.0", ""), "how wide the lens is")
    refused(tmp_path, "zmx", zemax().replace("ENPD 10.0", "OBNA 0.1"), "OBNA is not read")


@pytest.mark.parametrize(
    "more, said",
    [
        ("  TYPE PARAXIAL\n  PARM 1 100", ("surface 2", "PARAXIAL are not traced")),
        ("  TYPE COORDBRK", ("COORDBRK are not traced",)),
        ("  TYPE BINARY_2", ("BINARY_2",)),
        ("  GLAS MIRROR 0 0", ("mirrors are not traced",)),
        ("  TYPE ODDASPHE\n  PARM 1 0.1", ("a term r^1",)),
        ("  SQAP 3 4", ("not round about the axis",)),
        ("  DISZ x", ("line ", "needs a number")),
        ("  DISZ nan", ("is not a number",)),
    ],
)
def test_what_zemax_has_and_is_not_traced_is_refused(tmp_path, more, said):
    refused(tmp_path, "zmx", zemax(more={2: more}), *said)


def test_what_others_have_and_is_not_traced_is_refused(tmp_path):
    refused(tmp_path, "seq", code_v().replace("  STO", "  STO\n  ADE 5"), "line 12", "ADE 5")
    refused(tmp_path, "len", oslo().replace("AST", "AST\nTLA 5"), "TLA 5")
    thin = {"geometry": {"type": "Plane", "cs": {"z": 0.0}}, "interaction_model": {"type": "ThinLens"}}
    refused(tmp_path, "json", optiland(**thin), "surface 1", "ThinLens")
    tilted = {"geometry": {"type": "Plane", "cs": {"z": 0.0, "rx": 0.1}}}
    refused(tmp_path, "json", optiland(**tilted), "tilted")
    mirror = {"interaction_model": {"type": "RefractiveReflectiveModel", "is_reflective": True}}
    refused(tmp_path, "json", optiland(**mirror), "mirrors")


def test_what_is_left_out_is_said(tmp_path):
    head = "VDYN 0.0 0.2 0.3\nMNUM 3 1"
    said = " ".join(read(tmp_path, "zmx", zemax(head=head))[1])
    assert "vignetting factors are left out" in said and "of 3 configurations" in said
    said = " ".join(
        read(tmp_path, "seq", code_v().replace("WL", "VUY 0 0.1\nWL").replace("  STO", "  STO\n  XYZ 1"))[1]
    )
    assert "vignetting factors" in said and "XYZ" in said
    assert "vignetting" not in " ".join(read(tmp_path, "zmx", zemax(head="VDYN 0.0 0.0"))[1])


def test_aspheres_are_those_of_each_program(tmp_path):
    """r^4 and r^6 of the same surface, an odd one of r^3."""
    terms = (0.0, 1e-5, -2e-8)
    text = zemax(more={1: "  TYPE EVENASPH\n  CONI -0.5\n  PARM 2 1e-5\n  PARM 3 -2e-8"})
    first = lens_of(read(tmp_path, "zmx", text)[0]).surfaces[0]
    assert (first.conic, first.aspheres_mm) == (-0.5, terms)
    text = code_v().replace("S -435", "  ASP; K -0.5; A 1e-5; B -2e-8\nS -435")
    first = lens_of(read(tmp_path, "seq", text)[0]).surfaces[0]
    assert (first.conic, first.aspheres_mm) == (-0.5, terms)
    first = lens_of(
        read(tmp_path, "len", oslo().replace("RD 22.0", "CC -0.5\nAD 1e-5\nAE -2e-8\nRD 22.0"))[0]
    ).surfaces[0]
    assert (first.conic, first.aspheres_mm) == (-0.5, terms)
    shape = {
        "type": "EvenAsphere",
        "cs": {"z": 0.0},
        "radius": 22.01359,
        "conic": -0.5,
        "coefficients": terms,
    }
    first = lens_of(read(tmp_path, "json", optiland(geometry=shape))[0]).surfaces[0]
    assert (first.conic, first.aspheres_mm) == (-0.5, terms)
    text = zemax(more={1: "  TYPE ODDASPHE\n  PARM 2 1e-3\n  PARM 3 2e-4\n  PARM 4 1e-5"})
    first = lens_of(read(tmp_path, "zmx", text)[0]).surfaces[0]
    assert (first.aspheres_mm, first.odd_aspheres_mm) == ((1e-3, 1e-5), (2e-4,))


def test_glass_that_is_not_known_is_asked_for(tmp_path):
    refused(
        tmp_path,
        "zmx",
        zemax(),
        "surface 1: glass SK16",
        "surface 3: glass F2",
        "--glass SK16=ND,VD",
        glasses_by_name={},
    )
    known = zemax().replace("SK16", "N-BK7").replace("F2", "fused-silica")
    assert {each.glass for each in lens_of(read(tmp_path, "zmx", known, glasses_by_name={})[0]).surfaces} == {
        "N-BK7", "fused-silica", None,
    }  # fmt: skip
    model = zemax().replace("GLAS SK16 0 0 1.5 40", "GLAS ___BLANK 1 0 1.62 60.3").replace("F2", "N-SF10")
    recipe, notes = read(tmp_path, "zmx", model, glasses_by_name={})
    assert (lens_of(recipe).surfaces[0].nd, lens_of(recipe).surfaces[0].vd) == (1.62, 60.3)
    assert "by nd and Vd of the file alone" in " ".join(notes)
    for code, expected in (("620603", (1.620, 60.3)), ("620410.603236", (1.62041, 60.3236))):
        text = code_v().replace("SK16_SCHOTT", code)
        first = lens_of(read(tmp_path, "seq", text)[0]).surfaces[0]
        assert (first.nd, first.vd) == pytest.approx(expected)


def test_a_makers_catalogue_gives_the_formula_and_where_it_holds(tmp_path):
    """N-BK7 by its own numbers is our N-BK7; beyond its data, light is refused."""
    line = "CD 1.03961212E+00 6.00069867E-03 2.31792344E-01 2.00179144E-02 1.01046945E+00 1.03560653E+02"
    agf = f"CC a maker\nNM SK16 2 517642.251 1.5168 64.17 0\n{line}\nLD 3.0E-01 2.5E+00\n"
    agf += "NM F2 1 620364 1.62004 36.37 0\nCD 2.5 0.1 0.2\nLD 0.4 1.0\n"
    (tmp_path / "maker.agf").write_text(agf)
    how = {"glasses_by_name": {}, "catalogues": [tmp_path / "maker.agf"]}
    recipe, notes = read(tmp_path, "zmx", zemax(), **how)
    assert any("F2 by nd and Vd: formula Schott of its catalogue" in note for note in notes)
    first, third = (lens_of(recipe).surfaces[number] for number in (0, 2))
    ours = (
        PrescriptionLens(
            kind="prescription",
            f_number=5,
            surfaces=({"radius_mm": 20.0, "glass": "N-BK7", "stop": True}, {}),
        )
        .surfaces[0]
        .medium()
    )
    medium = first.medium()
    assert medium is not None and ours is not None
    assert float(medium.index(500e-9)) == pytest.approx(float(ours.index(500e-9)), rel=1e-12)
    with pytest.raises(InputError, match="outside the data"):
        medium.index(200e-9)
    assert (third.nd, third.vd) == (1.62004, 36.37)
    (tmp_path / "maker.agf").write_text("nothing")
    refused(tmp_path, "zmx", zemax(), "holds no glass", **how)


def test_what_is_no_lens_is_refused(tmp_path):
    refused(tmp_path, "txt", zemax(), "lens files end in .zmx, .seq, .len, .json")
    refused(tmp_path, "zmx", "", "does not say its unit")
    refused(tmp_path, "zmx", zemax()[:120], "a lens has object, surfaces and image")
    refused(tmp_path, "json", "{", "no lens of optiland")
    refused(tmp_path, "json", '{"aperture": 3}', "no lens of optiland")
    refused(tmp_path, "len", zemax(), "no lens of OSLO")
    refused(tmp_path, "seq", b"\x00\x01\x02", "no text")
    refused(tmp_path, "zmx", zemax().replace("  STOP", ""), "names no stop")
    refused(tmp_path, "zmx", zemax().replace("MODE SEQ", "MODE NSC"), "only sequential")
    with pytest.raises(InputError, match="does not exist"):
        camera_of(tmp_path / "none.zmx")


def test_a_file_of_two_bytes_a_letter_reads_the_same(tmp_path):
    plain, wide = (read(tmp_path, "zmx", zemax().encode(code))[0] for code in ("utf-8", "utf-16"))
    assert plain == wide


def test_what_is_written_reads_back(tmp_path):
    recipe, _ = read(tmp_path, "zmx", zemax(more={1: "  TYPE EVENASPH\n  PARM 2 1e-5\n  DIAM 6 1"}))
    text = toml_of(recipe, 'From "lens.zmx".\nsecond line')
    assert CameraRecipe.model_validate(tomllib.loads(text)) == recipe
    assert text.startswith('# From "lens.zmx".\n# second line\n')
