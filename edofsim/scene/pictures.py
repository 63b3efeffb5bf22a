"""Picture files of scenes."""

from __future__ import annotations

from pathlib import Path

from ..core.colours import Picture, colours_of, read_colours
from ..core.high_range import read_hdr, read_pfm, read_radiance
from ..core.measurements import SKIMAGE, packaged_file, read_numbers

__all__ = ["read_hdr", "read_pfm", "read_radiance", "source_picture"]


def source_picture(name: str, layer: str | None, base: Path, what: str = "picture") -> Picture:
    """A picture file, or `skimage:NAME` for one inside scikit-image, as linear light, and what it was taken
    for.

    An array of NumPy's counts as `View.from_image` takes it: sRGB, floats from 0 to 1.

    layer: of an OpenEXR file.

    Raises InputError.
    """
    path = packaged_file(name.removeprefix(SKIMAGE), what) if name.startswith(SKIMAGE) else Path(base) / name
    if path.suffix.lower() in (".npy", ".npz"):
        return colours_of(read_numbers(str(path), layer, Path(), what), name=f"{what}: {str(path)!r}")
    return read_colours(path, what, layer).positive()
