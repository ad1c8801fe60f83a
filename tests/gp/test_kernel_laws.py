"""The laws that every kernel obeys, on random trees over three columns."""

import json
from dataclasses import dataclass
from typing import ClassVar
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from exposight.gp import (
    Category,
    ChangePoint,
    Exponential,
    Kernel,
    Leaf,
    Linear,
    Matern32,
    Matern52,
    Quantity,
    RationalQuadratic,
    SquaredExponential,
    kernel_from_dict,
    register_kernel,
    tiling,
)
from exposight.gp.likelihood import MarginalLikelihood

# Sums of a dozen products in float64.
ROUNDING = 1e-12
# Central differences over 1e-5 of a logarithm: truncation 1e-10, cancellation 1e-11, and room for
# values of several hundred.
FINITE_DIFFERENCE = 1e-7

COLUMNS = 3


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Slopes(Leaf):
    """A kernel that exposight does not know, sum_d sigma_d² |x_d x'_d|^power."""

    variances: tuple[float, ...]
    power: float
    dims: tuple[int, ...]
    fixed: tuple[str, ...] = ()
    type_name: ClassVar[str] = "tests/slopes"
    quantities = {"variances": Quantity.SLOPE_VARIANCE, "power": Quantity.ALPHA}  # noqa: RUF012

    def parts(self, x, y):
        product = np.abs(x[:, None, self.dims] * y[None, :, self.dims])
        return product, np.array(self.variances) * product**self.power

    def fill(self, x, y, out):
        out[:] = self.parts(x, y)[1].sum(axis=2)

    def derivatives(self, x, y, weights):
        product, terms = self.parts(x, y)
        by_power = self.power * terms * np.log(product)
        return np.append(np.einsum("ij,ijd->d", weights, terms), np.sum(weights * by_power.sum(2)))

    def prior_variance(self, x):
        return np.abs(x[:, self.dims]) ** (2 * self.power) @ np.array(self.variances)


positive = st.floats(0.2, 5.0)
dims = st.lists(st.integers(0, COLUMNS - 1), min_size=1, max_size=COLUMNS, unique=True)


@st.composite
def stationary(draw: st.DrawFn) -> Kernel:
    kernel = draw(
        st.sampled_from([Exponential, Matern32, Matern52, RationalQuadratic, SquaredExponential])
    )
    own = tuple(draw(dims))
    count = draw(st.sampled_from([1, len(own)]))
    fields = ["variance", "length_scales"]
    values = {}
    if kernel is RationalQuadratic:
        fields.append("alpha")
        values["alpha"] = draw(positive)
    return kernel(
        variance=draw(positive),
        length_scales=tuple(draw(positive) for _ in range(count)),
        dims=own,
        fixed=tuple(draw(st.lists(st.sampled_from(fields), max_size=2, unique=True))),
        **values,
    )


@st.composite
def linear(draw: st.DrawFn) -> Kernel:
    own = tuple(draw(dims))
    return Linear(variances=tuple(draw(positive) for _ in own), dims=own)


change_points = st.builds(
    ChangePoint,
    dim=st.integers(0, COLUMNS - 1),
    minimum=st.one_of(st.none(), st.floats(-2.0, 0.0)),
    maximum=st.floats(0.5, 2.0),
)


@st.composite
def slopes(draw: st.DrawFn) -> Kernel:
    return Slopes(
        variances=tuple(draw(st.lists(positive, min_size=2, max_size=2))),
        power=draw(st.floats(0.5, 1.5)),
        dims=(2, 0),
        fixed=draw(st.sampled_from([(), ("power",), ("variances",)])),
    )


categories = st.builds(
    Category,
    variance=positive,
    dim=st.integers(0, COLUMNS),
    fixed=st.sampled_from([(), ("variance",)]),
)

kernels = st.recursive(
    st.one_of(stationary(), linear(), change_points, categories, slopes()),
    lambda children: st.one_of(
        st.tuples(children, children).map(lambda pair: pair[0] * pair[1]),
        st.tuples(children, children).map(lambda pair: pair[0] + pair[1]),
    ),
    max_leaves=4,
)


def inputs(seed: int, rows: int = 12) -> np.ndarray:
    """Normal inputs and a column of categories, the last row a copy of the first."""
    rng = np.random.default_rng(seed)
    x = np.column_stack([rng.normal(size=(rows, COLUMNS)), rng.integers(0, 3, size=rows)])
    x[-1] = x[0]
    return x


seeds = st.integers(0, 10_000)
laws = settings(max_examples=40, deadline=None)


def scale_of(kernel: Kernel, x: np.ndarray) -> float:
    return 1.0 + float(kernel.prior_variance(x).max())


@laws
@given(kernel=kernels, seed=seeds)
def test_the_covariance_is_symmetric(kernel, seed):
    x, y = inputs(seed), inputs(seed + 1, rows=7)
    tolerance = ROUNDING * scale_of(kernel, np.vstack([x, y]))
    np.testing.assert_allclose(kernel.value(x, y), kernel.value(y, x).T, rtol=0, atol=tolerance)


@laws
@given(kernel=kernels, seed=seeds)
def test_the_covariance_is_positive_semidefinite(kernel, seed):
    x = inputs(seed)
    covariance = kernel.value(x, x)
    eigenvalues = np.linalg.eigvalsh(0.5 * (covariance + covariance.T))
    assert eigenvalues.min() >= -100 * ROUNDING * scale_of(kernel, x)


@laws
@given(kernel=kernels, seed=seeds)
def test_the_prior_variance_is_the_covariances_diagonal(kernel, seed):
    x = inputs(seed)
    np.testing.assert_allclose(
        kernel.prior_variance(x),
        np.diag(kernel.value(x, x)),
        rtol=0,
        atol=ROUNDING * scale_of(kernel, x),
    )


@laws
@given(kernel=kernels, seed=seeds)
def test_gated_rows_are_zero_and_change_nothing_else(kernel, seed):
    x = inputs(seed)
    gated = kernel.gate(x)
    assert not kernel.value(x, x)[gated].any()
    np.testing.assert_array_equal(kernel.prior_variance(x)[gated], 0.0)


def pair(rows: int, i: int, j: int) -> np.ndarray:
    weights = np.zeros((rows, rows))
    weights[i, j] = 1.0
    return weights


@laws
@given(kernel=kernels, seed=seeds)
def test_derivatives_match_finite_differences(kernel, seed):
    x, logs, step = inputs(seed), kernel.log_parameters, 1e-5
    weights = np.random.default_rng(seed).normal(size=(len(x), len(x)))
    numeric = [
        np.sum(
            weights
            * (
                kernel.with_log_parameters(logs + shift).value(x, x)
                - kernel.with_log_parameters(logs - shift).value(x, x)
            )
        )
        / (2 * step)
        for shift in step * np.eye(len(logs))
    ]
    np.testing.assert_allclose(
        kernel.weigh(x, x, weights.copy()),
        numeric,
        rtol=0,
        # the sum of 144 differences
        atol=12 * FINITE_DIFFERENCE * scale_of(kernel, x),
    )


@laws
@given(kernel=kernels, seed=seeds)
def test_each_pair_has_its_own_derivative(kernel, seed):
    x = inputs(seed, rows=4)
    weights = np.random.default_rng(seed).normal(size=(4, 4))
    expected = sum(
        weights[i, j] * kernel.weigh(x, x, pair(4, i, j)) for i in range(4) for j in range(4)
    )
    np.testing.assert_allclose(
        kernel.weigh(x, x, weights.copy()),
        expected,
        rtol=0,
        atol=1e3 * ROUNDING * scale_of(kernel, x),
    )


@laws
@given(kernel=kernels, seed=seeds)
def test_the_gradient_of_the_likelihood_matches_finite_differences(kernel, seed):
    x = inputs(seed)
    y = np.random.default_rng(seed + 1).normal(size=len(x))
    likelihood = MarginalLikelihood(x, y, active=~kernel.gate(x))
    assume(not kernel.gate(x).all())
    logs = np.append(kernel.log_parameters, np.log(0.3))

    def evaluate(vector):
        return likelihood.value_and_gradient(
            kernel.with_log_parameters(vector[:-1]), np.exp(vector[-1])
        )

    step = 1e-5
    numeric = [
        (evaluate(logs + shift)[0] - evaluate(logs - shift)[0]) / (2 * step)
        for shift in step * np.eye(len(logs))
    ]
    # values up to a hundred, noise a tenth of the prior's variance
    np.testing.assert_allclose(evaluate(logs)[1], numeric, rtol=1e-6, atol=1e-6)


@laws
@given(kernel=kernels, seed=seeds)
def test_tiles_change_nothing(kernel, seed):
    x, y = inputs(seed, rows=9), inputs(seed + 1, rows=11)
    assume(not kernel.gate(x).all())
    likelihood = MarginalLikelihood(x, y[:9, 0], active=~kernel.gate(x))
    covariances, evaluation = kernel.value(x, y), likelihood.value_and_gradient(kernel, 0.3)
    with mock.patch.multiple(tiling, _ROWS=4, _COLUMNS=3):
        tiled, tiled_evaluation = kernel.value(x, y), likelihood.value_and_gradient(kernel, 0.3)
    tolerance = ROUNDING * scale_of(kernel, np.vstack([x, y]))
    np.testing.assert_allclose(tiled, covariances, rtol=0, atol=tolerance)
    # with noise far below the variance of the prior
    np.testing.assert_allclose(tiled_evaluation[0], evaluation[0], rtol=1e-8)
    np.testing.assert_allclose(tiled_evaluation[1], evaluation[1], rtol=1e-6, atol=1e-6)


@laws
@given(kernel=kernels)
def test_the_description_survives_json(kernel):
    assert kernel_from_dict(json.loads(json.dumps(kernel.to_dict()))) == kernel


@laws
@given(kernel=kernels)
def test_parameters_are_named_apart_and_ordered_as_the_logarithms(kernel):
    names = [parameter.name for parameter in kernel.parameters]
    assert len(set(names)) == len(names)
    moved = kernel.with_log_parameters(kernel.log_parameters + 0.5)
    for before, after in zip(kernel.parameters, moved.parameters, strict=True):
        factor = np.exp(0.5) if before.free else 1.0
        assert after.value == pytest.approx(factor * before.value)
        assert after.name == before.name
