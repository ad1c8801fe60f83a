"""The likelihood of other targets, its derivatives for a mean's parameters, and rows' noise."""

import numpy as np
import pytest

from exposight.errors import ObservationError
from exposight.gp import ChangePoint, GaussianProcess, RationalQuadratic
from exposight.gp.likelihood import MarginalLikelihood

# Sums over a few dozen rows, and central differences of a likelihood of order 100.
ROUNDING, FINITE_DIFFERENCE, STEP = 1e-9, 1e-6, 1e-5
NOISE = 0.04
KERNEL = RationalQuadratic(
    variance=1.5, length_scales=(0.4, 0.8), alpha=0.6, dims=(0, 1)
) * ChangePoint(dim=0, minimum=-1.0)

RNG = np.random.default_rng(8)
X = RNG.uniform(-1.5, 1.5, size=(40, 2))
Y = np.sin(3 * X[:, 0]) + 0.1 * RNG.normal(size=40)
ROW_NOISE = np.where(RNG.uniform(size=40) < 0.5, 0.0, RNG.uniform(0.0, 0.5, size=40))


@pytest.fixture(params=[None, ROW_NOISE], ids=["noise", "row noise"])
def likelihood(request):
    return MarginalLikelihood(X, Y, active=~KERNEL.gate(X), row_noise=request.param)


def covariance(likelihood, kernel=KERNEL, noise=NOISE):
    row_noise = 0.0 if likelihood._row_noise is None else likelihood._row_noise
    return kernel.value(X, X) + np.diag(np.full(len(X), noise) + row_noise)


def dense(k, y):
    return -0.5 * (y @ np.linalg.solve(k, y) + np.linalg.slogdet(k)[1] + len(y) * np.log(2 * np.pi))


@pytest.mark.parametrize("targets", [None, Y - 0.7 * X[:, 1]], ids=["given", "other"])
def test_value_and_alpha_are_those_of_the_dense_covariance(likelihood, targets):
    y, k = Y if targets is None else targets, covariance(likelihood)
    value, _, alpha = likelihood.evaluate(KERNEL, NOISE, targets)
    assert value == pytest.approx(dense(k, y), rel=ROUNDING)
    np.testing.assert_allclose(alpha, np.linalg.solve(k, y), rtol=ROUNDING)


def test_other_targets_leave_those_given_as_they_are(likelihood):
    before = likelihood.value_and_gradient(KERNEL, NOISE)
    likelihood.evaluate(KERNEL, NOISE, Y + 1.0)
    after = likelihood.value_and_gradient(KERNEL, NOISE)
    assert after[0] == before[0]
    np.testing.assert_array_equal(after[1], before[1])


def test_the_gradient_matches_finite_differences_of_the_dense_likelihood(likelihood):
    logs = np.append(KERNEL.log_parameters, np.log(NOISE))

    def value(vector):
        kernel = KERNEL.with_log_parameters(vector[:-1])
        return dense(covariance(likelihood, kernel, np.exp(vector[-1])), Y)

    numeric = [
        (value(logs + shift) - value(logs - shift)) / (2 * STEP)
        for shift in STEP * np.eye(len(logs))
    ]
    gradient = likelihood.evaluate(KERNEL, NOISE)[1]
    np.testing.assert_allclose(gradient, numeric, atol=FINITE_DIFFERENCE)


def test_alpha_gives_the_derivatives_for_a_means_parameters(likelihood):
    def mean(slope, rate):
        return slope * X[:, 0] + np.exp(rate * X[:, 1])

    def value(beta):
        return likelihood.evaluate(KERNEL, NOISE, Y - mean(*beta))[0]

    beta = np.array([0.3, -0.2])
    jacobian = np.column_stack([X[:, 0], X[:, 1] * np.exp(beta[1] * X[:, 1])])
    alpha = likelihood.evaluate(KERNEL, NOISE, Y - mean(*beta))[2]
    numeric = [
        (value(beta + shift) - value(beta - shift)) / (2 * STEP) for shift in STEP * np.eye(2)
    ]
    np.testing.assert_allclose(jacobian.T @ alpha, numeric, atol=FINITE_DIFFERENCE)


# -- the process with noise of each row ---------------------------------------------------------


def test_a_process_with_row_noise_is_the_dense_formula(likelihood):
    row_noise = likelihood._row_noise
    process = GaussianProcess.condition(KERNEL, NOISE, X, Y, row_noise=row_noise)
    k, new = covariance(likelihood), X[:6] + 0.1
    cross = KERNEL.value(new, X)
    expected = KERNEL.value(new, new) - cross @ np.linalg.solve(k, cross.T)
    joint = process.predict_jointly(new)
    assert process.log_marginal_likelihood == pytest.approx(dense(k, Y), rel=ROUNDING)
    np.testing.assert_allclose(joint.mean, cross @ np.linalg.solve(k, Y), atol=ROUNDING)
    np.testing.assert_allclose(joint.covariance, expected, atol=ROUNDING)


@pytest.mark.parametrize("first", [None, ROW_NOISE[:30]])
@pytest.mark.parametrize("then", [None, ROW_NOISE[30:]])
def test_rows_with_noise_of_their_own_are_added(first, then):
    process = GaussianProcess.condition(KERNEL, NOISE, X[:30], Y[:30], row_noise=first)
    more = process.with_observations(X[30:], Y[30:], row_noise=then)
    noise = np.concatenate(
        [np.zeros(30) if first is None else first, np.zeros(10) if then is None else then]
    )
    afresh = GaussianProcess.condition(KERNEL, NOISE, X, Y, row_noise=noise)
    assert more.log_marginal_likelihood == pytest.approx(
        afresh.log_marginal_likelihood, rel=ROUNDING
    )
    np.testing.assert_allclose(more.predict(X).std, afresh.predict(X).std, atol=ROUNDING)
    if first is not None or then is not None:
        np.testing.assert_array_equal(more.row_noise, noise)


def test_an_observation_of_endless_noise_tells_nothing():
    noise = np.zeros(40)
    noise[5] = 1e12
    with_it = GaussianProcess.condition(KERNEL, NOISE, X, Y, row_noise=noise)
    without = GaussianProcess.condition(KERNEL, NOISE, np.delete(X, 5, 0), np.delete(Y, 5))
    np.testing.assert_allclose(with_it.predict(X).mean, without.predict(X).mean, atol=ROUNDING)


@pytest.mark.parametrize("row_noise", [np.zeros(3), -np.ones(40), np.full(40, np.nan), 0.1])
def test_row_noise_that_cannot_be_is_refused(row_noise):
    with pytest.raises(ObservationError, match="a variance for each of the 40 rows"):
        GaussianProcess.condition(KERNEL, NOISE, X, Y, row_noise=row_noise)
