"""Point spread functions over depth and wavelength."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce
from pathlib import Path

import torch
from torch import Tensor

from ..core.threads import in_threads, threads_allowed
from ..errors import InputError
from . import cache as bank_cache
from .band_limited import band_limited_nodes, band_limited_weights, fewest_nodes
from .camera import Camera, defocus, defocus_per_dioptre
from .contrast import CONTRAST_DB, contrast_transfer, transfers_apart
from .fabrication import unscattered_fraction
from .lenses.base import AXIS
from .masks import PhaseMask
from .masks.height_map import HeightMapMask
from .precision import own_precision
from .propagation import Wave, energies, propagate
from .psf_field import PsfField
from .pupil import Aperture, aperture, chirp, pupil_function
from .sampling import plan_sampling, sampled_alike
from .sensor import response
from .transform import SensorWindow, make_bases

INTERPOLATION_ERROR = 3e-5
"""Error of PSFs that are interpolated between depths, in the root mean square of their values over depths:
that of float32 is not much smaller."""
HELD_BYTES = 256 << 20
"""Of PSFs of single bands, at a time, where channels are all that is asked for."""
LARGEST_BYTES = 8 << 30
"""Largest bank that is computed; beyond it the work is refused before it is begun."""
STILL_DB = 60.0
"""PSFs of a place in the field that make photos differ by less from those of the axis are taken for these,
where depths farther out of focus are concerned: these differ by less still."""


@own_precision
def psf_bank(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    *,
    window_px: int | None = None,
    seed: int | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    cache: Path | None = None,
) -> PsfField:
    """PSFs of a camera for wavelengths [band] in metres and inverse depths [depth] in 1/m.

    Akpinar et al., Eqs. `PSF`, `Q` and `defocus`, with what the lens adds to its parabola, on an oversampled
    grid of the sensor that is summed over each pixel. Differentiable by the camera's mask.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    window_px: width of the window in place of the recipe's.
    seed: of the fabrication error in place of the recipe's.
    cache: a folder for banks that outlive the process; those that carry no gradients are kept in memory in
        any case.
    camera: its lens, mask, sensor and place in the field.
    dtype: float32 or float64, of the PSFs.
    device: that computes and holds them.

    Many depths in float32 are interpolated between as many as a band-limited function of Psi needs
    (`nodes_for`), to within `INTERPOLATION_ERROR` of the PSF; float64 is computed depth by depth. The work
    takes the bank itself, a fixed memory (`propagation.BLOCK_BYTES`) and a few waves.

    Raises InputError for empty or invalid wavelengths and depths, wavelengths outside the glass data, a pupil
    sampling that cannot be met, and a bank too large to begin.
    """
    wavelengths, inverse_depths = axes_of(camera, wavelengths, inverse_depths)
    pixels = camera.recipe.psf.window_px if window_px is None else window_px
    if dtype not in (torch.float32, torch.float64):
        raise InputError(f"PSFs are computed in float32 or float64, not {dtype}")
    shape = (len(inverse_depths), len(wavelengths), pixels, pixels)
    _check_size(shape, dtype)
    trainable = carries_gradients(camera)
    if camera.lens.varies and not trainable:
        bank = partial(psf_bank, seed=seed, dtype=dtype, device=device, cache=cache)
        shared = _from_others(bank, camera, wavelengths, inverse_depths, pixels)
        if shared is not None:
            return PsfField(shared, inverse_depths, wavelengths)
    key = None
    if not trainable:
        key = bank_cache.key(camera, wavelengths, inverse_depths, pixels, seed, dtype)
        known = bank_cache.find(key, cache)
        if known is not None:
            return PsfField(known.to(device), inverse_depths, wavelengths)
    if camera.lens.measured:
        if camera.mask_given:
            raise InputError("measured PSFs hold what stood in the pupil: no mask can be added")
        found = camera.lens.psfs(camera.field, wavelengths, inverse_depths, camera.pixel, pixels).to(dtype)
        assert key is not None  # nothing is learned of it
        bank_cache.keep(key, found, cache)
        return PsfField(found.to(device), inverse_depths, wavelengths)
    opening = aperture(camera, plan_sampling(camera, wavelengths, inverse_depths, pixels), seed)
    where = torch.device(device)

    if trainable:
        waves = [
            wave_at(camera, opening, wavelength, inverse_depths, pixels, dtype, where)
            for wavelength in wavelengths.tolist()
        ]
        values = propagate(waves)[..., :pixels, :pixels]
    else:
        values = torch.empty(shape, dtype=dtype, device=where)
        nodes = [nodes_for(camera, wavelength, inverse_depths, dtype) for wavelength in wavelengths.tolist()]
        pieces = _pieces(list(map(len, nodes)))
        # of bands in several pieces, PSFs at nodes: these are the same for any number of threads
        held = {
            band: values.new_empty(len(nodes[band]), pixels, pixels)
            for band, part in pieces
            if part.start > 0 and nodes[band] is not inverse_depths
        }

        def between(band: int, energy: Tensor) -> None:
            per_dioptre = defocus_per_dioptre(camera, float(wavelengths[band]))
            weights = band_limited_weights(inverse_depths, nodes[band], per_dioptre)
            values[:, band] = torch.tensordot(weights.to(energy), energy, 1)

        def fill(piece: tuple[int, slice]) -> None:
            band, part = piece
            wave = wave_at(camera, opening, float(wavelengths[band]), nodes[band][part], pixels, dtype, where)
            energy = energies(wave)[:, :pixels, :pixels]
            if nodes[band] is inverse_depths:
                values[part, band] = energy
            elif band in held:
                held[band][part] = energy
            else:
                between(band, energy)

        in_threads(fill, pieces, where)
        in_threads(lambda band: between(band, held[band]), list(held), where)
    if key is not None:
        bank_cache.keep(key, values.cpu(), cache)
    return PsfField(values, inverse_depths, wavelengths)


def _from_others(
    bank: Callable[..., PsfField], camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, pixels: int
) -> Tensor | None:
    """PSFs of a place in the field [depth, band, y, x] from banks of others; None where it is one by itself.

    Of a lens that is the same all round, one place stands for all that are as far from the axis, mirrored.
    Depths that the same sampling of the pupil does for have a bank of their own; of those so far out of focus
    that the place hardly matters (`STILL_DB`), it is that of the axis.
    """
    (right, up), odd = camera.field, pixels | 1
    first = max(abs(right), abs(up)), min(abs(right), abs(up))
    if _same_all_round(camera) and (camera.field != first or pixels != odd):
        one = bank(replace(camera, field=first), wavelengths, inverse_depths, window_px=odd).values
        if abs(up) > abs(right):  # rows go down
            one = one.transpose(-1, -2).flip(-1, -2)
        mirrored = [axis for axis, place in ((-1, right), (-2, up)) if place < 0]
        return one.flip(mirrored)[..., :pixels, :pixels].contiguous()
    alike = sampled_alike(camera, wavelengths, inverse_depths, pixels)
    if len(alike) == 1 or camera.recipe.psf.pupil_sampling_um != "auto":
        return None
    banks: list[Tensor] = []
    order: list[Tensor] = []
    still = False
    for some, _ in reversed(alike):  # from focus on
        depths, axial = inverse_depths[some], camera.at_field(AXIS)
        found = bank(axial if still else camera, wavelengths, depths, window_px=pixels).values
        if camera.field != AXIS and not still:
            last = int(defocus(camera, wavelengths[0], depths).abs().argmax())
            there, central = (
                contrast_transfer(each[last])
                for each in (found, bank(axial, wavelengths, depths, window_px=pixels).values)
            )
            still = transfers_apart(there, central) < 10 ** ((CONTRAST_DB - STILL_DB) / 20)
        banks.append(found)
        order.append(some)
    return torch.cat(banks)[torch.cat(order).argsort().to(banks[0].device)]


def _same_all_round(camera: Camera) -> bool:
    return camera.lens.round and not camera.has_mask and camera.recipe.fabrication is None


def mean_psfs(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    height_noise: float,
    *,
    window_px: int | None = None,
    device: torch.device | str = "cpu",
) -> Tensor:
    """PSFs of a height map whose samples err, in the mean over such masks: float32 [depth, band, y, x].

    camera, wavelengths, inverse_depths, window_px, device: as of `psf_bank`, [band] and [depth].
    height_noise: standard deviation in metres, of a `height-map` mask; with 0 they are those of `psf_bank`.

    What the errors leave in order is the designed PSF (`unscattered_fraction`); the light that they scatter
    spreads evenly over the period of the sampled mask. Raises as `psf_bank`.
    """
    psf = psf_bank(camera, wavelengths, inverse_depths, window_px=window_px, device=device).values
    if height_noise == 0:
        return psf
    unscattered = unscattered_fraction(wavelengths, height_noise, camera.mask_material)
    mask = camera.mask
    assert isinstance(mask, HeightMapMask)
    pitch = mask.pitch_um * 1e-6
    period = wavelengths * camera.sensor_distance / pitch / camera.pixel
    glare = (1 - unscattered) / period.square()
    return psf * unscattered.to(psf)[:, None, None] + glare.to(psf)[:, None, None]


def channel_psfs(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    weights: Tensor | None = None,
    height_noise: float = 0.0,
    window_px: int | None = None,
    device: torch.device | str = "cpu",
) -> Tensor:
    """PSFs as the sensor's channels see a white point: float32 [depth, channel, y, x].

    Of many depths or wide windows only some bands are held at a time.

    camera, wavelengths, inverse_depths, device: as of `psf_bank`, [band] and [depth].
    weights: of the bands in the channels, [channel, band]; None for the camera's response.
    height_noise: of the mask, as in `mean_psfs`.
    window_px: side of the PSFs; None for the recipe's.

    Raises InputError as `psf_bank`.
    """
    wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64).cpu()
    weights = response(camera, wavelengths) if weights is None else weights
    size = 4 * len(inverse_depths) * (window_px or camera.recipe.psf.window_px) ** 2
    found = []
    for some in torch.arange(weights.shape[1]).split(max(1, HELD_BYTES // size)):
        how = {"window_px": window_px, "device": device}
        psf = mean_psfs(camera, wavelengths[some], inverse_depths, height_noise, **how)
        found.append(torch.einsum("cb,dbyx->dcyx", weights[:, some].to(psf), psf))
    return reduce(torch.add, found)


def wave_at(
    camera: Camera,
    opening: Aperture,
    wavelength: float,
    inverse_depths: Tensor,
    pixels: int,
    dtype: torch.dtype,
    device: torch.device,
    pixel: float | None = None,
    oversampling: int | None = None,
) -> Wave:
    """The wave from inverse depths in the aperture, on its way to a window.

    inverse_depths: [depth], 1/m.
    camera, opening: whose pupil the wave comes from, and what of it is open.
    wavelength: metres.
    pixels: along a side of the window.
    dtype, device: of the wave.
    pixel, oversampling: its side, metres, and samples along it; None for the camera's.
    """
    window = SensorWindow(pixels, pixel or camera.pixel, oversampling or camera.oversampling(wavelength))
    reach = wavelength * camera.sensor_distance
    wave = Wave(
        pupil_function(camera, opening, wavelength, dtype=dtype, device=device),
        chirp(opening.grid, defocus(camera, wavelength, inverse_depths), dtype=dtype, device=device),
        make_bases(opening.grid, window, reach, opening.light, dtype, device),
    )
    bend = opening.bend
    if bend is None:
        return wave
    steps, phases = inverse_depths - bend.focus, bend.paths * (2 * math.pi / wavelength)
    return replace(wave, steps=steps.to(wave.bases.fourier), bend=phases.to(wave.bases.fourier))


def nodes_for(camera: Camera, wavelength: float, inverse_depths: Tensor, dtype: torch.dtype) -> Tensor:
    """The inverse depths that PSFs at `inverse_depths` are computed at: fewer, or just these.

    inverse_depths: [depth], 1/m.
    camera, wavelength, dtype: as of `wave_at`.
    """
    if dtype == torch.float64:
        return inverse_depths
    low, high = (float(end) for end in inverse_depths.aminmax())
    per_dioptre = defocus_per_dioptre(camera, wavelength)
    if len(inverse_depths) <= fewest_nodes(low, high, per_dioptre):
        return inverse_depths
    nodes = band_limited_nodes(low, high, per_dioptre, INTERPOLATION_ERROR)
    return nodes if len(nodes) < len(inverse_depths) else inverse_depths


def carries_gradients(camera: Camera) -> bool:
    """Whether gradients must reach the camera's mask: its PSFs are not to be kept then."""
    maps = (camera.height_map, camera.amplitude)
    return torch.is_grad_enabled() and any(one is not None and one.requires_grad for one in maps)


def _pieces(depths: Sequence[int]) -> list[tuple[int, slice]]:
    """Bands, and where they are fewer than the threads, parts of the depths that PSFs of each are computed
    at: enough pieces to share out."""
    parts = math.ceil(threads_allowed() / len(depths))
    return [
        (band, slice(start, min(start + math.ceil(count / parts), count)))
        for band, count in enumerate(depths)
        for start in range(0, count, math.ceil(count / parts))
    ]


def axes_of(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
) -> tuple[Tensor, Tensor]:
    """Wavelengths and inverse depths as float64 [n]; refuses what cannot be one, or has no glass data.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    camera: whose glasses have data.

    Raises InputError for values that are no axes of PSFs.
    """
    wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64, device="cpu").flatten().detach()
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64, device="cpu").flatten().detach()
    problems = []
    if wavelengths.numel() == 0 or inverse_depths.numel() == 0:
        problems.append("PSFs need at least one wavelength and one depth")
    if not bool(torch.isfinite(inverse_depths).all()) or bool((inverse_depths < 0).any()):
        problems.append(
            "inverse depths must be finite and not negative (0 is infinity); nothing lies behind the lens"
        )
    has_height = camera.height_map is not None or isinstance(camera.mask, PhaseMask)
    for material in (*camera.lens.glasses(), *((camera.mask_material,) if has_height else ())):
        try:
            material.index(wavelengths)
        except InputError as error:
            problems.extend(error.problems)
    if problems:
        raise InputError(problems)
    return wavelengths, inverse_depths


def _check_size(shape: tuple[int, ...], dtype: torch.dtype) -> None:
    size = math.prod(shape) * dtype.itemsize
    if size > LARGEST_BYTES:
        raise InputError(
            f"a bank of {shape[0]} depths x {shape[1]} bands x {shape[2]} x {shape[3]} pixels would take"
            f" {size / 2**30:.3g} GiB, more than {LARGEST_BYTES / 2**30:.3g}; ask for fewer depths or bands"
            " at a time, or a smaller window"
        )
