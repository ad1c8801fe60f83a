"""The maximal information coefficient: how strongly two variables depend, in whatever way.

Two variables are laid on a grid; the mutual information of the cells, divided by its largest
possible value, is one entry of the *characteristic matrix*. The coefficient is the largest entry
over all grids of at most B = n^α cells: 1 for noiseless functions, near 0 for independent
variables. Two estimators are in use:

- ``"approx"``, of D. N. Reshef et al., *Detecting novel associations in large data sets*, Science
  334 (2011), 1518–1524, supporting material: one axis is cut into rows of equal counts, the other
  as well as possible, and each size of grid takes the better of the two assignments.
- ``"e"``, MIC_e of Y. A. Reshef et al., *Measuring dependence powerfully and equitably*, Journal
  of Machine Learning Research 17 (2016): only the axis with more parts is cut into equal counts,
  which makes it a consistent estimator. It is the cheaper one.

Only order and ties of the values matter. Turning an axis round can change the value slightly,
since rows of equal counts are filled from the low end. Exchanging x and y changes nothing in the
first estimator, and in the second only which axis of a square grid is optimised: there it is y.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import xlogy

from exposight.compiled import njit
from exposight.errors import InputError, ObservationError
from exposight.statistics.vectors import FloatArray, IntArray, as_floats, check_vector
from exposight.workers import Progress, ignore_progress

Estimator: TypeAlias = Literal["approx", "e"]

_FEWEST = 4
"""Observations of the smallest grid that says anything, 2 × 2."""


def maximal_information_matrix(
    table: ArrayLike,
    *,
    alpha: float = 0.6,
    c: float = 15,
    estimator: Estimator = "approx",
    threads: int = 1,
    progress: Progress = ignore_progress,
) -> FloatArray:
    """Maximal information coefficients of every two columns of a table (paper, Fig. 20).

    Parameters
    ----------
    table : (n, d) array
        One observation a row, one variable a column, in any units.
    alpha : float
        Grids have at most max(n^alpha, 4) cells; above 0, at most 1. The default is that of the
        2011 paper.
    c : float
        The optimised axis is cut at no more than c times as many places as it may get columns;
        above 0. More is slower and finds slightly better grids. The default is that of 2011.
    estimator : {"approx", "e"}
        Of 2011 or of 2016, see above.
    threads : int
        Pairs computed at the same time. The values do not depend on it.
    progress : Progress
        Called with the stage "dependence", pairs done, and all pairs.

    Returns
    -------
    (d, d) array
        From 0 to 1, and symmetric: for "e", which may distinguish x from y, the column further
        left is x. The diagonal is each variable's coefficient with itself: 1, less where most
        observations share a value, 0 where all do.

    Raises
    ------
    ObservationError
        If the table is not two-dimensional, has fewer than four rows or no column, or holds a
        value that is not finite.
    InputError
        If a setting is out of its range.
    """
    values = as_floats(table, "table")
    if values.ndim != 2 or values.shape[1] == 0:
        msg = f"expected a table (n, d) with a variable a column, got shape {values.shape}"
        raise ObservationError(msg)
    if threads < 1:
        msg = f"expected at least one thread, got {threads}; leave it out to use one"
        raise InputError(msg)
    columns = [
        check_vector(column, f"column {j}", fewest=_FEWEST) for j, column in enumerate(values.T)
    ]
    pairs = [(i, j) for i in range(len(columns)) for j in range(i, len(columns))]
    result = np.empty((len(columns), len(columns)))

    def coefficient(pair: tuple[int, int]) -> float:
        x, y = (columns[index] for index in pair)
        matrix = characteristic_matrix(x, y, alpha=alpha, c=c, estimator=estimator)
        return min(float(matrix.max()), 1.0)  # sums of logarithms may exceed it by rounding

    with ThreadPoolExecutor(threads) as pool:
        for done, ((i, j), value) in enumerate(
            zip(pairs, pool.map(coefficient, pairs), strict=True), start=1
        ):
            result[i, j] = result[j, i] = value
            progress("dependence", done, len(pairs))
    return result


def characteristic_matrix(
    x: ArrayLike,
    y: ArrayLike,
    *,
    alpha: float = 0.6,
    c: float = 15,
    estimator: Estimator = "approx",
) -> FloatArray:
    """Normalised mutual information of the best grid of every size.

    Parameters
    ----------
    x, y : (n,) array
        In any units; at least four observations.
    alpha, c, estimator
        As in `maximal_information_matrix`.

    Returns
    -------
    (m, m) array
        Element [i, j] for grids of j + 2 columns along x and i + 2 rows along y; 0 where such a
        grid has more than n^alpha cells. Its largest element is the maximal information
        coefficient, its sum the total information coefficient of the 2016 paper.

    Raises
    ------
    ObservationError, InputError
        As in `maximal_information_matrix`, or if x and y differ in length.
    """
    _check_settings(alpha, c, estimator)
    along_x, along_y = _sort(x, "x"), _sort(y, "y")
    if len(along_x.order) != len(along_y.order):
        msg = (
            f"x and y must hold the same observations, got {len(along_x.order)} and "
            f"{len(along_y.order)} values"
        )
        raise ObservationError(msg)
    n = len(along_x.order)
    cells = max(n**alpha, 4.0)
    # How many columns more than rows may be optimised. For "e" only the axis with fewer parts is,
    # and y where both have equally many.
    more_along_x, more_along_y = (-1, 0) if estimator == "e" else (n, n)
    counts = np.arange(n + 1.0)
    x_log_x = xlogy(counts, counts)
    by_x, by_y = (along_x.order, along_x.starts), (along_y.order, along_y.starts)
    optimised_x = characteristic_one_way(*by_x, *by_y, cells, float(c), more_along_x, x_log_x)
    optimised_y = characteristic_one_way(*by_y, *by_x, cells, float(c), more_along_y, x_log_x)
    return np.maximum(optimised_x, optimised_y.T)


def _check_settings(alpha: float, c: float, estimator: str) -> None:
    if not 0 < alpha <= 1:
        msg = f"alpha must lie above 0 and not above 1, got {alpha}; the paper uses 0.6"
        raise InputError(msg)
    if not 0 < c < np.inf:
        msg = f"c must be a positive number, got {c}; the paper uses 15"
        raise InputError(msg)
    if estimator not in get_args(Estimator):
        msg = f"expected the estimator 'approx' or 'e', got {estimator!r}"
        raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class _Sorted:
    """All that matters of a variable: the order of its values, and where a new value begins."""

    order: IntArray  # (n,) indices, ascending
    starts: IntArray  # (g + 1,) places in that order where a new value begins, and n


def _sort(values: ArrayLike, name: str) -> _Sorted:
    array = check_vector(values, name, fewest=_FEWEST)
    order = np.argsort(array, kind="stable")
    ascending = array[order]
    changes = np.flatnonzero(ascending[1:] != ascending[:-1]) + 1
    return _Sorted(order=order, starts=np.concatenate([[0], changes, [len(array)]]))


@njit(nogil=True)
def characteristic_one_way(
    order: IntArray,
    starts: IntArray,
    row_order: IntArray,
    row_starts: IntArray,
    cells: float,
    c: float,
    more: int,
    x_log_x: FloatArray,
) -> FloatArray:
    """Characteristic matrix of grids with rows of equal counts and the best columns.

    Of at most `cells` cells and at most `more` columns more than rows; elsewhere it is 0.
    """
    n = len(order)
    size = int(cells / 2) - 1
    matrix = np.zeros((size, size))
    for rows in range(2, size + 2):
        affordable = int(cells / rows)
        columns = min(affordable, rows + more)
        if columns < 2:
            continue
        row = _rows_of_equal_counts(row_order, row_starts, rows)
        ends = _superclumps(order, starts, row, max(int(min(c * affordable, n)), 1))
        cumulative = _cumulative_counts(order, row, rows, ends)
        losses = _least_losses(cumulative, ends, columns, x_log_x)
        for j in range(2, columns + 1):
            information = (losses[0] - losses[j - 1]) / n
            matrix[rows - 2, j - 2] = information / np.log(min(rows, j))
    return matrix


@njit(nogil=True)
def _equal_counts(starts: IntArray, parts: int) -> IntArray:
    """Part (0 …) of every group, so that parts of whole groups hold about equally many points."""
    left = starts[-1]
    part = np.empty(len(starts) - 1, dtype=np.int64)
    current = filled = 0
    wanted = left / parts
    for group in range(len(part)):
        size = starts[group + 1] - starts[group]
        if filled > 0 and abs(filled + size - wanted) >= abs(filled - wanted):
            current += 1
            filled = 0
            wanted = left / (parts - current)
        part[group] = current
        filled += size
        left -= size
    return part


@njit(nogil=True)
def _rows_of_equal_counts(order: IntArray, starts: IntArray, rows: int) -> IntArray:
    """Row of every point; equal values share a row."""
    part = _equal_counts(starts, rows)
    row = np.empty(len(order), dtype=np.int64)
    for group in range(len(part)):
        for place in range(starts[group], starts[group + 1]):
            row[order[place]] = part[group]
    return row


@njit(nogil=True)
def _superclumps(order: IntArray, starts: IntArray, row: IntArray, most: int) -> IntArray:
    """Places where the columns may be cut, with 0 and n.

    A best grid never cuts a clump, a run of points of the same row; values that several points
    share cannot be cut either. Where there are more clumps than allowed, neighbours are joined.
    """
    clumps: IntArray = np.empty(len(starts), dtype=np.int64)
    found = 0
    before = -1
    for group in range(len(starts) - 1):
        label = row[order[starts[group]]]
        for place in range(starts[group] + 1, starts[group + 1]):
            if row[order[place]] != label:
                label = -2 - group  # a shared value in several rows, a clump of its own
                break
        if label != before:
            clumps[found] = starts[group]
            found += 1
        before = label
    clumps[found] = len(order)
    clumps = clumps[: found + 1]
    if found <= most:
        return clumps
    part = _equal_counts(clumps, most)
    ends = np.empty(part[-1] + 2, dtype=np.int64)
    ends[0] = 0
    for clump in range(found):
        ends[part[clump] + 1] = clumps[clump + 1]
    return ends


@njit(nogil=True)
def _cumulative_counts(order: IntArray, row: IntArray, rows: int, ends: IntArray) -> IntArray:
    """Points of every row before every cut: (rows, len(ends))."""
    cumulative = np.zeros((rows, len(ends)), dtype=np.int64)
    for cut in range(1, len(ends)):
        for r in range(rows):
            cumulative[r, cut] = cumulative[r, cut - 1]
        for place in range(ends[cut - 1], ends[cut]):
            cumulative[row[order[place]], cut] += 1
    return cumulative


@njit(nogil=True)
def _least_losses(
    cumulative: IntArray, ends: IntArray, columns: int, x_log_x: FloatArray
) -> FloatArray:
    """Entropy of the rows that remains, n H(rows | columns), for at most 1, 2, … columns.

    Dynamic programming over the last cut: the best l columns up to a cut are the best l − 1 up to
    an earlier one, and a column between the two. This loop is where the time goes.
    """
    rows, cuts = cumulative.shape
    best = np.zeros((cuts, columns))
    loss = np.empty(cuts)  # of the column from an earlier cut to this one
    for cut in range(1, cuts):
        for start in range(cut):
            loss[start] = x_log_x[ends[cut] - ends[start]]
        for r in range(rows):
            total = cumulative[r, cut]
            for start in range(cut):
                loss[start] -= x_log_x[total - cumulative[r, start]]
        here = best[cut]
        here[:] = loss[0]
        for start in range(1, cut):
            before = best[start]
            for extra in range(1, columns):  # side by side in memory, so several at a time
                here[extra] = min(here[extra], before[extra - 1] + loss[start])
    least: FloatArray = best[-1]
    return least
