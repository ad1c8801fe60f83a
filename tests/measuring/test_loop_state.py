"""The loop one step at a time: what is fed, known again, kept, and refused."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import polars as pl
import pytest

from exposight.errors import (
    DamagedFileError,
    FileError,
    FormatError,
    InputError,
    MissingFileError,
    SensorError,
    VersionError,
)
from exposight.measuring import LoopState, LoopStep, loop_state, loop_step, measure_adaptively
from exposight.measuring.open_loop import OpenLoop
from exposight.observing import ObservationTable, read_observations


class Models:
    """Stands for two models in files."""

    checksums: ClassVar = {"quality": "0" * 64}

    @classmethod
    def load(cls, *paths):
        for path in paths:
            if not Path(path).is_file():
                raise MissingFileError(f"{path}: no such model file")
        return cls()


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch):
    """Decide as the plan says, so that every answer is known."""
    monkeypatch.setattr(loop_state, "planned_loop", lambda plan, *_: OpenLoop(plan))
    monkeypatch.setattr(loop_state, "SensorModels", Models)


@pytest.fixture
def captured(plate_plan, plate_driver, tmp_path):
    """The plan's campaign, as a robot's program fills it."""
    return measure_adaptively(plate_plan, plate_driver(), tmp_path / "door", models=None).campaign


@pytest.fixture
def state(tmp_path, plate_plan, plate_driver):
    """A loop that has begun."""
    path, model, driver = tmp_path / "loop.json", tmp_path / "quality", plate_driver()
    model.touch()
    began = LoopState.begin(plate_plan, [model], part=driver.part, sensor=driver.sensor)
    LoopStep(path, began).save()
    return path


def step(path, *fed):
    """One call: what is asked for after feeding, as view and exposure time."""
    with loop_step(path) as open_step:
        for each in fed:
            open_step.feed(each)
        request = open_step.request()
        open_step.save()
    return None if request is None else (request.view, request.exposure_ms)


def capture(campaign, number):
    return campaign.path / "captures" / f"{number:06d}"


def test_each_capture_brings_the_next_request(state, captured):
    assert step(state) == ("near", 1.0)
    assert step(state) == ("near", 1.0)
    assert step(state, capture(captured, 0)) == ("near", 10.0)
    assert step(state, capture(captured, 1)) == ("far", 12.0)
    assert step(state, capture(captured, 2)) is None
    with loop_step(state) as done:
        assert done.verdict.startswith("3 captures: 4 of 4 features succeeded, 3.9 were promised")
        assert [each.exposure_ms for each in done.decisions] == [1.0, 10.0, 12.0]


def test_captures_fed_again_are_known(state, captured):
    step(state, capture(captured, 0))
    assert step(state, capture(captured, 0), captured.path) is None
    with loop_step(state) as done:
        assert len(done.decisions) == 3
        done.feed(captured.path)
        assert "known already: view near at 10 ms" in done.known
    before = state.read_bytes()
    step(state, captured.path, captured.path / "observations.csv")
    assert state.read_bytes() == before


def decided(state):
    with loop_step(state) as open_step:
        return [each.exposure_ms for each in open_step.decisions]


def test_a_capture_that_shows_the_same_is_fed_when_it_comes_in_the_next_call_too(state, captured):
    """As of a sensor that clamps: a program that only feeds and asks is led to an end."""
    first = capture(captured, 0)
    assert step(state, first) == ("near", 10.0)
    assert step(state, first) == ("near", 10.0)  # as after an interrupted call
    assert decided(state) == [1.0]
    assert step(state, first, first) == ("far", 12.0)
    assert decided(state) == [1.0, 1.0]
    assert step(state, first) == ("far", 12.0)
    assert step(state, first) == ("far", 12.0)  # of another view than the one asked for
    assert decided(state) == [1.0, 1.0]


def test_a_failed_capture_can_be_repeated(state, captured, tmp_path):
    rows = read_observations(captured.path / "observations.csv").frame
    rows = rows.filter(pl.col("exposure_ms") == 1.0).with_columns(p_norm=pl.lit(0.0))
    for name, i_avg in (("dark", 0.0), ("less dark", 1.0), ("dark", 0.0)):
        frame = rows.with_columns(i_avg=pl.lit(i_avg))
        ObservationTable.from_frame(frame).write(tmp_path / f"{name}.csv")
    step(state, tmp_path / "dark.csv")
    step(state, tmp_path / "less dark.csv", tmp_path / "dark.csv")
    assert decided(state) == [1.0, 1.0]
    step(state, capture(captured, 0))
    with loop_step(state) as open_step:
        assert open_step.decisions[-1].succeeded == ("b1", "b2")


def test_rows_that_are_there_twice_are_taken_once(state, captured, tmp_path):
    rows = read_observations(captured.path / "observations.csv").frame
    ObservationTable.from_frame(pl.concat([rows, rows])).write(tmp_path / "twice.csv")
    step(state, captured.path / "observations.csv")
    before = state.read_bytes()
    step(state, tmp_path / "twice.csv")
    assert state.read_bytes() == before
    other = pl.concat([rows, rows.with_columns(p_norm=pl.lit(0.5))])
    other.write_csv(tmp_path / "two.csv")
    with pytest.raises(InputError, match="'b1' is there more than once in view 'near' at 1 ms"):
        step(state, tmp_path / "two.csv")


def test_an_exposure_time_that_was_not_asked_for_is_remarked_upon(state, captured, tmp_path):
    rows = read_observations(captured.path / "observations.csv").frame
    near = rows.filter((pl.col("view") == "near") & (pl.col("exposure_ms") == 1.0))
    for ms in (1.5, 45.0):
        frame = near.with_columns(exposure_ms=pl.lit(ms))
        ObservationTable.from_frame(frame).write(tmp_path / f"{ms}.csv")
    step(state, tmp_path / "1.5.csv")  # within the increment
    step(state, tmp_path / "45.0.csv")
    with loop_step(state) as open_step:
        one, other = (each.remark for each in open_step.decisions)
    assert one == ""
    assert "took 45 ms where 10 ms was asked for" in other


def test_a_table_is_fed_like_its_captures(state, captured, tmp_path, plate_plan):
    table = captured.path / "observations.csv"
    read_observations(table).write(tmp_path / "observations.parquet")
    assert step(state, table) is None
    with loop_step(state) as done:
        by_table = done.decisions
    state.write_bytes(_begun(state))
    step(state, tmp_path / "observations.parquet")
    with loop_step(state) as done:
        assert done.decisions == by_table
    state.write_bytes(_begun(state))
    step(state, captured.path)
    with loop_step(state) as done:
        assert done.decisions == by_table


def _begun(state):
    """The state's bytes before any capture."""
    format_ = loop_state._FORMAT
    return format_.seal(replace(format_.unseal(state.read_bytes(), ""), captures=()))


def test_a_capture_that_was_not_asked_for_counts_too(state, captured):
    assert step(state, capture(captured, 2)) == ("near", 1.0)
    with loop_step(state) as open_step:
        (decision,) = open_step.decisions
    assert decision.asked_ms is None
    assert decision.why == "far, 12 ms: not asked for, near, 1 ms was"


def test_captures_of_other_views_features_and_sensors_are_refused(
    state, captured, tmp_path, plate_plan, plate_driver
):
    rows = read_observations(captured.path / "observations.csv").frame
    for change, message in (
        ({"view": "neer"}, "no view 'neer'; did you mean 'near'"),
        ({"feature": "x"}, "no row of the plan's features, which are b1, b2, d1, d2"),
    ):
        changed = rows.head(1).with_columns(**{k: pl.lit(v) for k, v in change.items()})
        ObservationTable.from_frame(changed).write(tmp_path / "other.csv")
        with pytest.raises(InputError, match=message):
            step(state, tmp_path / "other.csv")
    other = replace(plate_plan, sensor="large")
    large = measure_adaptively(other, plate_driver(name="large"), tmp_path / "large", models=None)
    with pytest.raises(SensorError, match="is of sensor 'large', the loop is of 'small'"):
        step(state, large.campaign.path)
    with pytest.raises(MissingFileError, match="no capture"):
        step(state, tmp_path)
    assert step(state) == ("near", 1.0)


def test_two_calls_at_once_are_kept_apart(state):
    with loop_step(state), pytest.raises(FileError, match=r"another writer has .*loop\.json"):
        step(state)
    assert step(state) == ("near", 1.0)


def test_a_damaged_or_newer_state_is_named(state):
    content = state.read_bytes()
    state.write_bytes(content.replace(b"near", b"mean", 1))
    with pytest.raises(DamagedFileError, match=r"loop\.json is damaged"):
        step(state)
    state.write_bytes(content[: len(content) // 2])
    with pytest.raises(DamagedFileError, match="cut off"):
        step(state)
    document = json.loads(content)
    state.write_text(json.dumps({**document, "version": 99}), "utf-8")
    with pytest.raises(VersionError, match="update exposight"):
        step(state)
    state.write_text(json.dumps({**document, "format": "exposight plan"}), "utf-8")
    with pytest.raises(FormatError, match="exposight loop state"):
        step(state)


def test_other_models_are_noticed(state, monkeypatch):
    monkeypatch.setattr(Models, "checksums", {"quality": "1" * 64})
    with pytest.raises(FileError, match="began with other models than those that now lie at"):
        step(state)
    (state.parent / "quality").unlink()
    with pytest.raises(MissingFileError, match="quality"):
        step(state)


def test_a_plan_for_another_sensor_is_refused(plate_plan, plate_driver):
    driver = plate_driver(name="large")
    with pytest.raises(SensorError, match="the plan is for sensor 'small', got 'large'"):
        LoopState.begin(plate_plan, [], part=driver.part, sensor=driver.sensor)


def test_a_call_that_cannot_write_leaves_the_old_state(state, captured, monkeypatch):
    before = state.read_bytes()

    def no_space(_descriptor):
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", no_space)
        with pytest.raises(FileError, match="the disk is full"):
            step(state, captured.path)
    assert state.read_bytes() == before
    assert step(state, captured.path) is None
