"""Who does the tasks of a simulation: processes here, begun afresh and never left alone."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numba

from exposight.errors import InputError, NumericalError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence
    from multiprocessing.connection import Connection


_MOST_WORKERS = 8
"""More have to be asked for: each may take a gigabyte of memory."""

_WAKE_S = 0.2
"""Ctrl-C does not everywhere wake a thread that waits for others, so this one wakes by itself."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def usual_workers() -> int:
    """Return how many processes work at the same time unless told otherwise: one a core."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, _MOST_WORKERS)


class Workers(Protocol):
    """Those who do tasks, several at a time."""

    def run(
        self, work: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Generator[tuple[_Task, _Result]]:
        """Do tasks and yield them with their results as they are done, in any order.

        Close the generator (`contextlib.closing`) to be sure that no further task is begun.

        Parameters
        ----------
        work : callable
            What to do with a task; importable by other processes, as are the tasks and the
            results. Doing a task twice must do no harm.
        tasks : sequence
            What to do.

        Raises
        ------
        NumericalError
            If there is nobody left to do a task.
        ExposightError
            That `work` raised.
        """
        ...


@dataclass(frozen=True)
class LocalProcesses:
    """Processes on this machine.

    They end when the generator of `run` is closed or fails, and when this process dies, whatever
    kills it. They are begun afresh ("spawn"), so a script that uses more than one needs
    ``if __name__ == "__main__":`` around what it does.

    Parameters
    ----------
    count : int, 1 or more
        How many; 1 works in this one.

    Raises
    ------
    InputError
        If there is none.
    """

    count: int = 1

    def __post_init__(self) -> None:
        if self.count < 1:
            msg = f"tasks need at least 1 worker, got {self.count}"
            raise InputError(msg)

    def run(
        self, work: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Generator[tuple[_Task, _Result]]:
        """Do tasks and yield them with their results as they are done (`Workers`).

        Raises
        ------
        NumericalError
            If a worker dies.
        """
        if self.count == 1 or len(tasks) <= 1:
            yield from ((task, work(task)) for task in tasks)
            return
        # Fresh processes: forking one that has run compiled threads can hang.
        context = multiprocessing.get_context("spawn")
        leash, held = context.Pipe(duplex=False)
        with (
            leash,
            held,
            ProcessPoolExecutor(
                max_workers=min(self.count, len(tasks)),
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
                    "a worker process died (out of memory, or killed); what was captured is kept: "
                    "run again to go on, with fewer workers if memory was short"
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
