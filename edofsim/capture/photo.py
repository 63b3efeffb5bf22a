"""What comes out of a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from torch import Tensor

from ..core.json_values import Json
from ..core.notebook import picture_html, picture_png, show
from ..render.colour import colour_matrix, light_of
from ..render.view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class How:
    """The choices that a photo was made by; its file has them too.

    fidelity: values of its fields. layers, occlusion, sub_apertures, window_px, layers_db: as simulated.
    bands: groups that were blurred. hidden_surfaces: `rendered`, `guessed` or `not used`. field_step_px:
    between places with PSFs of their own, None where all have those of the axis. distortion: how view and
    camera agree in it. margin_repeated_px: of the border, beyond what was rendered. transmission: of the
    mask. sensor: its effects, in order; seed: of its noise. predicted: errors that the plan expects; scene,
    view, camera: name, key and recipe of what it shows; None where not known.
    """

    fidelity: Mapping[str, object] = field(default_factory=dict)
    layers: int = 0
    occlusion: str = ""
    hidden_surfaces: str = ""
    guessed_fragments: int = 0
    sub_apertures: int = 1
    bands: int = 0
    field_step_px: float | None = None
    distortion: str = ""
    window_px: int = 0
    layers_db: float | None = None
    margin_repeated_px: int = 0
    transmission: float = 1.0
    sensor: list[dict[str, object]] = field(default_factory=list)
    seed: int = 0
    predicted: Mapping[str, object] | None = None
    scene: str | None = None
    view: str | None = None
    camera: Mapping[str, object] | None = None

    @classmethod
    def of(cls, said: Json) -> How:
        """That of a file, which may be of another version."""
        return cls(**{each.name: said[each.name] for each in fields(cls) if each.name in said})

    def said(self) -> dict[str, object]:
        """For a file: without what is not known."""
        unknown = [name for name in ("predicted", "scene", "view", "camera") if getattr(self, name) is None]
        return {name: value for name, value in vars(self).items() if name not in unknown}


@dataclass(frozen=True)
class Photo:
    """A sensor image and what it is judged by. All images are linear, [channel, y, x], full scale 1.

    image: with noise.
    clean: without.
    ideal: all in focus, same response and exposure.
    exposure: factor from radiance to full scale.
    truncated: fraction of the light that left the PSF windows and came back as veiling glare (see
        `photograph.glare_of`), per channel [channel].
    how: the choices that were made.
    seconds: time of each stage.
    inverse_depth: [y, x] in 1/m, the mean of what each pixel sees, 0 is infinity; None where it is not known.
    colours: [3, 3], matrix from the sensor's colours to linear sRGB under the scene's light, for pictures
        alone (`render.colour_matrix`); None where bands hold no colours, and pictures show the channels as
        they are.
    """

    image: Tensor
    clean: Tensor
    ideal: Tensor
    exposure: float
    truncated: Tensor
    how: How = How()
    seconds: Mapping[str, float] = field(default_factory=dict)
    inverse_depth: Tensor | None = None
    colours: Tensor | None = None

    def show(self, which: Literal["image", "clean", "ideal"] = "image", axes: Axes | None = None) -> Axes:
        """Draw one of its images with Matplotlib; returns the axes.

        which: `image`, `clean` (without noise) or `ideal` (all in focus).
        axes: to draw in; None for new ones.
        """
        return show(getattr(self, which), which, axes, self.colours)

    def save(self, path: str | Path) -> Path:
        """Write it: as `.exr`, linear, with all that it holds but the seconds; as `.png`, the image in sRGB.
        Returns the path. Raises InputError for another suffix."""
        from .files import save_image, write_photo

        path = Path(path)
        if path.suffix.lower() == ".exr":
            return write_photo(path, self)
        return save_image(path, self.image, self.colours)

    @classmethod
    def load(cls, path: str | Path) -> Photo:
        """One that was saved as `.exr`. Raises InputError for any other file."""
        from .files import read_photo

        found = read_photo(Path(path))
        found["how"] = How.of(found["how"])
        return cls(**found)

    def _repr_png_(self) -> bytes:
        return picture_png(self.image, self.colours)

    def _repr_html_(self) -> str:
        rows, columns = self.image.shape[-2:]
        how = self.how
        said = f"layers {how.layers}, occlusion {how.occlusion}, sub_apertures {how.sub_apertures}"
        return picture_html(self.image, f"Photo of {columns} x {rows} pixels: {said}", self.colours)


def colours_of(views: Sequence[View], weights: Tensor) -> Tensor | None:
    """Matrix [3, 3] from the colours of a sensor to linear sRGB, for one white balance of all views.

    weights: the response [channel, band]. None where the bands hold no colours (`render.colour_matrix`).
    views: of the same bands.
    """
    lights = [light for view in views if (light := light_of(view)) is not None]
    light = np.mean(lights, axis=0) if lights else None
    wavelengths = views[0].wavelengths.cpu().double().numpy()
    found = colour_matrix(weights.detach().cpu().double().numpy(), wavelengths, light)
    return None if found is None else torch.from_numpy(found)
