"""Masks at the pupil of a camera recipe.

Coordinates are those of the pupil seen from the sensor towards the scene, normalised by its radius: u to the
right, v up, rho^2 = u^2 + v^2 <= 1. A phase is given in radians at `design_wavelength_nm`; the mask is then a
height of `material` above its substrate, and the phase at every other wavelength follows from that height and
the material's dispersion (Akpinar et al., Eqs. `dtophi` and `phi0tophi`).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Positive, RecipeModel

Finite = Annotated[float, Field(ge=-1e4, le=1e4)]
LEVIN = "levin"


class _PhaseMask(RecipeModel):
    """What all transparent masks share: what they are made of and where their phase is stated."""

    material: str = "S1813"
    design_wavelength_nm: Positive = 543.0


class ClearMask(RecipeModel):
    """No mask: an open circular aperture."""

    kind: Literal["clear"] = "clear"


class AnnularMask(RecipeModel):
    """A central disc of `inner_radius` (fraction of the pupil's radius) is opaque.

    W. T. Welford, "Use of annular apertures to increase focal depth", J. Opt. Soc. Am. 50, 749 (1960).
    """

    kind: Literal["annular"] = "annular"
    inner_radius: Annotated[float, Field(gt=0, lt=1)] = 0.5


class GaussianMask(RecipeModel):
    """Amplitude exp(-rho^2 / waist^2), `waist` as a fraction of the pupil's radius: an apodiser.

    J. Ojeda-Castaneda, P. Andres, A. Diaz, "Annular apodizers for low sensitivity to defocus and to spherical
    aberration", Opt. Lett. 11, 487 (1986), discusses such amplitude masks for depth of field.
    """

    kind: Literal["gaussian"] = "gaussian"
    waist: Annotated[float, Field(gt=0, le=100)] = 0.7


class CodedMask(RecipeModel):
    """A binary amplitude code of equal cells that fill the square around the pupil.

    `pattern` is "levin" or rows of "0" (opaque) and "1" (open), the top row first; rows and columns may
    differ in number. "levin" is a pattern of 13 x 13 cells found by the criterion of A. Levin, R. Fergus,
    F. Durand, W. T. Freeman, "Image and depth from a conventional camera with a coded aperture", ACM Trans.
    Graph. 26, 70 (2007).
    """

    kind: Literal["coded"] = "coded"
    pattern: Literal["levin"] | Annotated[tuple[str, ...], Field(min_length=1, max_length=512)] = LEVIN

    @model_validator(mode="after")
    def _rectangular(self) -> CodedMask:
        if self.pattern == LEVIN:
            return self
        rows = self.pattern
        if not rows[0] or any(len(row) != len(rows[0]) for row in rows):
            raise ValueError("pattern needs rows of equal length, with at least one cell")
        if set("".join(rows)) - {"0", "1"}:
            raise ValueError('pattern rows may hold "0" (opaque) and "1" (open) only')
        if "1" not in "".join(rows):
            raise ValueError("pattern lets no light through: it needs at least one open cell")
        return self


class CubicMask(_PhaseMask):
    """Phase alpha (u^3 + v^3).

    E. R. Dowski, W. T. Cathey, "Extended depth of field through wave-front coding", Appl. Opt. 34, 1859
    (1995). With 3 alpha >= 2 |Psi| everywhere in the depth range the caustic stays inside the pupil.
    """

    kind: Literal["cubic"] = "cubic"
    alpha_rad: Finite = 30.0


class LogarithmicMask(_PhaseMask):
    """Phase sum over w in {u, v} of sign(w) alpha w^2 (ln|w| + beta).

    S. S. Sherif, W. T. Cathey, E. R. Dowski, "Phase plate to extend the depth of field of incoherent hybrid
    imaging systems", Appl. Opt. 43, 2709 (2004).
    """

    kind: Literal["logarithmic"] = "logarithmic"
    alpha_rad: Finite = 30.0
    beta: Finite = 0.2


class SinusoidalMask(_PhaseMask):
    """Phase alpha (u^4 sin(beta u) + v^4 sin(beta v)), an odd function in the family of sinusoidal masks.

    H. Zhao, Y. Li, "Optimized sinusoidal phase mask to extend the depth of field of an incoherent imaging
    system", Opt. Lett. 35, 267 (2010).
    """

    kind: Literal["sinusoidal"] = "sinusoidal"
    alpha_rad: Finite = 30.0
    beta_rad: Finite = 1.5


class TangentMask(_PhaseMask):
    """Phase alpha (u^2 tan(beta u) + v^2 tan(beta v)).

    S. Chen, Z. Fan, Z. Xu, B. Zuo, S. Wang, H. Xiao, "Optimized asymmetrical tangent phase mask to obtain
    defocus invariant modulation transfer function in incoherent imaging systems", Opt. Lett. 39, 2171 (2014).
    |beta| < pi/2 keeps the tangent finite over the pupil.
    """

    kind: Literal["tangent"] = "tangent"
    alpha_rad: Finite = 30.0
    beta_rad: Annotated[float, Field(gt=-1.57, lt=1.57)] = 0.8


class Ring(RecipeModel):
    """A ring of constant phase between two radii (fractions of the pupil's radius)."""

    inner_radius: Annotated[float, Field(ge=0, lt=1)]
    outer_radius: Annotated[float, Field(gt=0, le=1)]
    phase_rad: Finite

    @model_validator(mode="after")
    def _has_width(self) -> Ring:
        if self.outer_radius <= self.inner_radius:
            raise ValueError("outer_radius must be above inner_radius")
        return self


class RingsMask(_PhaseMask):
    """Concentric rings of constant phase; between and around them the phase is 0.

    S. Elmalem, R. Giryes, E. Marom, "Learned phase coded aperture for the benefit of depth of field
    extension", Opt. Express 26, 15316 (2018): one ring or several, learned together with a network.
    """

    kind: Literal["rings"] = "rings"
    rings: Annotated[tuple[Ring, ...], Field(min_length=1, max_length=64)] = (
        Ring(inner_radius=0.55, outer_radius=0.8, phase_rad=6.2),
        Ring(inner_radius=0.8, outer_radius=1.0, phase_rad=12.3),
    )

    @model_validator(mode="after")
    def _apart(self) -> RingsMask:
        ordered = sorted(self.rings, key=lambda ring: ring.inner_radius)
        for inner, outer in zip(ordered, ordered[1:], strict=False):
            if outer.inner_radius < inner.outer_radius:
                raise ValueError(
                    f"rings overlap: one ends at {inner.outer_radius:g}, the next begins at"
                    f" {outer.inner_radius:g}"
                )
        return self


class ZernikeTerm(RecipeModel):
    """One Zernike polynomial in Noll's order, normalised to an RMS of 1 over the pupil."""

    noll: Annotated[int, Field(ge=1, le=1000)]
    rms_rad: Finite


class ZernikeMask(_PhaseMask):
    """Phase as a sum of Zernike polynomials (R. J. Noll, J. Opt. Soc. Am. 66, 207, 1976).

    The basis in which V. Sitzmann et al., "End-to-end optimization of optics and image processing for
    achromatic extended depth of field and super-resolution imaging", ACM Trans. Graph. 37, 114 (2018),
    search.
    """

    kind: Literal["zernike"] = "zernike"
    terms: Annotated[tuple[ZernikeTerm, ...], Field(min_length=1, max_length=1000)] = (
        ZernikeTerm(noll=7, rms_rad=2.0),
        ZernikeTerm(noll=8, rms_rad=2.0),
        ZernikeTerm(noll=11, rms_rad=1.5),
    )


class FourierTerm(RecipeModel):
    """cosine cos(pi (p u + q v)) + sine sin(pi (p u + q v)): p and q are periods across the pupil's
    diameter.
    """

    p: Annotated[int, Field(ge=-200, le=200)]
    q: Annotated[int, Field(ge=-200, le=200)]
    cosine_rad: Finite = 0.0
    sine_rad: Finite = 0.0


class FourierMask(_PhaseMask):
    """Phase as a sum of harmonics over the square around the pupil.

    The second basis of Sitzmann et al., ACM Trans. Graph. 37, 114 (2018).
    """

    kind: Literal["fourier"] = "fourier"
    terms: Annotated[tuple[FourierTerm, ...], Field(min_length=1, max_length=4096)] = (
        FourierTerm(p=1, q=0, sine_rad=8.0),
        FourierTerm(p=0, q=1, sine_rad=8.0),
        FourierTerm(p=2, q=1, cosine_rad=2.0),
    )


class HeightMapMask(_PhaseMask):
    """A free height map [n, n] sampled every `pitch_um`, row 0 the top of the pupil, centred on the axis.

    `file` (.npy or .safetensors, metres) is relative to the recipe; without it the map is flat, the start
    of a training. The pitch of 21 um is that of Akpinar et al. for their depth range. Between its samples the
    surface is bicubic; a step of more than half a wave at `design_wavelength_nm` is a wrap, and stays a step.
    """

    kind: Literal["height-map"] = "height-map"
    file: str | None = None
    pitch_um: Positive = 21.0


AnyMask = Annotated[
    ClearMask
    | AnnularMask
    | GaussianMask
    | CodedMask
    | CubicMask
    | LogarithmicMask
    | SinusoidalMask
    | TangentMask
    | RingsMask
    | ZernikeMask
    | FourierMask
    | HeightMapMask,
    Field(discriminator="kind"),
]
