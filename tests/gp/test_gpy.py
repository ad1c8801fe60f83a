"""The same numbers as GPy, the authors' library, on the paper's kernels."""

import warnings

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
    gpy_length_scale,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    GPy = pytest.importorskip("GPy", reason="GPy is installed with the development extras only")

pytestmark = pytest.mark.filterwarnings("ignore")

# GPy adds 1e-8 to the diagonal of every covariance matrix.
AGREEMENT = 1e-6
NOISE = 0.02
SCALES = (0.7, 1.3, 2.1)
ALPHA = 0.4
OURS = {"variance": 1.7, "dims": (0, 1, 2)}
# Table 8, q_k4 (its alpha is GPy's power).
TABLE_8_Q4 = {"variance": 1.45, "lengthscale": [1.06, 52.0, 18.0, 33.0], "power": 0.010}


def theirs(kind, **arguments):
    return getattr(GPy.kern, kind)(3, variance=1.7, **arguments)


PAIRS = {
    "squared exponential": (
        SquaredExponential(**OURS, length_scales=SCALES),
        lambda: theirs("RBF", lengthscale=SCALES, ARD=True),
    ),
    "exponential": (
        Exponential(**OURS, length_scales=SCALES),
        lambda: theirs("Exponential", lengthscale=SCALES, ARD=True),
    ),
    "exponential, isotropic": (
        Exponential(**OURS, length_scales=0.9),
        lambda: theirs("Exponential", lengthscale=0.9),
    ),
    "matern 3/2": (
        Matern32(**OURS, length_scales=SCALES),
        lambda: theirs("Matern32", lengthscale=SCALES, ARD=True),
    ),
    "matern 5/2": (
        Matern52(**OURS, length_scales=SCALES),
        lambda: theirs("Matern52", lengthscale=SCALES, ARD=True),
    ),
    "rational quadratic": (
        RationalQuadratic(**OURS, length_scales=SCALES, alpha=ALPHA),
        lambda: theirs(
            "RatQuad",
            lengthscale=[gpy_length_scale(scale, alpha=ALPHA) for scale in SCALES],
            power=ALPHA,
            ARD=True,
        ),
    ),
    "linear": (
        Linear(variances=SCALES, dims=(0, 1, 2)),
        lambda: GPy.kern.Linear(3, variances=SCALES, ARD=True),
    ),
    "product of Eq. 21": (
        Exponential(variance=1.7, length_scales=0.8, dims=(0,))
        * Exponential(variance=1.0, length_scales=SCALES[1:], dims=(1, 2), fixed=("variance",)),
        lambda: (
            GPy.kern.Exponential(1, variance=1.7, lengthscale=0.8, active_dims=[0])
            * GPy.kern.Exponential(2, lengthscale=SCALES[1:], ARD=True, active_dims=[1, 2])
        ),
    ),
    "sum": (
        SquaredExponential(**OURS, length_scales=2.0) + Linear(variances=SCALES, dims=(0, 1, 2)),
        lambda: theirs("RBF", lengthscale=2.0) + GPy.kern.Linear(3, variances=SCALES, ARD=True),
    ),
    # GPy's gate excludes its limits; no observation lies on one
    "gates of Eq. 9": (
        SquaredExponential(**OURS, length_scales=SCALES)
        * ChangePoint(dim=0, minimum=-1.0)
        * ChangePoint(dim=0, maximum=1.5),
        lambda: (
            theirs("RBF", lengthscale=SCALES, ARD=True)
            * GPy.kern.DomainKernel(1, -1.0, 1.5, active_dims=[0])
        ),
    ),
}


@pytest.fixture(params=PAIRS)
def pair(request):
    rng = np.random.default_rng(11)
    x = rng.normal(size=(60, 3))
    y = np.sin(2 * x[:, 0]) + 0.4 * x[:, 1] + 0.1 * rng.normal(size=60)
    ours, build = PAIRS[request.param]
    model = GPy.models.GPRegression(x, y[:, None], build(), noise_var=NOISE)
    return GaussianProcess.condition(ours, NOISE, x, y), model


def test_likelihood(pair):
    process, model = pair
    assert process.log_marginal_likelihood == pytest.approx(
        float(model.log_likelihood()), rel=AGREEMENT
    )


@pytest.mark.parametrize("include_noise", [False, True])
def test_prediction(pair, include_noise):
    process, model = pair
    x = np.random.default_rng(12).normal(size=(25, 3))
    mean, variance = model.predict(x, include_likelihood=include_noise)
    prediction = process.predict(x, include_noise=include_noise)
    np.testing.assert_allclose(prediction.mean, mean[:, 0], atol=AGREEMENT)
    np.testing.assert_allclose(prediction.std**2, variance[:, 0], atol=AGREEMENT)


def test_hyperparameters_written_by_gpy_carry_over():
    kernel = RationalQuadratic(
        variance=TABLE_8_Q4["variance"],
        length_scales=tuple(
            scale / np.sqrt(TABLE_8_Q4["power"]) for scale in TABLE_8_Q4["lengthscale"]
        ),
        alpha=TABLE_8_Q4["power"],
        dims=(0, 1, 2, 3),
    )
    x = np.random.default_rng(1).uniform(-1, 1, size=(30, 4)) * [120.0, 170.0, 300.0, 200.0]
    expected = GPy.kern.RatQuad(4, **TABLE_8_Q4, ARD=True).K(x)
    np.testing.assert_allclose(kernel.value(x, x), expected, rtol=1e-12)
