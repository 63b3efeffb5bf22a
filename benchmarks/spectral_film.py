"""A film of many bands in Mitsuba's spectral variant: four wavelengths a path, each counted in its band."""

from __future__ import annotations

from typing import Any

import numpy as np

from edofsim.render.meshes import make_mesh
from edofsim.render.settings import RenderSettings
from edofsim.render.translate import plugin_with
from edofsim.scene.model import BandTexture, SceneModel


class SpectralFilm:
    """The scene as Mitsuba's spectral variant renders it, four wavelengths a path, into a film of box-shaped
    bands. Spectra are Mitsuba's; of pictures it takes the colour, which is all that it can carry."""

    def __init__(
        self, mi: Any, model: SceneModel, settings: RenderSettings, sampler: str = "independent"
    ) -> None:
        self._mi, self._nm = mi, np.asarray(model.wavelengths) * 1e9
        contents: dict[str, Any] = {"type": "scene"}
        for number, item in enumerate(model.objects):
            reflectance = self._spectrum(item.surface.reflectance, flipped=0)
            bsdf = mi.load_dict(plugin_with(item.surface, reflectance))
            lamp = None
            if item.emission is not None:
                lamp = {"type": "area", "radiance": self._regular(item.emission)}
            contents[f"object{number}"] = make_mesh(mi, item, bsdf, lamp)
        if model.environment is not None:
            radiance = model.environment.radiance
            if radiance.image is None:
                contents["sky"] = {"type": "constant", "radiance": self._regular(radiance.basis[0])}
            else:
                contents["sky"] = {
                    "type": "envmap",
                    "bitmap": mi.Bitmap(self._picture(radiance)[:, ::-1].copy()),
                }
        rows, columns = settings.padded_shape
        half = 0.5 * (self._nm[1] - self._nm[0])
        bands = {
            f"band{number:03d}": {
                "type": "irregular",
                "wavelengths": f"{nm - half - 0.01}, {nm - half}, {nm + half}, {nm + half + 0.01}",
                "values": "0, 1, 1, 0",
            }
            for number, nm in enumerate(self._nm)
        }
        contents["sensor"] = {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(columns / 2 * settings.pixel_angle))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, 1.0, 1.0, 1.0])),
            "near_clip": 1e-3,
            "far_clip": 1e6,
            "film": {
                "type": "specfilm",
                "width": columns,
                "height": rows,
                "rfilter": {"type": "box"},
                **bands,
            },
            "sampler": {"type": sampler},
        }
        contents["integrator"] = {"type": "path", "max_depth": settings.max_depth, "rr_depth": 1000}
        self._scene = mi.load_dict(contents, optimize=False)

    def _regular(self, values: np.ndarray) -> dict[str, Any]:
        return {
            "type": "regular",
            "wavelength_min": float(self._nm[0]),
            "wavelength_max": float(self._nm[-1]),
            "values": ", ".join(f"{max(float(v), 1e-6):.7g}" for v in values),
        }

    def _picture(self, value: BandTexture) -> np.ndarray:
        """An rgb picture of the values near 610, 550 and 460 nm."""
        bands = [int(np.argmin(abs(self._nm - nm))) for nm in (610, 550, 460)]
        return np.clip(value.image @ value.basis[:, bands], 0, 1e4).astype(np.float32)

    def _spectrum(self, value: BandTexture, flipped: int) -> dict[str, Any]:
        if value.image is None:
            return self._regular(value.basis[0])
        picture = np.ascontiguousarray(self._picture(value)[::-1]).clip(0, 0.98)
        return {"type": "bitmap", "bitmap": self._mi.Bitmap(picture), "raw": False, "wrap_mode": "repeat"}

    @property
    def samples(self) -> int:
        """Samples a pixel of the last image: what the sampler makes of the number that it is asked for."""
        return int(self._scene.sensors()[0].sampler().sample_count())

    def image(self, samples: int, seed: int) -> np.ndarray:
        """One image, float64 [band, y, x]."""
        pixels = np.array(self._mi.render(self._scene, spp=samples, seed=seed), np.float64)
        return np.moveaxis(pixels, -1, 0)
