"""The regression demonstration of the GPML toolbox, computed by GPML."""

import json

import numpy as np
import pytest

from exposight.gp import GaussianProcess, Matern32, SquaredExponential, fit

# The reference values are quoted to double precision; both sides invert a 20 x 20 matrix.
AGREEMENT = 1e-6


@pytest.fixture(scope="module")
def demo(reference_data):
    return json.loads((reference_data / "gp" / "gpml_demo_regression.json").read_text())


@pytest.fixture(scope="module")
def observations(demo):
    return np.array(demo["x"])[:, None], np.array(demo["y"])


def column(values):
    return np.array(values)[:, None]


def squared_exponential(case):
    return SquaredExponential(variance=case["sf"] ** 2, length_scales=case["ell"], dims=(0,))


def test_matern_with_a_linear_mean(demo, observations):
    case, (x, y) = demo["case1"], observations
    kernel = Matern32(variance=case["sf"] ** 2, length_scales=case["ell"], dims=(0,))
    process = GaussianProcess.condition(kernel, case["sn"] ** 2, x, y - (0.5 * x[:, 0] + 1.0))
    z = column(demo["case1"]["z"])
    prediction = process.predict(z, include_noise=True)
    assert -process.log_marginal_likelihood == pytest.approx(case["nlml"], abs=AGREEMENT)
    np.testing.assert_allclose(prediction.mean + 0.5 * z[:, 0] + 1.0, case["mu"], atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std**2, case["var_y"], atol=AGREEMENT)


def test_squared_exponential_at_the_optimum(demo, observations):
    case = demo["case2"]
    process = GaussianProcess.condition(squared_exponential(case), case["sn"] ** 2, *observations)
    prediction = process.predict(column(demo["case1"]["z"]), include_noise=True)
    assert -process.log_marginal_likelihood == pytest.approx(case["nlml"], abs=AGREEMENT)
    np.testing.assert_allclose(prediction.mean, case["mu"], atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std**2, case["var_y"], atol=AGREEMENT)


def test_fitting_finds_the_same_optimum(demo, observations):
    case = demo["case2"]
    kernel = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
    result = fit(kernel, *observations, rng=np.random.default_rng(0))
    assert -result.log_marginal_likelihood == pytest.approx(case["nlml"], abs=AGREEMENT)
    assert result.process.kernel.length_scales[0] == pytest.approx(case["ell"], rel=1e-4)
    assert np.sqrt(result.process.noise_variance) == pytest.approx(case["sn"], rel=1e-4)


def test_squared_exponential_far_from_the_optimum(demo, observations):
    case = demo["case3"]
    process = GaussianProcess.condition(squared_exponential(case), case["sn"] ** 2, *observations)
    assert -process.log_marginal_likelihood == pytest.approx(case["nlml"], abs=AGREEMENT)
