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
from exposight.errors import FileError, NumericalError
from exposight.measuring import measure, measure_observations
from exposight.observing import read_observations
from exposight.plans import write_plan

RUNNER = """
import json, os, sys
from pathlib import Path
from exposight.measuring import measure, measure_observations
from exposight.plans import read_plan
from exposight.twin import SimulatedCell

for line in sys.stdin:  # each in a process of its own, forked after the imports, which take longest
    plan, scene, output, workers = json.loads(line)
    child = os.fork()
    if child:
        print(child, flush=True)
        os.waitpid(child, 0)
        print("ended", flush=True)
        continue
    plan = read_plan(plan)
    cell = SimulatedCell.for_plan(plan, rings_only=True, scene=Path(scene))
    options = {"workers": workers, "progress": lambda stage, *_: print(stage, flush=True)}
    if output.endswith(".csv"):
        measure_observations(plan, cell, table_path=output, **options)
    else:
        measure(plan, cell, output, **options)
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
        while runner.stdout.readline() != "measuring\n":  # it begins with its first view
            pass
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
@pytest.mark.slow
def test_a_run_killed_at_ten_random_moments_goes_on_to_the_same_bytes(
    tmp_path, long_plan, cell, content, killed
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
    measure(long_plan, cell(long_plan), folder)
    uninterrupted = measure(long_plan, cell(long_plan), tmp_path / "uninterrupted")
    assert content(folder) == content(uninterrupted.path)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
@pytest.mark.slow
def test_observing_at_once_goes_on_after_kills_to_the_same_table(
    tmp_path, sheet_plan, cell, killed, reports
):
    table, views = tmp_path / "table.csv", tmp_path / "table.csv.views"
    for pattern in ("0*.csv", "0*.sha256"):  # the first mostly before its seal is written
        killed(sheet_plan, table, workers=1, after=f"table.csv.views/{pattern}", then_s=0.0)
    assert not table.exists()
    # What was killed before its seal was written is measured again.
    there = sum(path.with_suffix(".sha256").is_file() for path in views.glob("0*.csv"))
    assert there >= 1
    went_on = measure_observations(sheet_plan, cell(sheet_plan), table_path=table, progress=reports)
    assert reports[0] == (2 * there, 8)
    assert not views.exists()
    assert went_on.frame.equals(measure_observations(sheet_plan, cell(sheet_plan)).frame)
    assert read_observations(table).frame.equals(went_on.frame)


def at(done, act):
    """Return a progress that does something when so many captures are there."""

    def progress(stage, now, _total):
        if (stage, now) == ("measuring", done):
            act()

    return progress


def interrupt():
    raise KeyboardInterrupt


def test_an_unfinished_table_goes_on_with_its_own_views_only(tmp_path, sheet_plan, cell, reports):
    table = tmp_path / "table.parquet"
    with pytest.raises(KeyboardInterrupt):
        measure_observations(
            sheet_plan, cell(sheet_plan), table_path=table, progress=at(4, interrupt)
        )
    other_sensor = replace(sheet_plan.sensor, name="another")
    for driver in (
        cell(replace(sheet_plan, seed=9)),
        cell(replace(sheet_plan, sensor=other_sensor)),
        cell(sheet_plan, lighting="III"),
    ):
        plan = replace(sheet_plan, seed=driver.seed, sensor=driver.sensor)
        with pytest.raises(KeyboardInterrupt):
            measure_observations(plan, driver, table_path=table, progress=at(0, interrupt))
    measure_observations(sheet_plan, cell(sheet_plan), table_path=table, progress=reports)
    assert reports[0] == (4, 8)
    assert [path.name for path in tmp_path.iterdir()] == ["table.parquet"]


def test_an_unfinished_table_has_one_writer(tmp_path, sheet_plan, cell):
    table, driver = tmp_path / "table.csv", cell(sheet_plan)

    def meanwhile():
        with pytest.raises(FileError, match="another writer has the unfinished table in"):
            measure_observations(sheet_plan, driver, table_path=table)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure_observations(sheet_plan, driver, table_path=table, progress=at(0, meanwhile))


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
@pytest.mark.slow
def test_a_worker_that_is_killed_is_told_and_costs_no_capture(
    tmp_path, alone, cell, sheet_plan, content, reports
):
    folder = tmp_path / "campaign"

    def kill_one() -> None:
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    message = r"a worker process died .*what was captured is kept: run again"
    with pytest.raises(NumericalError, match=message):
        measure(sheet_plan, cell(sheet_plan), folder, workers=2, progress=at(2, kill_one))
    assert not multiprocessing.active_children()
    assert 2 <= len(list(CampaignFolder(folder).captures())) < 8
    measure(sheet_plan, cell(sheet_plan), folder, progress=reports)
    assert reports[0][0] >= 2
    assert content(folder) == content(alone)


@pytest.mark.slow
def test_an_interrupt_ends_the_workers_before_the_next_writer_is_let_in(
    tmp_path, alone, cell, sheet_plan, content, reports
):
    folder = tmp_path / "campaign"
    with pytest.raises(KeyboardInterrupt):
        measure(sheet_plan, cell(sheet_plan), folder, workers=2, progress=at(2, interrupt))
    assert not multiprocessing.active_children()
    measure(sheet_plan, cell(sheet_plan), folder)
    assert content(folder) == content(alone)


STAGES = ["preparing the cell", "planning the views", "measuring"]


def test_stages_are_named_before_the_first_view(sheet_plan, cell, reports):
    def progress(*what):
        reports(*what)
        if what == ("measuring", 0, 8):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure_observations(sheet_plan, cell(sheet_plan), progress=progress)
    assert reports.stages == STAGES


@pytest.mark.parametrize("when", STAGES)
def test_an_unfinished_table_leaves_nothing_behind_before_the_first_view(
    tmp_path, sheet_plan, cell, when
):
    def stop(stage, _done, _total):
        if stage == when:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure_observations(
            sheet_plan, cell(sheet_plan), table_path=tmp_path / "t.csv", progress=stop
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_an_interrupt_at_any_write_before_the_first_view_costs_nothing(
    tmp_path, alone, cell, sheet_plan, content, monkeypatch
):
    folder, begun = tmp_path / "campaign", []
    fsync, calls = os.fsync, 0

    def count_down(descriptor):
        nonlocal calls
        calls -= 1
        if calls == 0:
            raise KeyboardInterrupt
        fsync(descriptor)

    def stop(stage, _done, _total):
        begun.append(stage)
        if stage == STAGES[-1]:
            raise KeyboardInterrupt

    writes, driver = 0, cell(sheet_plan)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", count_down)
        while STAGES[-1] not in begun:  # each run comes one write further than the one before
            writes += 1
            calls = writes
            with pytest.raises(KeyboardInterrupt):
                measure(sheet_plan, driver, folder, progress=stop)
    assert writes > 4
    measure(sheet_plan, cell(sheet_plan), folder)
    assert content(folder) == content(alone)


def test_a_deleted_capture_is_taken_again(tmp_path, alone, cell, sheet_plan, content, reports):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    shutil.rmtree(folder / "captures" / "000003")
    measure(sheet_plan, cell(sheet_plan), folder, progress=reports)
    assert reports == [(7, 8), (8, 8)]
    assert content(folder) == content(alone)


def test_a_disk_that_fills_up_costs_no_capture(
    tmp_path, alone, cell, monkeypatch, sheet_plan, content
):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / "campaign"
    with monkeypatch.context() as patch:

        def fill_up() -> None:
            patch.setattr(os, "fsync", no_space)

        with pytest.raises(FileError, match=r"view 'middle-x1-y2' at 30 ms: .*the disk is full"):
            measure(sheet_plan, cell(sheet_plan), folder, progress=at(4, fill_up))
    assert len(list(CampaignFolder(folder).captures())) == 4
    measure(sheet_plan, cell(sheet_plan), folder)
    assert content(folder) == content(alone)
