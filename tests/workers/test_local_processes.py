"""Worker processes that end with the one that began them, whatever happens to it."""

import multiprocessing
import subprocess
import sys
import time
from contextlib import closing

import pytest

from exposight.errors import InputError
from exposight.workers import DaskCluster, LocalProcesses, choose_workers

LONG_S = 60.0
SOON_S = 20.0
"""Ending takes a fraction of a second; a busy machine may take longer to get round to it."""

ENDLESS = f"""
import time
from exposight.errors import InputError
from exposight.workers import DaskCluster, LocalProcesses, choose_workers

for _ in LocalProcesses(2).run(time.sleep, [0.0, {LONG_S}, {LONG_S + 1}]):
    print("begun", flush=True)
"""


def test_workers_are_here_or_on_a_cluster():
    assert choose_workers(3) == LocalProcesses(3)
    assert choose_workers(1, "tcp://127.0.0.1:8786") == DaskCluster("tcp://127.0.0.1:8786")
    with pytest.raises(
        InputError, match=r"got 2 workers and the cluster 'tcp://127\.0\.0\.1:8786'"
    ):
        choose_workers(2, "tcp://127.0.0.1:8786")
    with pytest.raises(InputError, match="at least 1 worker, got 0"):
        choose_workers(0)


def test_one_worker_is_this_process():
    assert list(LocalProcesses(1).run(abs, [-1, -2])) == [(-1, 1), (-2, 2)]


@pytest.mark.slow
def test_workers_give_every_task_with_its_result():
    assert sorted(LocalProcesses(2).run(abs, range(-5, 0))) == [(-n, n) for n in (5, 4, 3, 2, 1)]
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_closing_ends_workers_in_the_middle_of_their_tasks():
    with closing(LocalProcesses(2).run(time.sleep, [0.0, LONG_S, LONG_S + 1])) as results:
        next(results)
        start = time.monotonic()
    assert not multiprocessing.active_children()
    assert time.monotonic() - start < SOON_S


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_workers_of_a_killed_process_end_too():
    process = subprocess.Popen(
        [sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    process.stdout.readline()
    start = time.monotonic()
    process.kill()
    process.wait()
    with process.stdout as stdout:
        stdout.read()  # ends when nobody holds its other end any more: all workers are gone
    assert time.monotonic() - start < SOON_S
