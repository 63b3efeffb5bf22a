"""The camera: lens, focus and sensor as numbers in SI units, and its paraxial facts."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ..core.notebook import table_html
from ..errors import InputError
from ..recipe.camera import CameraRecipe
from .lenses import Lens
from .lenses.base import AXIS, Field
from .masks import Mask, PhaseMask
from .masks.clear import ClearMask
from .masks.height_map import HeightMapMask
from .materials import Material, material

FEWEST_A_PIXEL = 2
"""Samples along a pixel's side where the recipe leaves them open."""
HIGHEST = 1e-3
"""Height of a mask [m] beyond which it is taken to be in another unit."""
PLACE_DIGITS = 12
"""Of tangents of a place on the sensor: far below a pixel, and above what rounding does."""
FOCUS_SAMPLES = 4096
"""Rings of equal area in which the phase of a lens is averaged."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera recipe with its materials resolved and its sensor in place. Lengths are in metres.

    recipe: as it was read.
    lens: the recipe's, or a simplified one.
    mask_material: of the recipe's mask; if that only blocks light, of a height map given in its place.
    aperture_radius: of the open lens.
    sensor_distance: z_i, from the lens plane to the sensor.
    pixel: pitch of the sensor.
    base: folder that files named in the recipe are relative to.
    height_map: [n, n] in metres, the mask as designed in place of the recipe's; None for the recipe's own
        (see `with_height`).
    amplitude: [n, n], that the mask also lets through (see `with_amplitude`).
    field: place in the field whose PSFs it has (`at_field`).
    by_phase: whether its pupil may be sampled as coarsely as the steepest phase allows, half as finely as the
        paper's bound: good enough for estimates.
    """

    recipe: CameraRecipe
    lens: Lens
    mask_material: Material
    aperture_radius: float
    sensor_distance: float
    pixel: float
    base: Path
    height_map: Tensor | None = None
    amplitude: Tensor | None = None
    field: Field = AXIS
    by_phase: bool = False

    @classmethod
    def from_recipe(cls, recipe: CameraRecipe, base: Path | None = None) -> Camera:
        """Resolve a recipe.

        base: folder of the recipe's file, by default the working directory.

        Raises InputError, naming every problem, for an unknown material, a wavelength outside the glass data,
        a lens without room for its aperture, and a focus that no sensor distance gives.
        """
        lens = recipe.lens
        assert isinstance(lens, Lens)  # what the registry holds
        lens = lens.in_folder(Path.cwd() if base is None else Path(base))
        lens = lens.focused_at(recipe.focus.distance_m, recipe.focus.wavelength_nm * 1e-9)
        problems = lens.problems()
        distance = math.nan if problems else _sensor_distance(recipe, lens, problems)
        if not problems:
            lens, distance = lens.at_sensor(1 / distance)
        material = (recipe.mask if isinstance(recipe.mask, PhaseMask) else HeightMapMask()).material
        mask_material = _material("mask.material", material, problems)
        if lens.measured and not (isinstance(recipe.mask, ClearMask) and recipe.fabrication is None):
            problems.append(
                "mask: measured PSFs hold what stood in the pupil; leave out mask and fabrication"
            )
        across = 2e6 * lens.aperture_radius
        if isinstance(recipe.mask, HeightMapMask) and recipe.mask.pitch_um > across:
            problems.append(
                f"mask.pitch_um = {recipe.mask.pitch_um:g} is larger than the pupil ({across:g} um across);"
                " choose a finer pitch"
            )
        if problems or mask_material is None:
            raise InputError(problems)
        return cls(
            recipe=recipe,
            lens=lens,
            mask_material=mask_material,
            aperture_radius=lens.aperture_radius,
            sensor_distance=distance,
            pixel=recipe.sensor.pixel_um * 1e-6,
            base=Path.cwd() if base is None else Path(base),
        )

    @property
    def mask(self) -> Mask:
        """The recipe's mask as it was designed."""
        mask = self.recipe.mask
        assert isinstance(mask, Mask)  # what the registry holds
        return mask

    @property
    def read_noise(self) -> float:
        """Standard deviation of the read noise, relative to full scale."""
        return self.recipe.sensor.read_noise

    def with_read_noise(self, deviation: float) -> Camera:
        """The camera with another read noise, relative to full scale."""
        sensor = self.recipe.sensor.model_copy(update={"read_noise": deviation})
        return replace(self, recipe=self.recipe.model_copy(update={"sensor": sensor}))

    @property
    def pixel_angle(self) -> float:
        """Tangent of the angle that one pixel sees, on the axis."""
        return self.pixel / self.sensor_distance

    def _repr_html_(self) -> str:
        recipe, green = self.recipe, 543e-9
        sharp, best = float(focus_distance(self, green)), best_focus_distance(self, green)
        rows = {
            "lens": f"{recipe.lens.kind}, f = {float(focal_length(self, green)) * 1e3:.4g} mm at 543 nm",
            "aperture": f"{2e3 * self.aperture_radius:.4g} mm across",
            "sharp at 543 nm": f"{sharp:.4g} m" if 0 < sharp < math.inf else "infinity",
            "best focus at 543 nm": f"{best:.4g} m" if 0 < best < math.inf else "infinity",
            "mask": "given in Python" if self.mask_given else recipe.mask.kind,
            "pixel": f"{self.pixel * 1e6:g} um, {self.pixel_angle * 1e3:.4g} mrad",
            "read noise": f"{self.read_noise:g} of full scale",
        }
        return table_html(f"Camera {recipe.name}", (), rows.items())

    def oversampling(self, wavelength: float) -> int:
        """Samples along a pixel's side for PSFs at `wavelength` [m]: the recipe's number, or 2, or one for
        each period of the finest fringes that the aperture lets through, if that is more: then their sum is
        all light, however sharp a PSF is."""
        fixed = self.recipe.psf.oversampling
        if fixed != "auto":
            return fixed
        return max(FEWEST_A_PIXEL, math.ceil(self.pixel * cutoff_frequency(self, wavelength) - 1e-9))

    def with_height(self, height: Tensor | None) -> Camera:
        """The same camera whose mask has another height map; gradients reach it. Samples are as far apart as
        `mask.pitch_um` says where the recipe's mask is a height map, else they just cover the pupil.

        height: [n, n], metres; None for the recipe's own mask.

        Raises InputError for a map that is not square and real, or whose values are not finite or above 1 mm.
        """
        if height is not None:
            _check_map(height, "a height map", "metres")
            check_thin(height, "the height map")
        return replace(self, height_map=height)

    def with_amplitude(self, amplitude: Tensor | None) -> Camera:
        """The same camera whose mask also lets through `amplitude` [n, n] of a wave, from 0 to 1, by samples
        that just cover the pupil; gradients reach it. Its PSFs are parts of the light that is let through.

        amplitude: [n, n], from 0 to 1; None for all light.

        Raises InputError for a map that is not square and real, or whose values are not from 0 to 1.
        """
        if amplitude is not None:
            _check_map(amplitude, "an amplitude", "0 to 1")
            if not 0 <= float(amplitude.detach().min()) <= float(amplitude.detach().max()) <= 1:
                raise InputError("the amplitude holds values that are not from 0 (opaque) to 1 (open)")
        return replace(self, amplitude=amplitude)

    def key(self) -> str:
        """What tells its recipe and the mask that it was given from others."""
        maps = (one for one in (self.height_map, self.amplitude) if one is not None)
        given = b"".join(one.detach().cpu().numpy().tobytes() for one in maps)
        return self.recipe.model_dump_json() + hashlib.sha256(given).hexdigest()

    @property
    def mask_given(self) -> bool:
        """Whether a mask was given in Python, in place of the recipe's or in addition."""
        return self.height_map is not None or self.amplitude is not None

    @property
    def has_mask(self) -> bool:
        """Whether a mask stands in the aperture: the recipe's, or one given in Python."""
        return self.mask_given or self.recipe.mask.kind != "clear"

    def without_gradients(self) -> Camera:
        """The same camera, whose mask does not learn."""
        maps = (None if one is None else one.detach() for one in (self.height_map, self.amplitude))
        return replace(self, **dict(zip(("height_map", "amplitude"), maps, strict=True)))

    def at_field(self, field: Field) -> Camera:
        """The same camera with the PSFs of points in another place of the field.

        field: tangents (right, up) of their chief ray with the axis.

        Raises InputError for what is not finite.
        """
        if not all(map(math.isfinite, field)):
            raise InputError(f"a place in the field is two finite tangents, right and up, not {field}")
        return replace(self, field=field if self.lens.varies else AXIS)

    def seen_at(self, place: Field) -> Camera:
        """The same camera with the PSFs of points whose light lands in another place of the sensor.

        place: tangents (right, up) of light that a lens without distortion images there.

        Raises InputError where there is no such chief ray.
        """
        # rounded, so that a place reached by two ways is one, and its PSFs are computed once
        right, up = (round(tangent, PLACE_DIGITS) + 0.0 for tangent in place)
        return self.at_field(self.lens.chief((right, up)))

    def with_pupil_sampling(self, pitch: float) -> Camera:
        """The same camera with samples of the pupil `pitch` [m] apart."""
        psf = self.recipe.psf.model_copy(update={"pupil_sampling_um": pitch * 1e6})
        return replace(self, recipe=self.recipe.model_copy(update={"psf": psf}))

    def without_mask(self) -> Camera:
        """The same lens and sensor with a clear aperture."""
        recipe = self.recipe.model_copy(update={"mask": ClearMask(), "fabrication": None})
        return replace(Camera.from_recipe(recipe, self.base), lens=self.lens)


def _check_map(values: Tensor, name: str, unit: str) -> None:
    if not isinstance(values, Tensor):
        raise InputError(f"{name} is a torch tensor [n, n] in {unit}, not {type(values).__name__}")
    if values.ndim != 2 or values.shape[0] != values.shape[1] or not values.is_floating_point():
        raise InputError(f"{name} is square, [n, n], and real; got {tuple(values.shape)}, {values.dtype}")
    if not bool(torch.isfinite(values.detach()).all()):
        raise InputError(f"{name} holds values that are NaN or infinite; give {unit}")


def check_thin(height: Tensor, name: str) -> None:
    """Raise InputError for heights [m] that no mask has, as those in another unit are.

    height: [n, n], metres.
    name: what the message calls them.
    """
    highest = float(height.detach().abs().max())
    if highest > HIGHEST:
        raise InputError(
            f"{name} holds heights of {highest:.4g} m, more than {HIGHEST * 1e3:g} mm; heights are in metres:"
            " divide micrometres by 1e6"
        )


def focal_length(camera: Camera, wavelengths: Tensor | float) -> Tensor:
    """Of the lens, metres, float64, same shape as `wavelengths` [m].

    wavelengths: any shape [...], metres.
    camera: whose lens it is.
    """
    return camera.lens.focal_length(wavelengths)


def focus_distance(camera: Camera, wavelengths: Tensor | float) -> Tensor:
    """Distance that is paraxially sharp, metres, float64, same shape as `wavelengths` [m].

    wavelengths: any shape [...], metres.
    camera: its lens, and how far away its sensor is.

    From 1/z = 1/f - 1/z_i; infinite where the sensor lies in the focal plane, negative where it is nearer.
    """
    return 1 / (1 / focal_length(camera, wavelengths) - 1 / camera.sensor_distance)


def best_focus_distance(camera: Camera, wavelength: float) -> float:
    """Distance [m] that is in best focus at a wavelength [m], see `best_vergence`: for a lens whose rim
    refracts too strongly nearer than what is paraxially sharp. Infinite or negative as `focus_distance`.
    """
    paraxial = 1 / float(focus_distance(camera, wavelength))
    vergence = paraxial + best_vergence(camera.lens, wavelength)
    return 1 / vergence if vergence else math.inf


def best_vergence(lens: Lens, wavelength: float) -> float:
    """Vergence [1/m] between the paraxial focus of a lens and the best, at a wavelength [m].

    There the phase that is left, the lens's with defocus, has the least variance over the pupil, and the
    Strehl ratio of a small one is largest (Born and Wolf, Principles of Optics, section 9.3); without mask.
    """
    area = (torch.arange(FOCUS_SAMPLES, dtype=torch.float64) + 0.5) / FOCUS_SAMPLES
    phase = lens.phase(area * lens.aperture_radius**2, wavelength)
    psi = -12 * float(((area - 0.5) * phase).mean())
    return psi * wavelength / (math.pi * lens.aperture_radius**2)


def defocus(camera: Camera, wavelengths: Tensor | float, inverse_depths: Tensor | float) -> Tensor:
    """Defocus coefficient Psi [rad] at the rim of the pupil, Akpinar et al., Eq. `defocus`; float64.

    wavelengths: any shape [...], metres.
    inverse_depths: any shape [...] that broadcasts with it, 1/m.
    camera: its lens, aperture and sensor's distance.

    Negative for points beyond the focus.
    """
    wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64)
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64)
    vergence = inverse_depths + 1 / camera.sensor_distance - 1 / focal_length(camera, wavelengths)
    return math.pi / wavelengths * vergence * camera.aperture_radius**2


def cutoff_frequency(camera: Camera, wavelength: float) -> float:
    """Frequency [1/m on the sensor] beyond which incoherent light carries nothing: 2 r / (lambda z_i)."""
    return 2 * camera.aperture_radius / (wavelength * camera.sensor_distance)


def defocus_per_dioptre(camera: Camera, wavelength: float) -> float:
    """Change of Psi with inverse depth [rad m] at a wavelength [m]."""
    return math.pi / wavelength * camera.aperture_radius**2


def _material(key: str, name: str, problems: list[str]) -> Material | None:
    try:
        return material(name)
    except InputError as error:
        problems.extend(f"{key}: {problem}" for problem in error.problems)
        return None


def _sensor_distance(recipe: CameraRecipe, lens: Lens, problems: list[str]) -> float:
    """z_i from 1/f = 1/z_focus + 1/z_i at the wavelength of the focus."""
    try:
        focal = float(lens.focal_length(recipe.focus.wavelength_nm * 1e-9))
    except InputError as error:
        problems.extend(f"focus.wavelength_nm: {problem}" for problem in error.problems)
        return math.nan
    if recipe.focus.distance_m <= focal:
        problems.append(
            f"focus.distance_m = {recipe.focus.distance_m:g} lies inside the focal length"
            f" ({focal * 1e3:.4g} mm): nothing there can be sharp; focus farther away"
        )
        return math.nan
    apart = 0.0
    if recipe.focus.plane == "best":
        apart = best_vergence(lens, recipe.focus.wavelength_nm * 1e-9)
    vergence = 1 / focal - 1 / recipe.focus.distance_m + apart
    if not vergence > 0:
        problems.append(
            f'focus.plane = "best" lies {abs(apart):.3g} 1/m from the paraxial plane, where no sensor can be;'
            " take a smaller aperture, or another lens"
        )
        return math.nan
    return 1 / vergence
