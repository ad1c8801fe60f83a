"""Closed forms of the single kernels, and what they refuse."""

import numpy as np
import pytest

from exposight.errors import InputError, ObservationError
from exposight.gp import (
    Category,
    ChangePoint,
    Exponential,
    GaussianProcess,
    Linear,
    Matern32,
    Matern52,
    Product,
    RationalQuadratic,
    SquaredExponential,
    Sum,
    gpy_length_scale,
    kernel_from_dict,
)

ORIGIN = np.zeros((1, 2))
# (3/3, 8/4): r² = 1 + 4, with length scales 3 and 4
POINT = np.array([[3.0, 8.0]])
R = np.sqrt(5.0)
ARD = {"variance": 2.0, "length_scales": (3.0, 4.0), "dims": (0, 1)}


@pytest.mark.parametrize(
    ("kernel", "expected"),
    [
        (SquaredExponential(**ARD), 2.0 * np.exp(-(R**2) / 2)),
        (Exponential(**ARD), 2.0 * np.exp(-R)),
        (Matern32(**ARD), 2.0 * (1 + np.sqrt(3) * R) * np.exp(-np.sqrt(3) * R)),
        (Matern52(**ARD), 2.0 * (1 + np.sqrt(5) * R + 5 * R**2 / 3) * np.exp(-np.sqrt(5) * R)),
        (RationalQuadratic(**ARD, alpha=0.7), 2.0 * (1 + R**2 / 1.4) ** -0.7),
        (Linear(variances=(2.0, 0.5), dims=(0, 1)), 0.0),
    ],
)
def test_closed_forms(kernel, expected):
    assert kernel.value(ORIGIN, POINT)[0, 0] == pytest.approx(expected, rel=1e-14)


def test_linear_weighs_every_column():
    kernel = Linear(variances=(2.0, 0.5), dims=(0, 1))
    assert kernel.value(POINT, np.array([[1.0, -2.0]]))[0, 0] == pytest.approx(2 * 3 - 0.5 * 16)


def test_only_rows_of_one_category_vary_together():
    kernel, codes = Category(variance=2.0, dim=1), np.array([[5.0, 0], [6.0, 1], [7.0, 0]])
    np.testing.assert_array_equal(kernel.value(codes, codes), [[2, 0, 2], [0, 2, 0], [2, 0, 2]])


def test_a_category_shifts_its_observations_and_tells_nothing_of_others():
    process = GaussianProcess.condition(
        Category(variance=4.0, dim=0), 0.5, [[0.0], [0.0], [3.0]], [1.0, 2.0, -5.0]
    )
    prediction = process.predict([[0.0], [3.0], [7.0]])
    # the mean of a group's n targets, shrunk by n v / (n v + noise)
    np.testing.assert_allclose(prediction.mean, [1.5 * 8.0 / 8.5, -5.0 * 4.0 / 4.5, 0.0])
    np.testing.assert_allclose(prediction.std**2, [4.0 * 0.5 / 8.5, 4.0 * 0.5 / 4.5, 4.0])


def test_a_single_length_scale_serves_all_dimensions():
    isotropic = Exponential(variance=2.0, length_scales=(3.0,), dims=(0, 1))
    assert isotropic.value(ORIGIN, POINT)[0, 0] == pytest.approx(2 * np.exp(-np.sqrt(73.0) / 3))


def test_columns_outside_dims_do_not_matter():
    kernel = Exponential(variance=2.0, length_scales=(3.0,), dims=(1,))
    x = np.array([[1.0, 5.0], [-7.0, 5.0]])
    assert kernel.value(x, x)[0, 1] == 2.0


def test_the_rational_quadratic_nears_the_squared_exponential():
    nearly = RationalQuadratic(**ARD, alpha=1e9).value(ORIGIN, POINT)
    np.testing.assert_allclose(nearly, SquaredExponential(**ARD).value(ORIGIN, POINT), rtol=1e-8)


def test_the_printed_form_of_eq_18_is_a_rescaled_squared_exponential():
    length_scale, distance = 40.0, 25.0
    kernel = SquaredExponential(variance=3.0, length_scales=length_scale / np.sqrt(2), dims=(0,))
    printed = 3.0 * np.exp(-((distance / length_scale) ** 2))
    assert kernel.value([[0.0]], [[distance]])[0, 0] == pytest.approx(printed, rel=1e-14)


def test_table_8_varies_by_20_ms_over_100_mm_with_the_exponential_kernel():
    table_8 = {"variance": 1.14e6, "length_scales": 5.45e5, "dims": (0,)}
    x = np.array([[0.0], [100.0]])
    spread = {}
    for kernel in (Exponential(**table_8), SquaredExponential(**table_8)):
        value = kernel.value(x, x)
        spread[type(kernel)] = np.sqrt(2 * (value[0, 0] - value[0, 1]))
    assert spread[Exponential] == pytest.approx(20.0, abs=1.0)
    assert spread[SquaredExponential] < 0.3


def test_the_exponential_gradient_survives_pairs_that_differ_by_rounding():
    x = np.array([[300.0, 1.0], [np.nextafter(300.0, 301.0), 1.0], [250.0, 2.0]])
    kernel = Exponential(variance=1.0, length_scales=(80.0, 1.0), dims=(0, 1))
    apart = kernel.weigh(x[[0, 2]], x[[0, 2]], np.ones((2, 2)))
    # the coincident pair counts as one row of double weight
    weights = np.array([[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]])
    np.testing.assert_allclose(kernel.weigh(x, x, weights)[1:], apart[1:], rtol=1e-12)


def test_gpys_length_scale_is_larger_by_the_root_of_alpha():
    assert gpy_length_scale(3.0, alpha=0.25) == pytest.approx(1.5)
    with pytest.raises(InputError, match="length_scale and alpha must be positive"):
        gpy_length_scale(3.0, alpha=-1.0)


def test_a_gate_includes_its_limits():
    gate = ChangePoint(dim=0, minimum=10.0, maximum=255.0)
    column = np.array([[9.999], [10.0], [255.0], [255.001]])
    np.testing.assert_array_equal(gate.gate(column), [True, False, False, True])


def test_a_product_of_gates_is_closed_where_one_is():
    gates = ChangePoint(dim=0, minimum=10.0) * ChangePoint(dim=0, maximum=255.0)
    column = np.array([[5.0], [100.0], [300.0]])
    np.testing.assert_array_equal(gates.gate(column), [True, False, True])
    np.testing.assert_array_equal(gates.value(column, column), np.diag([0.0, 1.0, 0.0]))


def test_a_sum_is_closed_only_where_all_terms_are():
    term = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
    gated = term * ChangePoint(dim=0, minimum=0.0)
    assert not (gated + term).gate([[-1.0]])[0]
    assert (gated + gated).gate([[-1.0]])[0]


def test_products_and_sums_are_flat():
    one = Linear(variances=(1.0,), dims=(0,))
    assert (one * one * one).factors == (one, one, one)
    assert (one + (one + one)).terms == (one, one, one)


def test_columns_are_those_of_all_leaves():
    kernel = Linear(variances=(1.0,), dims=(4,)) * ChangePoint(dim=0, minimum=1.0)
    assert kernel.columns == (0, 4)


def test_parameter_names_hold_the_column_and_number_repeated_kernels():
    kernel = Exponential(variance=1.0, length_scales=(2.0,), dims=(0,)) * Exponential(
        variance=3.0, length_scales=(4.0, 5.0), dims=(2, 1), fixed=("variance",)
    )
    assert {parameter.name: parameter.value for parameter in kernel.parameters} == {
        "exponential_1.variance": 1.0,
        "exponential_1.length_scale": 2.0,
        "exponential_2.variance": 3.0,
        "exponential_2.length_scale[2]": 4.0,
        "exponential_2.length_scale[1]": 5.0,
    }
    assert [parameter.name for parameter in kernel.parameters if not parameter.free] == [
        "exponential_2.variance"
    ]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"variance": -1.0}, r"Exponential\.variance must be positive and finite, got"),
        ({"variance": "much"}, "must be positive numbers"),
        ({"length_scales": (1.0, 0.0)}, r"Exponential\.length_scales must be positive"),
        ({"length_scales": (1.0, float("nan"))}, "must be positive and finite"),
        ({"length_scales": ()}, "must be positive and finite"),
        ({"length_scales": (1.0, 2.0, 3.0)}, "takes 1 length scale or 2, got 3"),
        ({"dims": ()}, "must name columns from 0 on, each once"),
        ({"dims": (1, 1)}, "must name columns from 0 on, each once"),
        ({"dims": (-1, 0)}, "must name columns from 0 on"),
        ({"dims": (0.5, 1)}, "must be whole numbers"),
        ({"fixed": ("alpha",)}, "with names out of variance, length_scales"),
        ({"fixed": "variance"}, "takes a tuple"),
    ],
)
def test_a_stationary_kernel_refuses(changed, message):
    with pytest.raises(InputError, match=message):
        Exponential(**{**ARD, **changed})


def test_a_negative_alpha_is_refused():
    with pytest.raises(InputError, match=r"RationalQuadratic\.alpha must be positive"):
        RationalQuadratic(**ARD, alpha=-0.5)


def test_a_linear_kernel_wants_a_variance_for_each_dimension():
    with pytest.raises(InputError, match="over 2 dimensions takes as many variances, got 1"):
        Linear(variances=(1.0,), dims=(0, 1))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({}, "takes a finite minimum, maximum or both"),
        ({"minimum": float("nan")}, "takes a finite minimum"),
        ({"minimum": 5.0, "maximum": 5.0}, "must lie below its maximum"),
    ],
)
def test_a_change_point_refuses(limits, message):
    with pytest.raises(InputError, match=message):
        ChangePoint(dim=0, **limits)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"variance": 0.0}, r"Category\.variance must be positive"),
        ({"dim": 0.5}, "must be whole numbers"),
        ({"fixed": ("dim",)}, "with names out of variance"),
    ],
)
def test_a_category_refuses(changed, message):
    with pytest.raises(InputError, match=message):
        Category(**{"variance": 1.0, "dim": 0, **changed})


@pytest.mark.parametrize("tree", [Product, Sum])
def test_a_tree_of_one_kernel_is_refused(tree):
    field = "factors" if tree is Product else "terms"
    with pytest.raises(InputError, match=f"at least two {field} are needed"):
        tree(**{field: (SquaredExponential(**ARD),)})


def test_a_factor_that_is_no_kernel_is_refused():
    with pytest.raises(InputError, match="factors must be kernels, got float"):
        Product(factors=(SquaredExponential(**ARD), 2.0))


def test_a_column_that_is_not_there_is_named():
    with pytest.raises(ObservationError, match=r"reads column 1 .* but x has 1 columns"):
        SquaredExponential(**ARD).value([[1.0]], [[1.0]])


@pytest.mark.parametrize("vector", [[0.0], [0.0, 0.0, float("nan")]])
def test_logarithms_that_do_not_fit_are_refused(vector):
    with pytest.raises(InputError, match=r"expected 3 finite logarithms .*length_scale\[1\]"):
        SquaredExponential(**ARD).with_log_parameters(vector)


@pytest.mark.parametrize(
    ("description", "message"),
    [
        ({"type": "periodic"}, "unknown kernel type 'periodic'; known are category, change_point"),
        ({"type": ["linear"]}, "unknown kernel type"),
        ({"variance": 1.0}, "needs the key 'type'"),
        ([], "described by a mapping, got list"),
        ({"type": "linear", "dims": [0]}, r"lacks \['variances'\]"),
        ({"type": "change_point", "dim": 0, "minimum": 1, "step": 2}, r"unexpected \['step'\]"),
        ({"type": "product"}, r"lacks \['factors'\]"),
        ({"type": "sum", "terms": "linear"}, "terms must be kernels, got str"),
        ({"type": "linear", "dims": [0], "variances": [-1.0]}, "must be positive"),
    ],
)
def test_a_description_that_is_no_kernel_is_refused(description, message):
    with pytest.raises(InputError, match=message):
        kernel_from_dict(description)
