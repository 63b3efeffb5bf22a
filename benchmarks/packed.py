"""Three bands a pass, through Mitsuba's own path integrator: slow, and right by someone else's code.

An rgb variant does not know what its channels mean. A scene whose colours are the values of three bands
renders those bands, so that ceil(bands / 3) passes make the whole image. Nothing is shared with the many-band
path tracer but the meshes and the BSDF plugins; it is what that one is compared with, in noise and in time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from edofsim.render.meshes import make_mesh
from edofsim.render.settings import RenderSettings
from edofsim.render.translate import plugin_with
from edofsim.scene.model import BandTexture, SceneModel


class PackedScene:
    """A scene in the active engine's rgb variant, whose three channels can be set to any bands.

    lens: aperture radius and focus distance in metres of a thin lens, None for the pinhole. integrator,
    sampler: Mitsuba's plugins, by default the path integrator with independent samples.
    """

    def __init__(
        self,
        mi: Any,
        model: SceneModel,
        settings: RenderSettings,
        *,
        lens: tuple[float, float] | None = None,
        integrator: dict[str, Any] | None = None,
        sampler: str = "independent",
    ) -> None:
        self._mi, self._model = mi, model
        contents: dict[str, Any] = {"type": "scene"}
        first = self.triple(0)
        for number, item in enumerate(model.objects):
            surface = item.surface
            bsdf = mi.load_dict(plugin_with(surface, self._carrier(surface.reflectance, first, item.mesh.uv)))
            lamp = None
            if item.emission is not None:
                lamp = {"type": "area", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}}
            contents[f"object{number}"] = make_mesh(mi, item, bsdf, lamp)
        if model.environment is not None:
            contents["sky"] = self._sky(model.environment.radiance, first)
        rows, columns = settings.padded_shape
        contents["sensor"] = {
            "type": "perspective" if lens is None else "thinlens",
            # The frame's right edge is at columns / 2 pixels. Mitsuba's +x points left when it looks along
            # +z.
            "fov": float(np.degrees(2 * np.arctan(columns / 2 * settings.pixel_angle))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, 1.0, 1.0, 1.0])),
            "near_clip": 1e-3,
            "far_clip": 1e6,
            "film": {
                "type": "hdrfilm",
                "width": columns,
                "height": rows,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": sampler},
        }
        if lens is not None:
            contents["sensor"] |= {"aperture_radius": lens[0], "focus_distance": lens[1]}
        # No roulette: the seed being the same in all passes, the noise of the bands stays alike.
        contents["integrator"] = integrator or {
            "type": "path",
            "max_depth": settings.max_depth,
            "rr_depth": 1000,
        }
        self.scene = mi.load_dict(contents, optimize=False)
        self._parameters = mi.traverse(self.scene)

    def triple(self, start: int) -> list[int]:
        """Three bands from `start` on; the last one is repeated at the end of the list."""
        last = len(self._model.wavelengths) - 1
        return [min(start + k, last) for k in range(3)]

    def _picture(self, value: BandTexture, bands: list[int]) -> np.ndarray:
        return np.clip(np.asarray(value.image) @ np.asarray(value.basis)[:, bands], 0, None).astype(
            np.float32
        )

    def _carrier(self, value: BandTexture, bands: list[int], uv: np.ndarray | None) -> dict[str, Any]:
        if value.image is None:
            return {"type": "rawconstant", "value": [float(v) for v in value.basis[0, bands]]}
        outside = uv is not None and bool((uv < -1e-6).any() or (uv > 1 + 1e-6).any())
        picture = np.ascontiguousarray(self._picture(value, bands)[::-1])
        return {
            "type": "bitmap",
            "bitmap": self._mi.Bitmap(picture),
            "raw": True,
            "format": "variant",
            "wrap_mode": "repeat" if outside else "clamp",
        }

    def _sky(self, value: BandTexture, bands: list[int]) -> dict[str, Any]:
        if value.image is None:
            return {
                "type": "constant",
                "radiance": {"type": "rgb", "value": [float(v) for v in value.basis[0, bands]]},
            }
        picture = np.ascontiguousarray(self._picture(value, bands)[:, ::-1])
        return {"type": "envmap", "bitmap": self._mi.Bitmap(picture)}

    def set_bands(self, bands: list[int]) -> None:
        """Give the three channels the values of three bands."""
        mi, parameters = self._mi, self._parameters
        for number, item in enumerate(self._model.objects):
            value = item.surface.reflectance
            leaf = item.surface.reflectance_key.split(".")[-1]
            ending = f".{leaf}.value" if value.image is None else f".{leaf}.data"
            keys = [k for k in parameters.keys() if k.startswith(f"object{number}.") and k.endswith(ending)]  # noqa: SIM118
            for key in keys:
                if value.image is None:
                    parameters[key] = mi.Color3f(*(float(v) for v in value.basis[0, bands]))
                else:
                    parameters[key] = mi.TensorXf(np.ascontiguousarray(self._picture(value, bands)[::-1]))
            if item.emission is not None:
                parameters[f"object{number}.emitter.radiance.value"] = mi.Color3f(
                    *(float(v) for v in item.emission[bands])
                )
        sky = self._model.environment
        if sky is not None and sky.radiance.image is None:
            parameters["sky.radiance.value"] = mi.Color3f(*(float(v) for v in sky.radiance.basis[0, bands]))
        elif sky is not None:
            picture = self._picture(sky.radiance, bands)[:, ::-1]
            # The plugin keeps a copy of the last column at the left and of the first at the right.
            around = np.concatenate([picture[:, -1:], picture, picture[:, :1]], axis=1)
            parameters["sky.data"] = mi.TensorXf(np.ascontiguousarray(around))
        parameters.update()

    @property
    def samples(self) -> int:
        """Samples a pixel of the last image: what the sampler makes of the number that it is asked for."""
        return int(self.scene.sensors()[0].sampler().sample_count())

    def image(self, samples: int, seed: int) -> np.ndarray:
        """One pass: float64 [3, y, x]."""
        pixels = self._mi.render(self.scene, spp=samples, seed=seed)
        return np.moveaxis(np.array(pixels, np.float64), -1, 0)


def packed_images(
    mi: Any, model: SceneModel, settings: RenderSettings, samples: int, seeds: Iterable[int]
) -> np.ndarray:
    """Independent images of the padded frame, float64 [seed, band, y, x], `samples` a pixel in each pass."""
    scene = PackedScene(mi, model, settings)
    bands, seeds = len(model.wavelengths), list(seeds)
    out = np.zeros((len(seeds), bands, *settings.padded_shape))
    for start in range(0, bands, 3):
        scene.set_bands(scene.triple(start))
        used = min(3, bands - start)
        for number, seed in enumerate(seeds):
            out[number, start : start + used] = scene.image(samples, seed)[:used]
    return out
