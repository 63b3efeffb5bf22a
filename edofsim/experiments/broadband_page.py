"""The page of the broadband experiment."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import matplotlib
from matplotlib.figure import Figure

from ..report.page import Block, Column, Gallery, Key, Keys, Notes, Page, Section, Table, Text
from ..report.pictures import Picture, picture_file
from ..report.plot import (
    DEPTH_MAP,
    INK,
    NARROW_IN,
    WIDE_IN,
    Plot,
    line_plot,
    metre_ticks,
    new_figure,
)
from ..report.words import distance, number, percent
from .chromatic import Chromatic
from .paper_figures import BROADBAND, DEPTHS_M
from .planes import CHANNELS

if TYPE_CHECKING:
    from .broadband import Result

ABOUT = (
    "Every band is convolved with the point spread function of its own wavelength; the sensor's colours are "
    "the sums weighted with its response, and so is the truth. Bands that a cube does not have are left out "
    "of both. "
    "The 99.5th percentile of the truth is 0.9 of full scale; read noise 0.005, height errors of 30 nm."
)


def page(result: Result) -> Page:
    """Broadband imaging."""
    first = result.rows[0]
    worst = min(r.restored_db[0] for r in result.rows if (r.system, r.cube) == (first.system, first.cube))
    paper = [value for values in BROADBAND.values() for value in values.values()]
    keys = (
        Key(f"{first.system}, {first.cube}", number(worst, 2), "dB", "restored, the worst distance", True),
        Key("the paper", f"{number(min(paper))} to {number(max(paper))}", "dB", "two other cubes"),
    )
    sections = [Section("Scores", (_scores(result), _paper(), _bands(result)))]
    for system, found in result.optics.items():
        sections.append(Section(f"Optics of {system}", _optics(system, found)))
    for cube in dict.fromkeys(row.cube for row in result.rows):
        sections.append(Section(cube, _pictures(result, cube)))
    notes = (Notes(result.problems),) if result.problems else ()
    return Page(
        "Broadband imaging",
        "Restoration of light of all wavelengths by networks trained with three.",
        tuple(sections),
        (Keys(keys), Text(ABOUT), *notes),
    )


def _scores(result: Result) -> Table:
    columns = (
        Column("System"),
        Column("Cube"),
        Column("Distance"),
        Column("photo", "dB", 2),
        Column("restored", "dB", 2),
        *(Column(name, "dB", 2) for name in CHANNELS),
        Column("in three wavelengths", "dB", 2),
        Column("filter that knows", "dB", 2),
    )
    rows = tuple(
        (r.system, r.cube, distance(r.depth_m), r.photo_db[0], *r.restored_db, r.three_db, r.filter_db)
        for r in result.rows
    )
    return Table(
        columns,
        rows,
        "PSNR against the response-weighted cube: of the photo; of the restored picture and its colours; "
        "of it where the same colours come as three single wavelengths, as in the training; and of the "
        "photo through a Wiener filter that knows the distance and the mask as it was made. The filters of "
        "a system's own, if it has any, are conditioned on the response, not on distance or errors.",
    )


def _paper() -> Table:
    columns = (Column("The paper's"), *(Column(distance(d), "dB", 2) for d in DEPTHS_M))
    rows = tuple((name, *(values[d] for d in DEPTHS_M)) for name, values in BROADBAND.items())
    return Table(columns, rows, "The paper's two cubes, of another data set, at an exposure that it does not "
                 "state.")  # fmt: skip


def _bands(result: Result) -> Table:
    columns = (
        Column("Cube"),
        Column("Bands"),
        *(Column(f"{name}: response left out") for name in CHANNELS),
    )
    rows = tuple(
        (cube, f"{len(nm)}\n{nm[0]:.0f} to {nm[-1]:.0f} nm", *(percent(s) for s in result.left_out[cube]))
        for cube, nm in result.bands_nm.items()
    )
    return Table(columns, rows, "Of the sensor's 31 bands from 420 to 720 nm, those that each cube has.")


def _optics(system: str, found: Chromatic) -> tuple[Block, ...]:
    names = [distance(d) for d in DEPTHS_M]
    nm = (found.wavelengths * 1e9).tolist()
    difference = line_plot(
        [(name, nm, found.difference[i].tolist()) for i, name in enumerate(names)],
        x="wavelength (nm)",
        y="difference of the PSF",
        alt=f"Difference of each band's PSF from that of the nearest training wavelength for {system}: 0 "
        f"near 482, 543 and 611 nm, at most {float(found.difference.max()):.2f}.",
        caption="How far each band's point spread function is from that of the nearest of the three training "
        "wavelengths at the same distance: ‖h − h₀‖ / ‖h₀‖. Near 482, 543 and 611 nm it is small by design.",
        width=WIDE_IN,
    )
    sides = ("to the right", "down")
    places = [
        line_plot(
            [(name, nm, found.centroid_um[i, :, axis].tolist()) for i, name in enumerate(names)],
            x="wavelength (nm)",
            y=f"centre of the light, {sides[axis]} (µm)",
            alt=f"Centre of the PSF by wavelength for {system}, {sides[axis]}: between "
            f"{float(found.centroid_um[..., axis].min()):.1f} and "
            f"{float(found.centroid_um[..., axis].max()):.1f} µm.",
            caption=f"Lateral symmetry: where the centre of the light lies, {sides[axis]} of the axis on the "
            "sensor. A shift between wavelengths is a colour fringe.",
            width=WIDE_IN,
        )
        for axis in (0, 1)
    ]
    means = found.asymmetry.mean(1)
    asymmetric = Table(
        (Column("Distance"), Column("left to right", "", 3), Column("top to bottom", "", 3)),
        tuple((names[i], float(means[i, 0]), float(means[i, 1])) for i in range(len(names))),
        "Asymmetry of the point spread functions, mean over the bands: the part of the light that lies "
        "elsewhere in the mirrored one. 0 is symmetric.",
    )
    linear = Table(
        (Column("Distance"), Column("in three wavelengths", "dB", 2), Column("in all bands", "dB", 2)),
        tuple((names[i], *found.linear_db[i].tolist()) for i in range(len(names))),
        "What the light alone costs: PSNR of photographs restored by the best linear filter that knows the "
        "distance and that all bands are equally bright, in closed form. What is lost from left to right is "
        "lost although the spectra are known.",
    )
    return (difference, linear, _axial(system, found), *places, asymmetric)


def _axial(system: str, found: Chromatic) -> Plot:
    """Sharpness over wavelength and depth, the lens alone and with the mask."""
    panels = (("lens alone", found.lens_transfer), ("with its mask", found.transfer))
    low = float(min(values.min() for _, values in panels))
    high = float(max(values.max() for _, values in panels))
    nm = (found.wavelengths * 1e9).tolist()
    low_z, high_z = float(found.inverse_depths[0]), float(found.inverse_depths[-1])

    def paint(narrow: bool = False) -> Figure:
        figure = new_figure(NARROW_IN if narrow else WIDE_IN, 6.6 if narrow else 3.6)
        axes_of = figure.subplots(*((2, 1) if narrow else (1, 2)), sharex=True, sharey=True)
        for axes, (title, values) in zip(axes_of, panels, strict=True):
            shown = axes.pcolormesh(
                nm,
                found.inverse_depths.tolist(),
                values.numpy(),
                cmap=matplotlib.colormaps[DEPTH_MAP],
                vmin=low,
                vmax=high,
                shading="nearest",
                rasterized=True,
            )
            inside = [(at, z) for at, z in zip(nm, found.focus.tolist(), strict=True) if z >= 0]
            axes.plot([a for a, _ in inside], [b for _, b in inside], color="white", linewidth=3)
            axes.plot(
                [a for a, _ in inside], [b for _, b in inside], color=INK, linewidth=1.4, linestyle="--"
            )
            axes.set_title(title, loc="left")
            axes.set_xlabel("wavelength (nm)")
            axes.grid(False)
            ticks = metre_ticks(low_z, high_z, 7)
            axes.set_yticks(ticks, ["∞" if t == 0 else f"{1 / t:.3g}" for t in ticks])
            axes.set_ylim(low_z, high_z)
        axes_of[0].set_ylabel("distance (m)")
        bar = figure.colorbar(shown, ax=list(axes_of), orientation="horizontal" if narrow else "vertical")
        bar.outline.set_visible(False)
        bar.set_label("rms modulation transfer")
        return figure

    spread = [float(values.max() / values.min()) for _, values in panels]
    return Plot(
        paint,
        alt="Sharpness over wavelength and distance. The lens alone is sharp along one line only; largest "
        f"over smallest value is {spread[0]:.1f} for it and {spread[1]:.1f} with the mask of {system}.",
        caption="Axial colour: root mean square of the modulation transfer over the sensor's frequencies. "
        "Dashed: the distance in focus for rays near the axis; spherical aberration moves the sharpest one "
        "nearer. A mask that extends the depth of field levels it: largest over smallest is "
        f"{spread[0]:.1f} for the lens, {spread[1]:.1f} with the mask.",
        paint_narrow=functools.partial(paint, True),
    )


def _pictures(result: Result, cube: str) -> tuple[Block, ...]:
    rows = [row for row in result.rows if row.cube == cube]
    truth = picture_file(rows[0].shown.sharp, "truth", f"{cube}: the response-weighted cube.")
    blocks: list[Block] = [
        _band_errors(result, cube),
        Gallery((truth,), "The response-weighted cube; the middle of it, as all below.", 4, pixels=True),
    ]
    for system in dict.fromkeys(row.system for row in rows):
        pictures: list[Picture] = []
        for row in (r for r in rows if r.system == system):
            at = distance(row.depth_m)
            pictures += row.shown.pair(cube, at, f"{system} at {at}", row.photo_db[0], row.restored_db[0])
        caption = "White-balanced to daylight (D65) and in sRGB; the PSNR is of the whole picture."
        blocks.append(Gallery(tuple(pictures), caption, columns=4, pixels=True, title=system))
    return tuple(blocks)


def _band_errors(result: Result, cube: str) -> Plot:
    """What the optics do to each band, of the first system."""
    first = result.rows[0].system
    rows = [row for row in result.rows if (row.system, row.cube) == (first, cube)]
    nm = result.bands_nm[cube]
    return line_plot(
        [(distance(r.depth_m), nm, r.band_errors) for r in rows],
        x="wavelength (nm)",
        y="error of the band (rms, relative)",
        alt=f"Relative error of each band's photo of {cube} by {first}, "
        f"{percent(min(min(r.band_errors) for r in rows))} to "
        f"{percent(max(max(r.band_errors) for r in rows))}.",
        caption=f"What the optics of {first} do to each band before anything is restored: root mean square "
        "of the difference between the band's photo and the band, over that of the band.",
        width=WIDE_IN,
    )
