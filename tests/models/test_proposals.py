"""Which capture to take next: what it would leave uncertain, one after the other."""

from itertools import product

import numpy as np
import polars as pl
import pytest
from tests.models.rings import SENSOR, observed

from exposight.errors import InputError, ObservationError
from exposight.models import (
    CaptureProposer,
    WindowModel,
    propose_captures,
    train_response,
    train_window,
)
from exposight.models.ring_data import FEW_CLIPPED
from exposight.observing import ObservationTable

TIMES = (2.0, 20.0, 60.0, 400.0)


@pytest.fixture(scope="module")
def model() -> WindowModel:
    """Learnt from few views, so that much is left to learn."""
    return train_window(observed(views=4), sensor=SENSOR)


@pytest.fixture(scope="module")
def further() -> ObservationTable:
    """Captures of four other views of the same sheet."""
    return observed(views=4, seed=3, places="new-{}", exposures_ms=TIMES)


def rings_of(table: ObservationTable) -> pl.DataFrame:
    return table.frame.unique(["feature", "view"], maintain_order=True)


def test_the_capture_that_tells_most_is_of_the_view_known_least(model: WindowModel) -> None:
    known = rings_of(observed(views=2))
    odd = rings_of(observed(views=1, seed=3, places="odd-{}")).with_columns(pl.col("p_deg") + 12.0)
    ranking = propose_captures(model, pl.concat([known, odd]), TIMES, targets=odd)
    best = ranking.row(0, named=True)
    assert best["view"] == "odd-0"
    assert best["error_after"] < 0.8 * best["error_before"]
    assert (ranking["error_after"] <= ranking["error_before"]).all()
    assert ranking["error_after"].is_sorted()


def test_what_is_known_before_is_what_forecasts_say(
    model: WindowModel, further: ObservationTable
) -> None:
    rings = rings_of(further)
    proposer = CaptureProposer.of(model, rings, TIMES)
    forecast = model.forecast(rings, TIMES)
    np.testing.assert_allclose(proposer.target_std, forecast.std, rtol=1e-9)
    assert proposer.error == pytest.approx(np.sqrt(np.mean(forecast.std**2)))


def test_a_capture_leaves_what_learning_from_it_leaves(
    model: WindowModel, further: ObservationTable
) -> None:
    rings = rings_of(further)
    proposer = CaptureProposer.of(model, rings, TIMES)
    taken = (further.frame["view"] == "new-1") & (further.frame["exposure_ms"] == 20.0)
    wiser = model.with_observations(further.where(taken))
    after = proposer.after("new-1", TIMES.index(20.0))
    assert after.error < 0.95 * proposer.error
    # bands are narrower besides, with more views
    learnt = CaptureProposer.of(wiser, rings, TIMES)
    assert (learnt.widening < after.widening).all()
    np.testing.assert_allclose(
        after.target_std / after.widening, learnt.target_std / learnt.widening, rtol=0.003
    )


def test_the_exposure_time_is_one_at_which_rings_neither_clip_nor_stay_dark(
    model: WindowModel, further: ObservationTable
) -> None:
    times = np.geomspace(0.2, 2000.0, 30)
    ranking = propose_captures(model, rings_of(further), times)
    for view, exposure_ms, n_rings in ranking.select("view", "exposure_ms", "rings").iter_rows():
        taken = observed(views=4, seed=3, places="new-{}", exposures_ms=(exposure_ms,))
        frame = taken.frame.filter(pl.col("view") == view)
        good = (frame["stack_clipped_share"] <= FEW_CLIPPED) & (frame["i_mean"] > 20.0)
        assert good.sum() == pytest.approx(n_rings, abs=0.6)
        assert good.sum() >= 6  # of 8
    # at other times nothing is measured, and nothing learnt
    useless = propose_captures(model, rings_of(further), (0.001, 1e5))
    assert useless["rings"].max() < 0.01
    np.testing.assert_allclose(useless["error_after"], useless["error_before"], rtol=1e-3)


def errors_of_captures(proposer: CaptureProposer, captures: list[tuple[str, int]]) -> float:
    """Condition on all captures at once, by the formula for jointly normal values."""
    rings = np.concatenate([proposer.views[view] for view, _ in captures])
    share, noise = (
        np.concatenate([values[proposer.views[view], time] for view, time in captures])
        for values in (np.maximum(proposer.usable, 1e-3), proposer.noise)
    )
    k, goal = proposer.covariance, proposer.targets
    within = k[np.ix_(rings, rings)]
    alone = (np.diagonal(k)[rings] + proposer.scatter + noise) / share - np.diagonal(k)[rings]
    across = k[np.ix_(goal, rings)]
    left = k[np.ix_(goal, goal)] - across @ np.linalg.inv(within + np.diag(alone)) @ across.T
    variance = proposer.widening[goal] ** 2 * (np.diagonal(left) + proposer.scatter)
    return float(np.sqrt(np.mean(variance)))


@pytest.mark.parametrize("again", [False, True])
def test_a_sequence_is_the_greedy_one_of_all(
    model: WindowModel, further: ObservationTable, again: bool
) -> None:
    proposer = CaptureProposer.of(model, rings_of(further), TIMES)
    sequence = proposer.sequence(3, again=again)
    taken: list[tuple[str, int]] = []
    before = proposer.error
    for row in sequence.iter_rows(named=True):
        left = [name for name in proposer.views if again or name not in dict(taken)]
        errors = {
            capture: errors_of_captures(proposer, [*taken, capture])
            for capture in product(left, range(len(TIMES)))
        }
        best = min(errors, key=lambda each: errors[each])
        assert (row["view"], row["exposure_ms"]) == (best[0], TIMES[best[1]])
        assert row["error_before"] == pytest.approx(before)
        assert row["error_after"] == pytest.approx(errors[best])
        before = errors[best]
        taken.append(best)
    assert propose_captures(model, rings_of(further), TIMES)[0].equals(sequence[0])


def test_a_sequence_ends_where_views_run_out(model: WindowModel, further: ObservationTable) -> None:
    proposer = CaptureProposer.of(model, rings_of(further), TIMES)
    assert sorted(proposer.sequence(9)["view"]) == [f"new-{i}" for i in range(4)]
    assert proposer.sequence(9, again=True).height == 9


def test_models_of_other_qualities_propose_too(
    model: WindowModel, further: ObservationTable
) -> None:
    table = observed(views=4)
    other = ObservationTable.from_frame(table.frame.with_columns(noise_mm=1.0 / pl.col("i_mean")))
    response = train_response(other, "noise_mm", model=model, better="lower")
    ranking = propose_captures(response, rings_of(further), TIMES)
    assert set(ranking["exposure_ms"]) <= {20.0, 60.0}


def test_what_cannot_be_proposed_is_said(model: WindowModel, further: ObservationTable) -> None:
    rings = rings_of(further)
    with pytest.raises(InputError, match="at least one view"):
        propose_captures(model, rings[:0], TIMES)
    with pytest.raises(InputError, match="exposure times above 0"):
        propose_captures(model, rings, (0.0, 5.0))
    with pytest.raises(ObservationError, match="another"):
        propose_captures(model, rings.with_columns(sensor=pl.lit("another")), TIMES)
    many = pl.concat([rings.with_columns(view=pl.lit(f"w{i}")) for i in range(130)])
    with pytest.raises(InputError, match="4 160 rings are too many"):
        propose_captures(model, many, TIMES)


@pytest.mark.parametrize("column", ["sensor", "finish"])
def test_captures_of_something_else_are_not_learnt_from(
    model: WindowModel, further: ObservationTable, column: str
) -> None:
    other = ObservationTable.from_frame(further.frame.with_columns(pl.lit("other").alias(column)))
    with pytest.raises(ObservationError, match="'other'"):
        model.with_observations(other)
