"""Worker processes of a simulation: begun afresh, heard one by one, never left alone."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

import numba

from exposight.errors import NumericalError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence
    from multiprocessing.connection import Connection

__all__ = ["run_tasks"]

_WAKE_S = 0.2
"""Ctrl-C does not everywhere wake a thread that waits for others, so this one wakes by itself."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def run_tasks(
    work: Callable[[_Task], _Result], tasks: Sequence[_Task], workers: int
) -> Generator[tuple[_Task, _Result]]:
    """Do tasks, several at a time, and yield them with their results as they are done.

    Close the generator (`contextlib.closing`) to be sure that no worker goes on: they end when it
    is closed or fails, and when this process dies, whatever kills it.

    Parameters
    ----------
    work : callable
        What to do with a task; importable by other processes, as are the tasks and the results.
    tasks : sequence
        Hashable.
    workers : int, 1 or more
        Processes; 1 works in this one.

    Raises
    ------
    NumericalError
        If a worker dies.
    """
    if workers == 1 or len(tasks) <= 1:
        yield from ((task, work(task)) for task in tasks)
        return
    # Fresh processes: forking one that has run compiled threads can hang.
    context = multiprocessing.get_context("spawn")
    leash, held = context.Pipe(duplex=False)
    with (
        leash,
        held,
        ProcessPoolExecutor(
            max_workers=min(workers, len(tasks)),
            mp_context=context,
            initializer=_begin_worker,
            initargs=(leash,),
        ) as pool,
    ):
        try:
            with _children_deaf_to_interrupts():
                futures = {pool.submit(work, task): task for task in tasks}
            while futures:
                done, _ = wait(futures, timeout=_WAKE_S, return_when=FIRST_COMPLETED)
                for future in done:
                    yield futures.pop(future), future.result()
        except BrokenProcessPool as error:
            msg = (
                "a worker process died (out of memory, or killed); what was captured is kept: run "
                "again to go on, with fewer workers if memory was short"
            )
            raise NumericalError(msg) from error
        except BaseException:  # an interrupt too: do not wait for what is being done
            held.close()
            raise


@contextmanager
def _children_deaf_to_interrupts() -> Iterator[None]:
    """Let processes begun within this block not hear Ctrl-C, not even while they start.

    In a terminal it reaches all of them; this one decides what becomes of the others.
    """
    if sys.platform == "win32":  # no such masks there; `_begin_worker` has to do
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited by children
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker(leash: Connection) -> None:
    """Make a process ready for work."""
    numba.set_num_threads(1)  # its siblings have the other cores
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(leash,), daemon=True).start()


def _end_with(leash: Connection) -> None:
    """End this worker when its parent lets go or dies: an orphan would disturb the next run."""
    with suppress(EOFError, OSError):
        leash.recv()  # nothing is ever sent
    os._exit(1)
