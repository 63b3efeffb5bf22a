"""What comes out of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from torch import Tensor

from ..core.notebook import picture_html, picture_png, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Photo:
    """A sensor image and what it is judged by. All images are linear, [channel, y, x], full scale 1.

    image: with noise.
    clean: without.
    ideal: all in focus, same response and exposure.
    exposure: factor from radiance to full scale.
    truncated: fraction of the light that left the PSF windows and came back as veiling glare (see
        `photograph.glare_of`), per channel [channel].
    how: the choices that were made (method, layers, occlusion, ...).
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
    how: Mapping[str, object] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    inverse_depth: Tensor | None = None
    colours: Tensor | None = None

    def show(self, which: Literal["image", "clean", "ideal"] = "image", axes: Axes | None = None) -> Axes:
        """Draw one of its images with Matplotlib; returns the axes."""
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

        return cls(**read_photo(Path(path)))

    def _repr_png_(self) -> bytes:
        return picture_png(self.image, self.colours)

    def _repr_html_(self) -> str:
        rows, columns = self.image.shape[-2:]
        shown = [name for name in ("layers", "occlusion", "sub_apertures") if name in self.how]
        said = ", ".join(f"{name} {self.how[name]}" for name in shown)
        return picture_html(self.image, f"Photo of {columns} x {rows} pixels: {said}", self.colours)
