"""Run tasks in parallel on processes of this machine, which never outlive this one; progress."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Protocol, TypeVar

import numba

from exposight.errors import InputError, NumericalError
from exposight.leash import end_with_parent

_MOST_WORKERS = 8
"""Each may take a gigabyte of memory, so more must be requested."""

_WAKE_S = 0.2
"""Ctrl-C does not wake a waiting thread on every platform, so it wakes regularly."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def usual_workers() -> int:
    """Return the default number of parallel processes: one per usable core, at most 8."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, _MOST_WORKERS)


class Workers(Protocol):
    """Run tasks in parallel."""

    def run(
        self, work: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Generator[tuple[_Task, _Result]]:
        """Run tasks and yield each with its result as soon as it is done, in any order.

        Close the generator (`contextlib.closing`) to be sure that no further task begins.

        Parameters
        ----------
        work : callable
            Runs one task. It, the tasks and the results are sent to other processes, so they must
            be picklable. Running a task twice must do no harm.
        tasks : sequence
            The tasks.

        Raises
        ------
        NumericalError
            If no worker is left to run a task.
        ExposightError
            Raised by `work`.
        """
        ...


@dataclass(frozen=True)
class LocalProcesses:
    """Run tasks in parallel on processes of this machine.

    The processes end when the generator of `run` is closed or fails, and when this process dies,
    however it dies. They are spawned, not forked, so a script that uses more than one needs an
    ``if __name__ == "__main__":`` block.

    Parameters
    ----------
    count : int, 1 or more
        Number of processes; 1 runs the tasks in this one.

    Raises
    ------
    InputError
        If it is below 1.
    """

    count: int = 1

    def __post_init__(self) -> None:
        if self.count < 1:
            msg = f"tasks need at least 1 worker, got {self.count}"
            raise InputError(msg)

    def run(
        self, work: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Generator[tuple[_Task, _Result]]:
        """Run tasks and yield each with its result as soon as it is done (`Workers`).

        Raises
        ------
        NumericalError
            If a worker dies.
        """
        if self.count == 1 or len(tasks) <= 1:
            yield from ((task, work(task)) for task in tasks)
            return
        # Spawned, because forking a process that has run compiled threads can hang.
        context = multiprocessing.get_context("spawn")
        leash, held = context.Pipe(duplex=False)
        with (
            leash,
            held,
            ProcessPoolExecutor(
                max_workers=min(self.count, len(tasks)),
                mp_context=context,
                initializer=_begin_worker,
                initargs=(leash, _main_process()),
            ) as pool,
        ):
            try:
                with _interrupts_blocked():
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
def _interrupts_blocked() -> Iterator[None]:
    """Keep Ctrl-C and SIGTERM from this process while others start, and Ctrl-C from them for ever.

    A terminal sends Ctrl-C to all of them; this process decides when the others end.
    """
    if sys.platform == "win32":  # no such masks there; `_begin_worker` has to do
        yield
        return
    before = signal.pthread_sigmask(
        signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM}
    )  # inherited by children
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _main_process() -> int | None:
    """Return this process's number; None in a thread, which may end before the workers."""
    ours = threading.current_thread() is threading.main_thread()
    return os.getpid() if ours else None


def _begin_worker(leash: Connection, parent: int | None) -> None:
    """Prepare a process for work."""
    threading.Thread(target=_end_with, args=(leash,), daemon=True).start()
    if parent is not None:  # the second rope: a thread cannot act while a compiled loop runs
        end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    numba.set_num_threads(1)  # the other processes use the other cores


def _end_with(leash: Connection) -> None:
    """End this process when its parent closes the pipe or dies."""
    with suppress(EOFError, OSError):
        leash.recv()  # nothing is ever sent
    os._exit(1)


class Progress(Protocol):
    """Receives the progress of a piece of work; a terminal draws a bar."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report progress.

        Parameters
        ----------
        stage : str
            What is being done, such as "observing".
        done, total : int
            Steps done and steps in all; a total of 0 means that it is not known yet.
        """
        ...


def ignore_progress(stage: str, done: int, total: int) -> None:
    """Ignore progress."""
