"""Sample points: Owen-scrambled Sobol pairs from a hash, for any pixel and sample without state.

Every number that a path uses follows from (seed, pixel, pass, sample, dimension) alone. So a view does not
depend on how its samples were split over launches, threads or machines, and work that was interrupted
continues exactly. Samples of one pass are stratified against each other; passes are independent, which is
what makes the error estimate honest.

Source: B. Burley, Practical hash-based Owen scrambling, JCGT 9(4), 2020, with N. Vegdahl's improved hash
for the Laine-Karras permutation (2021); pairs of dimensions are padded by shuffling the sample's index.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr

if TYPE_CHECKING:
    import mitsuba as mi

MIX = 0x9E3779B9


def hashed(value: mi.UInt32) -> mi.UInt32:
    """A well mixed UInt32 of a UInt32 (C. Wellons' lowbias32)."""
    value = value ^ (value >> 16)
    value = value * 0x7FEB352D
    value = value ^ (value >> 15)
    value = value * 0x846CA68B
    return value ^ (value >> 16)


def combined(seed: mi.UInt32, value: mi.UInt32) -> mi.UInt32:
    """A new UInt32 seed from a seed and something that tells this use of it from others."""
    return hashed((seed ^ hashed(value)) + MIX)


def permuted(reversed_bits: mi.UInt32, seed: mi.UInt32) -> mi.UInt32:
    """Laine-Karras: an Owen scramble of a number whose bits are given in reverse order."""
    x = reversed_bits
    x = x ^ (x * 0x3D20ADEA)
    x = x + seed
    x = x * ((seed >> 16) | 1)
    x = x ^ (x * 0x05526C56)
    return x ^ (x * 0x53A22864)


def second_dimension(index: mi.UInt32) -> mi.UInt32:
    """Bits of the second Sobol dimension of `index`, in reverse order: Pascal's triangle modulo 2."""
    x = index
    for mask, shift in ((0xAAAAAAAA, 1), (0xCCCCCCCC, 2), (0xF0F0F0F0, 4), (0xFF00FF00, 8), (0xFFFF0000, 16)):
        x = x ^ ((x & mask) >> shift)
    return x


def unit(bits: mi.UInt32, float_type: type[mi.Float]) -> mi.Float:
    """A float in [0, 1) of the upper 24 bits."""
    return float_type(bits >> 8) * (1.0 / (1 << 24))


def pair(index: mi.UInt32, seed: mi.UInt32, float_type: type[mi.Float]) -> tuple[mi.Float, mi.Float]:
    """Two stratified numbers in [0, 1) for sample `index` of the sequence that `seed` (UInt32) names."""
    shuffled = dr.brev(permuted(dr.brev(index), seed))
    first = permuted(shuffled, hashed(seed + 1))
    second = permuted(second_dimension(shuffled), hashed(seed + 2))
    return unit(dr.brev(first), float_type), unit(dr.brev(second), float_type)
