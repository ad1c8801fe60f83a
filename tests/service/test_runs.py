"""Runs of a served folder: carried out, paused, stopped, killed and continued, always the same."""

import json
import os
import random
import shutil
import signal
import threading
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from tests.measuring.conftest import PlateDriver, plate_exposure_plan
from tests.service.run_cases import ENDED, await_state, captured, request_of

from exposight.cell import CampaignFolder
from exposight.errors import (
    FileError,
    FormatError,
    InputError,
    MissingFileError,
    SensorError,
)
from exposight.geometry import RigidTransform
from exposight.measuring import measure, measure_adaptively
from exposight.planning import write_exposure_plan
from exposight.plans import read_plan, write_plan
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.run_files import (
    EventLog,
    RunFolder,
    RunRequest,
    events_after,
    events_from,
    first_state,
    now,
)
from exposight.service.run_process import RunProcess
from exposight.service.runs import Runs


@pytest.fixture
def served(run_folder):
    """Return the folder to measure in."""
    return run_folder


@pytest.fixture
def runs(served):
    opened = Runs(ServedFolder(served))
    yield opened
    opened.close()


def started(runs, name="one", **changes):
    return runs.start(RunRequest(**request_of(name, **changes)))


def test_a_run_measures_what_the_library_measures(runs, served, tmp_path):
    assert started(runs).state in {"starting", "running", "finished"}
    state = await_state(lambda: runs.run("one").state)
    expected = measure_adaptively(
        plate_exposure_plan(), PlateDriver(), tmp_path / "expected", models=None
    )
    assert (state.state, state.verdict, state.error) == ("finished", expected.verdict, "")
    assert state.n_captures == len(expected.decisions)
    assert state.n_had == len(expected.succeeded)
    assert captured(served / state.campaign) == captured(expected.campaign.path)
    events, _ = events_after(runs.run("one").events, 0)
    assert [each.seq for each in events] == list(range(1, state.last_seq + 1))
    decisions = [each.data for each in events if each.kind == "decision"]
    kept = (served / state.campaign / "decisions.jsonl").read_text().splitlines()
    assert decisions == [json.loads(line) for line in kept]
    asked = [each.data["view"] for each in events if each.kind == "request"]
    assert asked == [each["view"] for each in decisions]
    outcomes = {}
    for each in events:
        if each.kind == "outcomes":
            outcomes |= {row["feature"]: row["status"] for row in each.data["outcomes"]}
    assert outcomes == {each.feature: each.status for each in expected.outcomes}


def test_a_measuring_plan_is_taken_as_it_is(runs, served, sheet_run):
    runs.start(RunRequest(**sheet_run))
    state = await_state(lambda: runs.run("sheet").state)
    assert (state.state, state.error, state.n_had) == ("finished", "", None)
    assert state.n_captures == len(CampaignFolder(served / state.campaign)) > 4
    events, _ = events_after(runs.run("sheet").events, 0)
    assert {each.kind for each in events} == {"state", "request", "progress"}


def test_paused_stopped_and_continued_it_gives_the_same(runs, served, sheet_run, sheet_expected):
    runs.start(RunRequest(**sheet_run))
    runs.order("sheet", "pause")
    runs.order("sheet", "pause")  # once more changes nothing
    paused = await_state(lambda: runs.run("sheet").state, {"paused"})
    assert len(list((served / paused.campaign / "captures").glob("[0-9]*"))) == paused.n_captures
    assert runs.proceed("sheet").lives
    runs.order("sheet", "stop")
    assert runs.run("sheet").state.state in {"stopping", "stopped"}
    assert await_state(lambda: runs.run("sheet").state).state == "stopped"
    with pytest.raises(RequestError, match="continue it first"):
        runs.order("sheet", "pause")
    runs.proceed("sheet")
    assert await_state(lambda: runs.run("sheet").state).state == "finished"
    assert captured(served / paused.campaign) == sheet_expected
    with pytest.raises(RequestError, match="finished"):
        runs.proceed("sheet")


def test_killed_at_any_instant_it_goes_on_and_nothing_is_lost(
    runs, served, sheet_run, sheet_expected
):
    chance, kills = random.Random(5), 0
    runs.start(RunRequest(**sheet_run))
    while kills < 4:
        time.sleep(chance.uniform(0.05, 1.5))
        pid = runs._children[-1].pid
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        runs._children[-1].wait()
        kills += 1
        folder = RunFolder(served / "runs" / "sheet" / "campaign")
        before = captured(folder.path)
        state = await_state(lambda: runs.run("sheet").state, {"interrupted", "finished"})
        if state.state == "finished":
            break
        runs.proceed("sheet")
        assert captured(folder.path).items() >= before.items()
    assert await_state(lambda: runs.run("sheet").state).state == "finished"
    assert captured(served / "runs/sheet/campaign") == sheet_expected
    numbers = [each.seq for each in events_after(runs.run("sheet").events, 0)[0]]
    assert numbers == list(range(1, len(numbers) + 1))


def test_of_clients_that_start_the_same_run_one_does(served):
    servers = [Runs(ServedFolder(served)) for _ in range(4)]
    answers, barrier = [], threading.Barrier(len(servers))

    def start(server):
        barrier.wait()
        try:
            answers.append(started(server, "race").name)
        except RequestError as error:
            answers.append(error.status)

    threads = [threading.Thread(target=start, args=(each,)) for each in servers]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert sorted(answers, key=str) == [409, 409, 409, "race"]
    assert await_state(lambda: servers[0].run("race").state).state == "finished"
    for each in servers:
        each.close()


def test_a_run_ends_with_the_server_that_began_it(runs, served, sheet_run):
    runs.start(RunRequest(**sheet_run))
    await_state(lambda: runs.run("sheet").state, {"running"})
    runs.close()
    other = Runs(ServedFolder(served))
    assert other.run("sheet").state.state == "interrupted"
    with pytest.raises(RequestError):
        other.order("sheet", "stop")
    other.close()


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"plan": "none.json"}, FileError, "none.json"),
        ({"plan": "recorded"}, Exception, "no plan"),
        ({"plan": "../plan.json"}, Exception, "plan"),
        ({"models": "models"}, MissingFileError, "models"),
        ({"driver": {"kind": "replay", "recording": "nothing"}}, MissingFileError, "nothing"),
        ({"driver": {"kind": "replay", "recording": "sheet-expected"}}, SensorError, "sensor"),
        ({"driver": {"kind": "genicam", "cell": "bad.toml"}}, FormatError, "sensor"),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_is_written(
    runs, served, changes, error, says
):
    (served / "bad.toml").write_text("")
    with pytest.raises(error, match=says):
        started(runs, **changes)
    assert not (served / "runs" / "one").exists()


def test_a_recording_without_the_plans_views_is_refused(runs, served):
    plan = plate_exposure_plan()
    pose = RigidTransform(translation_mm=np.array([500.0, 0.0, 600.0]))
    write_exposure_plan(
        served / "plan.json",
        replace(plan, views=(replace(plan.views[0], camera_from_part=pose), *plan.views[1:])),
    )
    with pytest.raises(InputError, match="no capture at this pose"):
        started(runs)
    assert not (served / "runs" / "one").exists()


def test_an_unknown_finish_is_refused(runs, served, sheet_run):
    plan = read_plan(served / "sheet.toml")
    simulated = {key: value for key, value in plan.simulated.items() if key != "scene"}
    write_plan(served / "sheet.toml", replace(plan, simulated=simulated))
    driver = {"kind": "simulated", "finish": "nope"}
    with pytest.raises(InputError, match="finish 'nope' is not known"):
        runs.start(RunRequest(**{**sheet_run, "driver": driver}))
    assert not (served / "runs" / "sheet").exists()


def test_models_of_another_sensor_are_refused(runs, served, original):
    shutil.copytree(original / "models", served / "models")
    write_exposure_plan(served / "plan.json", replace(plate_exposure_plan(), sensor="another"))
    with pytest.raises(SensorError, match="the models are of sensor 'small'"):
        started(runs, models="models")


def test_links_that_lead_out_are_no_runs(runs, served, tmp_path):
    started(runs)
    await_state(lambda: runs.run("one").state)
    outside = shutil.copytree(served / "runs" / "one", tmp_path / "outside")
    (served / "runs" / "evil").symlink_to(outside)
    shutil.copytree(served / "runs" / "one", served / "runs" / "half")
    shutil.rmtree(served / "runs" / "half" / "campaign")
    (served / "runs" / "half" / "campaign").symlink_to(outside / "campaign")
    assert [each.name for each in runs.states()] == ["one"]
    for name in ("evil", "half"):
        for act in (runs.run, runs.proceed):
            with pytest.raises(MissingFileError, match="no run"):
                act(name)
    (served / "runs").rename(tmp_path / "moved")
    (served / "runs").symlink_to(tmp_path / "moved")
    assert runs.states() == []
    for act in (lambda: runs.run("one"), lambda: started(runs, "two")):
        with pytest.raises(MissingFileError):
            act()
    assert not (tmp_path / "moved" / "two").exists()


def test_what_a_run_says_has_no_path_of_the_machine(runs, served):
    started(runs)
    await_state(lambda: runs.run("one").state)
    folder = runs.run("one")
    folder.write_state(replace(folder.written_state, state="stopped"))
    (served / "recorded" / "campaign.json").write_text("{")
    runs.proceed("one")
    state = await_state(lambda: runs.run("one").state)
    assert state.state == "failed"
    assert "recorded/campaign.json" in state.error
    assert str(served) not in state.error
    assert str(served) not in folder.events.read_text()


def test_no_more_runs_measure_than_may(runs, served, sheet_run):
    """Whichever server processes are asked, and whether runs start or go on."""
    began = now()
    waiting = []
    for n in range(3):
        folder = RunFolder(served / "runs" / f"held{n}")
        folder.path.mkdir(parents=True)
        request = RunRequest(**request_of(folder.name))
        folder.write(request, first_state(folder.name, request, time=began))
        waiting.append(folder.take_lock())
    folder = RunFolder(served / "runs" / "later")
    folder.path.mkdir()
    request = RunRequest(**request_of("later"))
    folder.write(request, first_state("later", request, state="stopped", time=began))
    servers = [Runs(ServedFolder(served)) for _ in range(4)]
    answers, barrier = [], threading.Barrier(len(servers))

    def start(number, server):
        barrier.wait()
        try:
            answers.append(server.start(RunRequest(**{**sheet_run, "name": f"s{number}"})).name)
        except RequestError as error:
            answers.append(error.status)

    threads = [threading.Thread(target=start, args=each) for each in enumerate(servers)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert [each for each in answers if each == 429] == [429] * 3
    with pytest.raises(RequestError, match="no more may") as refused:
        runs.proceed("later")
    assert refused.value.status == 429
    for each in waiting:
        os.close(each)
    assert runs.proceed("later").lives
    await_state(lambda: runs.run("later").state)
    for each in servers:
        each.close()


def test_on_a_read_only_disk_runs_can_be_looked_at(runs, served, monkeypatch):
    folder = RunFolder(served / "runs" / "one")
    folder.path.mkdir(parents=True)
    request = RunRequest(**request_of())
    folder.write(request, first_state("one", request, time=now()))
    opening = os.open

    def read_only(path, flags, *args, **options):
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            raise OSError(30, "Read-only file system")
        return opening(path, flags, *args, **options)

    monkeypatch.setattr("os.open", read_only)
    assert runs.run("one").state.state == "interrupted"  # there is no lock's file
    monkeypatch.undo()
    os.close(folder.take_lock())
    monkeypatch.setattr("os.open", read_only)
    assert runs.run("one").state.state == "interrupted"


def test_a_run_with_a_damaged_state_has_failed(runs, served):
    started(runs)
    await_state(lambda: runs.run("one").state)
    (served / "runs" / "one" / "state.json").write_text("{")
    (state,) = runs.states()
    assert (state.name, state.state, state.plan) == ("one", "failed", "plan.json")
    assert state.error.startswith("state.json")
    with pytest.raises(FileError, match=r"state\.json"):
        runs.proceed("one")


def test_names_of_runs_are_plain(runs):
    for name in ("..", "a/b", "", "x" * 65, "ä", ".hidden", "a\n"):
        with pytest.raises(ValueError, match="name"):
            started(runs, name)
        with pytest.raises(MissingFileError):
            runs.run(name)


def test_a_driver_that_cannot_fails_the_run_and_keeps_captures(runs, served):
    shutil.rmtree(served / "recorded" / "captures" / "000001")
    started(runs)
    state = await_state(lambda: runs.run("one").state)
    assert (state.state, state.n_captures) == ("failed", 1)
    assert "replay the exposure times" in state.error
    shutil.rmtree(served / "recorded")
    shutil.copytree(served / "whole", served / "recorded")
    runs.proceed("one")
    state = await_state(lambda: runs.run("one").state)
    assert (state.state, state.error) == ("finished", "")


class FullDisk(PlateDriver):
    """The disk is full when the second capture is taken."""

    def capture(self, *args, **options):
        if len(self.taken) == 1:
            raise FileError("no space left")
        return super().capture(*args, **options)


def test_a_full_disk_fails_the_run_in_the_space_kept_for_that(runs, served, monkeypatch):
    started(runs)
    await_state(lambda: runs.run("one").state)
    folder = runs.run("one")
    shutil.rmtree(folder.campaign)
    folder.events.unlink()
    write, reserve = os.write, folder.path / "reserve"
    full = False

    def refuse(descriptor, data):
        if full and reserve.exists():
            write(descriptor, data[:5])
            raise OSError(28, "No space left on device")
        return write(descriptor, data)

    def measuring(plan, driver, *args, **options):
        nonlocal full
        full = True
        return measure_adaptively(plan, FullDisk(), *args, **options)

    monkeypatch.setattr("os.write", refuse)
    monkeypatch.setattr("exposight.service.run_process.measure_adaptively", measuring)
    RunProcess(folder, ServedFolder(served)).carry_out()
    state = runs.run("one").state
    assert state.state == "failed"
    assert "space" in state.error
    events, _ = events_after(folder.events, 0)
    assert [each.kind for each in events][-2:] == ["error", "state"]
    monkeypatch.undo()
    runs.proceed("one")
    assert await_state(lambda: runs.run("one").state).state == "finished"
    assert captured(folder.campaign) == captured(served / "expected")


def test_a_torn_last_event_is_cut_and_numbers_go_on(tmp_path):
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    for n in range(3):
        log.append("progress", f"{n}", {"done": n})
    whole = path.read_bytes()
    for cut in range(1, 30):
        path.write_bytes(whole[:-cut])
        events, end = events_after(path, 0)
        assert [each.seq for each in events] == [1, 2]
        reopened = EventLog(path)
        assert reopened.last_seq == 2
        assert reopened.append("progress", "again", {"x": float("nan")}).seq == 3
        later, _ = events_from(path, end)
        assert [(each.seq, each.data) for each in later] == [(3, {"x": None})]


def test_a_few_events_are_read_without_all_of_them(tmp_path):
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    for n in range(3000):
        log.append("progress", "x" * (n % 700), {"done": n})
    for after in (0, 1, 1499, 2990, 2999, 3000, 4000):
        events, end = events_after(path, after)
        assert [each.seq for each in events] == list(range(after + 1, 3001))
        assert end == path.stat().st_size
    began = time.perf_counter()
    for _ in range(20):
        events_after(path, 2999)
    assert (time.perf_counter() - began) / 20 < 0.01


def test_what_another_plan_captured_is_not_continued(runs, served):
    started(runs)
    await_state(lambda: runs.run("one").state)
    folder = runs.run("one")
    folder.write_state(replace(folder.written_state, state="stopped"))
    plan = plate_exposure_plan()
    write_exposure_plan(served / "plan.json", replace(plan, target_p_norm=0.8))
    runs.proceed("one")
    state = await_state(lambda: runs.run("one").state, ENDED)
    assert state.state == "failed"
    assert "another" in state.error


def test_measure_and_a_run_may_not_write_the_same_campaign(runs, served, sheet_run):
    """A run's campaign is locked as any other."""
    runs.start(RunRequest(**sheet_run))
    await_state(lambda: runs.run("sheet").state, {"running"})
    deadline = time.monotonic() + 30
    while not (served / "runs/sheet/campaign/campaign.json").exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    from exposight.twin import SimulatedCell

    plan = read_plan(served / "sheet.toml")
    with pytest.raises(FileError, match="another writer"):
        measure(plan, SimulatedCell.for_plan(plan, folder=served), served / "runs/sheet/campaign")
    runs.order("sheet", "stop")
