"""Numbers as a reader sees them: units, signs, and no number where there is none."""

from __future__ import annotations

import math

import pytest

from edofsim.report.words import decibels, depth_range, distance, duration, number, percent, significant


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (31.24, "31.2"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "∞"),
        (-math.inf, "−∞"),
        (-0.01, "0.0"),
        (-3.06, "−3.1"),
    ],
)
def test_number(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0031234, "0.00312"),
        (12.345, "12.3"),
        (45600.0, "45600"),
        (1.23e-9, "1.23e−9"),
        (0, "0"),
        (math.nan, "–"),
    ],
)
def test_three_significant_digits(value, text):
    assert significant(value).replace("e−09", "e−9") == text


def test_decibels_of_equal_images_are_infinite():
    assert decibels(math.inf) == "∞\u00a0dB"
    assert decibels(math.nan) == "–"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.085, "85 ms"),
        (1.42, "1.4 s"),
        (24.3, "24 s"),
        (99.7, "1 min 39 s"),
        (185.0, "3 min 05 s"),
        (7800, "2 h 10 min"),
    ],
)
def test_duration(seconds, text):
    assert duration(seconds).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("near", "far", "text"),
    [
        (0.6, 0.85, "0.60 to 0.85 m"),
        (0.0, 0.6, "up to 0.60 m"),
        (3.0, math.inf, "beyond 3.0 m"),
        (0.0, math.inf, "all depths"),
        (1.3, 1.3, "1.30 m"),
        (math.inf, math.inf, "beyond ∞"),
    ],
)
def test_depth_range(near, far, text):
    assert depth_range(near, far).replace("\u00a0", " ") == text


def test_infinity_has_no_unit():
    assert distance(math.inf) == "∞"


def test_parts_that_would_round_to_nothing_are_not_shown_as_nothing():
    assert percent(0.0).replace("\u00a0", " ") == "0 %"
    assert percent(5e-6).replace("\u00a0", " ") == "< 0.1 %"
    assert percent(0.57).replace("\u00a0", " ") == "57 %"
