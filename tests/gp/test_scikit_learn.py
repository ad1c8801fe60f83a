"""The same numbers as scikit-learn on the kernels that both have."""

import csv
from datetime import date

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process import kernels as sk

from exposight.gp import (
    Exponential,
    GaussianProcess,
    Linear,
    Matern32,
    Matern52,
    RationalQuadratic,
    SquaredExponential,
)

# Two implementations on a matrix of condition 1e4.
AGREEMENT = 1e-6
NOISE = 0.02
SCALES = (0.7, 1.3, 2.1)
OURS = {"variance": 1.7, "dims": (0, 1, 2)}

PAIRS = {
    "squared exponential": (
        SquaredExponential(**OURS, length_scales=SCALES),
        sk.ConstantKernel(1.7) * sk.RBF(SCALES),
    ),
    "exponential": (
        Exponential(**OURS, length_scales=SCALES),
        sk.ConstantKernel(1.7) * sk.Matern(SCALES, nu=0.5),
    ),
    "exponential, isotropic": (
        Exponential(**OURS, length_scales=0.9),
        sk.ConstantKernel(1.7) * sk.Matern(0.9, nu=0.5),
    ),
    "matern 3/2": (
        Matern32(**OURS, length_scales=SCALES),
        sk.ConstantKernel(1.7) * sk.Matern(SCALES, nu=1.5),
    ),
    "matern 5/2": (
        Matern52(**OURS, length_scales=SCALES),
        sk.ConstantKernel(1.7) * sk.Matern(SCALES, nu=2.5),
    ),
    # scikit-learn's rational quadratic has a single length scale
    "rational quadratic": (
        RationalQuadratic(**OURS, length_scales=0.9, alpha=0.4),
        sk.ConstantKernel(1.7) * sk.RationalQuadratic(length_scale=0.9, alpha=0.4),
    ),
    "linear": (
        Linear(variances=(1.0, 1.0, 1.0), dims=(0, 1, 2)),
        sk.DotProduct(sigma_0=0.0, sigma_0_bounds="fixed"),
    ),
    "sum": (
        SquaredExponential(**OURS, length_scales=2.0) + Exponential(**OURS, length_scales=0.5),
        sk.ConstantKernel(1.7) * sk.RBF(2.0) + sk.ConstantKernel(1.7) * sk.Matern(0.5, nu=0.5),
    ),
}


@pytest.fixture(params=PAIRS)
def pair(request):
    rng = np.random.default_rng(11)
    x = rng.normal(size=(60, 3))
    y = np.sin(2 * x[:, 0]) + 0.4 * x[:, 1] + 0.1 * rng.normal(size=60)
    ours, theirs = PAIRS[request.param]
    regressor = GaussianProcessRegressor(theirs, alpha=NOISE, optimizer=None).fit(x, y)
    return GaussianProcess.condition(ours, NOISE, x, y), regressor


def test_likelihood(pair):
    process, regressor = pair
    assert process.log_marginal_likelihood == pytest.approx(
        regressor.log_marginal_likelihood(), abs=AGREEMENT
    )


def test_prediction(pair):
    process, regressor = pair
    x = np.random.default_rng(12).normal(size=(25, 3))
    mean, std = regressor.predict(x, return_std=True)
    prediction = process.predict(x)
    np.testing.assert_allclose(prediction.mean, mean, atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std, std, atol=AGREEMENT)


def test_joint_prediction(pair):
    process, regressor = pair
    x = np.random.default_rng(12).normal(size=(25, 3))
    mean, covariance = regressor.predict(x, return_cov=True)
    joint = process.predict_jointly(x)
    np.testing.assert_allclose(joint.mean, mean, atol=AGREEMENT)
    np.testing.assert_allclose(joint.covariance, covariance, atol=AGREEMENT)


@pytest.mark.parametrize("name", [name for name in PAIRS if name != "linear"])
def test_gradient_of_the_likelihood(name, gradient_of):
    rng = np.random.default_rng(14)
    x, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    ours, theirs = PAIRS[name]
    regressor = GaussianProcessRegressor(theirs, alpha=NOISE, optimizer=None).fit(x, y)
    expected = regressor.log_marginal_likelihood(theirs.theta, eval_gradient=True)[1]
    if name == "rational quadratic":
        expected = expected[[0, 2, 1]]  # scikit-learn sorts its hyperparameters by name
    gradient = gradient_of(GaussianProcess.condition(ours, NOISE, x, y))
    np.testing.assert_allclose(gradient[:-1], expected, atol=AGREEMENT)


def test_monthly_carbon_dioxide(reference_data):
    with (reference_data / "gp" / "mauna_loa_monthly.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    days = np.array([date.fromisoformat(day).toordinal() for day, _ in rows])
    years = (days - date(1980, 1, 1).toordinal())[:, None] / 365.25
    level = np.array([float(co2) for _, co2 in rows])
    deviation = level - level.mean()
    ours = SquaredExponential(variance=2500.0, length_scales=50.0, dims=(0,)) + RationalQuadratic(
        variance=0.5, length_scales=1.2, alpha=0.8, dims=(0,)
    )
    theirs = sk.ConstantKernel(2500.0) * sk.RBF(50.0) + sk.ConstantKernel(
        0.5
    ) * sk.RationalQuadratic(1.2, 0.8)
    regressor = GaussianProcessRegressor(theirs, alpha=4.0, optimizer=None).fit(years, deviation)
    process = GaussianProcess.condition(ours, 4.0, years, deviation)
    assert process.log_marginal_likelihood == pytest.approx(
        regressor.log_marginal_likelihood(), abs=AGREEMENT
    )
    ahead = np.linspace(-25.0, 30.0, 50)[:, None]
    mean, std = regressor.predict(ahead, return_std=True)
    prediction = process.predict(ahead)
    np.testing.assert_allclose(prediction.mean, mean, atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std, std, atol=AGREEMENT)
