"""A view: a rendered scene, independent of any camera optics.

A view is a list of fragments. A fragment is one surface seen in one pixel; a pixel on a depth edge has
several, and *hidden* fragments lie behind the visible ones, for a blur to uncover.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..core.colours import colours_of
from ..core.files import whole
from ..core.images import mirrored
from ..core.json_values import Json
from ..core.limits import existing
from ..core.measurements import read_numbers
from ..core.notebook import picture_html, picture_png, show
from ..errors import InputError
from ..recipe.scene import Bands, Frame
from ..scene import depth_maps, spectra
from ..scene.pictures import source_picture
from ..scene.spectra import srgb_weights
from .colour import colour_matrix, light_entry, light_of
from .exr import read_view, write_view
from .fragment_fields import FragmentFields
from .fragments import Fragments

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class View(FragmentFields[Tensor]):
    """Fragments of a frame, sorted by pixel and, within a pixel, from near to far.

    The frame has `height` x `width` pixels and is surrounded by `margin` further pixels on each side, from
    which blurred light enters it. `pixel` counts in the frame with its margin, row by row from the top left.

    pixel: int64 [fragment]
    coverage: [fragment], fraction of the pixel's samples that see the fragment. Visible fragments of a
        pixel sum to 1 (background at infinity is a fragment too). A hidden fragment's coverage is the
        fraction of the samples whose continued ray meets it.
    inverse_depth: [fragment], mean of 1/z over the fragment, in 1/m; 0 is infinity.
    radiance: [band, fragment], premultiplied by coverage, linear.
    hidden: bool [fragment]
    wavelengths: float64 [band], metres
    pixel_angle: tangent of the angle that one pixel sees, on the axis
    noise: estimated relative standard error of the band mean over the image; 0 if not from sampling
    half_difference: [band, fragment], half of what two independent halves of the samples differ by in
        radiance: noise of the same kind as that of radiance, and independent of it. None where it is not
        known, or where there is none (noise is 0 then).
    axis: (y, x), where the optical axis meets the frame, in pixels from its top left corner; None: the
        middle. A part that is cut out keeps it, and it may lie outside.
    """

    def __post_init__(self) -> None:
        """Raises InputError for shapes that do not fit each other; values are checked before a photo."""
        count, bands = self.pixel.numel(), self.wavelengths.numel()
        wanted = dict.fromkeys(("pixel", "coverage", "inverse_depth", "hidden"), (count,))
        wanted |= {"wavelengths": (bands,), "radiance": (bands, count)}
        wanted |= {} if self.half_difference is None else {"half_difference": (bands, count)}
        problems = [
            f"a view of {count} fragments and {bands} bands needs {name} of shape {list(shape)}, not "
            f"{list(getattr(self, name).shape)}; View.flat makes one of images"
            for name, shape in wanted.items()
            if tuple(getattr(self, name).shape) != shape
        ]
        if min(self.height, self.width) < 1 or self.margin < 0:
            problems.append(
                f"a view cannot have {self.width} x {self.height} pixels and a margin of {self.margin}"
            )
        if self.axis is not None and not all(map(math.isfinite, self.axis)):
            problems.append(f"a view's axis is two finite numbers of pixels, (y, x), not {self.axis}")
        if not 0 < self.pixel_angle < math.inf:
            problems.append(f"a view's pixel_angle is finite and above 0, not {self.pixel_angle}")
        if problems:
            raise InputError(problems)

    @classmethod
    def flat(
        cls,
        radiance: Tensor | np.ndarray,
        inverse_depth: Tensor | np.ndarray | float,
        *,
        wavelengths: Tensor | np.ndarray | Sequence[float],
        pixel_angle: float,
        margin: int = 0,
        metadata: Json | None = None,
    ) -> View:
        """A view of one opaque fragment a pixel, and nothing behind. It has the type and the device of the
        radiance, and shares its memory.

        radiance: [band, y, x] of the frame with its margin, linear.
        inverse_depth: [y, x] in 1/m, or a number for all pixels.
        wavelengths: [band] in metres.
        pixel_angle: tangent of the angle that one pixel sees, on the axis.
        margin: pixels around the frame.
        metadata: what else is known of it.

        Raises InputError for shapes that do not fit each other, a radiance that is not finite, and depths
        that are not in front of the lens.
        """
        light = torch.as_tensor(radiance)
        light = light if light.is_floating_point() else light.float()
        depth = torch.as_tensor(inverse_depth, dtype=light.dtype, device=light.device)
        if light.ndim != 3:
            raise InputError(f"radiance needs the shape [band, y, x], not {list(light.shape)}")
        _, rows, columns = light.shape
        if depth.ndim and depth.shape != light.shape[1:]:
            raise InputError(
                f"inverse_depth has the shape {list(depth.shape)}: give a number, or [y, x] as the radiance "
                f"has them, {[rows, columns]}"
            )
        if not 0 <= 2 * margin < min(rows, columns):
            raise InputError(f"a margin of {margin} pixels does not fit into {columns} x {rows}")
        if not bool(torch.isfinite(light.detach()).all()):
            raise InputError("radiance holds values that are NaN or infinite")
        if not bool(((depth >= 0) & (depth < math.inf)).all()):
            raise InputError(
                "inverse_depth holds values that are NaN, infinite or negative; it is 1/z in 1/m, and 0 for "
                "infinity"
            )
        count = rows * columns
        return cls(
            height=rows - 2 * margin,
            width=columns - 2 * margin,
            margin=margin,
            pixel=torch.arange(count, device=light.device),
            coverage=light.new_ones(count),
            inverse_depth=depth.expand(rows, columns).reshape(-1).clone(),
            radiance=light.reshape(-1, count),
            hidden=torch.zeros(count, dtype=torch.bool, device=light.device),
            wavelengths=torch.as_tensor(wavelengths, dtype=torch.float64, device=light.device),
            pixel_angle=pixel_angle,
            metadata=metadata or {},
        )

    @classmethod
    def from_image(
        cls,
        rgb: np.ndarray | Tensor | str | Path,
        depth: np.ndarray | Tensor | float | str | Path,
        *,
        pixel_angle: float | None = None,
        wavelengths: np.ndarray | None = None,
        illuminant: str = "D65",
        margin: int | None = None,
    ) -> View:
        """A view of an sRGB picture with a depth map, as `[source] kind = "rgbd"` of a recipe reads them.

        rgb: a picture file (PNG, JPEG, TIFF, OpenEXR, PFM), or [y, x, 3], uint8 or floats from 0 to 1, as
            such files hold them; its colours become smooth reflectances under `illuminant`.
        depth: a file (PNG, TIFF, PFM, NPY, NPZ, MAT, EXR, CSV) in metres along the axis, or in millimetres
            where it holds whole numbers; or [y, x], floats in metres, or one number for all. `inf` is
            background; NaN, 0 and negative values are holes, filled with the farther neighbour in the row.
        pixel_angle: tangent of the angle that a pixel sees; None for that of the paper's camera, else take
            the `pixel_angle` of the camera that will photograph it.
        wavelengths: [band] in metres; None for 31 from 420 to 720 nm.
        illuminant: of the picture, a name such as `D65`.
        margin: pixels around the frame, the picture's mirror image, from which light comes; None for 64.

        Raises InputError for files that cannot be read, for shapes that do not fit each other, for a depth
        map that holds no depth, and for an array of whole numbers, which may be of any unit.
        """

        from_file = isinstance(rgb, str | Path)
        picture = source_picture(str(rgb), None, Path()) if from_file else colours_of(np.asarray(rgb))
        if isinstance(depth, str | Path):
            depth = read_numbers(str(depth), None, Path(), "depth map")
            depth = depth * depth_maps.usual_unit(depth)
        colours = picture.linear
        rows, columns = colours.shape[:2]
        inverse = depth_maps.inverse_of(np.asarray(depth), (rows, columns))
        frame = Frame()
        margin = frame.margin_px if margin is None else margin
        around = np.ix_(*(mirrored(np.arange(-margin, n + margin), n) for n in (rows, columns)))
        bands = Bands().wavelengths() if wavelengths is None else np.asarray(wavelengths, float)
        return cls.flat(
            spectra.upsampled(colours[around], bands, illuminant),
            inverse[around],
            wavelengths=bands,
            pixel_angle=frame.pixel_angle if pixel_angle is None else pixel_angle,
            margin=margin,
            metadata={
                "route": "made of a picture with depths",
                "picture": "; ".join(picture.assumed),
                "hidden": "missing: a picture holds no light from behind its edges",
                **light_entry(spectra.illuminant(illuminant, bands)),
            },
        )

    @property
    def bands(self) -> int:
        return int(self.radiance.shape[0])

    @property
    def axis_px(self) -> tuple[float, float]:
        """(y, x) of `axis`, the middle of the frame where it is None."""
        return (self.height / 2, self.width / 2) if self.axis is None else self.axis

    @property
    def one_each(self) -> bool:
        """Whether every pixel has one fragment, and it is seen: fragment i is pixel i then."""
        rows, columns = self.padded_shape
        if self.pixel.numel() != rows * columns or bool(self.hidden.any()):
            return False
        return bool((self.pixel == torch.arange(self.pixel.numel(), device=self.pixel.device)).all())

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> View:
        """The same view on another device; `dtype` applies to coverage, inverse depth and radiance.

        device: None for the same.
        dtype: float32 or float64; None for the same.
        """
        whole = {name: getattr(self, name).to(device) for name in ("pixel", "hidden", "wavelengths")}
        real = ("coverage", "inverse_depth", "radiance", "half_difference")
        held = {name: getattr(self, name) for name in real if getattr(self, name) is not None}
        return replace(self, **whole, **{name: value.to(device, dtype) for name, value in held.items()})

    def with_light(self, radiance: Tensor, wavelengths: Tensor | None = None) -> View:
        """The same surfaces with other light, whose noise is not known.

        radiance: [band, fragment], premultiplied by coverage.
        wavelengths: [band] in metres; None for those of this view.
        """
        wavelengths = self.wavelengths if wavelengths is None else wavelengths
        return replace(self, radiance=radiance, wavelengths=wavelengths, half_difference=None)

    def crop_margin(self, image: Tensor) -> Tensor:
        """Cut the margin off, to [..., height, width].

        image: of the frame with its margin, [..., y, x].
        """
        m = self.margin
        return image[..., m : m + self.height, m : m + self.width]

    def all_in_focus(self) -> Tensor:
        """The pinhole image of the padded frame, [band, y, x]: the sum of each pixel's visible fragments."""
        rows, columns = self.padded_shape
        seen = ~self.hidden
        image = self.radiance.new_zeros(self.bands, rows * columns)
        image.index_add_(1, self.pixel[seen], self.radiance[:, seen])
        return image.reshape(self.bands, rows, columns)

    def mean_inverse_depth(self) -> Tensor:
        """Coverage-weighted inverse depth of what is seen, padded frame, [y, x], in 1/m."""
        rows, columns = self.padded_shape
        total = self.coverage.new_zeros(rows * columns)
        weight = torch.zeros_like(total)
        seen = self.coverage * ~self.hidden
        total.index_add_(0, self.pixel, seen * self.inverse_depth)
        weight.index_add_(0, self.pixel, seen)
        return (total / weight.clamp_min(torch.finfo(weight.dtype).tiny)).reshape(rows, columns)

    @classmethod
    def of(cls, fragments: Fragments) -> View:
        """That of arrays, which shares their memory. Raises InputError as making one does."""
        held: Json = {each.name: getattr(fragments, each.name) for each in fields(Fragments)}
        arrays = {name: value for name, value in held.items() if hasattr(value, "dtype")}
        held.update({name: torch.from_numpy(value) for name, value in arrays.items()})
        return cls(**held)

    def fragments(self) -> Fragments:
        """As arrays, which share its memory where that is the processor's."""
        held = {each.name: getattr(self, each.name) for each in fields(Fragments)}
        tensors = {name: value for name, value in held.items() if hasattr(value, "detach")}
        return Fragments(**held | {name: value.detach().cpu().numpy() for name, value in tensors.items()})

    def save(self, path: str | Path) -> Path:
        """Write it as spectral OpenEXR, as the cache of rendered views holds it: light in half floats, each
        view scaled to use them well. Returns the path. Raises InputError for another suffix than `.exr`, and
        what `core.files.whole` raises."""

        path = Path(path)
        if path.suffix.lower() != ".exr":
            raise InputError(f"{path}: views are written as .exr")
        with whole(path) as temporary:
            write_view(temporary, self.fragments())
        return path

    @classmethod
    def load(cls, path: str | Path) -> View:
        """One that was saved, or an entry of the cache. Raises InputError for any other file."""

        try:
            return cls.of(read_view(existing(Path(path), "view")))
        except ValueError as error:
            raise InputError(str(error)) from None

    def colours(self) -> Tensor:
        """What the eye would see, linear sRGB [3, y, x] without the margin: daylight of radiance 1 is white,
        and a view of a picture has the picture's colours."""

        weights = torch.as_tensor(srgb_weights(self.wavelengths.cpu().numpy()))
        image = weights.to(self.radiance) @ self.all_in_focus().detach().flatten(1)
        return self.crop_margin(image.reshape(3, *self.padded_shape))

    def picture(self) -> Tensor:
        """`colours`, white-balanced to the scene's light where that is known, the 99th percentile at 0.9."""

        image, light = self.colours(), light_of(self)
        if light is not None:  # for the eye's own response the matrix is an exact adaptation to the light
            wavelengths = self.wavelengths.cpu().numpy()
            matrix = colour_matrix(srgb_weights(wavelengths), wavelengths, light)
            image = (
                image
                if matrix is None
                else torch.einsum("cs,syx->cyx", torch.as_tensor(matrix).to(image), image)
            )
        bright = float(np.percentile(image.cpu().numpy(), 99))
        return image * (0.9 / bright) if bright > 0 else image

    def show(self, axes: Axes | None = None) -> Axes:
        """Draw it, all in focus, with Matplotlib; returns the axes.

        axes: to draw in; None for new ones.
        """
        return show(self.picture(), self.caption(), axes)

    def caption(self) -> str:
        inverse = self.inverse_depth
        far, near = (f"{1 / float(end):.3g}" if end > 0 else "infinity" for end in inverse.aminmax())
        depths = f"at {near} m" if near == far else f"{near} to {far} m"
        behind = int(self.hidden.sum())
        return (
            f"View of {self.width} x {self.height} pixels, {self.bands} bands, {depths}, "
            f"{self.pixel.numel()} fragments, {behind} of them hidden"
        )

    def _repr_png_(self) -> bytes:
        return picture_png(self.picture())

    def _repr_html_(self) -> str:
        return picture_html(self.picture(), self.caption())
