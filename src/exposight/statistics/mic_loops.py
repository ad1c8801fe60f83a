"""Compiled loops of the maximal information coefficient; they release Python's lock."""

import numpy as np

from exposight.compiled import njit
from exposight.statistics.vectors import FloatArray, IntArray


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
    clumps = np.empty(len(starts), dtype=np.int64)
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
