"""The maximal information coefficient against reference values, an exhaustive search, and laws."""

import csv
import json
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import entropy
from sklearn.metrics import mutual_info_score

from exposight.errors import InputError, ObservationError
from exposight.statistics import characteristic_matrix, maximal_information_matrix

# Sums of a few hundred terms n log n in another order.
ROUNDING = 1e-12
# The reference tables hold ten digits; total information coefficients reach 50.
TEN_DIGITS = 6e-9

ESTIMATORS = ("approx", "e")
estimators = pytest.mark.parametrize("estimator", ESTIMATORS)
laws = settings(max_examples=40, deadline=None)


def mic(x, y, **settings):
    """The largest entry, 1 at most: a sum of logarithms may exceed it by rounding."""
    return min(characteristic_matrix(x, y, **settings).max(), 1.0)


@st.composite
def pairs(draw):
    n = draw(st.integers(4, 60))
    values = st.lists(st.integers(-20, 20), min_size=n, max_size=n)
    return np.array(draw(values)), np.array(draw(values))


@estimators
def test_reference_vectors(reference_data, estimator):
    vectors = json.loads((reference_data / "mic" / "small_vectors.json").read_text())
    for vector in vectors:
        ours = mic(
            vector["x"], vector["y"], alpha=vector["alpha"], c=vector["c"], estimator=estimator
        )
        assert ours == pytest.approx(vector[f"mic_{estimator}"], abs=ROUNDING)


@estimators
def test_reference_shapes_and_their_whole_matrices(reference_data, estimator):
    folder = reference_data / "mic"
    points = np.genfromtxt(folder / "datasaurus_xy.csv", delimiter=",", names=True)
    with (folder / "datasaurus_mine_values.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["estimator"] == f"mic_{estimator}"]
    assert len(rows) == 39
    for row in rows:
        matrix = characteristic_matrix(
            points[f"{row['pair']}_x"],
            points[f"{row['pair']}_y"],
            alpha=float(row["alpha"]),
            c=float(row["c"]),
            estimator=estimator,
        )
        assert matrix.max() == pytest.approx(float(row["MIC"]), abs=TEN_DIGITS)
        assert matrix.sum() == pytest.approx(float(row["TIC"]), abs=TEN_DIGITS)


def test_a_thousand_reference_points(reference_data):
    points = np.genfromtxt(
        reference_data / "mic" / "python_example_xy.csv", delimiter=",", names=True
    )
    # The values that minepy's documentation prints for this example.
    assert mic(points["x"], points["y_clean"]) == pytest.approx(1.0, abs=ROUNDING)
    assert mic(points["x"], points["y_noisy"]) == pytest.approx(0.505716693417, abs=1e-11)


def best_by_trying_all(ranks, of_rows, columns):
    """Largest mutual information of given rows with any partition into columns."""
    n = len(ranks)
    partitions = (np.searchsorted(cuts, ranks) for cuts in combinations(range(n - 1), columns - 1))
    return max(mutual_info_score(of_rows, column) for column in partitions)


# Twelve points fall into so many rows or columns evenly, hence without a choice.
@pytest.mark.parametrize("size", [(2, 2), (2, 3), (3, 2), (3, 3), (2, 4), (3, 4), (4, 3), (6, 2)])
def test_an_exhaustive_search_finds_no_better_grid(size):
    rows, columns = size
    x, y = np.random.default_rng(5).permuted(np.tile(np.arange(12), (2, 1)), axis=1)
    along_x = best_by_trying_all(x, y * rows // 12, columns) / np.log(min(size))
    along_y = best_by_trying_all(y, x * columns // 12, rows) / np.log(min(size))
    approx = characteristic_matrix(x, y, alpha=1, c=100)
    assert approx[rows - 2, columns - 2] == pytest.approx(max(along_x, along_y), abs=ROUNDING)
    consistent = characteristic_matrix(x, y, alpha=1, c=100, estimator="e")
    fewer = along_x if columns < rows else along_y
    assert consistent[rows - 2, columns - 2] == pytest.approx(fewer, abs=ROUNDING)


def test_grids_too_fine_are_left_out():
    x = np.arange(12)
    matrix = characteristic_matrix(x, x, alpha=1)
    sizes = np.outer(np.arange(2, 7), np.arange(2, 7))
    np.testing.assert_array_equal(matrix > 0, sizes <= 12)


@estimators
@pytest.mark.parametrize("function", [np.exp, np.negative, lambda x: np.floor(4 * x)])
def test_a_noiseless_monotone_function_is_one(function, estimator):
    x = np.arange(64) / 64
    assert mic(x, function(x), estimator=estimator) == pytest.approx(1.0, abs=ROUNDING)


def test_a_noiseless_function_with_turns_is_one():
    x = np.linspace(-1, 1, 400)
    assert mic(x, x**2) == pytest.approx(1.0, abs=ROUNDING)
    assert mic(x, np.sin(6 * x)) == pytest.approx(1.0, abs=ROUNDING)


@estimators
def test_all_combinations_equally_often_are_zero(estimator):
    x, y = np.meshgrid(np.arange(2), np.arange(3))
    repeated = np.tile(x.ravel(), 10), np.tile(y.ravel(), 10)
    assert mic(*repeated, estimator=estimator) == pytest.approx(0.0, abs=ROUNDING)


@estimators
def test_two_values_share_their_entropy(estimator):
    x = np.repeat([0.0, 1.0], [12, 4])
    expected = entropy([0.75, 0.25], base=2)
    assert mic(x, 5 - x, estimator=estimator) == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize(("estimator", "bound"), [("approx", 0.12), ("e", 0.06)])
def test_independent_variables_are_small(estimator, bound):
    x, y = np.random.default_rng(3).normal(size=(2, 3000))
    assert mic(x, y, estimator=estimator) < bound


@estimators
def test_a_variable_that_does_not_vary_is_zero(estimator):
    assert mic(np.full(9, 0.1), np.arange(9), estimator=estimator) == 0.0
    assert mic(np.arange(9), np.full(9, 0.1), estimator=estimator) == 0.0


@laws
@given(pair=pairs(), estimator=st.sampled_from(ESTIMATORS), alpha=st.sampled_from([0.3, 0.6, 1]))
def test_between_zero_and_one(pair, estimator, alpha):
    assert 0.0 <= mic(*pair, alpha=alpha, c=3, estimator=estimator) <= 1.0


@laws
@given(pair=pairs())
def test_exchanging_the_variables_transposes(pair):
    x, y = pair
    np.testing.assert_array_equal(characteristic_matrix(y, x), characteristic_matrix(x, y).T)
    assert mic(x, y) == mic(y, x)


@laws
@given(pair=pairs())
def test_exchanging_the_variables_changes_square_grids_only_in_the_second_estimator(pair):
    x, y = pair
    change = (
        characteristic_matrix(y, x, estimator="e") - characteristic_matrix(x, y, estimator="e").T
    )
    np.fill_diagonal(change, 0.0)
    assert not change.any()


@laws
@given(pair=pairs(), estimator=st.sampled_from(ESTIMATORS))
def test_increasing_functions_change_nothing(pair, estimator):
    x, y = pair
    value = mic(x, y, estimator=estimator)
    assert mic(x**3, y, estimator=estimator) == value
    assert mic(x, np.exp(y), estimator=estimator) == value


@laws
@given(pair=pairs(), estimator=st.sampled_from(ESTIMATORS), seed=st.integers(0, 100))
def test_the_order_of_observations_changes_nothing(pair, estimator, seed):
    x, y = pair
    order = np.random.default_rng(seed).permutation(len(x))
    assert mic(x[order], y[order], estimator=estimator) == mic(x, y, estimator=estimator)


@estimators
def test_a_table_holds_the_coefficients_of_its_columns(estimator):
    table = np.random.default_rng(2).integers(0, 30, size=(80, 3))
    result = maximal_information_matrix(table, estimator=estimator)
    for i in range(3):
        for j in range(i, 3):
            expected = mic(table[:, i], table[:, j], estimator=estimator)
            assert result[i, j] == result[j, i] == expected


def test_threads_change_no_bit():
    table = np.random.default_rng(4).normal(size=(60, 5))
    one = maximal_information_matrix(table)
    np.testing.assert_array_equal(maximal_information_matrix(table, threads=3), one)


def test_a_table_reports_progress():
    seen = []
    table = np.random.default_rng(4).normal(size=(20, 2))
    maximal_information_matrix(table, progress=lambda *step: seen.append(step))
    assert seen == [("dependence", done, 3) for done in (1, 2, 3)]


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([1, 2, 3], [1, 2, 3], r"x must be a vector of at least 4 numbers, got shape \(3,\)"),
        (np.zeros((4, 2)), np.zeros(4), r"x must be a vector .* got shape \(4, 2\)"),
        (np.arange(5), np.arange(6), "same observations, got 5 and 6 values"),
        (np.arange(4), [0, 1, np.nan, 2], "y must be finite, got nan in row 2; leave"),
        (np.arange(4), [0, 1, 2, np.inf], "y must be finite, got inf in row 3"),
        (["a", "b", "c", "d"], np.arange(4), "x must be an array of numbers"),
    ],
)
def test_data_that_cannot_be_used(x, y, message):
    with pytest.raises(ObservationError, match=message):
        mic(x, y)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (np.zeros(5), r"expected a table \(n, d\).* got shape \(5,\)"),
        (np.zeros((5, 0)), r"expected a table \(n, d\)"),
        (np.zeros((3, 2)), "column 0 must be a vector of at least 4"),
        ([[0, 1], [1, np.nan], [2, 0], [3, 3]], "column 1 must be finite, got nan in row 1"),
    ],
)
def test_tables_that_cannot_be_used(table, message):
    with pytest.raises(ObservationError, match=message):
        maximal_information_matrix(table)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"alpha": 0.0}, "alpha must lie above 0 and not above 1, got 0.0"),
        ({"alpha": 1.5}, "alpha must lie above 0"),
        ({"alpha": np.nan}, "alpha must lie above 0"),
        ({"c": 0}, "c must be a positive number, got 0"),
        ({"estimator": "mic_e"}, "'approx' or 'e', got 'mic_e'"),
        ({"threads": 0}, "at least one thread, got 0"),
    ],
)
def test_settings_out_of_range(choice, message):
    with pytest.raises(InputError, match=message):
        maximal_information_matrix(np.zeros((5, 2)), **choice)
