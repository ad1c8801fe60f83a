"""What merging exposures promises, and what it gained."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from tests.models.rings import SENSOR, observed

from exposight.errors import InputError, ObservationError
from exposight.models import RingForecast, train_window
from exposight.observing import ObservationTable
from exposight.planning.merged_quality import MergeGain, merged_chance, merged_p_norm


@pytest.fixture(scope="module")
def rings() -> RingForecast:
    table = observed()
    frame = observed(views=3, seed=4, places="new-{}").frame.unique(["feature", "view"])
    model = train_window(table, sensor=SENSOR)
    return model.forecast(frame.sort("view", "feature"), (10.0,))


TIMES_MS = (2.0, 8.0, 25.0, 60.0, 150.0, 400.0)


@pytest.mark.parametrize("time_ms", TIMES_MS)
def test_one_exposure_merged_is_that_exposure(rings: RingForecast, time_ms: float) -> None:
    single = rings.at([time_ms])
    assert merged_p_norm(rings, [time_ms]) == pytest.approx(single.p_norm[:, 0], abs=0.01)
    assert merged_chance(rings, [time_ms]) == pytest.approx(single.chance[:, 0], abs=0.15)


def test_more_exposures_never_promise_less_and_their_order_does_not_matter(rings) -> None:
    before = np.zeros(len(rings.mean))
    for count in range(1, len(TIMES_MS) + 1):
        promised = merged_p_norm(rings, TIMES_MS[:count])
        assert (promised >= before - 1e-9).all()
        assert (promised >= merged_p_norm(rings, TIMES_MS[count - 1 : count]) - 1e-9).all()
        before = promised
    assert merged_p_norm(rings, TIMES_MS[::-1]) == pytest.approx(before)
    assert merged_p_norm(rings, TIMES_MS * 2) == pytest.approx(before)


def test_a_promise_is_what_pixels_drawn_one_by_one_give(rings: RingForecast) -> None:
    rng, draws = np.random.default_rng(1), 4000
    points, window = rings.points, rings.window
    n, k = points.high.shape
    # One number moves both edges of a pixel, as a pixel's grain does.
    shape = (draws, n, k)
    x = rings.mean[:, None] + rings.std[:, None] * rng.standard_normal((draws, n, 1))
    low = (
        window.log_low - points.low + points.shift_low[:, None] * rng.standard_normal((draws, n, 1))
    )
    high = window.log_high - points.high
    high = high + points.shift_high[:, None] * rng.standard_normal((draws, n, 1))
    grain = rng.standard_normal(shape)
    had = np.zeros(shape, dtype=bool)
    times = (4.0, 160.0)
    for time_ms in times:
        at = x + np.log(time_ms)
        had |= (at >= low + points.width_low[:, None] * grain) & (
            at <= high + points.width_high[:, None] * grain
        )
    drawn = (had * points.weight).sum(axis=-1).mean(axis=0) * points.best
    assert merged_p_norm(rings, times) == pytest.approx(drawn, abs=0.02)


def test_exposures_far_apart_add_up_and_equal_ones_add_nothing(rings: RingForecast) -> None:
    sure = replace(rings, covariance=1e-8 * np.eye(len(rings.mean)))
    apart = merged_p_norm(sure, [0.5, 2000.0])
    assert apart == pytest.approx(
        sum(merged_p_norm(sure, [time_ms]) for time_ms in (0.5, 2000.0)), abs=1e-6
    )
    assert merged_p_norm(sure, [40.0, 40.0]) == pytest.approx(merged_p_norm(sure, [40.0]))


@pytest.mark.parametrize("times", [[], [0.0], [np.nan], [5.0, -1.0]])
def test_times_that_are_none(rings: RingForecast, times: list[float]) -> None:
    with pytest.raises(InputError, match="above 0 ms"):
        merged_p_norm(rings, times)


def _rows(p_norm: dict[tuple[str, float], float]) -> ObservationTable:
    frame = observed(views=1, features=2, exposures_ms=(5.0, 50.0)).frame
    values = [p_norm[f, t] for f, t in frame.select("feature", "exposure_ms").iter_rows()]
    return ObservationTable(frame=frame.with_columns(p_norm=pl.Series(values)))


SINGLE = {("f0", 5.0): 0.5, ("f0", 50.0): 0.6, ("f1", 5.0): 0.97, ("f1", 50.0): 0.2}


def _merged(f0: float, f1: float) -> ObservationTable:
    table = _rows({("f0", 5.0): 0.0, ("f0", 50.0): f0, ("f1", 5.0): 0.0, ("f1", 50.0): f1})
    return table.where(table.frame["exposure_ms"] == 50.0)


def test_the_gain_is_against_the_best_single_capture_of_each_feature() -> None:
    promised = pl.DataFrame({"feature": ["f0"], "view": ["v0"], "promised": [0.95]})
    gain = MergeGain.of(_rows(SINGLE), _merged(0.92, 0.97), promised)
    assert gain.frame["best_ms"].to_list() == [50.0, 5.0]
    assert gain.frame["gain"].to_list() == pytest.approx([0.32, 0.0])
    assert gain.reached(0.75) == {"single": 1, "merged": 2, "promised": 1}
    assert "1 more of 2 features" in gain.verdict
    assert gain.table.frame["target"].to_list() == [0.75, 0.9, 0.95, 0.98]


def test_where_nothing_is_gained_it_says_so() -> None:
    gain = MergeGain.of(_rows(SINGLE), _merged(0.7, 0.97))
    assert gain.verdict.startswith("merging gains nothing")
    assert "promised" not in gain.table.frame.columns


def test_nothing_to_compare() -> None:
    empty = _merged(0.9, 0.9)
    empty = empty.where(empty.frame["exposure_ms"] < 0)
    with pytest.raises(ObservationError, match="nothing to compare"):
        MergeGain.of(_rows(SINGLE), empty)
