"""Large work in pieces: a covariance matrix tile by tile, rows chunk by chunk, pieces in threads.

What a tile needs stays in the processor's cache, and a chunk's matrices in memory.
"""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import Protocol, TypeVar

import numba
import numpy as np
import scipy.linalg  # noqa: F401  # its LAPACK must be loaded for the controller to see it
from threadpoolctl import ThreadpoolController

from exposight.errors import InputError
from exposight.gp.observations import FloatArray
from exposight.workers import Progress

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

# Half a MB each for values and weights together, small beside a core's second cache; columns are
# scaled once for all rows of a tile.
_ROWS, _COLUMNS = 64, 1024
# Looked up once: finding the libraries takes longer than many a prediction.
_LIBRARIES = ThreadpoolController()


class Tileable(Protocol):
    """A kernel, as far as tiles of its covariance matrix are concerned."""

    def fill(self, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
        """Write the covariances of checked inputs into a tile in C order."""

    def weigh(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Sum the weighted derivatives of the covariances in a tile."""


def tile(kernel: Tileable, x: FloatArray, y: FloatArray) -> FloatArray:
    """Covariances of few checked inputs in C order, (n, D) and (m, D): a fresh (n, m) array."""
    out = np.empty((len(x), len(y)))
    kernel.fill(x, y, out)
    return out


def row_blocks(rows: int) -> list[slice]:
    """Split rows into blocks, each as high as a tile."""
    return [slice(start, min(start + _ROWS, rows)) for start in range(0, rows, _ROWS)]


def _column_blocks(first: int, columns: int) -> Iterator[slice]:
    for start in range(first, columns, _COLUMNS):
        yield slice(start, min(start + _COLUMNS, columns))


def fill_tiles(kernel: Tileable, x: FloatArray, y: FloatArray, out: FloatArray) -> None:
    """Write the covariances of checked inputs, (n, D) and (m, D), into `out`, (n, m)."""
    for rows in row_blocks(len(x)):
        for columns in _column_blocks(0, len(y)):
            out[rows, columns] = tile(kernel, x[rows], y[columns])


def fill_triangle(kernel: Tileable, x: FloatArray, rows: slice, out: FloatArray) -> None:
    """Write one of the `row_blocks` of the covariance of `x`, (n, n), from its diagonal on."""
    for columns in _column_blocks(rows.start, len(x)):
        out[rows, columns] = tile(kernel, x[rows], x[columns])


def weighted_derivatives(
    kernel: Tileable, x: FloatArray, rows: slice, weights: Callable[[slice, slice], FloatArray]
) -> FloatArray:
    """Sum the weighted derivatives of a block of rows of the covariance, from its diagonal on.

    Parameters
    ----------
    kernel : Tileable
    x : (n, D) array
        Checked inputs in C order.
    rows : slice
        One of `row_blocks`.
    weights : callable
        Returns the weights of a tile, given its rows and columns: a fresh array in C order.

    Returns
    -------
    (p,) array
        sum_ij W_ij dK_ij / dlog theta for each free hyperparameter.
    """
    parts = [
        kernel.weigh(x[rows], x[columns], weights(rows, columns))
        for columns in _column_blocks(rows.start, len(x))
    ]
    total: FloatArray = np.sum(parts, axis=0)
    return total


def choose_threads(asked: int | None, *, worthwhile: bool) -> int:
    """Choose the number of threads of a computation.

    Parameters
    ----------
    asked : int or None
        What the caller wants.
    worthwhile : bool
        Whether the computation is large enough for several threads.

    Returns
    -------
    int
        What was asked for; else 1 where it is small, or in a worker process, whose siblings have
        the other cores; else as many as numba may use (``NUMBA_NUM_THREADS``).

    Raises
    ------
    InputError
        If fewer than one was asked for.
    """
    if asked is None:
        alone = multiprocessing.parent_process() is None
        return int(numba.get_num_threads()) if worthwhile and alone else 1
    if asked < 1:
        msg = f"threads must be at least 1, got {asked}; leave it out to have it chosen"
        raise InputError(msg)
    return asked


def in_threads(
    work: Callable[[_Item], _Result], items: Iterable[_Item], *, threads: int
) -> Iterable[_Result]:
    """Apply a function that releases Python's lock to items; yield the results in their order."""
    if threads == 1:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(work, items)


def limit_blas(threads: int) -> AbstractContextManager[object]:
    """Limit the threads of linear algebra while the context lasts.

    Beside other work on the same cores OpenBLAS with two threads was up to ten times slower than
    with one, for it spins while it waits.
    """
    context: AbstractContextManager[object] = _LIBRARIES.limit(limits=threads, user_api="blas")
    return context


def predict_in_chunks(
    predict_rows: Callable[[slice], None],
    rows: int,
    *,
    chunk: int,
    threads: int | None,
    worthwhile: bool,
    progress: Progress,
) -> None:
    """Predict rows a chunk at a time, in threads where that is worth it.

    Parameters
    ----------
    predict_rows : callable
        Called with the rows of one chunk; its linear algebra runs on one thread.
    rows, chunk : int
        How many there are, and how many at once.
    threads, worthwhile
        As for `choose_threads`.
    progress : Progress
        Called with the stage "predicting", rows done, and all rows.
    """
    chunks = [slice(start, min(start + chunk, rows)) for start in range(0, rows, chunk)]
    count = choose_threads(threads, worthwhile=worthwhile)
    with limit_blas(1):
        for done, _ in zip(chunks, in_threads(predict_rows, chunks, threads=count), strict=True):
            progress("predicting", done.stop, rows)
