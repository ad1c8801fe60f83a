"""The compiled exponential and logarithm, and the derivatives where distances vanish."""

import numpy as np
import pytest

from exposight.gp import Exponential, Matern32, Matern52, RationalQuadratic
from exposight.gp.kernels import loops

# One to two units in the last place of a double.
LAST_PLACES = 4.5e-16


def exponential_of(x: np.ndarray) -> np.ndarray:
    r2 = (x**2)[None, :]
    loops.correlate_exponential(r2, 1.0)
    return r2[0]


def test_the_exponential_is_right_to_the_last_places():
    # squares whose roots come back exactly
    x = np.concatenate([np.arange(708.0), np.arange(0.0, 60.0, 2.0**-10)])
    np.testing.assert_allclose(exponential_of(x), np.exp(-x), rtol=LAST_PLACES)


def test_the_exponential_ends_in_zero():
    assert exponential_of(np.array([0.0]))[0] == 1.0
    np.testing.assert_array_equal(exponential_of(np.array([709.0, 1e4, 1e150])), 0.0)


@pytest.mark.parametrize("alpha", [0.004, 0.5, 1.0, 1000.0])
def test_the_power_is_right_over_all_distances(alpha):
    u = np.logspace(-20, 12, 4000)
    r2 = (2.0 * alpha * u)[None, :]
    loops.correlate_rational_quadratic(r2, 1.0, alpha)
    expected = np.exp(-alpha * np.log1p(u))
    # the exponent's rounding is multiplied by the exponent
    tolerance = LAST_PLACES * (2.0 + np.abs(alpha * np.log1p(u)))
    kept = expected > 1e-300
    error = np.abs(r2[0][kept] / expected[kept] - 1.0)
    assert np.all(error <= tolerance[kept])


def test_the_derivative_for_alpha_keeps_its_digits_at_small_distances():
    kernel = RationalQuadratic(variance=1.0, length_scales=1.0, alpha=2.0, dims=(0,))
    x = np.array([[0.0], [1e-3]])
    u = 1e-6 / 4.0
    # u/(1 + u) − log(1 + u) = −u²/2 + 2u³/3 − …
    expected = 2.0 * 2.0 * (-(u**2) / 2 + 2 * u**3 / 3)
    derivative = kernel.weigh(x, x, np.ones((2, 2)))[-1]
    assert derivative == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("kind", [Exponential, Matern32, Matern52])
def test_coincident_observations_add_nothing_to_the_length_scales(kind):
    kernel = kind(variance=1.0, length_scales=(2.0, 3.0), dims=(0, 1))
    x = np.array([[1.0, 2.0], [1.0, 2.0]])
    np.testing.assert_array_equal(kernel.weigh(x, x, np.ones((2, 2))), [4.0, 0.0, 0.0])
