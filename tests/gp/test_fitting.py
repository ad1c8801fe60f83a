"""Maximum likelihood: optima, starts, bounds, and what a fit refuses."""

import numpy as np
import pytest

from exposight.errors import InputError, NotPositiveDefiniteError, NumericalError, ObservationError
from exposight.gp import (
    EVALUATIONS,
    Bounds,
    ChangePoint,
    DataScale,
    Exponential,
    GaussianProcess,
    Linear,
    RationalQuadratic,
    SquaredExponential,
    fit,
)
from exposight.gp.bounds import starting_values
from exposight.gp.likelihood import MarginalLikelihood

SMOOTH = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
PRODUCT = Exponential(variance=1.0, length_scales=1.0, dims=(0,)) * Exponential(
    variance=1.0, length_scales=(1.0, 1.0), dims=(1, 2), fixed=("variance",)
)


@pytest.fixture
def observations():
    rng = np.random.default_rng(7)
    x = rng.uniform(0.0, 4.0, size=(40, 1))
    return x, np.sin(2 * x[:, 0]) + 0.1 * rng.normal(size=40)


def seeded(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def drawn(kernel, noise_variance, x, rng):
    """One draw of observations from a prior."""
    covariance = kernel.value(x, x) + noise_variance * np.eye(len(x))
    return np.linalg.cholesky(covariance) @ rng.normal(size=len(x))


def test_the_gradient_vanishes_at_the_maximum(observations, gradient_of):
    result = fit(SMOOTH, *observations, rng=seeded())
    assert result.converged
    assert result.parameters_at_bound == ()
    # the optimiser stops at 1e-6 an observation
    np.testing.assert_allclose(gradient_of(result.process), 0.0, atol=1e-3)


def test_a_fit_is_at_least_as_likely_as_the_truth():
    rng = seeded(2)
    truth = RationalQuadratic(variance=0.5, length_scales=(20.0, 90.0), alpha=0.8, dims=(0, 1))
    x = np.column_stack([rng.uniform(10, 255, 120), rng.uniform(-180, 180, 120)])
    y = drawn(truth, 0.01, x, rng)
    result = fit(truth, x, y, rng=seeded())
    at_truth = GaussianProcess.condition(truth, 0.01, x, y)
    assert result.log_marginal_likelihood >= at_truth.log_marginal_likelihood


def test_the_truth_is_found_again():
    rng = seeded(4)
    truth = SquaredExponential(variance=2.0, length_scales=(15.0,), dims=(0,))
    x = rng.uniform(0, 500, size=(300, 1))
    process = fit(SMOOTH, x, drawn(truth, 0.02, x, rng), rng=seeded()).process
    # three standard errors of thirty length scales and 300 noisy values
    assert process.kernel.length_scales[0] == pytest.approx(15.0, rel=0.2)
    assert process.noise_variance == pytest.approx(0.02, rel=0.3)


def test_a_fixed_hyperparameter_stays(observations):
    kernel = SquaredExponential(variance=3.0, length_scales=1.0, dims=(0,), fixed=("variance",))
    fitted = fit(kernel, *observations, rng=seeded()).process.kernel
    assert fitted.variance == 3.0
    assert fitted.length_scales != (1.0,)


def test_the_same_seed_gives_the_same_result(observations):
    one, other = (fit(SMOOTH, *observations, rng=seeded(5)) for _ in range(2))
    assert one.process.kernel == other.process.kernel
    assert one.process.noise_variance == other.process.noise_variance
    assert one.evaluations == other.evaluations


def test_every_start_is_reported_and_the_best_one_wins(observations):
    seen = []
    result = fit(
        SMOOTH,
        *observations,
        rng=seeded(),
        restarts=4,
        progress=lambda *step: seen.append(step),
    )
    starts = [step for step in seen if step[0] == "fitting"]
    assert starts == [("fitting", done, 4) for done in (1, 2, 3, 4)]
    assert len(result.starts) == 4
    assert result.evaluations == sum(start.evaluations for start in result.starts)
    best = max(start.log_marginal_likelihood for start in result.starts)
    assert result.log_marginal_likelihood == pytest.approx(best, rel=1e-9)
    assert result.seconds > 0.0


def test_every_evaluation_within_a_start_is_reported(observations):
    seen = []
    result = fit(SMOOTH, *observations, rng=seeded(), progress=lambda *step: seen.append(step))
    within = [step for step in seen if step[0] == EVALUATIONS]
    assert within == [(EVALUATIONS, done + 1, 0) for done in range(result.evaluations)]


def test_the_first_start_can_be_the_given_values(observations):
    kernel = SquaredExponential(variance=0.7, length_scales=0.9, dims=(0,))
    result = fit(
        kernel, *observations, rng=seeded(), first_start="given", noise_variance=0.02, restarts=1
    )
    np.testing.assert_allclose(np.exp(result.starts[0].start), [0.7, 0.9, 0.02])


def test_the_first_start_is_measured_by_the_data(observations):
    x, y = observations
    result = fit(SMOOTH, x, y, rng=seeded(), restarts=1)
    np.testing.assert_allclose(
        np.exp(result.starts[0].start), [np.mean(y**2), x.std(), 0.01 * np.mean(y**2)]
    )


def test_a_parameter_at_its_bound_is_named(observations):
    bounds = Bounds(named={"squared_exponential.length_scale": (1e-3, 0.05)})
    result = fit(SMOOTH, *observations, rng=seeded(), bounds=bounds, restarts=1)
    assert "squared_exponential.length_scale" in result.parameters_at_bound
    assert result.process.kernel.length_scales[0] == pytest.approx(0.05)


def test_equal_bounds_hold_the_noise_fixed(observations):
    bounds = Bounds(named={"noise_variance": (0.04, 0.04)})
    result = fit(SMOOTH, *observations, rng=seeded(), bounds=bounds)
    assert result.process.noise_variance == pytest.approx(0.04)
    assert result.parameters_at_bound == ()


def test_noiseless_targets_stop_at_the_noise_floor():
    x = np.linspace(0.0, 3.0, 30)[:, None]
    y = np.exp(-x[:, 0])
    result = fit(SMOOTH, x, y, rng=seeded())
    assert result.process.noise_variance == pytest.approx(1e-6 * np.mean(y**2))
    assert "noise_variance" in result.parameters_at_bound


def test_a_gated_kernel_learns_from_the_rows_inside():
    rng = seeded(1)
    x = rng.uniform(0.0, 300.0, size=(80, 1))
    kernel = RationalQuadratic(variance=1.0, length_scales=1.0, alpha=1.0, dims=(0,)) * ChangePoint(
        dim=0, minimum=10.0, maximum=255.0
    )
    y = np.where(kernel.gate(x), 0.0, np.exp(-(((x[:, 0] - 120) / 60) ** 2)))
    process = fit(kernel, x, y + 0.01 * rng.normal(size=80), rng=seeded()).process
    np.testing.assert_allclose(process.predict(x).mean, y, atol=0.03)
    assert process.predict([[5.0]]).mean[0] == 0.0


def test_a_linear_kernel_recovers_a_plane():
    rng = seeded(3)
    x = rng.normal(size=(50, 2)) * [1.0, 100.0]
    y = 3.0 * x[:, 0] - 0.2 * x[:, 1] + 0.01 * rng.normal(size=50)
    process = fit(Linear(variances=(1.0, 1.0), dims=(0, 1)), x, y, rng=seeded()).process
    np.testing.assert_allclose(process.predict(np.eye(2)).mean, [3.0, -0.2], atol=0.01)


def test_starting_values_give_the_product_the_targets_variance():
    rng = seeded()
    x = rng.normal(size=(500, 3)) * [50.0, 200.0, 2.0]
    scale = DataScale.of(x, np.full(500, 4.0))
    start = PRODUCT.with_log_parameters(starting_values(PRODUCT, scale))
    assert start.prior_variance(x[:1])[0] == pytest.approx(16.0)
    assert start.factors[1].length_scales == pytest.approx(
        np.sqrt(2.0) * x[:, 1:].std(axis=0), rel=1e-12
    )


def test_only_the_first_factor_starts_with_the_targets_variance():
    kernel = SMOOTH * SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
    x = np.array([[-2.0], [2.0]])
    start = kernel.with_log_parameters(
        starting_values(kernel, DataScale.of(x, np.array([3.0, 3.0])))
    )
    np.testing.assert_allclose(start.prior_variance(x), 9.0)


def test_starting_values_share_the_variance_between_terms():
    kernel = SMOOTH + Linear(variances=(1.0,), dims=(0,))
    x = np.array([[-2.0], [2.0]])
    start = kernel.with_log_parameters(
        starting_values(kernel, DataScale.of(x, np.array([3.0, 3.0])))
    )
    np.testing.assert_allclose(start.prior_variance(x), 9.0)


def test_one_failing_start_does_not_lose_the_others(observations, monkeypatch):
    original, calls = MarginalLikelihood.value_and_gradient, []

    def failing_once(*args, **kwargs):
        calls.append(1)
        if len(calls) == 1:
            msg = "no factor"
            raise NotPositiveDefiniteError(msg)
        return original(*args, **kwargs)

    monkeypatch.setattr(MarginalLikelihood, "value_and_gradient", failing_once)
    result = fit(SMOOTH, *observations, rng=seeded())
    assert result.starts[0].log_marginal_likelihood == -np.inf
    assert result.starts[0].message == "no factor"
    assert isinstance(result.starts[0].error, NotPositiveDefiniteError)
    assert result.converged


def test_a_failure_on_the_way_turns_the_search_back(observations, monkeypatch):
    original, calls = MarginalLikelihood.value_and_gradient, []

    def failing_midway(*args, **kwargs):
        calls.append(1)
        if len(calls) == 4:
            msg = "no factor"
            raise NotPositiveDefiniteError(msg)
        return original(*args, **kwargs)

    undisturbed = fit(SMOOTH, *observations, rng=seeded(), restarts=1)
    monkeypatch.setattr(MarginalLikelihood, "value_and_gradient", failing_midway)
    disturbed = fit(SMOOTH, *observations, rng=seeded(), restarts=1)
    assert disturbed.log_marginal_likelihood == pytest.approx(
        undisturbed.log_marginal_likelihood, abs=1e-4
    )


def test_a_search_that_is_cut_short_says_so(observations):
    result = fit(SMOOTH, *observations, rng=seeded(), restarts=1, max_iterations=1)
    assert not result.converged


def test_when_every_start_fails_the_reasons_are_told(observations, monkeypatch):
    def failing(*_, **__):
        msg = "no factor"
        raise NotPositiveDefiniteError(msg)

    monkeypatch.setattr(MarginalLikelihood, "value_and_gradient", failing)
    with pytest.raises(NumericalError, match="every one of 3 starts failed: no factor"):
        fit(SMOOTH, *observations, rng=seeded())


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (np.zeros((2, 3)), [1.0, 2.0], "fewer observations than dimensions: 2 observations of 3"),
        (np.ones((5, 1)), np.arange(5.0), "all observations are alike: the 5 rows hold the same"),
        (np.arange(5.0)[:, None], np.ones(5), "all observations are alike: each of the 5 targets"),
        ([[1.0]], [1.0], "at least two observations are needed"),
        ([[0.0], [np.nan]], [1.0, 2.0], "x must be finite, got nan in row 1, column 0"),
        ([[0.0], [1.0]], [np.nan, 2.0], "y must be finite, got nan in row 0"),
    ],
)
def test_observations_that_teach_nothing_are_refused(x, y, message):
    with pytest.raises(ObservationError, match=message):
        fit(SMOOTH, x, y, rng=seeded())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"restarts": 0}, "restarts must be at least 1, got 0"),
        ({"noise_variance": -1.0}, "noise_variance must be positive"),
        ({"first_start": "random"}, "first_start must be 'data' or 'given', got 'random'"),
        ({"threads": 0}, "threads must be at least 1, got 0"),
        ({"bounds": Bounds(named={"alpha": (1.0, 2.0)})}, r"bounds are given for \['alpha'\]"),
    ],
)
def test_arguments_that_cannot_be_right_are_refused(observations, arguments, message):
    with pytest.raises(InputError, match=message):
        fit(SMOOTH, *observations, rng=seeded(), **arguments)


@pytest.mark.parametrize("limits", [(0.0, 1.0), (2.0, 1.0), (1.0, float("inf"))])
def test_bounds_out_of_order_are_refused(limits):
    with pytest.raises(InputError, match="bounds of alpha must be 0 < low <= high"):
        Bounds(alpha=limits)
