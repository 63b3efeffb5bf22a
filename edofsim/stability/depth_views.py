"""Hard views: depth and coverage."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..optics import Camera, focus_distance
from .photos import HardView, Row
from .views import PADDED, across, flat, half, layered_view, uniform

CUT = 0.8
"""Inverse depth between the front and the background of views in two layers."""


def _in_focus(camera: Camera) -> float:
    return 1 / float(focus_distance(camera, 550e-9))


def _one_outlier() -> Tensor:
    depth = torch.full(PADDED, 0.5, dtype=torch.float64)
    depth[PADDED[0] // 2, PADDED[1] // 2] = 10.0
    return depth


def _single_pixels() -> Tensor:
    """Every 13th pixel lies at a depth of its own, all others at one."""
    depth = torch.full(PADDED, 0.5, dtype=torch.float64)
    alone = depth.reshape(-1)[::13]
    depth.reshape(-1)[::13] = torch.linspace(0.0, 2.0, alone.numel(), dtype=torch.float64)
    return depth


def _edge_in_a_pixel(_: Camera) -> HardView:
    """One column is covered by half: it shows both sides of the step."""
    covered = half(1.0, 0.0).clone()
    covered[:, PADDED[1] // 2] = 0.5
    return HardView(layered_view(covered, 2.0, 0.0, 1.0), cut=CUT)


def _wires(_: Camera) -> HardView:
    """A hundred wires a tenth of a pixel thick, at as many depths, in front of a wall."""
    base = flat(0.2)
    count = base.pixel.numel()
    wired = torch.arange(count)[torch.arange(count) % 3 == 0]
    depth = torch.linspace(0.5, 2.0, 100, dtype=torch.float64)[torch.arange(len(wired)) % 100]
    thick = 0.1
    radiance = base.radiance.clone()
    radiance[:, wired] *= 1 - thick
    coverage = base.coverage.clone()
    coverage[wired] -= thick
    pixel = torch.cat([wired, base.pixel, wired])
    order = torch.argsort(
        3 * pixel + torch.cat([torch.zeros_like(wired), torch.ones_like(base.pixel), 2 + 0 * wired])
    )
    wires = thick * uniform(base.bands, len(wired), seed=6)
    behind = base.radiance[:, wired] * thick
    return HardView(
        replace(
            base,
            pixel=pixel[order],
            coverage=torch.cat([torch.full_like(depth, thick), coverage, torch.full_like(depth, thick)])[
                order
            ],
            inverse_depth=torch.cat([depth, base.inverse_depth, base.inverse_depth[wired]])[order],
            radiance=torch.cat([wires, radiance, behind], 1)[:, order],
            hidden=torch.cat(
                [torch.zeros_like(wired), torch.zeros_like(base.pixel), torch.ones_like(wired)]
            ).bool()[order],
        )
    )


def _sum_above_one(_: Camera) -> HardView:
    view = layered_view(half(0.5, 0.5), 1.2, 0.4)
    return HardView(replace(view, coverage=view.coverage * (1 + 1e-6)), cut=CUT)


DEPTH: tuple[Row, ...] = (
    (
        "infinity",
        "all light is parallel: 1/z = 0",
        "division by depth",
        lambda _: HardView(flat(0.0)),
    ),
    (
        "a million kilometres",
        "z = 1e9 m, next to infinity",
        "1/z lost in a sum",
        lambda _: HardView(flat(1e-9)),
    ),
    (
        "in focus for one band",
        "550 nm is sharp: its geometric blur is 0, others are not",
        "a blur of width 0",
        lambda camera: HardView(flat(_in_focus(camera))),
    ),
    (
        "five centimetres",
        "20 dioptres: most light leaves the window",
        "phase beyond the sampling",
        lambda _: HardView(flat(20.0)),
    ),
    (
        "one depth",
        "nothing but a convolution is called for",
        "layers where none are",
        lambda _: HardView(flat(1.0)),
    ),
    (
        "one micrometre apart",
        "two surfaces whose 1/z differs by 1e-6",
        "division by the distance of two nodes",
        lambda _: HardView(flat(half(1.0, 1 / (1 + 1e-6)))),
    ),
    (
        "half a metre to infinity",
        "the largest step that there is, from a pixel to the next",
        "ringing between nodes",
        lambda _: HardView(flat(half(2.0, 0.0))),
    ),
    (
        "both in one pixel",
        "half a metre and infinity share the pixels of a column",
        "the mean of two depths",
        _edge_in_a_pixel,
    ),
    (
        "slanted through focus",
        "blur falls to nothing and grows again",
        "focus between two nodes",
        lambda _: HardView(flat(across(torch.linspace(0.2, 1.2, PADDED[1], dtype=torch.float64)))),
    ),
    (
        "empty layers",
        "two depths and nine layers",
        "0 / 0 in a layer without light",
        lambda _: HardView(flat(half(0.3, 1.5)), options={"layers": 9}),
    ),
    (
        "layers of one column",
        "every column has its own depth",
        "layers that hold a single pixel",
        # white noise at 35 depths is as far from the natural images of the tolerance as a view can be
        lambda _: HardView(
            flat(across(torch.linspace(0.0, 2.0, PADDED[1], dtype=torch.float64))), layered=0.02
        ),
    ),
    (
        "layers of one pixel",
        "81 pixels at as many depths among others at one",
        "layers that hold a single pixel",
        lambda _: HardView(flat(_single_pixels())),
    ),
    (
        "one outlier",
        "one pixel at 0.1 m, all others at 2 m",
        "all layers spent on one pixel",
        lambda _: HardView(flat(_one_outlier())),
    ),
    (
        "more layers than depths",
        "three depths and forty layers",
        "nodes that coincide",
        lambda _: HardView(
            flat(across((torch.arange(PADDED[1]) % 3).double() * 0.5)), options={"layers": 40}
        ),
    ),
)

COVERAGE: tuple[Row, ...] = (
    (
        "coverage 0",
        "fragments that cover nothing",
        "0 / 0 where light is divided by coverage",
        lambda _: HardView(layered_view(half(0.0, 0.0), 1.2, 0.4), cut=CUT),
    ),
    (
        "coverage 1",
        "the front covers all: nothing of the back is seen",
        "1 / (1 - 1)",
        lambda _: HardView(layered_view(half(1.0, 1.0), 1.2, 0.4), cut=CUT),
    ),
    (
        "coverage 1 and hidden light",
        "all that the blur uncovers is hidden",
        "1 / (1 - 1)",
        lambda _: HardView(layered_view(half(1.0, 0.0), 1.2, 0.4, 1.0), cut=CUT),
    ),
    (
        "coverage 1e-7",
        "a hair thinner than single precision",
        "cancellation in 1 - a",
        lambda _: HardView(layered_view(half(1e-7, 1 - 1e-7), 1.2, 0.4, 1.0), cut=CUT),
    ),
    ("coverage above 1", "fragments that sum to 1 + 1e-6", "negative light behind", _sum_above_one),
    ("a hundred wires", "thin things at a hundred depths", "products of a hundred factors", _wires),
    (
        "hidden nearer than the gap",
        "a hidden surface that lies 1 mm behind the visible one",
        "an edge where there is none",
        lambda _: HardView(layered_view(half(1.0, 0.0), 1.0, 0.999, 1.0)),
    ),
    (
        "hidden coverage 1e-7",
        "next to nothing is known of what is behind",
        "division by what was found",
        lambda _: HardView(layered_view(half(1.0, 0.0), 1.2, 0.4, 1e-7), cut=CUT),
    ),
    (
        "half covered everywhere",
        "an edge in every pixel",
        "no pixel is far from an edge",
        lambda _: HardView(layered_view(half(0.5, 0.5), 1.2, 0.4, 0.5), cut=CUT),
    ),
)
