"""The sensor: its spectral response and its noise."""

from __future__ import annotations

import csv
import difflib
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..core.tables import kept_tables
from ..errors import InputError
from .camera import Camera

PAPER = "paper"
LINES = "lines"
PAPER_COLOURS = torch.tensor([611e-9, 543e-9, 482e-9], dtype=torch.float64)
"""Red, green and blue of Akpinar et al., [3] in metres."""
COLOUR_SCIENCE = {"nikon-5100": "Nikon 5100 (NPL)", "sigma-sdmerill": "Sigma SDMerill (NPL)"}


def response(camera: Camera, wavelengths: Tensor) -> Tensor:
    """What each band adds to red, green and blue: [3, band], float64, each row summing to 1 over the bands.

    wavelengths: [band], metres. `sensor.response` of the recipe is "paper" (31 bands read off the figure of
    camera: the recipe's sensor says which response.
    Akpinar et al.), "nikon-5100" or "sigma-sdmerill" (measured by NPL, in colour-science), "lines" (three
    bands, each one channel: the paper's model of 611, 543 and 482 nm), or a CSV file with the columns
    wavelength_nm, r, g, b. Between tabulated wavelengths it is interpolated linearly.

    Raises InputError for a response that cannot be read, wavelengths outside it, and a channel left dark.
    """
    wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64).detach().cpu().flatten()
    name = camera.recipe.sensor.response
    if name == LINES:
        return _lines(wavelengths)
    table_nm, curves, source = _table(name, camera.base)
    nm = (wavelengths * 1e9).numpy()
    outside = nm[(nm < table_nm[0] - 1e-3) | (nm > table_nm[-1] + 1e-3)]
    if outside.size:
        raise InputError(
            f"sensor.response {name!r} ({source}) covers {table_nm[0]:g} to {table_nm[-1]:g} nm and does not "
            f"have {outside[0]:g} nm; narrow the bands of the scene or choose another response"
        )
    rows = np.stack([np.interp(nm, table_nm, curve) for curve in curves])
    sums = rows.sum(1)
    if (sums <= 0).any():
        dark = ", ".join(
            channel for channel, total in zip(("red", "green", "blue"), sums, strict=True) if total <= 0
        )
        raise InputError(
            f"sensor.response {name!r} leaves {dark} dark at these wavelengths; add bands that it sees"
        )
    return torch.from_numpy(rows / sums[:, None])


def response_curves(camera: Camera) -> tuple[Tensor, Tensor] | None:
    """The camera's tabulated response, float64: wavelengths [n] in metres, curves [3, n]; None for "lines".

    Raises InputError for a response that cannot be read.
    """
    if camera.recipe.sensor.response == LINES:
        return None
    table_nm, curves, _ = _table(camera.recipe.sensor.response, camera.base)
    return torch.from_numpy(table_nm * 1e-9), torch.from_numpy(np.array(curves, dtype=np.float64))


def _lines(wavelengths: Tensor) -> Tensor:
    if wavelengths.numel() != 3:
        raise InputError(
            'sensor.response "lines" is for three bands, one for each channel; there are'
            f" {wavelengths.numel()}"
        )
    order = torch.argsort(wavelengths, descending=True)
    return torch.eye(3, dtype=torch.float64)[torch.argsort(order)].T


def _table(name: str, base: Path) -> tuple[np.ndarray, np.ndarray, str]:
    """Wavelengths [n] in nm, curves [3, n], and where they come from. A file is read anew, since it may have
    changed."""
    return _known(name) if name == PAPER or name in COLOUR_SCIENCE else _file(name, base)


@lru_cache(maxsize=8)
def _known(name: str) -> tuple[np.ndarray, np.ndarray, str]:
    if name == PAPER:
        path = resources.files("edofsim.optics") / "data" / "sensor_response.csv"
        return (*_read_csv(path.read_text(encoding="utf-8"), name), "read off a figure of Akpinar et al.")
    return (*_from_colour_science(COLOUR_SCIENCE[name]), "NPL, through colour-science")


def _file(name: str, base: Path) -> tuple[np.ndarray, np.ndarray, str]:
    path = base / name
    if not path.is_file():
        known = [PAPER, LINES, *COLOUR_SCIENCE]
        near = difflib.get_close_matches(name.lower(), known, 1, 0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(
            f"sensor.response = {name!r} is neither a known response nor a file in {base}; {hint}known:"
            f" {', '.join(known)}"
        )
    return (*_read_csv(path.read_text(encoding="utf-8", errors="replace"), str(path)), str(path))


def _read_csv(text: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    try:
        rows = list(csv.DictReader(text.splitlines()))
        table = np.array([[float(row[key]) for key in ("wavelength_nm", "r", "g", "b")] for row in rows])
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(
            f"sensor.response {name}: needs numbers in the columns wavelength_nm, r, g, b ({error!r})"
        ) from error
    if (
        len(table) < 2
        or not np.isfinite(table).all()
        or (table < 0).any()
        or (np.diff(table[:, 0]) <= 0).any()
    ):
        raise InputError(
            f"sensor.response {name}: needs two rows or more, rising wavelengths, and finite values of 0 or"
            " above"
        )
    return table[:, 0], table[:, 1:].T


def _from_colour_science(title: str) -> tuple[np.ndarray, np.ndarray]:
    def make() -> dict[str, np.ndarray]:
        from colour import MSDS_CAMERA_SENSITIVITIES

        found = MSDS_CAMERA_SENSITIVITIES[title]
        return {"": np.vstack([found.wavelengths, np.asarray(found.values).clip(0).T])}

    nm, *curves = kept_tables(f"sensor {title}", make)[""]
    return nm, np.stack(curves)
