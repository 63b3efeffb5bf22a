"""Many bands in few: the light of each channel gathered in groups of bands, each blurred once.

A photo's channel c is sum_b w_cb psf_b * light_b. Bands whose PSFs hardly differ may share one: a group's
light is the sum of its bands' weighted light, exactly as colourful as before, and its PSF the mean of theirs,
weighted by the light that the whole view sends. What is lost is only that some surface's light within a group
may lie at other wavelengths than the view's on the whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..render.view import View


@dataclass(frozen=True)
class Gathering:
    """Groups of bands.

    wavelengths: [m] at which PSFs are computed, metres.
    psfs: [group, m] which of them make a group's PSF, rows summing to 1.
    light: [group, band] which bands' light it carries.
    response: [channel, group]. All float64.
    """

    wavelengths: Tensor
    psfs: Tensor
    light: Tensor
    response: Tensor

    @property
    def groups(self) -> int:
        return int(self.light.shape[0])


def every_band(wavelengths: Tensor, response: Tensor) -> Gathering:
    """Each band on its own: wavelengths [band], response [channel, band].

    wavelengths: [band], metres.
    response: [channel, band].
    """
    alone = torch.eye(wavelengths.numel(), dtype=torch.float64)
    return Gathering(wavelengths, alone, alone, response.double())


def gathered(
    wavelengths: Tensor, response: Tensor, spectrum: Tensor, place: Tensor, groups: int, colours: int
) -> Gathering:
    """Each channel's bands in `groups` groups whose PSFs are computed at `colours` wavelengths (0: all).

    wavelengths: [band].
    response: [channel, band].
    spectrum: [band], of the view's light as a whole.
    place: [band], a coordinate along which PSFs change, such as Psi.
    groups: of each channel.
    colours: wavelengths of each group; 0 for all of its bands.

    Within a channel the groups are those that leave the least variance of it. With all of its wavelengths a
    group's PSF is exact for light of the view's own spectrum.
    """
    light: list[Tensor] = []
    channels: list[int] = []
    share: list[float] = []
    where: list[np.ndarray] = []
    weight: list[np.ndarray] = []
    for channel, row in enumerate(response.double()):
        seen = torch.nonzero(row > 0).squeeze(1)
        amount = (row * spectrum.double())[seen]
        amount = amount if float(amount.sum()) > 0 else row[seen]
        for part in _least_variance(place.double()[seen].numpy(), amount.numpy(), groups):
            bands = seen[part]
            total = float(row[bands].sum())
            light.append(torch.zeros_like(row).index_put((bands,), row[bands] / total))
            channels.append(channel)
            share.append(total)
            points, weights = _quadrature(wavelengths.double()[bands].numpy(), amount[part].numpy(), colours)
            where.append(points)
            weight.append(weights)
    unique = np.unique(np.round(np.concatenate(where), 15))
    bands = wavelengths.double().numpy()
    exact = dict(zip(np.round(bands, 15).tolist(), bands.tolist(), strict=True))  # whose PSFs may be known
    psfs = torch.zeros(len(light), len(unique), dtype=torch.float64)
    for group, (points, weights) in enumerate(zip(where, weight, strict=True)):
        psfs[group, np.searchsorted(unique, np.round(points, 15))] = torch.from_numpy(weights)
    back = torch.zeros(response.shape[0], len(light), dtype=torch.float64)
    back[channels, torch.arange(len(light))] = torch.tensor(share, dtype=torch.float64)
    at = torch.tensor([exact.get(each, each) for each in unique.tolist()], dtype=torch.float64)
    return Gathering(at, psfs, torch.stack(light), back)


def _least_variance(place: np.ndarray, amount: np.ndarray, groups: int) -> list[np.ndarray]:
    """Neighbouring bands in at most `groups` groups: least sum of amount (place - the group's mean)^2."""
    count = len(place)
    groups = min(groups, count)
    if groups == 1:
        return [np.arange(count)]
    w, s, q = (np.concatenate([[0], np.cumsum(amount * place**k)]) for k in (0, 1, 2))
    weight = w[None, :] - w[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (q[None, :] - q[:, None]) - (s[None, :] - s[:, None]) ** 2 / weight
    spread = np.where(weight > 0, spread, 0.0)
    spread[np.tril_indices(count + 1)] = np.inf  # [begin, end]: of the bands from begin up to end
    best = np.full((groups + 1, count + 1), np.inf)
    best[0, 0], cut = 0.0, np.zeros((groups + 1, count + 1), int)
    for k in range(1, groups + 1):
        costs = best[k - 1][:, None] + spread
        cut[k], best[k] = costs.argmin(0), costs.min(0)
    parts: list[np.ndarray] = []
    end = count
    for k in range(groups, 0, -1):
        parts.append(np.arange(cut[k, end], end))
        end = cut[k, end]
    return parts[::-1]


def _quadrature(points: np.ndarray, amount: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Few points and weights (sum 1) that integrate polynomials over many: Gauss's rule of that measure,
    by Lanczos's recurrence (Golub and Welsch 1969). count 0: the points themselves."""
    amount = np.where(amount.sum() > 0, amount, 1.0)
    weights = amount / amount.sum()
    if count == 0 or count >= np.count_nonzero(weights):
        return points[weights > 0], weights[weights > 0]
    centre, scale = points.mean(), np.ptp(points) or 1.0
    x = (points - centre) / scale
    basis, before = np.sqrt(weights), np.zeros_like(weights)
    alpha: list[float] = []
    beta: list[float] = []
    for _ in range(count):
        alpha.append(float(basis @ (x * basis)))
        rest = x * basis - alpha[-1] * basis - (beta[-1] if beta else 0.0) * before
        beta.append(float(np.linalg.norm(rest)))
        before, basis = basis, rest / max(beta[-1], 1e-300)
    nodes, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(beta[:-1], 1) + np.diag(beta[:-1], -1))
    return centre + scale * nodes, vectors[0] ** 2


def gathered_view(view: View, gathering: Gathering) -> View:
    """The view with groups in the bands' place; each group's wavelength is the mean of its PSFs'."""
    light = gathering.light.to(view.radiance) @ view.radiance
    return view.with_light(light, gathering.psfs @ gathering.wavelengths)
