"""Scores of distributions and chances, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import lognorm, norm

from exposight.errors import InputError, ObservationError
from exposight.statistics import (
    LEVELS,
    brier,
    crps,
    log_score,
    reliability,
)

NORMAL = norm.ppf(LEVELS)
places = st.floats(-6.0, 6.0)


def normal(mean, std):
    return (mean + std * NORMAL)[:, None]


@given(places, st.floats(0.1, 9.0), st.floats(-5.0, 5.0))
def test_the_crps_of_a_normal_distribution(z, std, mean):
    # Gneiting and Raftery 2007, Eq. 21, with the sign of a loss
    expected = std * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / math.sqrt(math.pi))
    found = crps([mean + std * z], normal(mean, std))
    assert found == pytest.approx(expected, rel=0.005)


def test_the_crps_of_a_point_is_the_absolute_error():
    points = np.tile([1.0, 2.0, 5.0], (len(LEVELS), 1))
    assert crps([1.5, 2.0, 1.0], points) == pytest.approx((0.5 + 0.0 + 4.0) / 3, rel=1e-9)


def test_the_crps_of_an_even_distribution():
    # of U(0, 1): y² − y + 1/3 for y within
    levels = np.linspace(0.001, 0.999, 999)
    quantiles = np.tile(levels[:, None], (1, 3))
    y = np.array([0.1, 0.5, 0.9])
    assert crps(y, quantiles, levels) == pytest.approx(np.mean(y**2 - y + 1 / 3), rel=1e-4)


@given(places, st.floats(0.1, 9.0), st.floats(-5.0, 5.0))
def test_the_log_score_of_a_normal_distribution(z, std, mean):
    expected = -norm.logpdf(mean + std * z, mean, std)
    assert log_score([mean + std * z], normal(mean, std)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("y", [0.3, 1.0, 4.0])
def test_the_log_score_of_a_log_normal_distribution(y):
    quantiles = np.exp(0.5 * NORMAL)[:, None]
    assert log_score([y], quantiles) == pytest.approx(-lognorm.logpdf(y, 0.5), abs=0.04)


def test_a_width_adds_to_the_standard_deviation():
    expected = -norm.logpdf(0.02, 0.0, 0.03)
    assert log_score([0.02], normal(0.0, 0.02), width=0.01) == pytest.approx(expected, abs=1e-9)
    point = np.zeros((len(LEVELS), 1))
    assert log_score([0.0], point, width=0.01) == pytest.approx(-norm.logpdf(0.0, 0.0, 0.01))


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))
def test_scores_are_proper(mean, z):
    # no other normal distribution is expected to score better than the true one
    y = normal(0.0, 1.0)[1:-1:2, 0]
    weight = np.diff(np.array(LEVELS)[::2])
    for score in (crps, log_score):
        true, other = (
            sum(w * score([each], normal(*shape)) for w, each in zip(weight, y, strict=True))
            for shape in ((0.0, 1.0), (mean, math.exp(z)))
        )
        assert true <= other + 0.002


def test_the_brier_score_is_the_mean_square():
    assert brier([True, False], [0.8, 0.4]) == pytest.approx((0.04 + 0.16) / 2)
    assert brier([True, False], [1.0, 0.0]) == 0.0


def test_chances_are_grouped():
    bins = reliability([True, False, True, True], [0.05, 0.01, 0.55, 1.0], bins=10)
    assert [(each.low, each.n, each.came_true) for each in bins] == [
        (0.0, 2, 0.5),
        (0.5, 1, 1.0),
        (0.9, 1, 1.0),
    ]
    assert bins[0].said == pytest.approx(0.03)
    assert sum(each.n for each in bins) == 4


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=50), st.integers(1, 20))
def test_the_groups_hold_every_chance_once(chances, bins):
    grouped = reliability([True] * len(chances), chances, bins=bins)
    assert sum(each.n for each in grouped) == len(chances)
    assert all(each.low <= each.said <= each.high + 1e-12 for each in grouped)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: brier([True], [1.2]), ObservationError, "from 0 to 1"),
        (lambda: brier([True, False], [1.0]), ObservationError, "must match the 2"),
        (lambda: crps([1.0], [[1.0], [0.0]], [0.2, 0.8]), ObservationError, "ascend"),
        (lambda: crps([1.0], [[1.0], [2.0]], [0.8, 0.2]), InputError, "levels must ascend"),
        (lambda: crps([1.0, 2.0], [[1.0], [2.0]], [0.2, 0.8]), ObservationError, r"\(2, 2\)"),
    ],
)
def test_what_makes_no_sense_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()
