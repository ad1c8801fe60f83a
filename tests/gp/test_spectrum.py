"""Predictions of very many rows: standard deviations right to 1e-4, exact where they cannot be."""

import numpy as np
import pytest

from exposight.gp import ChangePoint, Exponential, GaussianProcess, RationalQuadratic, regression
from exposight.gp.spectrum import TOLERANCE

SMOOTH = RationalQuadratic(variance=0.8, length_scales=(80.0, 300.0), alpha=2.0, dims=(0, 1))
GATED = SMOOTH * ChangePoint(dim=0, minimum=10.0)
ROUGH = Exponential(variance=0.8, length_scales=(5.0,), dims=(0, 1))
LOW, HIGH = (0.0, -200.0), (255.0, 200.0)
# what is left of the few rows of a test is compared with the exact path, which takes one at a time
ROWS = 12_000


def process_of(kernel, noise, n=300):
    rng = np.random.default_rng(3)
    x = rng.uniform(LOW, HIGH, size=(n, 2))
    return GaussianProcess.condition(kernel, noise, x, np.sin(x[:, 0] / 40.0))


def many_and_few(process, x, **settings):
    """Predict all rows at once, and some of them by the exact path."""
    some = slice(None, None, 37)
    return process.predict(x, **settings), process.predict(x[some], **settings), some


def spectrum_of(process, x, noise):
    return process._spectrum(x[:1000], len(x), noise)


@pytest.mark.parametrize("include_noise", [True, False])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_standard_deviations_agree_with_the_exact_path(noise, include_noise):
    process = process_of(GATED, noise)
    x = np.random.default_rng(1).uniform(LOW, HIGH, size=(ROWS, 2))
    assert spectrum_of(process, x[x[:, 0] > 10.0], noise) is not None
    many, few, some = many_and_few(process, x, include_noise=include_noise)
    np.testing.assert_allclose(many.std[some], few.std, rtol=TOLERANCE, atol=1e-12)
    np.testing.assert_allclose(many.mean[some], few.mean, rtol=1e-9, atol=1e-12)


def test_rows_beside_the_sampled_ones_are_held_to_the_bound():
    process = process_of(SMOOTH, 1e-4)
    rng = np.random.default_rng(2)
    x = rng.uniform(LOW, HIGH, size=(ROWS, 2))
    x[1::50] = rng.uniform((-900.0, -900.0), (900.0, 900.0), size=(len(x[1::50]), 2))
    x[2::50] = process.x[rng.integers(0, len(process.x), len(x[2::50]))]
    many = process.predict(x)
    for start in (1, 2):
        few = process.predict(x[start::50])
        np.testing.assert_allclose(many.std[start::50], few.std, rtol=TOLERANCE)


def test_a_rough_kernel_is_computed_exactly():
    process = process_of(ROUGH, 1e-3)
    x = np.random.default_rng(1).uniform(LOW, HIGH, size=(ROWS, 2))
    assert spectrum_of(process, x, 0.0) is None
    many, few, some = many_and_few(process, x)
    np.testing.assert_allclose(many.std[some], few.std, rtol=1e-10)


def test_nearly_repeated_observations_are_right_too():
    rng = np.random.default_rng(3)
    x = np.repeat(rng.uniform(LOW, HIGH, size=(150, 2)), 2, axis=0)
    x[1::2] += 1e-7
    process = GaussianProcess.condition(SMOOTH, 1e-9, x, np.sin(x[:, 0] / 40.0))
    asked = np.vstack([rng.uniform(LOW, HIGH, size=(ROWS, 2)), x])
    many, few, some = many_and_few(process, asked, include_noise=True)
    np.testing.assert_allclose(many.std[some], few.std, rtol=TOLERANCE)


def test_threads_change_nothing():
    process = process_of(SMOOTH, 1e-3)
    x = np.random.default_rng(1).uniform(LOW, HIGH, size=(ROWS, 2))
    one, two = (process.predict(x, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.std, two.std)


def test_blocks_equal_the_whole(monkeypatch):
    process = process_of(SMOOTH, 1e-3)
    x = np.random.default_rng(1).uniform(LOW, HIGH, size=(ROWS, 2))
    whole = process.predict(x)
    monkeypatch.setattr(regression, "_CHUNK", 700)
    np.testing.assert_allclose(process.predict(x).std, whole.std, rtol=1e-9)
