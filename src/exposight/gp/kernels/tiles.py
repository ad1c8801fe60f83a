"""A covariance matrix, tile by tile, so that what a tile needs stays in the processor's cache."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from exposight.gp.observations import FloatArray

# Half a MB each for values and weights together, small beside a core's second cache; columns are
# scaled once for all rows of a tile.
_ROWS, _COLUMNS = 64, 1024


class Tileable(Protocol):
    """What this module asks of a kernel."""

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """Write the covariances of checked inputs into a tile in C order."""

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Sum the weighted derivatives of the covariances in a tile."""


def tile(kernel: Tileable, x: FloatArray, y: FloatArray) -> FloatArray:
    """Covariances of few inputs, in a fresh array.

    Parameters
    ----------
    kernel : Tileable
    x, y : (n, D) and (m, D) array
        Checked inputs in C order.

    Returns
    -------
    (n, m) array
    """
    out = np.empty((len(x), len(y)))
    kernel.fill(x, y, out)
    return out


def row_blocks(rows: int) -> list[slice]:
    """Split rows into blocks, each as high as a tile."""
    return [slice(start, min(start + _ROWS, rows)) for start in range(0, rows, _ROWS)]


def _column_blocks(first: int, columns: int) -> Iterator[slice]:
    for start in range(first, columns, _COLUMNS):
        yield slice(start, min(start + _COLUMNS, columns))


def fill(kernel: Tileable, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
    """Write the covariance of every row of `x` with every row of `y`.

    Parameters
    ----------
    kernel : Tileable
    x, y : (n, D) and (m, D) array
        Checked inputs in C order.
    out : (n, m) array
        Overwritten.
    """
    for rows in row_blocks(len(x)):
        for columns in _column_blocks(0, len(y)):
            out[rows, columns] = tile(kernel, x[rows], y[columns])


def product(kernel: Tileable, x: FloatArray, y: FloatArray, vector: FloatArray) -> FloatArray:
    """Multiply the covariance of `x` with `y` by a vector, without keeping the matrix.

    Parameters
    ----------
    kernel : Tileable
    x, y : (n, D) and (m, D) array
        Checked inputs in C order.
    vector : (m,) array

    Returns
    -------
    (n,) array
    """
    out = np.zeros(len(x))
    for rows in row_blocks(len(x)):
        for columns in _column_blocks(0, len(y)):
            out[rows] += tile(kernel, x[rows], y[columns]) @ vector[columns]
    return out


def fill_triangle(kernel: Tileable, x: FloatArray, rows: slice, out: FloatArray) -> None:
    """Write a block of rows of the covariance matrix, from its diagonal on.

    Parameters
    ----------
    kernel : Tileable
    x : (n, D) array
        Checked inputs in C order.
    rows : slice
        One of `row_blocks`.
    out : (n, n) array
        Overwritten in these rows, in the columns from their first on.
    """
    for columns in _column_blocks(rows.start, len(x)):
        out[rows, columns] = tile(kernel, x[rows], x[columns])


def weighted_derivatives(
    kernel: Tileable,
    x: FloatArray,
    rows: slice,
    *,
    first_column: int,
    weights: Callable[[slice, slice], FloatArray],
) -> FloatArray:
    """Sum the weighted derivatives of a block of rows of the covariance matrix.

    Parameters
    ----------
    kernel : Tileable
    x : (n, D) array
        Checked inputs in C order.
    rows : slice
        One of `row_blocks`.
    first_column : int
        Columns before it are left out.
    weights : callable
        Returns the weights of a tile, given its rows and columns: a fresh array in C order.

    Returns
    -------
    (p,) array
        sum_ij W_ij dK_ij / dlog theta for each free hyperparameter.
    """
    parts = [
        kernel.weigh(x[rows], x[columns], weights(rows, columns))
        for columns in _column_blocks(first_column, len(x))
    ]
    total: FloatArray = np.sum(parts, axis=0)
    return total
