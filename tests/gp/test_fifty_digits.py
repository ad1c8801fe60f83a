"""The same numbers as a computation with fifty digits."""

import numpy as np
import pytest

from exposight.gp import (
    ChangePoint,
    Exponential,
    GaussianProcess,
    Linear,
    Matern32,
    Matern52,
    RationalQuadratic,
    SquaredExponential,
)
from exposight.gp.factor import Factor

mp = pytest.importorskip("mpmath", reason="mpmath is installed with the development extras only").mp

DIGITS = 50
# Double precision times a condition number of a few hundred.
AGREEMENT = 1e-12
NOISE = 0.04
X = np.random.default_rng(8).uniform(-1.0, 1.0, size=(8, 3))
X[-1] = X[0]  # an observation made twice
Y = np.array([0.3, -1.2, 0.8, 0.1, 2.0, -0.4, 0.9, 0.5])
NEW = np.array([[0.2, -0.3, 0.5], [3.0, 0.0, 0.1]])

SHAPES = {
    "squared_exponential": lambda r: mp.exp(-(r**2) / 2),
    "exponential": lambda r: mp.exp(-r),
    "matern32": lambda r: (1 + mp.sqrt(3) * r) * mp.exp(-mp.sqrt(3) * r),
    "matern52": lambda r: (1 + mp.sqrt(5) * r + 5 * r**2 / 3) * mp.exp(-mp.sqrt(5) * r),
}
KERNELS = {
    "squared exponential": SquaredExponential(variance=1.3, length_scales=0.7, dims=(0, 2)),
    "exponential": Exponential(variance=1.3, length_scales=(0.7, 1.1), dims=(2, 0)),
    "matern 3/2": Matern32(variance=1.3, length_scales=(0.7, 1.1), dims=(1, 2)),
    "matern 5/2": Matern52(variance=1.3, length_scales=0.7, dims=(0, 1, 2)),
    "rational quadratic": RationalQuadratic(
        variance=1.3, length_scales=(0.3, 0.4), alpha=0.2, dims=(0, 1)
    ),
    "nearly squared exponential": RationalQuadratic(
        variance=1.3, length_scales=0.5, alpha=900.0, dims=(0, 1)
    ),
    "product of Eq. 21": Exponential(variance=1.7, length_scales=0.8, dims=(0,))
    * Exponential(variance=1.0, length_scales=(0.9, 1.4), dims=(1, 2)),
    "a tree": (
        SquaredExponential(variance=1.3, length_scales=0.7, dims=(0,))
        + Linear(variances=(0.4, 0.2), dims=(1, 2))
    )
    * Matern32(variance=0.8, length_scales=1.2, dims=(1,))
    + Exponential(variance=0.5, length_scales=1.0, dims=(2,)) * ChangePoint(dim=0, minimum=-0.5),
    "gates of Eq. 9": RationalQuadratic(variance=1.3, length_scales=0.6, alpha=0.7, dims=(0, 1))
    * ChangePoint(dim=2, minimum=-0.8)
    * ChangePoint(dim=2, maximum=0.8),
}


def covariance(tree, values, x, y):
    """k(x, y) with fifty digits, from a kernel's description; takes its hyperparameters in turn."""
    match tree["type"]:
        case "product":
            return mp.fprod(covariance(child, values, x, y) for child in tree["factors"])
        case "sum":
            return mp.fsum(covariance(child, values, x, y) for child in tree["terms"])
        case "change_point":
            low = tree["minimum"] if tree["minimum"] is not None else -mp.inf
            high = tree["maximum"] if tree["maximum"] is not None else mp.inf
            return mp.mpf(all(low <= point[tree["dim"]] <= high for point in (x, y)))
        case "linear":
            return mp.fsum(next(values) * x[dim] * y[dim] for dim in tree["dims"])
    variance = next(values)
    scales = [next(values) for _ in tree["length_scales"]]
    scales *= len(tree["dims"]) // len(scales)
    r = mp.sqrt(
        mp.fsum(((x[d] - y[d]) / scale) ** 2 for d, scale in zip(tree["dims"], scales, strict=True))
    )
    if tree["type"] == "rational_quadratic":
        alpha = next(values)
        return variance * (1 + r**2 / (2 * alpha)) ** (-alpha)
    return variance * SHAPES[tree["type"]](r)


class Exact:
    """Regression with fifty digits."""

    def __init__(self, kernel, logs):
        self.tree = kernel.to_dict()
        self.parameters = [mp.exp(log) for log in logs]
        self.x = [[mp.mpf(value) for value in row] for row in X]
        self.y = mp.matrix([mp.mpf(value) for value in Y])
        n = len(self.x)
        self.matrix = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                self.matrix[i, j] = self.k(self.x[i], self.x[j])
            self.matrix[i, i] += self.parameters[-1]

    def k(self, x, y):
        return covariance(self.tree, iter(self.parameters), x, y)

    def likelihood(self):
        alpha = mp.lu_solve(self.matrix, self.y)
        quadratic = (self.y.T * alpha)[0]
        log_2pi = len(self.x) * mp.log(2 * mp.pi)
        return -(quadratic + mp.log(mp.det(self.matrix)) + log_2pi) / 2

    def predict(self, point):
        cross = mp.matrix([self.k(point, own) for own in self.x])
        solved = mp.lu_solve(self.matrix, cross)
        return (solved.T * self.y)[0], self.k(point, point) - (solved.T * cross)[0]


@pytest.fixture(params=KERNELS, autouse=True)
def kernel(request):
    before, mp.dps = mp.dps, DIGITS
    yield KERNELS[request.param]
    mp.dps = before


def exact_logs(kernel):
    return [mp.log(own.value) for own in kernel.parameters] + [mp.log(mp.mpf(NOISE))]


def test_likelihood(kernel):
    process = GaussianProcess.condition(kernel, NOISE, X, Y)
    expected = Exact(kernel, exact_logs(kernel)).likelihood()
    assert process.log_marginal_likelihood == pytest.approx(float(expected), rel=AGREEMENT)


def test_gradient(kernel, gradient_of):
    gradient = gradient_of(GaussianProcess.condition(kernel, NOISE, X, Y))
    logs, step = exact_logs(kernel), mp.mpf(10) ** -15
    expected = []
    for index in range(len(logs)):
        higher, lower = (
            [log + sign * step * (index == own) for own, log in enumerate(logs)] for sign in (1, -1)
        )
        difference = Exact(kernel, higher).likelihood() - Exact(kernel, lower).likelihood()
        expected.append(float(difference / (2 * step)))
    np.testing.assert_allclose(gradient, expected, rtol=AGREEMENT, atol=10 * AGREEMENT)


@pytest.mark.parametrize("with_inverse", [True, False])
def test_mean_and_variance(kernel, with_inverse, monkeypatch):
    if not with_inverse:
        monkeypatch.setattr(Factor, "inverse", None)
    prediction = GaussianProcess.condition(kernel, NOISE, X, Y).predict(NEW)
    exact = Exact(kernel, exact_logs(kernel))
    mean, variance = zip(*(exact.predict([mp.mpf(v) for v in row]) for row in NEW), strict=True)
    np.testing.assert_allclose(prediction.mean, np.array(mean, float), atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std**2, np.array(variance, float), atol=AGREEMENT)
