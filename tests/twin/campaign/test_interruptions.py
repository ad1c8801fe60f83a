"""A sheet measured by plan through kills, interrupts, full disks: always the same in the end."""

import errno
import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace

import pytest

from exposight.cell import CampaignFolder
from exposight.errors import FileError, InputError, NumericalError
from exposight.observing import read_observations
from exposight.twin import simulate, simulate_observations, write_plan

RUNNER = """
import json, os, sys
from pathlib import Path
from exposight.twin import CellSettings, read_plan, simulate, simulate_observations

for line in sys.stdin:  # each in a process of its own, forked after the imports, which take longest
    plan, scene, output, workers = json.loads(line)
    child = os.fork()
    if child:
        print(child, flush=True)
        os.waitpid(child, 0)
        print("ended", flush=True)
        continue
    settings = CellSettings(rings_only=True, workers=workers, scene=Path(scene))
    tell = lambda *_: print("report", flush=True)
    if output.endswith(".csv"):
        simulate_observations(read_plan(plan), settings, tell, table_path=output)
    else:
        simulate(read_plan(plan), output, settings, tell)
    os._exit(0)
"""

KILLS = 10


@pytest.fixture(scope="module")
def long_plan(sheet_plan):
    """Enough captures for ten kills."""
    exposures_ms = tuple(map(float, range(30, 230, 20)))
    return replace(sheet_plan, planes=(replace(sheet_plan.planes[0], exposures_ms=exposures_ms),))


@pytest.fixture
def killed(tmp_path, scene):
    """Carry a plan out in another process until it is killed."""
    runner = subprocess.Popen(
        [sys.executable, "-c", RUNNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        encoding="utf-8",
    )

    def run(plan, output, *, workers, after, then_s):
        """Kill it so long after another such file was written, or after it began."""
        write_plan(tmp_path / "plan.toml", plan)
        words = [*map(str, (tmp_path / "plan.toml", scene, output)), workers]
        print(json.dumps(words), file=runner.stdin, flush=True)
        process = int(runner.stdout.readline())
        assert runner.stdout.readline() == "report\n"  # it begins with its first view
        if after is not None:
            wait_for_another_file(tmp_path, after)
        time.sleep(then_s)
        with suppress(ProcessLookupError):  # it may have come to its end
            os.kill(process, signal.SIGKILL)  # its workers are left to themselves
        while runner.stdout.readline() != "ended\n":
            pass

    with runner:
        yield run
        runner.kill()


def wait_for_another_file(folder, pattern):
    begun, deadline = len(list(folder.glob(pattern))), time.monotonic() + 60
    while len(list(folder.glob(pattern))) == begun:
        assert time.monotonic() < deadline
        time.sleep(0.001)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_a_run_killed_at_ten_random_moments_goes_on_to_the_same_bytes(
    tmp_path, long_plan, rings, content, killed
):
    moments = random.Random(5)
    folder = tmp_path / "killed"
    counts = []
    for number in range(KILLS):
        writing = number % 2 == 1  # else wherever it is, mostly tracing
        killed(
            long_plan,
            folder,
            workers=2 if number in {1, 6} else 1,
            after="killed/captures/0*" if writing else None,
            then_s=moments.uniform(0.0, 0.05 if writing else 0.3),
        )
        counts.append(len(list(CampaignFolder(folder).captures())))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1] < 40, "kills must come in the middle"
    simulate(long_plan, folder, rings)
    uninterrupted = simulate(long_plan, tmp_path / "uninterrupted", rings)
    assert content(folder) == content(uninterrupted.path)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_observing_at_once_goes_on_after_kills_to_the_same_table(
    tmp_path, sheet_plan, rings, killed
):
    table, views = tmp_path / "table.csv", tmp_path / "table.csv.views"
    for _ in range(2):
        killed(sheet_plan, table, workers=1, after="table.csv.views/0*.csv", then_s=0.0)
    assert not table.exists()
    there = len(list(views.glob("0*.csv")))
    assert there >= 2
    reports = []
    went_on = simulate_observations(
        sheet_plan, rings, lambda *n: reports.append(n), table_path=table
    )
    assert reports[0] == (2 * there, 8)
    assert not views.exists()
    assert went_on.frame.equals(simulate_observations(sheet_plan, rings).frame)
    assert read_observations(table).frame.equals(went_on.frame)


def interrupt_at(when):
    def interrupt(done, _total):
        if done == when:
            raise KeyboardInterrupt

    return interrupt


def test_an_unfinished_table_goes_on_with_the_same_plan_only(tmp_path, sheet_plan, rings):
    table = tmp_path / "table.parquet"
    with pytest.raises(KeyboardInterrupt):
        simulate_observations(sheet_plan, rings, interrupt_at(4), table_path=table)
    message = r"unfinished table in .*table\.parquet\.views was simulated with another plan, .*seed"
    with pytest.raises(InputError, match=message):
        simulate_observations(replace(sheet_plan, seed=9), rings, table_path=table)
    with pytest.raises(InputError, match="rings only, not whole frames"):
        simulate_observations(sheet_plan, replace(rings, rings_only=False), table_path=table)
    simulate_observations(sheet_plan, rings, table_path=table)
    assert [path.name for path in tmp_path.iterdir()] == ["table.parquet"]


def test_an_unfinished_table_has_one_writer(tmp_path, sheet_plan, rings):
    table = tmp_path / "table.csv"

    def meanwhile(_done, _total):
        with pytest.raises(FileError, match="another writer has the unfinished table in"):
            simulate_observations(sheet_plan, rings, table_path=table)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_observations(sheet_plan, rings, meanwhile, table_path=table)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_a_worker_that_is_killed_is_told_and_costs_no_capture(
    tmp_path, alone, rings, sheet_plan, content
):
    folder = tmp_path / "campaign"

    def kill_one(done: int, _total: int) -> None:
        if done == 2:
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    message = r"a worker process died .*what was captured is kept: run again"
    with pytest.raises(NumericalError, match=message):
        simulate(sheet_plan, folder, replace(rings, workers=2), kill_one)
    assert not multiprocessing.active_children()
    assert 2 <= len(list(CampaignFolder(folder).captures())) < 8
    first = []
    simulate(sheet_plan, folder, rings, lambda done, _: first.append(done))
    assert first[0] >= 2
    assert content(folder) == content(alone)


def test_an_interrupt_ends_the_workers_before_the_next_writer_is_let_in(
    tmp_path, alone, rings, sheet_plan, content
):
    def interrupt(done: int, _total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    folder = tmp_path / "campaign"
    with pytest.raises(KeyboardInterrupt):
        simulate(sheet_plan, folder, replace(rings, workers=2), interrupt)
    assert not multiprocessing.active_children()
    simulate(sheet_plan, folder, rings)
    assert content(folder) == content(alone)


STAGES = ["preparing the scene", "planning the views", "taking the first views"]


def test_stages_are_named_before_the_first_view(tmp_path, sheet_plan, rings):
    told = []

    def tell(*what):
        told.append(what)
        if what == (0, 8):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(sheet_plan, tmp_path / "campaign", rings, tell, stage=tell)
    with pytest.raises(KeyboardInterrupt):
        simulate_observations(sheet_plan, rings, tell, stage=tell)
    assert told == [*((stage,) for stage in STAGES), (0, 8)] * 2


@pytest.mark.parametrize("when", STAGES)
def test_an_unfinished_table_leaves_nothing_behind_before_the_first_view(
    tmp_path, sheet_plan, rings, when
):
    def interrupt(stage):
        if stage == when:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_observations(sheet_plan, rings, stage=interrupt, table_path=tmp_path / "t.csv")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_at_any_write_before_the_first_view_costs_nothing(
    tmp_path, alone, rings, sheet_plan, content, monkeypatch
):
    folder, begun = tmp_path / "campaign", []
    fsync, calls = os.fsync, 0

    def count_down(descriptor):
        nonlocal calls
        calls -= 1
        if calls == 0:
            raise KeyboardInterrupt
        fsync(descriptor)

    def stop(stage):
        begun.append(stage)
        if stage == STAGES[-1]:
            raise KeyboardInterrupt

    writes = 0
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", count_down)
        while STAGES[-1] not in begun:  # each run comes one write further than the one before
            writes += 1
            calls = writes
            with pytest.raises(KeyboardInterrupt):
                simulate(sheet_plan, folder, rings, stage=stop)
    assert writes > 4
    simulate(sheet_plan, folder, rings)
    assert content(folder) == content(alone)


def test_a_deleted_capture_is_taken_again(tmp_path, alone, rings, sheet_plan, content):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    shutil.rmtree(folder / "captures" / "000003")
    reports = []
    simulate(sheet_plan, folder, rings, lambda *n: reports.append(n))
    assert reports == [(7, 8), (8, 8)]
    assert content(folder) == content(alone)


def test_a_disk_that_fills_up_costs_no_capture(
    tmp_path, alone, rings, monkeypatch, sheet_plan, content
):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / "campaign"
    with monkeypatch.context() as patch:

        def fill_up(done: int, _total: int) -> None:
            if done == 4:
                patch.setattr(os, "fsync", no_space)

        with pytest.raises(FileError, match=r"view 'middle-x1-y2' at 30 ms: .*the disk is full"):
            simulate(sheet_plan, folder, rings, fill_up)
    assert len(list(CampaignFolder(folder).captures())) == 4
    simulate(sheet_plan, folder, rings)
    assert content(folder) == content(alone)
