"""How finely the pupil has to be sampled, by the paper's bound and by the replicas that sampling makes."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from ..core.words import metres
from ..errors import InputError
from .camera import Camera, defocus
from .grid import PupilGrid
from .height import given_pitch, natural_samples
from .masks import PhaseMask, asked
from .masks.height_map import HeightMapMask

FEWEST_SAMPLES = 128
"""Samples across the pupil below which its round edge is too coarse, whatever the phase."""
LARGEST_PUPIL = 8192
"""Samples across the pupil beyond which a PSF is refused rather than begun (a wave is then 1 GiB)."""
FIELD_SAMPLES = 65
"""Places along each axis of the pupil at which phases of the field are looked at."""
OWN_GRID = 1.6
"""Ratio of pitches of the pupil from which on depths have a grid of their own."""
SCATTERED_ORDERS = 2
"""Diffraction orders of a height map's pitch out to which its cells scatter light that counts: interpolated
between its samples, a map is smooth but for what lies within them."""


def sampling_bound(camera: Camera, largest_defocus: float) -> float:
    """Coarsest pitch of the pupil [m] for defocus up to |Psi|: r pi / (8 Psi), Akpinar et al., Eq.
    `MinSampling`.
    """
    return math.inf if largest_defocus == 0 else camera.aperture_radius * math.pi / (8 * abs(largest_defocus))


def plan_sampling(
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    window_px: int,
) -> PupilGrid:
    """Choose the grid of the pupil for all wavelengths [m] and inverse depths [1/m] asked for.

    A fixed `psf.pupil_sampling_um` is taken as it is, if it meets the paper's bound and its replicas stay out
    of the window; "auto" takes what meets both, resolves the surface as it is designed or made, keeps the
    steepest phase (lens, defocus and mask together) below half of the sampling's Nyquist slope, and the light
    that the cells of a height map scatter out of the window.

    camera, wavelengths, inverse_depths, window_px: as of `psf_bank`, [band] and [depth]. Where `by_phase` is
        set, the paper's bound is left out: it is twice as fine as the steepest phase asks for.

    Raises InputError, with both numbers, for a fixed sampling that is too coarse, and for work too large to
    begin.
    """
    psi = defocus(camera, wavelengths[None, :], inverse_depths[:, None])
    largest = float(psi.flatten()[psi.abs().argmax()])
    bound = sampling_bound(camera, largest)
    window = window_px * camera.pixel
    fixed = camera.recipe.psf.pupil_sampling_um
    if camera.lens.measured:
        samples, pitch = FEWEST_SAMPLES, 2 * camera.aperture_radius / FEWEST_SAMPLES
    elif fixed == "auto":
        samples, pitch = _automatic(camera, wavelengths, psi, window, math.inf if camera.by_phase else bound)
    else:
        pitch = fixed * 1e-6
        _check_fixed(camera, wavelengths, inverse_depths, psi, pitch, window)
        samples = natural_samples(camera, pitch)
    if samples > LARGEST_PUPIL:
        _check_near(camera, wavelengths, inverse_depths)
        raise InputError(
            f"PSFs at Psi = {largest:.4g} need {samples:.6g} samples across the pupil"
            f" ({pitch * 1e6:.3g} um), more than {LARGEST_PUPIL}; {_what_helps(camera, wavelengths, psi)}"
        )
    return PupilGrid(samples, pitch, camera.aperture_radius)


def _check_near(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> None:
    """Raises InputError where the cause of a pupil that is too fine is a depth within the focal length."""
    nearest = 1 / float(inverse_depths.max()) if float(inverse_depths.max()) > 0 else math.inf
    focal = float(camera.lens.focal_length(float(wavelengths.double().mean())))
    if nearest < focal:
        raise InputError(
            f"the nearest depth is {nearest:.3g} m, within the focal length of the lens ({focal:.3g} m), "
            "where "
            "nothing can be photographed; is it in another unit? A depth map has its unit in [source.depth]: "
            'unit = 0.001 for millimetres, holds = "relative_inverse_depth" for what a network estimates'
        )


def _what_helps(camera: Camera, wavelengths: Tensor, psi: Tensor) -> str:
    """Against a pupil that is too fine: is it steep for the lens's own aberration, or for defocus?"""
    plain = replace(camera, lens=camera.lens.without_spherical_aberration())
    with_lens, without = (float(_steepest(each, wavelengths, psi, False).max()) for each in (camera, plain))
    if with_lens < 2 * without:
        return "leave out the extreme depths or narrow the window"
    waves = camera.lens.waves_at_most(float(wavelengths.min()))
    return (
        f"the cause is the spherical aberration of the lens ({waves:.3g} waves within its aperture). What"
        ' helps is a smaller aperture, or another kind of lens: "achromat", or "ideal", which has none'
    )


def coarsest_pitch(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, window_px: int) -> float:
    """The coarsest fixed pitch [m] that `plan_sampling` takes, with replicas out of the window.

    camera, wavelengths, inverse_depths, window_px: as of `psf_bank`, [band] and [depth].
    """
    ends = torch.stack([inverse_depths.min(), inverse_depths.max()])
    return min(coarsest_pitches(camera, wavelengths, ends, window_px))


def coarsest_pitches(
    camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, window_px: int
) -> list[float]:
    """The same of each inverse depth [depth] by itself.

    camera, wavelengths, inverse_depths, window_px: as of `psf_bank`, [band] and [depth].
    """
    shortest = float(wavelengths.double().min())
    alone = shortest * camera.sensor_distance / (window_px * camera.pixel)
    psi = defocus(camera, wavelengths.double()[None, :], inverse_depths.double()[:, None])
    if camera.by_phase:
        slopes = _steepest(camera, wavelengths, psi, with_mask=given_pitch(camera) is None).amax(1)
        return [0.999 * min(math.pi / (2 * slope), alone) for slope in slopes.tolist()]
    return [0.999 * min(sampling_bound(camera, most), alone) for most in psi.abs().amax(1).tolist()]


def sampled_alike(
    camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, window_px: int
) -> list[tuple[Tensor, float]]:
    """Depths, by number, that one pitch of the pupil does for, and the coarsest that does [m], between the
    wavelengths [band] too: those farthest out of focus need the finest, by which the PSFs of all would take
    long. Those that do with a pitch `OWN_GRID` times as coarse have one of their own, and so on. None is
    coarser than both the finest and a height map's own, whose samples scatter light into the window.

    camera, wavelengths, inverse_depths, window_px: as of `psf_bank`, [band] and [depth].
    """
    if camera.lens.measured:
        return [(torch.arange(len(inverse_depths)), 2 * camera.aperture_radius / FEWEST_SAMPLES)]
    low, high = (float(end) for end in wavelengths.double().aminmax())
    between = torch.linspace(low, high, 32, dtype=torch.float64)
    enough = torch.tensor(coarsest_pitches(camera, between, inverse_depths, window_px))
    designed = _designed_pitch(camera)
    if designed is not None:
        enough = enough.clamp_max(max(designed, float(enough.min())))
    groups = []
    while bool((enough < math.inf).any()):
        finest = enough.min()
        some = torch.nonzero(enough < OWN_GRID * finest).flatten()
        groups.append((some, float(finest)))
        enough[some] = math.inf
    return groups


def _automatic(
    camera: Camera, wavelengths: Tensor, psi: Tensor, window: float, bound: float
) -> tuple[int, float]:
    map_pitch = given_pitch(camera)
    slopes = _steepest(camera, wavelengths, psi, with_mask=map_pitch is None)
    reach = float(wavelengths.min()) * camera.sensor_distance
    needed = min(bound, math.pi / (2 * float(slopes.max())), reach / window)
    fabrication = camera.recipe.fabrication
    if fabrication is not None and fabrication.pitch_um is not None:
        made = fabrication.pitch_um * 1e-6
        _check_made(camera, made)
        pitch = made / math.ceil(made / needed - 1e-9)
        return natural_samples(camera, pitch), pitch
    designed = _designed_pitch(camera)
    if designed is not None:
        needed = min(needed, reach / (SCATTERED_ORDERS * reach / designed + window / 2))
    across = max(FEWEST_SAMPLES, 2 * math.ceil(camera.aperture_radius / needed - 1e-9))
    return across + 2, 2 * camera.aperture_radius / across  # the samples of an edge reach a cell beyond it


def _designed_pitch(camera: Camera) -> float | None:
    """Distance [m] of the samples of a height map or an amplitude, None where there is none."""
    mask = camera.recipe.mask
    height = given_pitch(camera) or (mask.pitch_um * 1e-6 if isinstance(mask, HeightMapMask) else None)
    if camera.amplitude is None:
        return height
    own = 2 * camera.aperture_radius / len(camera.amplitude)
    return own if height is None else min(own, height)


def _check_made(camera: Camera, pitch: float) -> None:
    diameter = 2 * camera.aperture_radius
    if not diameter / LARGEST_PUPIL <= pitch <= diameter:
        raise InputError(
            f"fabrication.pitch_um = {pitch * 1e6:.4g} does not suit a pupil of {diameter * 1e3:.4g} mm: "
            f"choose from {diameter * 1e6 / LARGEST_PUPIL:.3g} ({LARGEST_PUPIL} samples across it) to "
            f"{diameter * 1e6:.4g} um"
        )


def _steepest(camera: Camera, wavelengths: Tensor, psi: Tensor, with_mask: bool) -> Tensor:
    """Steepest phase within the pupil of each wave [rad/m], [depth, band]: mask, lens remainder and
    defocus."""
    radius = camera.aperture_radius
    radii = torch.linspace(0, radius, 65, dtype=torch.float64)
    lens = torch.stack([camera.lens.slope(radii, float(wavelength)) for wavelength in wavelengths])
    bowl = (2 * psi[:, :, None] * radii / radius**2 + lens).abs().amax(2)
    mask = camera.mask
    design = mask.design_wavelength_nm * 1e-9 if isinstance(mask, PhaseMask) else 0.0
    steepest = asked(mask, "slope", mask.slope) / radius if with_mask else 0.0
    off_axis = _field_slope(camera, wavelengths) if camera.lens.varies else 0.0
    return (bowl + off_axis + steepest * design / wavelengths).clamp_min(math.pi / (2 * radius))


def _field_slope(camera: Camera, wavelengths: Tensor) -> Tensor:
    """Steepest phase that the lens adds for the camera's place in the field [rad/m], [band]."""
    axis = torch.linspace(-camera.aperture_radius, camera.aperture_radius, FIELD_SAMPLES, dtype=torch.float64)
    right, up = axis[None, :], axis.flip(0)[:, None]
    lit = (camera.lens.field_open(right, up, camera.field) > 0) & (right.hypot(up) <= camera.aperture_radius)
    steepest = []
    for wavelength in wavelengths.tolist():
        phase = camera.lens.field_phase(right, up, wavelength, camera.field)
        down, across = torch.gradient(phase, spacing=float(axis[1] - axis[0]))
        steepest.append(torch.where(lit, down.hypot(across), 0.0).max())
    return torch.stack(steepest)


def _check_fixed(
    camera: Camera, wavelengths: Tensor, inverse_depths: Tensor, psi: Tensor, pitch: float, window: float
) -> None:
    depth, band = divmod(int(psi.abs().argmax()), psi.shape[1])
    worst = float(psi[depth, band])
    bound = sampling_bound(camera, worst)
    problems = []
    if pitch > bound * (1 + 1e-9) and not camera.by_phase:
        problems.append(
            f"psf.pupil_sampling_um = {pitch * 1e6:g} is too coarse: at {float(wavelengths[band]) * 1e9:g} nm"
            f" and {metres(float(inverse_depths[depth]))} Psi is {worst:.4g}, which needs"
            f' {bound * 1e6:.3g} um or finer; use that or "auto"'
        )
    shortest = float(wavelengths.min())
    period = shortest * camera.sensor_distance / pitch
    if period < window:
        problems.append(
            f"psf.pupil_sampling_um = {pitch * 1e6:g} repeats the PSF every {period * 1e6:.4g} um at"
            f" {shortest * 1e9:g} nm, inside the window of {window * 1e6:.4g} um; use"
            f' {shortest * camera.sensor_distance / window * 1e6:.3g} um or finer, or "auto"'
        )
    if problems:
        raise InputError(problems)
