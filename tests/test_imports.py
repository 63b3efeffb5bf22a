"""Data goes one way through the rooms, and imports only follow it."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import edofsim

PACKAGE = Path(edofsim.__file__).parent

MAY_IMPORT: dict[str, set[str]] = {
    "core": set(),
    "recipe": set(),
    "scene": {"recipe"},
    "render": {"recipe", "scene"},
    "optics": {"recipe"},
    "capture": {"recipe", "render", "optics"},
    "reference": {"recipe", "scene", "render", "optics", "capture"},
    "plan": {"recipe", "scene", "render", "optics", "capture"},
    "restore": {"recipe", "optics", "capture"},
    "learn": {"recipe", "scene", "render", "optics", "capture", "restore"},
    "data": {"recipe", "scene", "render", "optics", "capture", "plan", "learn"},
    "stability": {"recipe", "render", "optics", "capture"},
}
MAY_IMPORT["report"] = {*MAY_IMPORT, "pipeline"} - {"stability"}
MAY_IMPORT["experiments"] = {*MAY_IMPORT, "options", "completion"}
MAY_IMPORT["benchmark"] = {*MAY_IMPORT, "options", "completion"} - {"stability"}
MAY_IMPORT["cli"] = {*MAY_IMPORT, "pipeline", "console", "options", "completion"}
COMMON = {"errors", "record", "core"}
KEPT_OUT = {"recipe": {"mitsuba", "drjit", "torch", "trimesh"}, "scene": {"mitsuba", "drjit", "torch"}}
MITSUBA_ROOMS = {"render", "reference", "experiments"}
BEHIND_THE_DOOR = {f"edofsim.restore.{name}" for name in ("choice", "conditioning", "restore", "wiener")}
ONLY_IN = {"mitsuba": MITSUBA_ROOMS, "drjit": MITSUBA_ROOMS}


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent != PACKAGE]


def imported(path: Path) -> set[str]:
    """Absolute dotted names that a module imports, wherever in it; names under TYPE_CHECKING too."""
    package = ("edofsim", *path.relative_to(PACKAGE).parts[:-1])
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            # `from .. import x` names modules, `from ..x import y` names what is in one
            names |= {module} if node.module else {f"{module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_follow_the_flow_of_data(path: Path):
    room = path.relative_to(PACKAGE).parts[0]
    names = imported(path)
    rooms = {name.split(".")[1] for name in names if name.startswith("edofsim.")}
    rooms -= COMMON | {room, "__version__"}
    assert rooms <= MAY_IMPORT[room], f"{path.name} in {room}/ imports {sorted(rooms - MAY_IMPORT[room])}"
    assert room == "restore" or not names & BEHIND_THE_DOOR, "import it from edofsim.restore"
    outside = {name.split(".")[0] for name in names}
    assert not outside & KEPT_OUT.get(room, set())
    for package, homes in ONLY_IN.items():
        assert package not in outside or room in homes, f"{package} is not for {room}/"


def dotted(path: Path) -> str:
    return ".".join(("edofsim", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__")


def modules_imported(path: Path, known: set[str]) -> set[str]:
    """Those of the known modules that a module imports, wherever in it, but not for its types alone."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    package = ("edofsim", *path.relative_to(PACKAGE).parts[:-1])
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join((*package[: len(package) - node.level + 1], *filter(None, [node.module])))
            names = (f"{base}.{alias.name}" for alias in node.names)
            found |= {name if name in known else base for name in names}
    return found & known


def test_no_import_leads_back_to_where_it_began():
    """Those within functions count as well."""
    paths = {dotted(path): path for path in modules()}
    graph = {name: modules_imported(path, set(paths)) - {name} for name, path in paths.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_the_rooms_are_all_there():
    assert {path.relative_to(PACKAGE).parts[0] for path in modules()} == set(MAY_IMPORT)


def test_importing_edofsim_and_the_command_line_starts_no_engine():
    """`edofsim --help` and a wrong option must answer at once, on a machine without LLVM too."""
    code = "import sys, edofsim.cli; assert not {'mitsuba', 'drjit', 'torch'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


SHARED_BY_TRUTHS = {
    # what is asked for, and refused alike
    "capture.checks.check_pixel_angle": "refusals",
    "capture.fidelity.Fidelity": "names how bands are gathered",
    "optics.Camera": "the camera's numbers",
    "optics.camera.focus_distance": "the thin lens's one number",
    "optics.masks.clear.ClearMask": "refusals",
    # the light that is compared
    "capture.crop.crop": "the part of the view",
    "capture.band_groups.gathered_view": "the same groups of bands in truth and photo",
    "capture.imaging.gathering_of": "the same",
    "capture.photograph.axes_of": "the same",
    "capture.prepare.channel_weights": "the sensor's response",
    # the pupil: held against integrals that the tests write out (`hard_cases.written_out`)
    "optics.defocus": "pupil",
    "optics.plan_sampling": "pupil",
    "optics.psf_bank": "PSFs of what nothing hides",
    "optics.grid.PupilGrid": "pupil",
    "optics.grid.bicubic_matrix": "pupil",
    "optics.pupil.Aperture": "pupil",
    "optics.pupil.aperture": "pupil",
    "optics.pupil.bent": "pupil",
    "optics.pupil.pupil_function": "pupil",
    "optics.transform.SensorWindow": "what a pixel integrates",
    "optics.transform.pixel_weights": "what a pixel integrates",
}
"""All that the slow truths take from the rooms that they judge, and why: nothing of it blurs light,
composites or finds what is hidden."""


def test_truths_share_with_what_they_judge_what_is_listed_and_no_more():
    found = set()
    for path in sorted((PACKAGE / "reference").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level == 2:
                names = {".".join(filter(None, (node.module, alias.name))) for alias in node.names}
                found |= {name for name in names if name.split(".")[0] in ("capture", "optics")}
    assert found == set(SHARED_BY_TRUTHS)


def test_the_integrals_that_are_written_out_share_nothing():
    written = Path(__file__).parent / "stability" / "hard_cases" / "written_out.py"
    assert "import edofsim" not in written.read_text() and "from edofsim" not in written.read_text()
