"""Exact regression: closed forms, invariances, gates, added observations, and what it refuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import InputError, NotPositiveDefiniteError, ObservationError
from exposight.gp import (
    ChangePoint,
    Exponential,
    GaussianProcess,
    RationalQuadratic,
    SquaredExponential,
    regression,
)
from exposight.gp.tiling import limit_blas
from exposight.statistics import coverage

# Cholesky factorisations of a few dozen rows, well conditioned.
ROUNDING = 1e-10

SMOOTH = SquaredExponential(variance=2.0, length_scales=0.5, dims=(0,))
GATED = (
    RationalQuadratic(variance=1.5, length_scales=(0.4, 0.8), alpha=0.6, dims=(0, 1))
    * ChangePoint(dim=0, minimum=-1.0)
    * ChangePoint(dim=0, maximum=1.0)
)


@pytest.fixture
def observations():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.5, 1.5, size=(40, 2))
    return x, np.sin(3 * x[:, 0]) + 0.3 * x[:, 1] + 0.1 * rng.normal(size=40)


def test_one_observation_in_closed_form():
    process = GaussianProcess.condition(SMOOTH, 0.5, [[0.0]], [3.0])
    prediction = process.predict([[0.5]])
    covariance = 2.0 * np.exp(-0.5)
    assert process.log_marginal_likelihood == pytest.approx(
        -0.5 * (9.0 / 2.5 + np.log(2.5) + np.log(2 * np.pi))
    )
    assert prediction.mean[0] == pytest.approx(covariance / 2.5 * 3.0)
    assert prediction.std[0] ** 2 == pytest.approx(2.0 - covariance**2 / 2.5)


def test_noise_adds_to_the_variance_of_a_new_observation(observations):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    x = observations[0][:5] + 0.1
    function, observed = process.predict(x), process.predict(x, include_noise=True)
    np.testing.assert_allclose(observed.std**2, function.std**2 + 0.04, rtol=ROUNDING)
    np.testing.assert_array_equal(observed.mean, function.mean)


def test_threads_of_linear_algebra_change_nothing():
    x = np.random.default_rng(0).uniform(size=(600, 2))
    stds = []
    for count in (1, 2):
        with limit_blas(count):
            process = GaussianProcess.condition(GATED, 0.01, x, x[:, 0])
            stds.append(process.predict(x).std)
    np.testing.assert_array_equal(*stds)


def test_far_away_the_prior_returns():
    prediction = GaussianProcess.condition(SMOOTH, 0.1, [[0.0]], [3.0]).predict([[1e3]])
    assert prediction.mean[0] == 0.0
    assert prediction.std[0] == pytest.approx(np.sqrt(2.0))


def test_the_order_of_observations_does_not_matter(observations):
    x, y = observations
    order = np.random.default_rng(0).permutation(len(y))
    one = GaussianProcess.condition(GATED, 0.04, x, y)
    other = GaussianProcess.condition(GATED, 0.04, x[order], y[order])
    assert other.log_marginal_likelihood == pytest.approx(one.log_marginal_likelihood, rel=ROUNDING)
    np.testing.assert_allclose(other.predict(x).mean, one.predict(x).mean, atol=ROUNDING)


def test_scaling_the_targets_scales_the_prediction(observations):
    x, y = observations
    scaled = SquaredExponential(variance=9.0 * 2.0, length_scales=0.5, dims=(0,))
    one = GaussianProcess.condition(SMOOTH, 0.04, x, y).predict(x)
    three = GaussianProcess.condition(scaled, 9.0 * 0.04, x, 3.0 * y).predict(x)
    np.testing.assert_allclose(three.mean, 3.0 * one.mean, rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(three.std, 3.0 * one.std, rtol=ROUNDING, atol=ROUNDING)


def test_chunks_change_nothing_and_report_progress(observations, monkeypatch):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    x = np.random.default_rng(5).uniform(-1.5, 1.5, size=(11, 2))
    whole = process.predict(x)
    monkeypatch.setattr(regression, "_CHUNK", 4)
    seen = []
    parts = process.predict(x, progress=lambda *step: seen.append(step))
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=ROUNDING)
    np.testing.assert_allclose(parts.std, whole.std, rtol=ROUNDING)
    assert seen == [("predicting", done, 11) for done in (4, 8, 11)]


def test_no_rows_give_no_predictions(observations):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    assert process.predict(np.empty((0, 2))).mean.shape == (0,)


def test_outside_the_gate_the_prediction_is_exactly_zero_without_variance(observations):
    prediction = GaussianProcess.condition(GATED, 0.04, *observations).predict(
        [[-1.2, 0.0], [1.001, 0.0]]
    )
    np.testing.assert_array_equal(prediction.mean, [0.0, 0.0])
    np.testing.assert_array_equal(prediction.std, [0.0, 0.0])


def test_gated_observations_have_the_likelihood_of_white_noise(observations):
    x, y = observations
    inside = ~GATED.gate(x)
    assert 0 < inside.sum() < len(y)
    covariance = GATED.value(x, x) + 0.04 * np.eye(len(y))
    expected = -0.5 * (
        y @ np.linalg.solve(covariance, y)
        + np.linalg.slogdet(covariance)[1]
        + len(y) * np.log(2 * np.pi)
    )
    process = GaussianProcess.condition(GATED, 0.04, x, y)
    assert process.log_marginal_likelihood == pytest.approx(expected, rel=ROUNDING)
    only_inside = GaussianProcess.condition(GATED, 0.04, x[inside], y[inside])
    np.testing.assert_allclose(process.predict(x).mean, only_inside.predict(x).mean, atol=ROUNDING)


def test_the_likelihoods_gradient_matches_finite_differences(observations, gradient_of):
    x, y = observations
    process = GaussianProcess.condition(GATED, 0.04, x, y)
    logs = np.append(GATED.log_parameters, np.log(0.04))
    step = 1e-5

    def likelihood(vector):
        kernel = GATED.with_log_parameters(vector[:-1])
        return GaussianProcess.condition(kernel, np.exp(vector[-1]), x, y).log_marginal_likelihood

    numeric = [
        (likelihood(logs + shift) - likelihood(logs - shift)) / (2 * step)
        for shift in step * np.eye(len(logs))
    ]
    # central differences of a likelihood of order 100
    np.testing.assert_allclose(gradient_of(process), numeric, atol=1e-6)


def test_training_data_are_copied_and_cannot_be_changed(observations):
    x, y = observations
    process = GaussianProcess.condition(GATED, 0.04, x, y)
    x[0, 0] = 99.0
    assert process.x[0, 0] != 99.0
    with pytest.raises(ValueError, match="read-only"):
        process.y[0] = 1.0


def test_no_jitter_where_none_is_needed(observations):
    assert GaussianProcess.condition(GATED, 0.04, *observations).jitter == 0.0


def test_jitter_is_reported_and_the_prediction_still_interpolates():
    x = np.linspace(0.0, 1.0, 60)[:, None]
    process = GaussianProcess.condition(SMOOTH, 1e-18, x, np.sin(4 * x[:, 0]))
    assert 0.0 < process.jitter <= 2e-6
    np.testing.assert_allclose(process.predict(x).mean, np.sin(4 * x[:, 0]), atol=1e-3)


def test_a_variance_that_rounds_below_zero_is_zero():
    # v − (v/√v)² is minus one unit in the last place for some of these v
    for variance in np.linspace(1.0, 2.0, 50):
        kernel = SquaredExponential(variance=variance, length_scales=1.0, dims=(0,))
        std = GaussianProcess.condition(kernel, 1e-20, [[0.0]], [1.0]).predict([[0.0]]).std
        assert 0.0 <= std[0] < 1e-7


def test_a_matrix_without_factor_names_cause_and_remedy(monkeypatch):
    def fill(self, x, y, out):
        out[:] = -1.0

    monkeypatch.setattr(SquaredExponential, "fill", fill)
    with pytest.raises(
        NotPositiveDefiniteError, match=r"3 observations .* noise_variance=0\.1 .* Raise the noise"
    ):
        GaussianProcess.condition(SMOOTH, 0.1, [[0.0], [1.0], [2.0]], [1.0, 2.0, 3.0])


def test_a_matrix_that_overflows_is_told_apart():
    huge = SquaredExponential(variance=1e308, length_scales=1.0, dims=(0,))
    kernel = huge * SquaredExponential(variance=1e308, length_scales=1.0, dims=(0,))
    with (
        np.errstate(over="ignore"),
        pytest.raises(NotPositiveDefiniteError, match="values that are not finite"),
    ):
        GaussianProcess.condition(kernel, 0.1, [[0.0], [1.0]], [1.0, 2.0])


@pytest.mark.parametrize("noise_variance", [0.0, -1.0, float("nan"), float("inf")])
def test_a_noise_variance_must_be_positive(noise_variance):
    with pytest.raises(InputError, match="noise_variance must be positive and finite, got"):
        GaussianProcess.condition(SMOOTH, noise_variance, [[0.0]], [1.0])


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([[0.0], [float("nan")]], [1.0, 2.0], "x must be finite, got nan in row 1, column 0"),
        ([[0.0], [1.0]], [1.0, float("inf")], "y must be finite, got inf in row 1"),
        ([0.0, 1.0], [1.0, 2.0], r"\(observations, dimensions\), got shape \(2,\)"),
        ([[0.0], [1.0]], [1.0, 2.0, 3.0], r"each of the 2 rows .* got shape \(3,\)"),
        ([["a"]], [1.0], "x must be an array of numbers"),
        (np.empty((0, 1)), [], "at least one observation"),
    ],
)
def test_malformed_observations_are_refused(x, y, message):
    with pytest.raises(ObservationError, match=message):
        GaussianProcess.condition(SMOOTH, 0.1, x, y)


def test_observations_wholly_outside_the_gate_are_refused():
    with pytest.raises(ObservationError, match="all 2 observations lie outside the range"):
        GaussianProcess.condition(GATED, 0.1, [[5.0, 0.0], [6.0, 0.0]], [0.0, 0.1])


def test_predicting_with_other_columns_is_refused(observations):
    process = GaussianProcess.condition(SMOOTH, 0.1, *observations)
    with pytest.raises(ObservationError, match=r"must have the 2 columns .* got 1"):
        process.predict([[1.0]])


def test_an_unused_column_may_not_hold_nan(observations):
    process = GaussianProcess.condition(
        Exponential(variance=1, length_scales=1, dims=(0,)), 0.1, *observations
    )
    with pytest.raises(ObservationError, match="got nan in row 0, column 1"):
        process.predict([[1.0, float("nan")]])


def test_observations_of_the_prior_are_predicted_with_the_right_confidence():
    rng = np.random.default_rng(10)
    x = rng.uniform(-1.0, 1.0, size=(800, 2))
    covariance = GATED.value(x, x) + 0.05 * np.eye(800)
    y = np.linalg.cholesky(covariance) @ rng.normal(size=800)
    process = GaussianProcess.condition(GATED, 0.05, x[:400], y[:400])
    prediction = process.predict(x[400:], include_noise=True)
    # three standard errors of a share of 400
    for k, share, tolerance in ((1.0, 0.683, 0.07), (2.0, 0.954, 0.03)):
        covered = coverage(y[400:], prediction.mean, prediction.std, k)
        assert covered == pytest.approx(share, abs=tolerance)


# -- several rows together -----------------------------------------------------------------


def test_the_joint_covariance_has_the_variances_on_its_diagonal(observations):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    x = np.random.default_rng(4).uniform(-1.3, 1.3, size=(70, 2))
    for noise in (False, True):
        single, joint = (
            predict(x, include_noise=noise)
            for predict in (process.predict, process.predict_jointly)
        )
        np.testing.assert_allclose(joint.mean, single.mean, atol=ROUNDING)
        np.testing.assert_allclose(np.diag(joint.covariance), single.std**2, atol=ROUNDING)
        np.testing.assert_array_equal(joint.covariance, joint.covariance.T)
        assert np.linalg.eigvalsh(joint.covariance).min() > -ROUNDING
    assert process.predict_jointly(np.empty((0, 2))).covariance.shape == (0, 0)


# -- groups left out: the same as conditioning without them ----------------------------------

GROUPS = np.random.default_rng(6).integers(0, 7, size=40)


@pytest.mark.parametrize("row_noise", [None, np.random.default_rng(2).uniform(0, 0.3, 40)])
@pytest.mark.parametrize("groups", [GROUPS, np.arange(40), [f"hole {g}" for g in GROUPS]])
def test_groups_left_out_are_predicted_as_without_them(observations, groups, row_noise):
    x, y = observations
    left_out = GaussianProcess.condition(GATED, 0.04, x, y, row_noise=row_noise).leave_out(groups)
    noise = np.zeros(40) if row_noise is None else row_noise
    for group in set(groups):
        rows = np.asarray(groups) == group
        without = GaussianProcess.condition(GATED, 0.04, x[~rows], y[~rows], row_noise=noise[~rows])
        expected = without.predict(x[rows], include_noise=True)
        np.testing.assert_allclose(left_out.mean[rows], expected.mean, atol=ROUNDING)
        np.testing.assert_allclose(
            left_out.std[rows] ** 2, expected.std**2 + noise[rows], rtol=ROUNDING
        )


def test_without_its_only_group_a_process_is_its_prior(observations):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    prior = process.leave_out(np.zeros(40, dtype=int))
    np.testing.assert_allclose(prior.mean, 0.0, atol=ROUNDING)
    np.testing.assert_allclose(
        prior.std**2, GATED.prior_variance(observations[0]) + 0.04, rtol=ROUNDING
    )


def test_every_observation_needs_a_group(observations):
    process = GaussianProcess.condition(GATED, 0.04, *observations)
    with pytest.raises(InputError, match=r"a label for each of the 40 .* got shape \(3,\)"):
        process.leave_out([1, 2, 3])


# -- more observations: the same as conditioning afresh ---------------------------------------

NOISE = 0.04
NEW = np.random.default_rng(5).uniform(-1.2, 1.2, size=(7, 2))


def observe(count):
    """A quarter of them lies outside the gate."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.3, 1.3, size=(count, 2))
    return x, np.sin(3 * x[:, 0]) + 0.3 * x[:, 1] + 0.1 * rng.normal(size=count)


def assert_same(one, other):
    # well-conditioned factors of a few dozen rows, updated a few times
    tolerance = 1e-9
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.y, other.y)
    assert one.log_marginal_likelihood == pytest.approx(
        other.log_marginal_likelihood, rel=tolerance
    )
    mine, theirs = one.predict(NEW), other.predict(NEW)
    np.testing.assert_allclose(mine.mean, theirs.mean, atol=tolerance)
    np.testing.assert_allclose(mine.std, theirs.std, atol=tolerance)


@settings(max_examples=40, deadline=None)
@given(additions=st.lists(st.lists(st.integers(0, 59), max_size=6), min_size=1, max_size=5))
def test_any_sequence_of_additions_equals_conditioning_afresh(additions):
    x, y = observe(60)
    held = list(range(20))
    process = GaussianProcess.condition(GATED, NOISE, x[held], y[held])
    for added in additions:
        process = process.with_observations(x[added].reshape(-1, 2), y[added])
        held += added
    assert_same(process, GaussianProcess.condition(GATED, NOISE, x[held], y[held]))


@pytest.mark.parametrize("count", [1, 12])
def test_adding_uses_the_present_factor(count, monkeypatch):
    x, y = observe(40)
    process = GaussianProcess.condition(GATED, NOISE, x[count:], y[count:])
    before = process.predict(NEW)
    whole = GaussianProcess.condition(GATED, NOISE, np.roll(x, -count, 0), np.roll(y, -count))
    monkeypatch.setattr(
        regression, "factorise", lambda *_: pytest.fail("the covariance was factorised afresh")
    )
    assert_same(process.with_observations(x[:count], y[:count]), whole)
    np.testing.assert_array_equal(process.predict(NEW).mean, before.mean)


def test_added_observations_outside_the_gate_count_as_white_noise_alone():
    process = GaussianProcess.condition(GATED, NOISE, *observe(30))
    more = process.with_observations([[5.0, 0.0]], [0.3])
    noise = -0.5 * (0.3**2 / NOISE + np.log(2 * np.pi * NOISE))
    assert more.log_marginal_likelihood - process.log_marginal_likelihood == pytest.approx(noise)
    np.testing.assert_array_equal(more.predict(NEW).mean, process.predict(NEW).mean)


def test_a_repeated_observation_that_leaves_no_factor_is_given_jitter():
    kernel = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
    process = GaussianProcess.condition(kernel, 1e-20, [[0.0], [3.0]], [1.0, 2.0])
    assert process.jitter == 0.0
    repeated = process.with_observations([[0.0]], [1.0])
    assert 0.0 < repeated.jitter <= 1e-6
    np.testing.assert_allclose(repeated.predict([[0.0]]).mean, 1.0, atol=1e-5)


def test_malformed_new_observations_are_refused():
    process = GaussianProcess.condition(SMOOTH, 0.1, [[0.0]], [0.0])
    with pytest.raises(ObservationError, match=r"must have the 1 columns .* got 2"):
        process.with_observations([[0.0, 1.0]], [0.0])
    with pytest.raises(ObservationError, match="each of the 1 rows"):
        process.with_observations([[0.0]], [0.0, 1.0])
