"""How many threads a computation takes."""

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import TypeVar

import numba
import scipy.linalg  # noqa: F401  # its LAPACK must be loaded for the controller to see it
from threadpoolctl import ThreadpoolController

from exposight.errors import InputError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

# Found once: looking for the libraries takes longer than many a prediction.
_LIBRARIES = ThreadpoolController()


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
    """Apply a function that releases Python's lock to items, in order.

    Parameters
    ----------
    work : callable
    items : iterable
    threads : int
        At least 1.

    Yields
    ------
    object
        Results in the order of the items, whatever the number of threads.
    """
    if threads == 1:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(work, items)


def limit_blas(threads: int) -> AbstractContextManager[object]:
    """Hold linear algebra to a number of threads while the context lasts.

    Beside other work on the same cores OpenBLAS with two threads was up to ten times slower than
    with one, for it spins while it waits.
    """
    context: AbstractContextManager[object] = _LIBRARIES.limit(limits=threads, user_api="blas")
    return context
