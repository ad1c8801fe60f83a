"""The closed loop on tables whose every outcome is known."""

from collections.abc import Callable

import numpy as np
import polars as pl
import pytest
from tests.models.rings import SENSOR, observed

from exposight.errors import InputError, ObservationError
from exposight.models import train_window
from exposight.observing import ObservationTable
from exposight.planning import CaptureCosts, ExposureLimits, SensorModels, train
from exposight.planning.closed_loop import ClosedLoop
from exposight.planning.lookahead import captures_left, cost_left

TIMES_MS = tuple(float(t) for t in np.unique(np.geomspace(2.0, 700.0, 40).round()))
LIMITS = ExposureLimits(
    name="grid", min_ms=2.0, max_ms=700.0, increment_ms=1.0, allowed_ms=TIMES_MS
)
NEED = 0.75


@pytest.fixture(scope="module")
def models() -> SensorModels:
    return SensorModels(quality=train_window(observed(views=12, features=8), sensor=SENSOR))


def cell(**changes: object) -> ObservationTable:
    """Return new views of a cell at all exposure times."""
    return observed(views=3, features=8, seed=5, exposures_ms=TIMES_MS, places="new{}", **changes)


def rings_of(table: ObservationTable) -> pl.DataFrame:
    return table.frame.unique(["feature", "view"], keep="first", maintain_order=True)


def measured(
    loop: ClosedLoop,
    table: ObservationTable,
    spoil: Callable[[pl.DataFrame], pl.DataFrame] = lambda frame: frame,
) -> list[tuple[str, float]]:
    """Carry a loop out, and return its captures."""
    captures = []
    while (request := loop.next()) is not None:
        assert len(captures) < 40
        captures.append((request.view, request.exposure_ms))
        rows = table.frame.filter(
            (pl.col("view") == request.view) & (pl.col("exposure_ms") == request.exposure_ms)
        )
        loop.took(ObservationTable.from_frame(spoil(rows)))
    return captures


def coverable(table: ObservationTable) -> set[str]:
    frame = table.frame.filter(pl.col("p_norm") >= NEED)
    return set(frame["feature"])


def test_every_feature_is_had_and_no_capture_is_taken_twice(models: SensorModels) -> None:
    table = cell()
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    captures = measured(loop, table)
    had = {each.feature for each in loop.outcomes if each.status == "had"}
    assert had == coverable(table)
    assert len({*captures}) == len(captures)
    assert all(
        each.p_norm >= NEED for each in loop.outcomes if each.p_norm and each.status == "had"
    )
    assert len(loop.log) == len(captures) == loop.n_captures


@pytest.mark.parametrize("light", [0.5, 2.0])
def test_a_lamp_of_another_power_is_learnt_from_the_first_capture(
    models: SensorModels, light: float
) -> None:
    table = cell(level=11.4 + np.log(light))
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    captures = measured(loop, table)
    reference = ClosedLoop(models, rings_of(cell()), LIMITS, need=NEED)
    assert len(captures) <= len(measured(reference, cell())) + 1
    assert {each.status for each in loop.outcomes} == {"had"}
    assert any(f"{light:g} times as bright" in line for line in loop.log)


def test_told_the_same_captures_it_says_the_same(models: SensorModels) -> None:
    """Resuming is telling the captures again."""
    table = cell(level=11.0)
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    captures = measured(loop, table)
    again = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    for view, exposure_ms in captures:
        request = again.next()
        assert request is not None
        assert (request.view, request.exposure_ms) == (view, exposure_ms)
        rows = (pl.col("view") == view) & (pl.col("exposure_ms") == exposure_ms)
        again.took(ObservationTable.from_frame(table.frame.filter(rows)))
    assert again.next() is None
    assert again.log == loop.log
    assert again.report.frame.equals(loop.report.frame)


def test_a_feature_that_never_gives_points_is_given_up_with_what_was_seen(
    models: SensorModels,
) -> None:
    table = cell()

    def hidden(rows: pl.DataFrame) -> pl.DataFrame:
        nothing = pl.when(pl.col("feature") == "f3").then(0.1).otherwise(pl.col("p_norm"))
        return rows.with_columns(nothing.alias("p_norm"))

    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    captures = measured(loop, table, hidden)
    (lost,) = (each for each in loop.outcomes if each.status != "had")
    assert lost.feature == "f3"
    assert lost.status == "given up"
    assert lost.p_norm == pytest.approx(0.1)
    assert "neither dark nor clipped" in lost.reason
    assert len(captures) <= 3 * 5 + 8  # tries are limited in each of three views


def test_a_plan_says_in_which_view_a_feature_is_had(models: SensorModels) -> None:
    table = cell()
    loop = ClosedLoop(
        models, rings_of(table), LIMITS, need=NEED, views_of=dict.fromkeys(["f0", "f1"], "new2")
    )
    measured(loop, table)
    assert all(each.status == "had" for each in loop.outcomes)
    with pytest.raises(InputError, match="does not see it"):
        ClosedLoop(models, rings_of(table), LIMITS, need=NEED, views_of={"f0": "nowhere"})


def test_models_without_windows_are_carried_out_too() -> None:
    table = observed(views=12, features=8)
    chain = train(table, models=("q_k4", "e_k6"), sensor=SENSOR, restarts=1)
    new = cell()
    loop = ClosedLoop(chain, rings_of(new), LIMITS, need=NEED)
    measured(loop, new)
    had = sum(each.status == "had" for each in loop.outcomes)
    assert had >= 6


def test_captures_of_no_view_and_of_several_are_refused(models: SensorModels) -> None:
    table = cell()
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    with pytest.raises(ObservationError, match="one capture"):
        loop.took(table)
    other = table.frame.filter(pl.col("view") == "new0").with_columns(view=pl.lit("elsewhere"))
    other = other.filter(pl.col("exposure_ms") == TIMES_MS[0])
    with pytest.raises(ObservationError, match="which the plan does not have"):
        loop.took(ObservationTable.from_frame(other))
    with pytest.raises(InputError, match="no view sees a feature"):
        ClosedLoop(models, rings_of(table).clear(), LIMITS, need=NEED)


def test_the_sweep_from_the_left_adds_up_the_captures_left() -> None:
    served = np.zeros((1, 3, 6), dtype=np.bool_)
    served[0, 0, 0:2] = served[0, 1, 1:4] = served[0, 2, 4:6] = True
    assert captures_left(served).tolist() == [2.0, 1.0, 2.0, 2.0, 1.0, 1.0]
    times = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    # the first two features share setting 1, the third is served from setting 4 on
    assert cost_left(served, times).tolist() == [2.0 + 5.0, 5.0, 1.0 + 5.0, 1.0 + 5.0, 2.0, 2.0]


def test_least_time_takes_shorter_captures(models: SensorModels) -> None:
    table = cell()
    costs = CaptureCosts(frames=12, overhead_ms=10.0)
    spent = {}
    for goal in ("count", "time"):
        loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED, costs=costs, goal=goal)
        captures = measured(loop, table)
        assert {each.status for each in loop.outcomes} == {"had"}
        spent[goal] = sum(costs.capture_ms(exposure_ms) for _, exposure_ms in captures)
    assert spent["time"] < spent["count"]


def test_features_that_captures_do_not_show_are_given_up(models: SensorModels) -> None:
    table = cell()

    def shifted(rows: pl.DataFrame) -> pl.DataFrame:
        lost = pl.col("feature") == "f3"
        return rows.with_columns(
            p_norm=pl.when(lost).then(None).otherwise("p_norm"),
            i_avg=pl.when(lost).then(None).otherwise("i_avg"),
            i_mean=pl.when(lost).then(None).otherwise("i_mean"),
            visibility=pl.when(lost).then(pl.lit("partly out of frame")).otherwise("visibility"),
        )

    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    captures = measured(loop, table, shifted)
    (lost,) = (each for each in loop.outcomes if each.status != "had")
    assert lost.feature == "f3"
    assert "partly out of frame" in lost.reason
    assert len(captures) <= 12


def test_a_sensor_that_takes_one_exposure_time_whatever_is_asked_ends(models: SensorModels) -> None:
    table = cell()
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    asked = []
    while (request := loop.next()) is not None:
        assert len(asked) < 60
        asked.append((request.view, request.exposure_ms))
        rows = (pl.col("view") == request.view) & (pl.col("exposure_ms") == TIMES_MS[-1])
        loop.took(ObservationTable.from_frame(table.frame.filter(rows)))
    assert len({*asked}) == len(asked)
    lost = [each.reason for each in loop.outcomes if each.status == "given up"]
    assert lost
    assert all("clips at 700 ms" in reason for reason in lost), lost


def test_a_lamp_that_clips_everything_is_noticed(models: SensorModels) -> None:
    table = cell(level=11.4 + np.log(40.0))
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    measured(loop, table)
    first = loop.log[0]
    assert "times as bright as forecast" in first
    good = coverable(table)
    assert {each.feature for each in loop.outcomes if each.status == "had"} == good


def test_p_norm_in_percent_is_refused(models: SensorModels) -> None:
    table = cell()
    loop = ClosedLoop(models, rings_of(table), LIMITS, need=NEED)
    one = table.frame.filter((pl.col("view") == "new0") & (pl.col("exposure_ms") == TIMES_MS[20]))
    with pytest.raises(ObservationError, match="in percent"):
        loop.took(ObservationTable.from_frame(one.with_columns(p_norm=pl.col("p_norm") * 7.5)))
