"""Metrics against closed forms and scikit-learn, and what they refuse."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn import metrics as sk

from exposight.errors import InputError, ObservationError
from exposight.statistics import (
    coverage,
    mae,
    mse,
    r2,
    rmse,
    score,
)

# Sums of a hundred numbers in another order.
ROUNDING = 1e-12

seeds = st.integers(0, 10_000)


def pair(seed):
    rng = np.random.default_rng(seed)
    observed = rng.normal(size=100)
    return observed, observed + 0.3 * rng.normal(size=100)


def test_closed_forms():
    observed, predicted = [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 6.0]
    assert mse(observed, predicted) == 1.0
    assert rmse(observed, predicted) == 1.0
    assert mae(observed, predicted) == 0.5
    assert r2(observed, predicted) == pytest.approx(1 - 4 / 5)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_the_same_as_scikit_learn(seed):
    observed, predicted = pair(seed)
    assert r2(observed, predicted) == pytest.approx(sk.r2_score(observed, predicted), rel=ROUNDING)
    assert mse(observed, predicted) == pytest.approx(
        sk.mean_squared_error(observed, predicted), rel=ROUNDING
    )
    assert mae(observed, predicted) == pytest.approx(
        sk.mean_absolute_error(observed, predicted), rel=ROUNDING
    )


def test_the_mean_itself_scores_zero():
    observed = np.array([1.0, 2.0, 6.0])
    assert r2(observed, np.full(3, 3.0)) == 0.0


def test_coverage_counts_within_k_standard_deviations():
    assert coverage([0.0, 1.0, 2.0, 3.0], np.zeros(4), np.ones(4), 2.0) == 0.75


def test_a_calibrated_prediction_covers_as_the_normal_distribution():
    rng = np.random.default_rng(0)
    std = rng.uniform(0.5, 2.0, 20_000)
    observed = std * rng.normal(size=20_000)
    # three standard errors of a share over 20 000
    assert coverage(observed, np.zeros(20_000), std, 2.0) == pytest.approx(0.9545, abs=0.005)


def test_the_score_gathers_the_metrics():
    observed, predicted = pair(3)
    std = np.full(100, 0.3)
    result = score(observed, predicted, std)
    assert result.n == 100
    assert result.r2_percent == 100 * r2(observed, predicted)
    assert result.mse == mse(observed, predicted)
    assert result.rmse == rmse(observed, predicted)
    assert result.mae == mae(observed, predicted)
    assert result.coverage_1sigma == coverage(observed, predicted, std, 1.0)
    assert result.coverage_2sigma == coverage(observed, predicted, std, 2.0)


def test_a_band_of_its_own_is_what_two_deviations_would_cover():
    result = score([1.0, 2.0, 3.0], [1.0, 1.0, 1.0], [1.0] * 3, band=([0.5] * 3, [1.0, 1.9, 3.0]))
    assert result.coverage_2sigma == pytest.approx(2 / 3)


def test_a_score_without_deviations_has_no_coverage():
    result = score([1.0, 2.0], [1.0, 2.0])
    assert result.coverage_1sigma is None
    assert result.coverage_2sigma is None


def test_r2_of_constant_observations_is_undefined():
    with pytest.raises(ObservationError, match="R² is undefined: all 3 observations are 2"):
        r2([2.0, 2.0, 2.0], [1.0, 2.0, 3.0])


def test_a_score_of_constant_observations_keeps_the_errors():
    result = score([2.0, 2.0], [1.0, 2.0])
    assert math.isnan(result.r2_percent)
    assert result.mse == 0.5


@pytest.mark.parametrize("metric", [r2, mse, rmse, mae, score])
@pytest.mark.parametrize(
    ("observed", "predicted", "message"),
    [
        ([], [], r"observed must be a vector of at least one number, got shape \(0,\)"),
        ([[1.0, 2.0]], [1.0, 2.0], r"observed must be a vector .* got shape \(1, 2\)"),
        ([1.0, np.nan], [1.0, 2.0], "observed must be finite, got nan in row 1"),
        ([1.0, 2.0], [np.inf, 2.0], "must be finite, got inf in row 0"),
        ([1.0, 2.0], [1.0], "must match the 2 observations, got 1"),
        (["a", "b"], [1.0, 2.0], "observed must be an array of numbers"),
    ],
)
def test_malformed_input_is_refused(metric, observed, predicted, message):
    with pytest.raises(ObservationError, match=message):
        metric(observed, predicted)


def test_a_negative_deviation_is_refused():
    with pytest.raises(ObservationError, match="std must not be negative, got -1 in row 1"):
        coverage([1.0, 2.0], [1.0, 2.0], [1.0, -1.0], 2.0)


def test_coverage_wants_a_positive_multiple():
    with pytest.raises(InputError, match="k must be positive, got 0"):
        coverage([1.0], [1.0], [1.0], 0)
