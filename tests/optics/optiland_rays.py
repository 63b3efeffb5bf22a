"""Writes optiland_rays.json: rays and waves of lenses by optiland 0.6.3, which edofsim does not need.
 python -m venv other && other/bin/pip install optiland==0.6.3 && other/bin/python
tests/optics/optiland_rays.py
"""

from __future__ import annotations

import json
import warnings
from importlib import import_module
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")
objectives, simple = (import_module(f"optiland.samples.{name}") for name in ("objectives", "simple"))
Wavefront = import_module("optiland.wavefront").Wavefront

LENSES = {
    "Cooke triplet": objectives.CookeTriplet,
    "double Gauss": objectives.DoubleGauss,
    "Tessar": objectives.TessarLens,
    "telephoto": objectives.Telephoto,
    "Heliar": objectives.HeliarLens,
    "Petzval f/1.4": objectives.PetzvalLens,
    "US 8,879,901": objectives.ObjectiveUS008879901,
    "reverse telephoto": objectives.ReverseTelephoto,
    "cemented achromat": simple.CementedAchromat,
    "singlet": simple.SingletStopSurf2,
}
PUPIL = np.array([0.0, 0.7, -0.999]), np.array([1.0, -0.7, 0.0])
FIELDS = (0.0, 0.7, 1.0)
KEPT = 12
"""Rays of a wave that are kept."""


def plain(value: object) -> float:
    return float(f"{float(np.asarray(value, dtype=float).ravel()[0]):.15g}")


def rows(*values: object) -> list[list[float]]:
    return [[plain(each) for each in np.asarray(row, dtype=float)] for row in values]


def prescription(optic, wavelengths: list[float]) -> dict[str, object]:
    surfaces = list(optic.surfaces)[1:-1]
    vertices = [plain(each.geometry.cs.z) for each in list(optic.surfaces)[1:]]
    return {
        "radii": [None if np.isinf(r := plain(s.geometry.radius)) else r for s in surfaces],
        "conics": [plain(getattr(s.geometry, "k", 0) or 0) for s in surfaces],
        "thicknesses": [plain(step) for step in np.diff(vertices)],
        "indices": [[1.0, *(plain(s.material_post.n(w)) for s in surfaces)] for w in wavelengths],
        "stop": int(optic.surfaces.stop_index) - 1,
        "wavelengths_um": wavelengths,
        "focal": plain(optic.paraxial.f2()),
        "entrance": plain(optic.paraxial.EPL()),
        "exit": plain(optic.paraxial.XPL()),
        "diameter": plain(optic.paraxial.EPD()),
    }


def rays(optic, wavelengths: list[float], distance: float) -> list[dict[str, object]]:
    found = []
    for number, wavelength in enumerate(wavelengths):
        for field in FIELDS:
            each = optic.ray_tracer.ray_generator.generate_rays(0, field, *PUPIL, wavelength)
            start = rows(*(np.array(getattr(each, name)) for name in "xyzLMN"))
            optic.surfaces.trace(each)
            end = rows(*(np.array(getattr(each, name)) for name in "xyLMN"), np.array(each.opd))
            found.append({"far": distance == np.inf, "wave": number, "start": start, "end": end})
    return found


def wave(optic, field: float, wavelength: float, distance: float) -> dict[str, object]:
    seen = Wavefront(optic, [(0, field)], [wavelength], num_rays=17, distribution="uniform")
    data = seen.get_data((0, field), wavelength)
    chief = optic.ray_tracer.ray_generator.generate_rays(0, field, np.zeros(1), np.zeros(1), wavelength)
    some = slice(3, None, len(np.asarray(data.opd)) // KEPT)
    places = (np.asarray(each, dtype=float)[some] for each in (data.pupil_x, data.pupil_y, data.opd))
    x, y, opd = rows(*places)
    return {
        "distance": None if distance == np.inf else distance,
        "tangent": plain(chief.M) / plain(chief.N),
        "landing": plain(data.reference_center[1]),
        "radius": plain(data.radius),
        "x": x,
        "y": y,
        "opd": opd,
    }


def main() -> None:
    found = {}
    for name, make in LENSES.items():
        optic = make()
        given = [plain(each.value) for each in optic.wavelengths.wavelengths]
        wavelengths = [given[0], plain(optic.primary_wavelength), given[-1]]
        lens = prescription(optic, wavelengths)
        lens["rays"] = rays(optic, wavelengths, np.inf)
        optic.updater.set_thickness(1000.0, 0)
        lens["rays"] += rays(optic, wavelengths, 1000.0)
        if name not in ("Petzval f/1.4", "cemented achromat", "singlet"):
            optic = make()
            optic.set_ray_aiming("iterative")
            lens["waves"] = []
            for distance in (np.inf, 30 * lens["focal"]):
                if distance != np.inf:
                    optic.updater.set_thickness(distance - lens["entrance"], 0)
                optic.updater.image_solve()
                lens["waves"] += [wave(optic, field, wavelengths[1], distance) for field in FIELDS]
        found[name] = lens
    Path(__file__).with_suffix(".json").write_text(json.dumps(found, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
