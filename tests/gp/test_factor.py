"""The factor in place, its inverse, and why a matrix has none."""

import numpy as np
import pytest

from exposight.errors import InputError, NotPositiveDefiniteError
from exposight.gp import Exponential, GaussianProcess, SquaredExponential, factor, tiling
from exposight.gp.factor import factor_lower, factorise, invert_lower
from exposight.gp.likelihood import MarginalLikelihood
from exposight.gp.tiling import choose_threads

# A few hundred rows, well conditioned.
ROUNDING = 1e-11
KERNEL = Exponential(variance=2.0, length_scales=(1.0, 2.0), dims=(0, 1))
SMOOTH = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))


@pytest.fixture
def x():
    return np.random.default_rng(5).normal(size=(300, 2))


@pytest.mark.parametrize("rows", [1, 2, 127, 129, 300])
def test_a_triangle_is_inverted_in_place(rows):
    rng = np.random.default_rng(rows)
    matrix = np.asfortranarray(rng.normal(size=(rows, rows)) / rows + 2.0 * np.eye(rows))
    before = matrix.copy()
    invert_lower(matrix)
    np.testing.assert_allclose(np.tril(matrix) @ np.tril(before), np.eye(rows), atol=ROUNDING)
    np.testing.assert_array_equal(np.triu(matrix, 1), np.triu(before, 1))


@pytest.mark.parametrize("rows", [1, 2, 95, 97, 300])
def test_a_matrix_is_factorised_in_place(rows):
    rng = np.random.default_rng(rows)
    half = rng.normal(size=(rows, rows))
    matrix = np.asfortranarray(half @ half.T / rows + np.eye(rows))
    before = matrix.copy()
    assert factor_lower(matrix)
    np.testing.assert_allclose(np.tril(matrix), np.linalg.cholesky(before), atol=ROUNDING)
    np.testing.assert_array_equal(np.triu(matrix, 1), np.triu(before, 1))


@pytest.mark.parametrize("place", [0, 120])
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_a_matrix_that_is_not_positive_definite_has_no_factor(place, value):
    matrix = np.asfortranarray(np.eye(200))
    matrix[place, place] = value
    assert not factor_lower(matrix)


@pytest.mark.parametrize(
    "matrix", [np.eye(3, dtype=np.float32), np.ones((2, 3)), np.arange(9.0).reshape(3, 3)]
)
def test_a_matrix_that_cannot_be_inverted_in_place_is_refused(matrix):
    with pytest.raises(InputError, match="square, writeable float64 matrix in Fortran's order"):
        invert_lower(matrix)


def test_factor_inverse_and_determinant_agree_with_numpy(x):
    covariance = KERNEL.value(x, x) + 0.1 * np.eye(len(x))
    own = factorise(KERNEL, 0.1, x)
    inverse = np.linalg.inv(covariance)
    np.testing.assert_allclose(np.tril(own.matrix), np.linalg.cholesky(covariance), atol=ROUNDING)
    assert own.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=ROUNDING)
    np.testing.assert_allclose(np.tril(own.consume()), np.tril(inverse), atol=ROUNDING)


def test_threads_change_nothing(x):
    y = np.random.default_rng(1).normal(size=len(x))
    active = np.ones(len(x), dtype=bool)
    results = [
        MarginalLikelihood(x, y, active=active, threads=count).value_and_gradient(KERNEL, 0.1)
        for count in (1, 2)
    ]
    assert results[0][0] == pytest.approx(results[1][0], rel=ROUNDING)
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=ROUNDING)


def test_predictions_are_the_same_bits_with_any_number_of_threads(x):
    process = GaussianProcess.condition(KERNEL, 0.1, x, x[:, 0])
    new = np.random.default_rng(2).normal(size=(4100, 2))
    one, two = (process.predict(new, threads=count) for count in (1, 2))
    np.testing.assert_array_equal(one.mean, two.mean)
    np.testing.assert_array_equal(one.std, two.std)


def test_small_tasks_and_worker_processes_take_one_thread(monkeypatch):
    assert choose_threads(None, worthwhile=False) == 1
    assert choose_threads(3, worthwhile=False) == 3
    monkeypatch.setattr(tiling.multiprocessing, "parent_process", lambda: "a parent")
    assert choose_threads(None, worthwhile=True) == 1


@pytest.mark.parametrize(
    ("kernel", "x", "cause"),
    [
        (SMOOTH, [[0.0], [1.0], [1.0]], "1 observations repeat another one's inputs"),
        (
            SquaredExponential(variance=1.0, length_scales=1e4, dims=(0,)),
            [[0.0], [1.0], [2.0]],
            r"squared_exponential\.length_scale=10000 is 5000 times what its column spans",
        ),
        (SMOOTH, [[0.0], [1.0], [2.0]], "the noise is 1e-11 of the prior's variance"),
    ],
)
def test_the_cause_of_a_missing_factor_is_named(kernel, x, cause, monkeypatch):
    monkeypatch.setattr(factor, "factor_lower", lambda _: False)
    with pytest.raises(NotPositiveDefiniteError, match=cause):
        factorise(kernel, 1e-11, np.array(x))


def test_an_ill_conditioned_factor_is_solved_with_and_not_inverted():
    x = np.linspace(0.0, 1.0, 40)[:, None]
    process = GaussianProcess.condition(SMOOTH, 1e-13, x, np.sin(x[:, 0]))
    np.testing.assert_allclose(process.predict(x).mean, np.sin(x[:, 0]), atol=1e-5)
    assert factorise(SMOOTH, 1e-13, x).inverse is None
    assert factorise(SMOOTH, 1e-2, x).inverse is not None


def test_nearly_repeated_and_repeated_rows_with_little_noise_have_a_likelihood():
    x = np.repeat(np.linspace(0.0, 1.0, 20), 3)[:, None]
    x[::3] += 1e-13
    y = np.sin(3.0 * x[:, 0])
    likelihood = MarginalLikelihood(x, y, active=np.ones(60, dtype=bool))
    for kernel in (SMOOTH, Exponential(variance=1.0, length_scales=1.0, dims=(0,))):
        value, gradient = likelihood.value_and_gradient(kernel, 1e-8)
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()
